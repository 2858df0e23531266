"""What is off once frames and units are right: lags of channels and the lever arm of the positions, then gains of u, v
and r, an angle between track and heading, and a set of the water, with their standard errors.

Lags and arm compete, per folder. The misfits are those of competition.py. A lag is tried on a grid; the lever arm is
that of least squares. A folder has one value, and a trial that differs from it pays for that.

Gains: over windows of a record the way made is what u and v make of it, each times a gain, turned by an angle; a lever
arm turns with the heading, and where u and v are through the water a current adds the same everywhere. The change of
the heading is that of the integrated turn rate times a gain. The errors have the density of Cauchy: receivers that
repeat or skip a fix leave most rows right and others off by half a step. Standard errors are those of a jackknife over
pieces of the records (Kunsch 1989) and over records, so that neighbours that err alike count once, of half the way from
the regression to the reverse one, between which errors of u, v and r leave the gain (Fuller 1987, section 1.1), and of
what windows of several lengths differ by; the value is that of the one with the least.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cases.evidence.competition import APART, COST, free_nats
from cases.evidence.signals import PIECES, Signals, densest, independent, jackknife, over_windows, white_noise
from cases.evidence.tails import normal_tail, student_quantile
from cases.inputs import integral
from cases.trial import Trial

WINDOWS = (1, 8, 64)  # Rows of a window; the longest is at most a piece of the record. Set by hand (2, 2).
STEPS = 30  # Of the iteration, which converges linearly. Set by hand.
MOST_ROWS = 3000  # Windows of a record that are looked at. Set by hand.
# Standard errors beyond which a value is no chance: the best of several windows is taken. Set by hand (3, 5).
SIGMAS = 4.0
# Gains below are a note: u by what it is of the way, v as sway is a tenth of it, r as each fit finds that of its gyro
# (usual deviation as in competition.py). Set by hand.
MATTERS = {"u": 0.005, "v": 0.03, "r": 0.03}
TRACK, TURN = ("u", "v", "angle", "arm_x", "arm_y", "lag", "drift_x", "drift_y"), ("r",)


class Scale(NamedTuple):
    """values, std: by the names of TRACK or TURN; gains are what the column has to be multiplied by, less one, the
    angle [rad] that by which the track lies clockwise of heading and velocities, arms in m and drifts in m/s.
    noise: standard deviation of a sample of u or r over its rms; crit: SIGMAS by Student's t."""

    values: dict[str, float]
    std: dict[str, float]
    noise: float
    crit: float

    def significant(self, name: str, least: float = 0.0) -> bool:
        """Whether a value is no chance and beyond the ``least``."""
        size, std = abs(self.values.get(name, 0.0)), self.std.get(name, 0.0)
        return size > self.crit * std and size - 2 * std > least

    def matters(self, name: str) -> bool:
        """Whether a gain errs by more than matters and by more than the noise of a sample."""
        return self.significant(name, max(MATTERS[name], self.noise))


def scale(trials: Sequence[Trial], names: Sequence[str]) -> Scale | None:
    """The values ``names``, the first of TRACK or all of TURN, of all ``trials`` together; None where nothing tells."""
    turns = tuple(names) == TURN
    column, place = ("r", 5) if turns else ("u", 3)
    use = [trial for trial in trials if independent(trial, "turn" if turns else "track")]
    use = [trial for trial in use if np.isfinite(trial[column]).any()]
    fits = [each for rows in WINDOWS if (each := _fitted(use, len(names), rows, turns)) is not None]
    if not fits:
        return None
    values, std = np.array(fits).transpose(1, 2, 0)  # (names, windows) each
    least = std.min(axis=1, keepdims=True)
    # windows that know a value much less well do not differ from it
    spread = np.where(std <= 3 * least, values, np.nan)
    values = np.take_along_axis(values, np.argmin(std, axis=1)[:, None], 1)[:, 0]  # of the windows that know it best
    std = np.hypot(least[:, 0], np.nanstd(spread, axis=1))  # windows that disagree make it wider
    size = [max(float(np.sqrt(np.nanmean(trial[column] ** 2))), 1e-12) for trial in use]
    share = float(np.median([white_noise([trial.states])[place] / each for trial, each in zip(use, size, strict=True)]))
    values = values - [name in "uvr" for name in names]  # gains less one
    value_of, std_of = (dict(zip(names, each.tolist(), strict=True)) for each in (values, std))
    # as many SIGMAS of a normal law as are as rare by Student's t of the pieces
    return Scale(value_of, std_of, share, -student_quantile(normal_tail(SIGMAS), PIECES * len(use) - 1))


def _rows(trials: Sequence[Trial], count: int, rows: int, turns: bool) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """What is predicted by each value (M, count) and what was measured (M,), of windows of so many ``rows``."""
    for trial in trials:
        psi = trial.psi_unwrapped
        if turns:
            measured, parts = psi, [trial["r"]]
        else:
            turn = np.exp(1j * psi)
            u, v = trial["u"] * turn, 1j * trial["v"] * turn
            measured, parts = trial["x"] + 1j * trial["y"], [u, v, 1j * (u + v)]  # in the order of TRACK
        valid = np.isfinite(measured) & np.all([np.isfinite(part) for part in parts], axis=0)
        if len(trial) - rows < 10 * PIECES or rows > len(trial) // PIECES or not valid.any():
            continue
        totals = [integral(trial.t, np.where(valid, part, 0.0)) for part in parts]
        if not turns:  # what the arm, a lag and a drift add has no integral: the window's end less its begin
            totals += [turn, 1j * turn, u + v, trial.t + 0j, 1j * trial.t]
        A = np.stack([total[rows:] - total[:-rows] for total in totals[:count]], axis=1)
        bad = np.concatenate([[0], np.cumsum(~valid)])
        A[bad[rows + 1 :] > bad[: -rows - 1]] = np.nan  # a count of bad rows that grows within a window
        some = slice(None, None, max(1, rows // 4, len(A) // MOST_ROWS))  # windows that overlap more say nothing new
        yield A[some], (measured[rows:] - measured[:-rows])[some]


def _fitted(trials: Sequence[Trial], count: int, rows: int, turns: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """Values and standard errors, (count,) each, by windows of so many ``rows``."""
    parts = list(_rows(trials, count, rows, turns))
    if not parts:
        return None
    A, y = (np.concatenate(some) for some in zip(*parts, strict=True))
    piece = np.concatenate([PIECES * k + np.arange(len(a)) * PIECES // len(a) for k, (a, _) in enumerate(parts)])
    good = np.isfinite(A).all(axis=1) & np.isfinite(y)
    A, y, piece = A[good], y[good], piece[good]
    made = A[:, 0] if turns else A[:, :2].sum(axis=1)
    power = np.abs(made) ** 2
    if len(y) < 4 * PIECES or not power.sum() > 0:
        return None
    strong = power >= np.median(power)  # where the ship hardly moves, a ratio is noise
    values = np.array([densest(np.real(y[strong] * np.conj(made[strong])) / np.maximum(power[strong], 1e-300))] * count)
    values[2:] = 0.0  # angle, arms, lag and drift begin at none
    # columns of like size, whatever their units: the ridge ``flat`` is then as small for each
    size = np.sqrt(np.mean(np.abs(A) ** 2, axis=0)) + 1e-12 * np.sqrt(power.mean())
    A, values = A / size, values * size
    of = [np.real, np.imag] if np.iscomplexobj(A) else [np.real]
    rows_of, wanted = [np.ascontiguousarray(part(A)) for part in of], [part(y) for part in of]
    flat = 1e-9 * np.eye(count)
    for _ in range(STEPS):
        error = np.sqrt(sum((b - a @ values) ** 2 for a, b in zip(rows_of, wanted, strict=True)))
        weight = 1.0 / (1.0 + (error / max(float(np.median(error)), 1e-12)) ** 2)  # Cauchy's: outliers lose their say
        normal = flat * weight.sum() + sum((a.T * weight) @ a for a in rows_of)
        before = values
        values = np.linalg.solve(normal, sum(a.T @ (weight * b) for a, b in zip(rows_of, wanted, strict=True)))
        if np.abs(values - before).max() < 1e-6 * np.abs(values).max():
            break
    edges = np.flatnonzero(np.diff(piece, prepend=-1))
    if len(edges) < PIECES // 2:
        return None
    spans = [slice(*span) for span in pairwise([*edges, len(y)])]
    N = np.array([sum((a[some].T * weight[some]) @ a[some] for a in rows_of) for some in spans])
    h = np.array([sum(a[some].T @ (weight * b)[some] for a, b in zip(rows_of, wanted, strict=True)) for some in spans])
    total = N.sum(axis=0) + flat * weight.sum()
    gained = values**2 / np.diag(np.linalg.inv(total))
    unexplained = float(weight @ error**2)
    gains = [name in "uvr" for name in (TURN if turns else TRACK)[:count]]
    # half the way to the reverse regression, which errors of u, v and r would ask for (Fuller 1987, section 1.1)
    told = gained > 0  # not of a column without motion and noise
    noisy = np.divide(0.5 * unexplained, gained, out=np.zeros(count), where=told) * values
    noisy = np.where(gains, np.where(told, noisy, np.inf), 0.0)
    record, std = piece[edges] // PIECES, np.abs(noisy)
    groups = [(N, h)]
    if len(parts) > 2:  # files differ by more than their pieces
        of_file = (np.unique(record)[:, None] == record).astype(float)
        groups.append((np.tensordot(of_file, N, 1), of_file @ h))
    for normal, sums in groups:
        std = np.maximum(std, np.hypot(noisy, jackknife(normal, sums, flat * weight.sum())[1]))
    return values / size, std / size


CLOSE = 6.0  # Explanations that are closer than so many nats cannot be told apart. Set by hand.
# What an explanation costs beside, that supposes the rare: a channel that is early, which needs all the others to be
# late, or compass and gyro late together. A lever arm forward, or velocities that are late, look much like these.
RARE = 6.0  # set by hand (1, 1)
LEAST = 0.004  # Relative misfit below which nothing is compared: rounding. Set by hand.
# Name -> signals that are late together, their columns, and what is said to be late.
LAGS = {
    "w": (("w",), ("u", "v"), "u and v are"),
    "place": (("place",), ("x", "y"), "x and y are"),
    "psi": (("psi",), ("psi",), "psi is"),
    "psi, r": (("psi", "r"), ("psi", "r"), "psi and r are"),
    "r": (("r",), ("r",), "r is"),
}
MOST_CENTRES = 4  # Of so many trials the grid is refined around their own best lag. Set by hand.
ROOM = 400_000  # So many rows of a record that is moved by several lags are looked at at once. Set by hand.
# Steps of the grid of lags on each side of zero, and of its refinement. Set by hand (0, 0 and 1, 0).
TRIED, FINER = 12, 3
Value = complex | float


@dataclass(frozen=True)
class Shift:
    """An explanation of what is left over, of one trial. name: a key of LAGS, or "arm"; value: lag [s] or arm x + i y
    [m]; rivals: names of explanations that are as good; shared: whether the other files of the folder have it, too."""

    name: str
    value: Value
    rivals: tuple[str, ...] = ()
    shared: bool = True


@dataclass(frozen=True)
class Explanation:
    """What one explanation is worth to the trials of a folder: values, each trial's or None where it is none there;
    total: what they gain together (negative)."""

    values: list[Value | None]
    total: float


def candidates(found: Sequence[Signals], longest: float) -> dict[str, Explanation]:
    """Name of a ``Shift`` -> its worth to the trials of a folder, all of them with a track or all without. found: their
    signals; longest: lag [s] up to which is searched."""
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
    return [None if v is None else Shift(best, v, rivals, shared) for v in values]


def _rare(name: str, values: Sequence[Value | None]) -> float:
    lags = [float(np.real(value)) for value in values if value is not None]
    early = name in LAGS and bool(lags) and float(np.median(lags)) < 0
    return RARE * (early + (name == "psi, r"))


def nats(s: Signals) -> float:
    """Nats of positions against velocities and of heading against turn rate of ``s``."""
    return float(_nats(s, s.has_track))


def nats_of_lags(s: Signals, name: str, lags: np.ndarray) -> np.ndarray:
    """Nats (n,) over those of no lag, of the same windows, where what ``name`` says is late by ``lags`` (n,) [s]."""
    at_once, out = max(1, ROOM // len(s.psi)), [np.empty(0)]
    for k in range(0, len(lags), at_once):
        late = s.shifted(lags[k : k + at_once], *LAGS[name][0])
        out.append(_nats(late, s.has_track) - _nats(replace(s, good=late.good), s.has_track))
    return np.concatenate(out)


def _nats(s: Signals, has_track: bool) -> np.ndarray:
    """Nats (...) of the records ``s``, of turns alone where they have no track. A sum over windows that no record of
    ``s`` has of its own is made once."""
    turn = np.zeros(())
    if s.has_turn:
        turn = free_nats(s.stats(over_windows(s.psi), s.summed(s.r)), turns=False, floor=LEAST)
    if not has_track:
        return turn
    return turn + free_nats(s.stats(over_windows(s.place), s.summed(s.w * np.exp(1j * s.psi))), floor=LEAST)


def _together(costs: np.ndarray) -> tuple[list[int | None], float]:
    """Index of the value of each trial, and the total, where ``costs`` (trials, values) are over those of none."""
    if not len(costs):
        return [], 0.0
    individual = costs.min(axis=1) + APART
    alone = np.minimum(individual, 0.0)  # each trial its own value, or none
    # one value for all, for which the folder pays once: a trial has it, its own, or none although the others have it
    shared = COST + np.minimum(costs, np.minimum(individual, APART)[:, None]).sum(axis=0)
    value = int(np.argmin(shared))
    alike = bool(shared[value] < alone.sum())
    ways = np.stack(
        [costs[:, value] if alike else np.full(len(costs), np.inf), individual, np.full(len(costs), alike * APART)]
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
    # refined twice, about the lag of all and of each that differs
    for step in (longest / TRIED, longest / TRIED / FINER):
        apart = table.min(axis=1) < -APART
        centres = {float(grid[int(np.argmin(row))]) for row in (table.sum(axis=0), *table[apart][:MOST_CENTRES])}
        more = np.array(sorted({round(c + k * step / FINER, 9) for c in centres for k in range(-FINER, FINER + 1)}))
        more = more[np.abs(more) <= longest]
        grid, table = np.concatenate([grid, more]), np.concatenate([table, over_none(more)], axis=1)
    inner = np.abs(np.abs(grid) - longest) > 1e-9  # at the end of the grid a lag may be longer yet: no evidence for it
    costs = np.where(inner, table, np.maximum(table, 0.0))
    chosen, total = _together(costs)
    return Explanation([None if i is None else float(grid[i]) for i in chosen], total)


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
    return Explanation([None if i is None else values[i] for i in chosen], total)


def _normal(s: Signals) -> tuple[complex, float]:
    """Numerator and denominator of the arm of least squares, those of several trials to be added; the gain of u and v
    and the angle of the track are left free."""
    turn = np.exp(1j * s.psi)
    made = s.summed(s.w * turn)

    def mean(a: np.ndarray, b: np.ndarray) -> complex:
        return complex(np.sum(s.stats(a, b)[1]))

    power = mean(made, made).real
    # both without what goes with the way made, so that a complex factor of it (gain and angle) changes nothing
    way, free = (a - made * (mean(a, made) / power if power > 0 else 0.0) for a in map(over_windows, (s.place, turn)))
    return mean(way, free), mean(free, free).real
