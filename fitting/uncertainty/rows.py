"""The uncertainty of a calibration as plain values for ``result.json``; bootstrap and profiles on request."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from fitting.calibration import Calibration
from fitting.uncertainty.bootstrap import Replicates, bootstrap
from fitting.uncertainty.profile_likelihood import profiles
from fitting.uncertainty.sandwich import changes_without_each
from mmg.errors import OutOfRange, UnknownName


def check_request(replicates: int, symbols: Sequence[str], free: Sequence[str]) -> None:
    """Raises UserError for fewer than 0 bootstrap ``replicates`` and for ``symbols`` to profile that are not
    ``free``."""
    if replicates < 0:
        raise OutOfRange(f"--bootstrap {replicates} must not be negative")
    unknown = [s for s in symbols if s not in free]
    if unknown:
        raise UnknownName(f"--profile: {', '.join(unknown)} is not among the free coefficients: {', '.join(free)}")


def uncertainty_rows(calibration: Calibration) -> dict:
    """Key "uncertainty" of a ``calibration``."""
    symbols, info, spread = calibration.prior.symbols, calibration.information, calibration.spread
    by_run, unit, sizes = info.by_run(), calibration.prior.std, np.sqrt(np.diag(spread.covariance))
    return {
        "uncertainty": {
            "windows": spread.clusters[0],
            "runs": spread.clusters[1],
            "dispersion": spread.dispersion,
            "coefficients": {
                s: {
                    "std": float(sizes[i] * unit[i]),
                    "std_model": float(np.sqrt(spread.model[i, i]) * unit[i]),
                    "degrees_of_freedom": float(spread.freedom[i]),
                }
                for i, s in enumerate(symbols)
            },
            "without_run": {
                "method": "step",
                "change_in_standard_errors": {
                    calibration.segments.trials[run]: _most_moved(moved[: len(symbols)], symbols)
                    for run, moved in zip(by_run.run, changes_without_each(by_run) / sizes, strict=True)
                },
            },
        }
    }


def refit_rows(calibration: Calibration, replicates: int = 0, profiled: Sequence[str] = ()) -> dict:
    """Keys "bootstrap" (when ``replicates`` > 0) and "profiles" (of the ``profiled``) of a ``calibration``.

    Refits are spread over the calibration's workers. What fails is listed, never raised.
    """
    info, spread = calibration.information, calibration.spread
    content: dict[str, Any] = {}
    sizes = np.sqrt(np.diag(spread.covariance))
    problem, x, workers = calibration.problem, calibration.solution.x, calibration.settings.workers
    if replicates:
        began = time.perf_counter()
        full = bootstrap(info, replicates, calibration.settings.seed, problem, x, workers)
        content["bootstrap"] = _drawn(full, calibration, sizes) | {"seconds": time.perf_counter() - began}
    if profiled:
        content["profiles"] = profiles(problem, x, profiled, spread.covariance, spread.model, workers)
    return content


def _most_moved(moved: np.ndarray, symbols: Sequence[str]) -> dict:
    """What leaving a run out moves, in standard errors: the coefficients it moves most."""
    most = np.argsort(-np.abs(np.nan_to_num(moved)))[:5]
    return {"largest": {symbols[i]: float(moved[i]) for i in most}, "rms": float(np.sqrt(np.mean(moved**2)))}


def _drawn(found: Replicates, calibration: Calibration, sizes: np.ndarray) -> dict:
    prior, shape = calibration.prior, (2, found.p.shape[1])
    std = found.good.std(axis=0, ddof=1) if len(found.good) > 1 else np.full(shape[1], np.nan)
    interval = np.quantile(found.good, (0.025, 0.975), axis=0) if len(found.good) else np.full(shape, np.nan)
    return {
        "method": "refit",
        "replicates": len(found.p),
        "failed": [{"replicate": label, "reason": why} for label, why in found.failures],
        "coefficients": {
            s: {
                "std": float(std[i] * prior.std[i]),
                "std_over_robust": float(std[i] / sizes[i]),
                "lower": float(prior.mean[i] + prior.std[i] * interval[0, i]),
                "upper": float(prior.mean[i] + prior.std[i] * interval[1, i]),
            }
            for i, s in enumerate(prior.symbols)
        },
    }
