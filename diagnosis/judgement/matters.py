"""Whether what is left beside a name matters: to predictions, not to a test. Where hardly any random force acts, every
rounding is significant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.validation.held_out import errors, start_states, window_length

LEAST_SHARE = 0.05
"""Share of a gap up to which nobody is told of it."""
DRAWS = 8
"""Draws of the noise of the sensors."""


def matters(error: float, best: float, before: float) -> bool:
    """Whether predictions with an ``error`` leave more than LEAST_SHARE of the gap between the error ``before``, with
    nothing named, and the ``best`` one (mean squared errors of 30 s windows)."""
    return error - best > LEAST_SHARE * max(before - best, 0.0)


def remainder_matters(p: SearchProblem, found: Selection, tests: GriddedTrials | None, held: HeldOut | None) -> bool:
    """Whether predictions with the effects ``found`` have an error that the noise of the sensors does not explain, of a
    size that matters.

    p: the problem; tests: trials that took no part; held: the check on these, None without any: then the trials of
    ``p`` themselves are predicted. Returns True where these hold no whole window either.
    """
    data = p.data if held is None or tests is None else tests
    before, after = _before_and_after(p, found, held)
    return not after or matters(after, sensor_error(p.steps, data, found.final), before)


def _before_and_after(p: SearchProblem, found: Selection, held: HeldOut | None) -> tuple[float, float]:
    """Errors without and with the effects; zeros without a whole window."""
    if held is not None:
        return held.mse_before, held.mse_after
    return _mean_error(p.steps, p.data, found.null.theta), _mean_error(p.steps, p.data, found.final.theta)


def _mean_error(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> float:
    """Mean squared error of 30 s windows, 0 without any."""
    windows, _ = errors(steps, data, theta, window_length(steps.ship))
    return float(windows.mean()) if len(windows) else 0.0


def sensor_error(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> float:
    """Error of predictions of a flawless model, which begin at noisy rows and are compared with such: of the paths that
    ``fit`` predicts for the trials ``data``, logged with its noise. steps: the transition model. Returns the mean over
    windows and draws, 0 where the ship cannot be followed."""
    theta = fit.theta
    acted = acting(steps, data, theta)
    first = start_states(steps, acted, theta)[:1]
    path = steps.logged(steps.follow(np.repeat(first, len(data.y), axis=0), acted.controls, theta), theta)
    if not np.isfinite(path).all():
        return 0.0
    noise, rng = np.hypot(fit.noise.white, fit.noise.coloured), np.random.default_rng(0)
    drawn = (replace(data, y=path + noise * rng.standard_normal(path.shape)) for _ in range(DRAWS))
    return float(np.mean([_mean_error(steps, one, theta) for one in drawn]))
