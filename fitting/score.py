"""The two metrics: Wakita et al. (2022) Eq. 25 with restarts every 100 s, and 30 s windows every 15 s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cases.trial import STATES, Trial
from fitting.predict import predict, usable
from mmg.errors import UserError
from mmg.rollout import Simulator

PAPER_WINDOW = 100.0
WINDOW, STRIDE = 30.0, 15.0


@dataclass(frozen=True)
class TrialScore:
    """Both metrics of one trial (dimensionless), each also split by state (6,)."""

    name: str
    paper: float
    paper_by_state: np.ndarray
    window: float
    window_by_state: np.ndarray
    windows: int


@dataclass(frozen=True)
class Score:
    """Scores of a set of trials with the sigma they were divided by.

    paper, window: pooled over all rows of all trials; sigma: (6,) with ``sigma_from`` saying where it is from.
    """

    trials: tuple[TrialScore, ...]
    paper: float
    window: float
    sigma: np.ndarray
    sigma_from: str
    notes: tuple[str, ...] = field(default=())


def pooled_sigma(trials: Sequence[Trial]) -> np.ndarray:
    """Standard deviation of each state over all rows of all trials, heading as stored, shape (6,)."""
    rows = [np.column_stack([t[c] for c in STATES])[usable(t)] for t in trials if t.has_position]
    if not rows:
        raise UserError("sigma cannot be taken from trials without positions x and y; give it with --sigma")
    sigma = np.vstack(rows).std(axis=0)
    if not (sigma > 0).all():
        flat = ", ".join(s for s, value in zip(STATES, sigma, strict=True) if not value > 0)
        raise UserError(f"sigma of {flat} is zero in these trials; give sigma with --sigma or --sigma-from")
    return sigma


def wrapped_error(predicted: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Predicted minus measured, the heading error wrapped into (-pi, pi], shape (N, 6)."""
    error = predicted - measured
    error[:, 2] = np.pi - np.mod(np.pi - error[:, 2], 2 * np.pi)
    return error


def score_trial(simulator: Simulator, trial: Trial, sigma: np.ndarray, method: str = "rk4") -> tuple[
    TrialScore, float, int, float, int, list[str]
]:  # fmt: skip
    """Score one trial; also returns the sums and row counts that pool into a set, and notes."""
    if not trial.has_position:
        raise UserError(f"{trial.name}: no position columns x [m], y [m]; both metrics need all six states")
    measured = trial.states
    totals = []
    notes: list[str] = []
    for length, stride, whole in ((PAPER_WINDOW, PAPER_WINDOW, True), (WINDOW, STRIDE, False)):
        windows, remarks = predict(simulator, trial, length, stride, short_last=whole, method=method)
        notes += remarks
        squares, rows = np.zeros(6), 0
        for w in windows:
            error = wrapped_error(w.states, measured[w.first : w.last + 1])
            # paper metric: a window's first row counts with error 0, the next window's first row is not counted twice
            end = w.last if whole and w.last < len(trial) - 1 else w.last + 1
            part = error[: end - w.first] if whole else error[1:]
            squares += (part**2).sum(axis=0)
            rows += len(part)
        totals.append((squares / sigma**2, rows, len(windows)))
    (paper, n_paper, _), (window, n_window, count) = totals
    by_paper, by_window = (s / n if n else np.full(6, np.nan) for s, n in ((paper, n_paper), (window, n_window)))
    result = TrialScore(
        trial.name, float(by_paper.sum()), by_paper, float(by_window.sum()), by_window, count
    )
    return result, float(paper.sum()), n_paper, float(window.sum()), n_window, notes


def score(
    simulator: Simulator,
    trials: Sequence[Trial],
    sigma: np.ndarray | None = None,
    sigma_from: str = "the scored trials",
    method: str = "rk4",
) -> Score:
    """Both metrics of a ship on a set of trials; sigma defaults to the pooled one of these trials."""
    sigma = pooled_sigma(trials) if sigma is None else np.asarray(sigma, dtype=float)
    rows = [score_trial(simulator, trial, sigma, method) for trial in trials]
    paper = sum(r[1] for r in rows) / max(sum(r[2] for r in rows), 1)
    total = sum(r[4] for r in rows)
    window = sum(r[3] for r in rows) / total if total else float("nan")
    return Score(
        tuple(r[0] for r in rows), paper, window, sigma, sigma_from, tuple(note for r in rows for note in r[5])
    )
