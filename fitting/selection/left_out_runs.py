"""Runs left out of a calibration without calibrating again: the estimate without them, and how it predicts them.

The cost of each window, its states eliminated, is a quadratic in the coefficients near the estimate, with a gradient
and an information of its own (fitting/nlp/fisher_information.py). Without some runs the objective is the sum of the
others, whose minimum one Newton step finds (the infinitesimal jackknife of White 1982, with the exact remaining
information as in Beirami et al. 2017). A constant that only the runs left out determine falls back to its prior, as it
must for a run that was never seen. All windows of all runs are then simulated in one batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.calibration import Calibration
from fitting.nlp.fisher_information import Information
from fitting.prediction.predict import ShipsByTrial
from fitting.prediction.score import score


def relative_change(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """mean(after) / mean(before) - 1 over files (R,) that both have, and its jackknife error; NaN for too few."""
    good = ~(np.isnan(before) | np.isnan(after))
    a, b, n = before[good], after[good], int(good.sum())
    change = float(b.mean() / a.mean() - 1) if n else float("nan")
    if n < 2:
        return change, float("nan")
    without = (b.sum() - b) / (a.sum() - a) - 1  # the change without each file
    return change, float(np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum()))


def estimates_without(
    info: Information, folds: Sequence[Sequence[int]], bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Estimates of scaled coefficients without the runs of each of ``folds`` (numbers of runs), (folds, P).

    info: of the windows at the estimate; bounds: lower and upper (P,) of the scaled coefficients. What pushes against
    a bound stays there. A fold whose remaining information is not positive is all NaN.
    """
    lower, upper = bounds
    estimates = np.full((len(folds), len(info.p)), np.nan)
    for k, out in enumerate(folds):
        rest = ~np.isin(info.run, list(out))
        H = info.fisher[rest].sum(axis=0) + info.prior_information
        slope = info.score[rest].sum(axis=0) + info.prior_score
        bound, target = np.zeros(len(info.p), dtype=bool), info.p.copy()
        try:
            for _ in range(8):  # 8: each round adds a bound; set by hand
                # at the minimum with those at bounds where they are: H_ff step = -(slope_f + H_fb step_b)
                step, free = np.where(bound, target - info.p, 0.0), ~bound
                step[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free] + H[np.ix_(free, bound)] @ step[bound])
                wanted = info.p + step
                outside = (wanted < lower) | (wanted > upper)
                if not outside.any():
                    break
                bound |= outside
                target = np.clip(wanted, lower, upper)
            estimates[k] = np.clip(wanted, lower, upper)
        except np.linalg.LinAlgError:
            continue  # nothing determines some coefficient: the fold stays NaN
    return estimates


def each_alone(count: int) -> list[tuple[int, ...]]:
    """Folds that leave out each of ``count`` runs alone."""
    return [(i,) for i in range(count)]


def coefficients_without(
    fit: Calibration, folds: Sequence[Sequence[int]], info: Information | None = None
) -> np.ndarray:
    """All coefficients (R, P) of the ship of the calibration ``fit``, for each of her runs without its fold.

    folds: numbers of the runs left out together, each in one; info: as of ``leave_out``. A second estimate
    (``calibration.with_second``) keeps its distance: it is not made again without a run. A constant of one run is that
    of a run never seen, one of a campaign as the rest of the campaign says. Where too little is left a row is NaN.
    """
    problem, prior, shared = fit.problem, fit.problem.prior, len(fit.p)
    shift = fit.p - fit.iterate["p"][:shared]
    at = [problem.ship.symbols.index(s) for s in fit.ship.symbols]  # constants of runs are none of the ship
    estimates = estimates_without(info or fit.information, folds, problem.p_bounds())
    values = np.full((sum(map(len, folds)), len(at)), np.nan)
    for out, p in zip(folds, estimates, strict=True):
        scaled = np.clip(p[:shared] + shift, *fit.prior.scaled_bounds)
        theta = np.atleast_2d(problem.coefficients(np.concatenate([scaled, p[shared:]])))[:, at]
        for i in out:
            values[i] = theta[(prior.campaign[i] if prior.campaign else i) if prior.constants else 0]
    return values


def leave_out(
    fit: Calibration, folds: Sequence[Sequence[int]], sigma: np.ndarray, info: Information | None = None
) -> np.ndarray:
    """How the calibration ``fit`` predicts its own trials when they are left out, fold by fold: mean squared error
    (R,) of the 30 s windows of each over six states in units of ``sigma`` (6,).

    folds: numbers of the trials left out together, each in one; info: of the windows, by default that of the
    calibration; with other weights of windows or samples the estimate is what these make it. A run without a whole
    window has NaN, one on which the estimate diverges inf. Raises UserError for trials without positions.
    """
    own = coefficients_without(fit, folds, info)
    # all windows of all runs in one batch
    simulator = ShipsByTrial(fit.ship, own, not fit.problem.kernels.interpreted_because)
    rows = score(simulator, fit.trials, sigma).trials
    return np.array([row.window if row.windows > 0 else np.nan for row in rows])
