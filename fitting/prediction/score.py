"""The two metrics: Wakita et al. (2022) Eq. 25 with restarts every 100 s, and 30 s windows every 15 s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cases.trial import STATES, Trial
from fitting.prediction.adaptation import Adaptation
from fitting.prediction.predict import Forecaster, Window, predict_all, usable
from mmg.errors import UserError
from mmg.motion.flow import INPUTS
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
    placed = [t for t in trials if t.has_position]
    rows = [np.column_stack([t[c] for c in STATES])[usable(t, [n for n in INPUTS if n in t])] for t in placed]
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


def _squares(trial: Trial, windows: Sequence[Window], whole: bool) -> tuple[np.ndarray, int]:
    """Sum of squared errors by state (6,) and number of rows counted.

    ``whole`` (restarts): a window's first row counts with error 0, and the row at which the next window starts is its.
    Otherwise the first row of each window is left out.
    """
    measured, total, rows = trial.states, np.zeros(6), 0
    for w in windows:
        error = wrapped_error(w.states, measured[w.first : w.last + 1])
        if not whole:
            error = error[1:]
        elif w.last < len(trial) - 1:
            error = error[:-1]
        total += (error**2).sum(axis=0)
        rows += len(error)
    return total, rows


@np.errstate(all="ignore")
def score(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    sigma: np.ndarray | None = None,
    sigma_from: str = "the scored trials",
    method: str = "rk4",
    adapt: float | None = None,
) -> Score:
    """Both metrics of a ship or a black box on a set of trials; sigma defaults to the pooled one of these trials.

    adapt: seconds before each window from which the run's disturbance is estimated (fitting.prediction.adaptation),
    of a ship only.

    Raises UserError when a trial has no positions, or sigma cannot be pooled.
    """
    for trial in trials:
        if not trial.has_position:
            raise UserError(f"{trial.name}: no position columns x [m], y [m]; both metrics need all six states")
    sigma = pooled_sigma(trials) if sigma is None else np.asarray(sigma, dtype=float)
    past = Adaptation.of(simulator.ship, adapt) if adapt and isinstance(simulator, Simulator) else None
    paper = predict_all(simulator, trials, PAPER_WINDOW, PAPER_WINDOW, True, method, adaptation=past)
    short = predict_all(simulator, trials, WINDOW, STRIDE, False, method, adaptation=past)
    rows, notes = [], []
    pooled = np.zeros((2, 2))
    for trial, (restarts, remarks), (windows, more) in zip(trials, paper, short, strict=True):
        notes += remarks + more
        means = []
        for j, (found, whole) in enumerate(((restarts, True), (windows, False))):
            squares, count = _squares(trial, found, whole)
            squares = squares / sigma**2
            pooled[j] += squares.sum(), count
            means.append(squares / count if count else np.full(6, np.nan))
        rows.append(
            TrialScore(trial.name, float(means[0].sum()), means[0], float(means[1].sum()), means[1], len(windows))
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        means_all = pooled[:, 0] / pooled[:, 1]
    return Score(tuple(rows), float(means_all[0]), float(means_all[1]), sigma, sigma_from, tuple(notes))
