"""How far the gap closes: trials that took no part, predicted before and after an effect is added."""

from __future__ import annotations

import numpy as np

from diagnosis.data import Data
from diagnosis.kalman import smoothed
from diagnosis.latent import Estimate, Path, Priors, active_states, first_path, look_around
from diagnosis.result import HeldOut
from diagnosis.steps import Steps
from mmg.logged import columns
from mmg.memory import MODEL_LENGTH

WINDOW, STRIDE = 30.0, 15.0
"""Seconds of a window and between their starts."""
DRAWS = 2000


def scales(length: float) -> np.ndarray:
    """What an error of each state is measured by (6,): .3 m, .3 m, 5 deg, .05 m/s, .05 m/s, .01 rad/s at 3 m length."""
    lam = length / MODEL_LENGTH
    k = lam**0.5
    return np.array([0.3 * lam, 0.3 * lam, np.radians(5.0), 0.05 * k, 0.05 * k, 0.01 / k])


def errors(steps: Steps, data: Data, theta: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean squared scaled errors of open-loop windows of ``length`` seconds (0: whole runs), by window, and their run.

    Each begins at its logged row; of two windows one begins STRIDE seconds after the other. A channel that was not
    measured does not count.
    """
    starts: list[tuple[int, int]] = []
    rows = round(length / data.h)
    for r, total in enumerate(data.steps):
        span = rows or int(total)
        first = range(0, max(int(total) - span, 0) + 1, max(1, round(STRIDE / data.h)) if rows else int(total))
        starts += [(k, r) for k in first if k + span <= total and data.measured[k, r, 2:].all()]
    if not starts:
        return np.zeros(0), np.zeros(0, dtype=int)
    k0, r0 = np.array(starts).T
    count = np.full(len(k0), rows) if rows else data.steps[r0]
    z = steps.settled(data.y[k0, r0].T, data.inputs[np.minimum(k0, len(data.inputs) - 1), r0].T, theta)
    sigma = scales(float(steps.ship.particulars["L"]))
    total, seen = np.zeros(len(k0)), np.zeros(len(k0))
    for k in range(int(count.max())):
        at = np.minimum(k0 + k, len(data.inputs) - 1)
        z = steps.advance(z, data.inputs[at, r0].T, theta)
        row = np.minimum(k0 + k + 1, len(data.y) - 1)
        error = (columns(steps.model, z, theta).T - data.y[row, r0]) / sigma
        good = data.measured[row, r0] & (k < count)[:, None]
        square = np.where(good, np.minimum(np.nan_to_num(error**2, nan=1e6), 1e6), 0.0)
        total += square.sum(axis=1)
        seen += good.sum(axis=1)
    return total / np.maximum(seen, 1), data.run[r0]


def compare(steps: Steps, data: Data, before: Estimate, after: Estimate, seed: int = 0) -> HeldOut | None:
    """Windows by two fits, with an interval of the reduction by drawing runs again; None without a whole window."""
    length = WINDOW * (float(steps.ship.particulars["L"]) / MODEL_LENGTH) ** 0.5
    a, run = errors(steps, data, before.theta, length)
    b, _ = errors(steps, data, after.theta, length)
    if not len(a):
        return None
    runs = np.unique(run)
    sums = np.array([[x[run == r].sum() for r in runs] for x in (a, b)])
    rng = np.random.default_rng(seed)
    draws = rng.choice(len(runs), (DRAWS, len(runs)))
    lost = 1 - sums[1][draws].sum(axis=1) / np.maximum(sums[0][draws].sum(axis=1), 1e-300)
    low, high = np.quantile(lost, [0.05, 0.95])
    whole = [errors(steps, data, f.theta, 0.0)[0].mean() for f in (before, after)]
    likely = [one_step_likelihood(steps, data, f) for f in (before, after)]
    gain = likely[0] - likely[1]
    gains = np.array([gain[data.run == r].sum() for r in np.unique(data.run)])
    drawn = gains[rng.choice(len(gains), (DRAWS, len(gains)))].sum(axis=1)
    between = np.quantile(drawn, [0.05, 0.95])
    return HeldOut(
        mse_before=float(a.mean()),
        mse_after=float(b.mean()),
        reduction=float(1 - b.sum() / max(a.sum(), 1e-300)),
        interval_90=(float(low), float(high)),
        windows=len(a),
        by_run={data.trials[r]: (float(a[run == r].mean()), float(b[run == r].mean())) for r in runs},
        likelihood_gain=float(gains.sum()),
        likelihood_interval_90=(float(between[0]), float(between[1])),
        horizons={
            "1 step": (one_step_error(steps, data, before), one_step_error(steps, data, after)),
            "30 s": (float(a.mean()), float(b.mean())),
            "whole run": (float(whole[0]), float(whole[1])),
        },
    )


def one_step_error(steps: Steps, data: Data, found: Estimate) -> float:
    """Mean squared scaled error one grid step after each logged row."""
    return float(errors(steps, data, found.theta, data.h)[0].mean())


@np.errstate(all="ignore")
def one_step_likelihood(steps: Steps, data: Data, found: Estimate, iterations: int = 4) -> np.ndarray:
    """Negative log likelihood of each window (R,) of other trials at the coefficients and noise of a fit."""
    nothing = Priors((), *(np.zeros(0) for _ in range(4)))
    active = active_states(steps, found.free.symbols, found.theta)
    path = first_path(steps, data, found.theta)
    for k in range(iterations):
        around = look_around(steps, data, found.theta, path, found.noise, nothing, np.zeros(0), active)
        if k == iterations - 1:
            break
        mean, _, _ = smoothed(around.system, around.filter, around.white[..., -1], around.states[..., -1])
        z = path.z.copy()
        z[..., active] += mean[..., : len(active)]
        path = Path(z, path.force + mean[..., len(active) : len(active) + 3])
    return 0.5 * (around.filter.log_det + (around.white[..., -1] ** 2).sum(axis=(0, 2)))
