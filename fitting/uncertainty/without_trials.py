"""Coefficients of a calibration without each of its trials, and without all trials of a kind, for prediction bands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration
from fitting.prediction.band_calibration import Without
from fitting.selection.left_out_runs import each_alone, estimates_without


def without_trials(found: Calibration, trials: Sequence[Trial]) -> Without:
    """All coefficients of the ship of the calibration ``found`` without each of the ``trials`` (R of them, those that
    it was made on), and without all of its kind, by one Newton step each.

    A second estimate (``fitting.selection.two_estimates``) keeps its distance: it is not made again without a run.
    Constants of single runs stay at their neutral values, as for a run that was never seen; those of campaigns are as
    the rest of the campaign says. Where too little is left a row is NaN.
    """
    kinds = [t.kind for t in trials]
    folds = [tuple(i for i, k in enumerate(kinds) if k == kind) for kind in dict.fromkeys(kinds)]
    run = _coefficients(found, len(trials), each_alone(len(trials)))
    return Without(run, _coefficients(found, len(trials), folds) if len(folds) > 1 else None)


def _coefficients(found: Calibration, count: int, folds: Sequence[Sequence[int]]) -> np.ndarray:
    """Coefficients (R, P) of the ship without the fold that each of so many runs is in."""
    ship, problem = found.ship, found.problem
    values = np.tile(np.asarray(ship.values, dtype=float), (count, 1))
    shared = len(found.p)
    beside = found.p - found.iterate["p"][:shared]
    at = [ship.symbols.index(s) for s in found.prior.symbols]
    own = [ship.symbols.index(s) for s in found.problem.prior.constants] if problem.prior.campaign else []
    for out, p in zip(folds, estimates_without(found.information, folds, problem.p_bounds()), strict=True):
        for i in out:
            scaled = np.clip(p[:shared] + beside, *found.prior.scaled_bounds)
            values[i, at] = found.prior.mean + found.prior.std * scaled
            if own:
                columns = shared + len(own) * problem.prior.campaign[i] + np.arange(len(own))
                values[i, own] = problem.prior.mean[columns] + problem.prior.std[columns] * p[columns]
    return values
