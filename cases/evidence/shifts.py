"""Lags of channels and the lever arm of the positions: they compete, per folder, once frames and units are right.

The misfits are those of competition.py. A lag is tried on a grid; the lever arm is that of least squares. A folder has
one value, and a trial that differs from it pays for that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.signals import Signals, Stats, evidence, over_windows, relative

COST = 8.0
"""Nats by which a lag or an arm has to be better than none."""

APART = 10.0
"""What a trial pays that differs from its folder."""

CLOSE = 6.0
"""Explanations that are closer than so many nats cannot be told apart."""

RARE = 6.0
"""What an explanation costs beside, that supposes the rare: a channel that is early, which needs all the others to be
late, or compass and gyro late together. A lever arm forward, or velocities that are late, look much like these."""

LEAST = 0.004
"""Relative misfit below which nothing is compared: rounding."""

LAGS = {"w": ("w",), "place": ("place",), "psi": ("psi",), "psi, r": ("psi", "r"), "r": ("r",)}
"""Name -> signals that are late together."""

MOST_CENTRES = 4
"""Of so many trials the grid is refined around their own best lag."""

ROOM = 400_000
"""So many rows of a record that is moved by several lags are looked at at once."""

TRIED, FINER = 12, 3
"""Steps of the grid of lags on each side of zero, and of its refinement."""

Value = complex | float


@dataclass(frozen=True)
class Shift:
    """An explanation of what is left over, of one trial.

    name: a key of LAGS, or "arm"; value: lag [s] or arm x + i y [m]; gained: nats of its folder; rivals: names of
    explanations that are as good; shared: whether the other files of the folder have it, too.
    """

    name: str
    value: Value
    gained: float
    rivals: tuple[str, ...] = ()
    shared: bool = True


@dataclass(frozen=True)
class Explanation:
    """What one explanation is worth to the trials of a folder: values, each trial's or None where it is none there;
    total: what they gain together (negative); alone: each trial's own best value, None for a lag that gains
    nothing there."""

    values: list[Value | None]
    total: float
    alone: Sequence[Value | None]


def candidates(found: Sequence[Signals], longest: float) -> dict[str, Explanation]:
    """Name of a ``Shift`` -> its worth to the trials of a folder, all of them with a track or all without.

    found: their signals; longest: lag [s] up to which is searched.
    """
    names = (*LAGS, "arm") if all(s.has_track for s in found) else ("r",)
    return {name: _lag(found, name, longest) if name in LAGS else _arms(found) for name in names}


def shifts(found: Mapping[str, Explanation]) -> list[Shift | None]:
    """The best explanation of each of the trials of a folder by the ``candidates`` found, None where there is none."""
    gains = {name: -one.total - _rare(name, one.values) for name, one in found.items()}
    best = max(gains, key=lambda name: gains[name])
    if gains[best] <= 0:
        return [None] * len(found[best].values)
    rivals = tuple(name for name in gains if name != best and gains[best] - gains[name] < CLOSE and gains[name] > 0)
    values = found[best].values
    shared = 2 * sum(v is not None for v in values) > len(values)
    return [None if v is None else Shift(best, v, gains[best], rivals, shared) for v in values]


def _rare(name: str, values: Sequence[Value | None]) -> float:
    known = [float(np.real(value)) for value in values if value is not None]
    early = name in LAGS and bool(known) and float(np.median(known)) < 0
    return RARE * (early + (name == "psi, r"))


def nats(s: Signals) -> float:
    """Nats of positions against velocities and of heading against turn rate of ``s``."""
    return float(_nats(s, s.has_track))


def nats_of_lags(s: Signals, name: str, lags: np.ndarray) -> np.ndarray:
    """Nats (n,) over those of no lag, of the same windows, where what ``name`` says is late by ``lags`` (n,) [s]."""
    at_once, out = max(1, ROOM // len(s.psi)), [np.empty(0)]
    for k in range(0, len(lags), at_once):
        late = s.shifted(lags[k : k + at_once], *LAGS[name])
        out.append(_nats(late, s.has_track) - _nats(replace(s, good=late.good), s.has_track))
    return np.concatenate(out)


def _nats(s: Signals, has_track: bool) -> np.ndarray:
    """Nats (...) of the records ``s``, of turns alone where they have no track.

    A sum over windows that no record of ``s`` has of its own is made once.
    """
    turn = _logged(s.stats(over_windows(s.psi), s.summed(s.r)), False) if s.has_turn else np.zeros(())
    return turn + _logged(s.stats(s.way(), s.summed(s.w * np.exp(1j * s.psi))), True) if has_track else turn


def _logged(stats: Stats, turns: bool) -> np.ndarray:
    """Nats (...) of a misfit, with the gain, and where it ``turns`` the angle, as are usual."""
    total, both = np.sum(stats.predicted, axis=-1), np.sum(stats.both, axis=-1)
    factor = both / np.where(total > 0, total, 1.0)
    gain = np.clip(np.abs(factor), 0.9, 1.1)
    angle = np.clip(np.angle(factor), -0.05, 0.05) if turns else np.zeros(np.shape(factor))
    misfit = relative(stats, gain * np.exp(1j * angle) if turns else gain)
    usual = 0.5 * (np.log(gain) / 0.03) ** 2 + 0.5 * (angle / 0.035) ** 2
    return np.asarray(np.where(total > 0, evidence(misfit, LEAST) + usual, 0.0))


def _together(costs: np.ndarray) -> tuple[list[int | None], float]:
    """Index of the value of each trial, and the total, where ``costs`` (trials, values) are over those of none."""
    if not len(costs):
        return [], 0.0
    own = costs.min(axis=1) + APART
    alone = np.minimum(own, 0.0)
    shared = COST + np.minimum(costs, np.minimum(own, APART)[:, None]).sum(axis=0)
    value = int(np.argmin(shared))
    alike = bool(shared[value] < alone.sum())
    ways = np.stack(
        [costs[:, value] if alike else np.full(len(costs), np.inf), own, np.full(len(costs), alike * APART)]
    )
    chosen = np.stack([np.full(len(costs), value), np.argmin(costs, axis=1), np.full(len(costs), -1)])
    picked = chosen[np.argmin(ways, axis=0), np.arange(len(costs))]
    return [None if i < 0 else int(i) for i in picked], float(shared[value] if alike else alone.sum())


def _lag(some: Sequence[Signals], name: str, longest: float) -> Explanation:
    """Lags [s] of what ``name`` says is late, up to the ``longest``."""

    def over_none(grid: np.ndarray) -> np.ndarray:
        return np.array([nats_of_lags(s, name, grid) for s in some])

    grid = np.linspace(-longest, longest, 2 * TRIED + 1)
    table = over_none(grid)
    for step in (longest / TRIED, longest / TRIED / FINER):
        apart = table.min(axis=1) < -APART
        centres = {float(grid[int(np.argmin(row))]) for row in (table.sum(axis=0), *table[apart][:MOST_CENTRES])}
        more = np.array(sorted({round(c + k * step / FINER, 9) for c in centres for k in range(-FINER, FINER + 1)}))
        more = more[np.abs(more) <= longest]
        grid, table = np.concatenate([grid, more]), np.concatenate([table, over_none(more)], axis=1)
    inner = np.abs(np.abs(grid) - longest) > 1e-9
    costs = np.where(inner, table, np.maximum(table, 0.0))
    chosen, total = _together(costs)
    alone = [float(grid[np.argmin(row)]) if row.min() < -COST else None for row in costs]
    return Explanation([None if i is None else float(grid[i]) for i in chosen], total, alone)


def _arms(some: Sequence[Signals]) -> Explanation:
    """Lever arms of least squares of each trial, and of all of them."""

    def without(s: Signals, arm: Value) -> float:
        return nats(replace(s, place=s.place - arm * np.exp(1j * s.psi)))

    normal = [_normal(s) for s in some]
    joint = sum(across for across, _ in normal), sum(power for _, power in normal)
    values: list[Value] = [across / power if power > 0 else 0.0 for across, power in (joint, *normal)]
    plain = np.array([nats(s) for s in some])
    costs = np.full((len(some), len(values)), np.inf)  # a trial has the value of all, or its own
    costs[:, 0] = [without(s, values[0]) for s in some] - plain
    for k, s in enumerate(some):
        costs[k, k + 1] = without(s, values[k + 1]) - plain[k]
    chosen, total = _together(costs)
    return Explanation([None if i is None else values[i] for i in chosen], total, values[1:])


def _normal(s: Signals) -> tuple[complex, float]:
    """Numerator and denominator of the arm of least squares, those of several trials to be added; the gain of u and v
    and the angle of the track are left free."""
    turn = np.exp(1j * s.psi)
    made, power = s.summed(s.w * turn), 0.0

    def mean(a: np.ndarray, b: np.ndarray) -> complex:
        return complex(np.sum(s.stats(a, b)[1]))

    power = mean(made, made).real
    way, free = (a - made * (mean(a, made) / power if power > 0 else 0.0) for a in (s.way(), over_windows(turn)))
    return mean(way, free), mean(free, free).real
