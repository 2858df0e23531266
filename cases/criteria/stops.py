"""Crash stops in a measured run: revolutions that go astern from ahead and stay there until the way is off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WAY_OFF = 0.1
"""Share of the speed at the order at which a ship counts as stopped where her record ends."""


@dataclass(frozen=True)
class Stop:
    """order_time, end: s after the first sample; stopped: whether the way is off at the end."""

    order_time: float
    end: float
    stopped: bool


def find_stops(t: np.ndarray, n: np.ndarray, u: np.ndarray) -> list[Stop]:
    """Stops in a run of times ``t`` (N,) [s], revolutions ``n`` (N,) [1/s] and speed ahead ``u`` (N,) [m/s].

    Complete ones; without any, one that the record does not finish, if revolutions then stay astern to its end.
    """
    good = np.isfinite(n)
    t, n, u = t[good], n[good], u[good]
    ahead = float(np.percentile(n, 95)) if len(n) else 0.0
    if ahead <= 0:
        return []
    astern = (n < -0.05 * ahead).astype(int)
    edges = np.flatnonzero(np.diff(astern)) + 1
    firsts = [int(k) for k in edges if astern[k]]
    lasts = [next((int(e) for e in edges if e > k), len(t)) for k in firsts]
    found = [stop for a, b in zip(firsts, lasts, strict=True) if (stop := _stop(t, n, u, a, b)) is not None]
    complete = list({stop.order_time: stop for stop in reversed(found) if stop.stopped}.values())[::-1]
    open_ = [stop for stop in found if stop.end >= t[-1] - 1e-9]
    return complete or open_[-1:]


def _stop(t: np.ndarray, n: np.ndarray, u: np.ndarray, first: int, last: int) -> Stop | None:
    """The stop whose revolutions are astern in rows ``first`` to ``last``; None if they were not ahead before."""
    begin = first
    while begin > 0 and n[begin - 1] > n[begin] - 1e-12 and n[begin - 1] <= 0:
        begin -= 1
    before = np.flatnonzero(n[:begin] > 0)
    if len(before) == 0:
        return None
    stretch = np.arange(int(before[-1]), -1, -1)
    level = _level_before(n, stretch)
    steady = np.flatnonzero(n[:first] >= 0.97 * level)
    if len(steady) == 0:
        return None
    at = int(steady[-1])
    known = np.flatnonzero(np.isfinite(u[: at + 1]))
    speed = float(u[known[-1]]) if len(known) else float("nan")
    off = np.flatnonzero(u[at:] <= 0)
    rows = len(t) if last >= len(t) else last
    stopped = bool(speed > 0 and len(off) and at + off[0] <= min(rows + 2, len(t) - 1))
    return Stop(float(t[at]), float(t[min(rows, len(t)) - 1]), stopped)


def _level_before(n: np.ndarray, rows: np.ndarray) -> float:
    """The revolutions that were held ahead before they fell: the median of the faster ones of the last stretch ahead,
    whose ``rows`` run back in time."""
    ahead: list[float] = []
    for k in rows:
        if n[k] <= 0 and ahead:
            break
        ahead.append(float(n[k]))
    values = np.array(ahead)
    return float(np.median(values[values > 0.5 * values.max()]))
