"""Gains of u, v and r, an angle between track and heading, and a set of the water, with their standard errors.

Over windows of a record the way made is what u and v make of it, each times a gain, turned by an angle; a lever arm
turns with the heading, and where u and v are through the water a current adds the same everywhere. The change of the
heading is that of the integrated turn rate times a gain. The errors have the density of Cauchy: receivers that repeat
or skip a fix leave most rows right and others off by half a step. Standard errors are those of a jackknife over pieces
of the records (Kunsch 1989) and over records, so that neighbours that err alike count once, of half the way from the
regression to the reverse one, between which errors of u, v and r leave the gain (Fuller 1987, section 1.1), and of what
windows of several lengths differ by; the value is that of the one with the least.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cases.evidence.signals import PIECES, densest, independent, white_noise
from cases.evidence.tails import normal_tail, student_quantile
from cases.inputs import integral
from cases.trial import Trial

WINDOWS = (1, 8, 64)
"""Rows of a window; the longest is at most a piece of the record."""

STEPS = 30
"""Of the iteration, which converges linearly."""

MOST_ROWS = 3000
"""Windows of a record that are looked at."""

SIGMAS = 4.0
"""Standard errors beyond which a value is no chance: the best of several windows is taken."""

MATTERS = {"u": 0.005, "v": 0.03, "r": 0.03}
"""Gains below are a note: u by what it is of the way, v as sway is a tenth of it, r as each fit finds that of its gyro
(usual deviation as in competition.py)."""

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
    found = [each for rows in WINDOWS if (each := _fitted(use, len(names), rows, turns)) is not None]
    if not found:
        return None
    values, std = np.array(found).transpose(1, 2, 0)  # (names, windows) each
    least = std.min(axis=1, keepdims=True)
    spread = np.where(std <= 3 * least, values, np.nan)
    values = np.take_along_axis(values, np.argmin(std, axis=1)[:, None], 1)[:, 0]
    std = np.hypot(least[:, 0], np.nanstd(spread, axis=1))
    size = [max(float(np.sqrt(np.nanmean(trial[column] ** 2))), 1e-12) for trial in use]
    share = float(np.median([white_noise([trial.states])[place] / each for trial, each in zip(use, size, strict=True)]))
    values = values - [name in "uvr" for name in names]
    value_of, std_of = (dict(zip(names, each.tolist(), strict=True)) for each in (values, std))
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
            measured, parts = trial["x"] + 1j * trial["y"], [u, v, 1j * (u + v)]
        known = np.isfinite(measured) & np.all([np.isfinite(part) for part in parts], axis=0)
        if len(trial) - rows < 10 * PIECES or rows > len(trial) // PIECES or not known.any():
            continue
        totals = [integral(trial.t, np.where(known, part, 0.0)) for part in parts]
        if not turns:
            totals += [turn, 1j * turn, u + v, trial.t + 0j, 1j * trial.t]
        A = np.stack([total[rows:] - total[:-rows] for total in totals[:count]], axis=1)
        bad = np.concatenate([[0], np.cumsum(~known)])
        A[bad[rows + 1 :] > bad[: -rows - 1]] = np.nan
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
    strong = power >= np.median(power)
    values = np.array([densest(np.real(y[strong] * np.conj(made[strong])) / np.maximum(power[strong], 1e-300))] * count)
    values[2:] = 0.0
    size = np.sqrt(np.mean(np.abs(A) ** 2, axis=0)) + 1e-12 * np.sqrt(power.mean())
    A, values = A / size, values * size
    of = [np.real, np.imag] if np.iscomplexobj(A) else [np.real]
    rows_of, wanted = [np.ascontiguousarray(part(A)) for part in of], [part(y) for part in of]
    flat = 1e-9 * np.eye(count)
    for _ in range(STEPS):
        error = np.sqrt(sum((b - a @ values) ** 2 for a, b in zip(rows_of, wanted, strict=True)))
        weight = 1.0 / (1.0 + (error / max(float(np.median(error)), 1e-12)) ** 2)
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
    left = float(weight @ error**2)
    noisy = np.where([name in "uvr" for name in (TURN if turns else TRACK)[:count]], 0.5 * left / gained * values, 0.0)
    record = piece[edges] // PIECES
    groups = [np.arange(len(edges)), *([record] if len(parts) > 2 else [])]  # files differ by more than their pieces
    std = np.abs(noisy)
    for group in groups:
        each = [np.flatnonzero(group == one) for one in np.unique(group)]
        without = [np.linalg.solve(total - N[some].sum(axis=0), (h.sum(axis=0) - h[some].sum(axis=0))) for some in each]
        std = np.maximum(std, np.hypot(noisy, np.sqrt((len(each) - 1) * np.var(without, axis=0))))
    return values / size, std / size
