"""Which positions of an NMEA log come from the same receiver: by talker, sentence and place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

M_PER_DEG = 111.2e3
"""Metres of a degree of latitude, within 0.6 %."""
NEAR = 3.0
"""Metres within which fixes of one receiver by different satellites agree (horizontal error of GNSS, GPS SPS 2020)."""
STEADY = 0.1
"""Scatter of a distance, in itself, below which it is that of two antennas."""
ALIKE = 0.9
"""Least share of the fixes of the one most heard with which another is heard equally often."""
PAIRED = 0.9
"""Least cosine of the turn from the distance of one pair of fixes to that of the next, of two antennas."""


@dataclass(frozen=True, eq=False)
class Fixes:
    """Valid positions of one sentence: index (N,) of its rows, t (N,) [s], degrees (N,), decimals of the minutes (N,)
    and ranks of the quality (N,)."""

    name: str
    index: np.ndarray
    t: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    decimals: np.ndarray
    quality: np.ndarray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def rounding(self) -> float:
        """Of the positions [m]."""
        return M_PER_DEG / 60.0 * 10.0 ** -float(np.median(self.decimals))

    @property
    def z(self) -> np.ndarray:
        """Metres east + 1j north (N,) of the first fix, continuous over 180 degrees."""
        longitude = np.unwrap(self.longitude, period=360.0)
        east = (longitude - longitude[0]) * np.cos(np.radians(self.latitude[0]))
        return M_PER_DEG * (east + 1j * (self.latitude - self.latitude[0]))

    def rows(self, rows: np.ndarray) -> Fixes:
        """Those at ``rows``."""
        parts = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "name"}
        return replace(self, **parts)


@dataclass(frozen=True)
class Receiver:
    """The ``fixes`` of one receiver, the best first; distance: to the first receiver [m], None where they are not heard
    at the same time."""

    fixes: tuple[Fixes, ...]
    distance: float | None = None


def receivers_of(sentences: Sequence[Fixes]) -> list[Receiver]:
    """The receivers behind the sentences ``sentences``, that which is used first: the one heard most often, or, equally
    often, the one of better quality, or the first."""
    fixes = [part for one in sentences for part in divided(one)]
    most = max((len(f) for f in fixes), default=0)
    fixes.sort(key=lambda f: (-len(f) if len(f) < ALIKE * most else -most, -float(np.mean(f.quality))))
    groups: list[list[Fixes]] = []
    for one in fixes:
        own = next((group for group in groups if _one_receiver(group[0], one)), None)
        if own is None:
            groups.append([one])
        else:
            own.append(one)
    found: list[Receiver] = []
    for group in groups:
        finest = sorted(group, key=lambda f: (len(f) < ALIKE * len(group[0]), f.rounding))
        distance = _distance(groups[0][0], group[0])[0] if found else None
        found.append(Receiver(tuple(finest), None if distance is None else float(np.median(distance))))
    return found


def _one_receiver(a: Fixes, b: Fixes) -> bool:
    """Whether two series of fixes are of one receiver: they agree within NEAR, and not at a steady distance; what is
    never heard at the same time is, where it goes on where the other one stops."""
    off, tolerance = _distance(a, b)
    if off is None:
        first, last = sorted((a, b), key=lambda f: float(f.t[0]))
        both = first.rows(np.arange(len(first))[-5:])
        both = Fixes("", *(np.append(getattr(both, f.name), getattr(last, f.name)[0]) for f in fields(both)[1:]))
        step = np.abs(np.diff(both.z))
        speed = float(np.median(step[:-1] / np.maximum(np.diff(both.t)[:-1], 1e-3))) if len(step) > 1 else 0.0
        return bool(step[-1] <= NEAR + 2.0 * speed * (both.t[-1] - both.t[-2]))
    middle = float(np.median(off))
    low, high = np.percentile(off, [25, 75])
    return middle <= tolerance or (middle <= NEAR and high - low > STEADY * middle)


def _distance(a: Fixes, b: Fixes) -> tuple[np.ndarray | None, float]:
    """Metres (M,) between two series at their common times, else at those of the rarer one between fixes of the other,
    None without any; and how large they are by rounding and interpolation alone."""
    a, b = (b, a) if len(b) > len(a) else (a, b)
    rounding = 1.5 * (a.rounding + b.rounding)
    common, i, j = np.intersect1d(np.round(a.t, 2), np.round(b.t, 2), return_indices=True)
    if len(common) > 0.5 * len(b):
        latitude, longitude, b, slack = a.latitude[i], a.longitude[i], b.rows(j), 0.0
    else:
        inside = np.flatnonzero((b.t >= a.t[0]) & (b.t <= a.t[-1]))
        if not len(inside) or len(a) < 3:
            return None, rounding
        b, slack = b.rows(inside), 0.25 * float(np.percentile(np.abs(np.diff(a.z, 2)), 95))
        latitude = np.interp(b.t, a.t, a.latitude)
        longitude = np.interp(b.t, a.t, np.unwrap(a.longitude, period=360.0))
    east = (np.remainder(longitude - b.longitude + 180.0, 360.0) - 180.0) * np.cos(np.radians(b.latitude))
    return np.asarray(M_PER_DEG * np.hypot(east, latitude - b.latitude)), rounding + slack


def divided(fixes: Fixes) -> list[Fixes]:
    """The fixes of each of two receivers behind one talker and sentence: where it says two positions at one time."""
    if len(fixes) < 8:
        return [fixes]
    z, step = fixes.z, np.diff(fixes.t)
    twice = np.flatnonzero((step == 0) & (np.abs(np.diff(z)) > 3.0 * fixes.rounding))
    if len(twice) > 3:
        turn = np.angle(np.diff(z)[twice[1:]] * np.conj(np.diff(z)[twice[:-1]]))
        steady = np.median(np.abs(np.cos(turn))) > PAIRED  # noise has any direction
        return _by_pairs(fixes, z, twice) if steady else [fixes]
    return [fixes]


def _by_pairs(fixes: Fixes, z: np.ndarray, twice: np.ndarray) -> list[Fixes]:
    """Fixes of two receivers, of which pairs at the rows ``twice`` and behind them have the same time: which is which
    is told by the direction from one to the other, which turns slowly; single ones belong to the nearer track."""
    apart = z[twice + 1] - z[twice]
    flips = np.cumprod(np.append(1.0, np.sign(np.real(apart[1:] * np.conj(apart[:-1])) + 1e-300)))
    second = np.zeros(len(fixes), dtype=bool)
    second[np.where(flips > 0, twice + 1, twice)] = True
    paired = np.zeros(len(fixes), dtype=bool)
    paired[twice] = paired[twice + 1] = True
    off = []
    for rows in (np.flatnonzero(paired & ~second), np.flatnonzero(paired & second)):
        off.append(np.abs(z - np.interp(fixes.t, fixes.t[rows], z[rows])))
    second |= ~paired & (off[1] < off[0])
    return [fixes.rows(np.flatnonzero(~second)), fixes.rows(np.flatnonzero(second))]


def merged(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (N,) of the first of the ``series``, in order, and of others where it is silent for more than
    half its step."""
    t, values = series[0]
    t, first = np.unique(t, return_index=True)
    values = values[first]
    for other, more in series[1:]:
        if len(t) < 2 or not len(other):
            continue
        near = np.minimum(np.searchsorted(t, other), len(t) - 1)
        off = np.minimum(np.abs(t[near] - other), np.abs(t[np.maximum(near - 1, 0)] - other))
        new = off > 0.5 * float(np.median(np.diff(t)))
        t, order = np.unique(np.concatenate([t, other[new]]), return_index=True)
        values = np.concatenate([values, more[new]])[order]
    return t, values
