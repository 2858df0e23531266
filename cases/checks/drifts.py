"""Stretches over which heading or position drift away from the integrated turn rate or velocities.

The mismatch is summed up along the record. Over a sound time of any length it changes by little; what is little is
taken from the same record over a few seconds, and grows with the time as noise and small errors of scale do. The
stretch is where it changes most for its length (the scan statistic of a change of mean).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

SECONDS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 50.0, 60.0, 75.0, 95.0)
"""Lengths that are compared."""

SHORT = 5.0
"""Longer times are judged by what is usual over this, as a drift of a minute may be half of the record."""

GROWTH = {"psi": 0.5, "position": 0.8}
"""Power of the time by which the usual change grows beyond SHORT."""

LIMIT = {
    "psi": ((1.0, 28.0), (2.0, 22.0), (5.0, 18.0), (10.0, 18.0), (20.0, 18.0)),
    "position": ((1.0, 60.0), (2.0, 30.0), (5.0, 17.0), (10.0, 12.0), (20.0, 10.0)),
}
"""Time [s] and change over the usual one from which it is broken, between them by straight lines.

The sound parts of real records of a model reach 17, 14, 13 and 9 in heading over 2, 5, 10 and 20 s, and 25, 13, 8 and 5
in position, by the tails of satellite positions.
"""

DENSE = 0.35
"""Share of the changes by which the usual one is known: most of them may lie in a drift."""

AS_MEDIAN = (1.486, 1.268)
"""What makes that share the median of a normal law, of headings and of positions in the plane."""

LEAST_TURN = 0.1
"""rad; a heading that is off by less is not broken."""

LEAST_WAY = 0.1
"""A position that is off by less than this share of the way is not broken."""

CORE = 0.08
"""Share of the change that may lie outside the stretch at each end."""

MOST = 12
"""Stretches of one channel in a record; one with more has no sound part to compare with."""

MANY = 50000
"""Of more rows than this some are enough to know what is usual."""

Drift = tuple[int, int, complex]
"""First and last row, and the change."""


def drifts(
    t: np.ndarray, mismatch: np.ndarray, channel: str, way: float, known: Sequence[tuple[int, int]], rounded: float
) -> list[Drift]:
    """The stretches of a record in which its ``mismatch`` (N,) drifts by more than is usual, in order of time.

    t: (N,) [s]; channel: "psi" or "position"; way: root mean square speed [m/s] of the record; known: first and last
    rows of stretches that were found before, in which nothing is looked for; rounded: resolution of heading [rad] or
    position [m], by which they are off in any case.
    """
    steps = np.diff(mismatch)
    for first, last in known:
        steps[max(first - 1, 0) : last + 1] = 0.0
    usual = _usual(t, np.concatenate([[0.0], np.cumsum(steps)]), channel)
    found: list[Drift] = []
    while len(found) < MOST:
        total = np.concatenate([[0.0], np.cumsum(steps)])
        one = _largest(t, total, usual, channel, way, rounded)
        if one is None:
            break
        found.append(one)
        steps[one[0] : one[1]] = 0.0
    return sorted(found, key=lambda drift: drift[0])


def _usual(t: np.ndarray, total: np.ndarray, channel: str) -> dict[float, tuple[float, complex]]:
    """Time -> the usual change over it and its median, of those of SECONDS that fit into the record twice."""
    found: dict[float, tuple[float, complex]] = {}
    dt = float(np.median(np.diff(t)))
    for seconds in SECONDS:
        rows = round(seconds / dt)
        if rows < 2 or len(t) <= 2 * rows:
            continue
        change = (total[rows:] - total[:-rows])[:: max(1, len(total) // MANY)]
        plane = np.iscomplexobj(change)
        centre = complex(_dense(change.real), _dense(change.imag) if plane else 0.0)
        size = AS_MEDIAN[plane] * float(np.quantile(np.abs(change - centre), DENSE))
        if seconds > SHORT and SHORT in found:
            base, drift = found[SHORT]
            size, centre = min(size, base * (seconds / SHORT) ** GROWTH[channel]), drift * seconds / SHORT
        found[seconds] = (max(size, 1e-9), centre)
    return found


def _dense(values: np.ndarray) -> float:
    """Middle of the shortest interval that holds DENSE of the ``values`` (N,)."""
    ordered, count = np.sort(values), max(1, int(DENSE * len(values)))
    widths = ordered[count:] - ordered[:-count]
    at = int(np.argmin(widths)) if len(widths) else 0
    return float(0.5 * (ordered[at] + ordered[min(at + count, len(ordered) - 1)]))


def _largest(
    t: np.ndarray,
    total: np.ndarray,
    usual: dict[float, tuple[float, complex]],
    channel: str,
    way: float,
    rounded: float,
) -> Drift | None:
    """What drifts most for its length among what is beyond the limit; None where nothing is."""
    dt, best, most = float(np.median(np.diff(t))), None, 0.0
    times, limits = zip(*LIMIT[channel], strict=True)
    for seconds, (size, centre) in usual.items():
        rows = round(seconds / dt)
        change = np.abs(total[rows:] - total[:-rows] - centre)
        least = rounded + (LEAST_TURN if channel == "psi" else LEAST_WAY * way * seconds)
        at = int(np.argmax(change))
        value = float(change[at])
        if value > max(float(np.interp(seconds, times, limits)) * size, least) and value / np.sqrt(seconds) > most:
            best, most = (at, at + rows), value / np.sqrt(seconds)
    return _cut(total, *best) if best else None


def _cut(total: np.ndarray, first: int, last: int) -> Drift:
    """The part of the rows from ``first`` to ``last`` in which the sum changes, and the change."""
    change = complex(total[last] - total[first])
    if change == 0:
        return first, last, change
    share = ((total[first : last + 1] - total[first]) / change).real
    half = int(np.argmax(share >= 0.5))
    begin = np.flatnonzero(share[: half + 1] <= CORE)
    end = half + np.flatnonzero(share[half:] >= 1 - CORE)
    return first + int(begin[-1] if len(begin) else 0), first + int(end[0] if len(end) else last - first), change


def tightened(total: np.ndarray, first: int, last: int) -> tuple[int, int]:
    """The rows from ``first`` to ``last`` between which the sum ``total`` (N,) changes, without the sound ones around.

    A sum that comes back changes as long as it is away by a quarter of the farthest.
    """
    away = np.abs(total[first : last + 1] - total[first])
    farthest = float(away.max())
    if away[-1] >= 0.5 * farthest > 0:
        return _cut(total, first, last)[:2]
    far = first + np.flatnonzero(away > 0.25 * farthest)
    return (max(int(far[0]) - 1, first), min(int(far[-1]) + 1, last)) if len(far) else (first, last)


def there_and_back(found: Sequence[Drift], t: np.ndarray, longest: float) -> Iterator[tuple[int, int]]:
    """First and last row of each of the ``found`` drifts, together with the next one where that undoes it within
    ``longest`` [s] of the times t (N,)."""
    skip = False
    for i, (first, last, change) in enumerate(found):
        if skip:
            skip = False
            continue
        if i + 1 < len(found):
            begin, end, other = found[i + 1]
            size = max(abs(change), abs(other))
            if t[begin] - t[last] <= longest and abs(change + other) < 0.4 * size:
                skip = True
                yield first, end
                continue
        yield first, last
