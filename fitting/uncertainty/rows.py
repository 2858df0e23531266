"""The uncertainty of a calibration as plain values for ``result.json``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.calibration import Calibration
from fitting.uncertainty.sandwich import changes_without_each


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


def _most_moved(moved: np.ndarray, symbols: Sequence[str]) -> dict:
    """What leaving a run out moves, in standard errors: the coefficients it moves most."""
    most = np.argsort(-np.abs(np.nan_to_num(moved)))[:5]
    return {"largest": {symbols[i]: float(moved[i]) for i in most}, "rms": float(np.sqrt(np.mean(moved**2)))}
