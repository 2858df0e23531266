"""What a calibration found as rows of result.json: the solver's account, coefficients, correlation, name and date."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from datetime import datetime, timezone
from typing import Any

import numpy as np

from cases.quantities import UNITS
from cases.trial import Trial
from fitting.calibration import Calibration, condition_number
from fitting.record import CoefficientRow
from fitting.report.run_folder import versions
from fitting.uncertainty.sandwich import changes_without_each
from mmg.motion.flow import STATES
from mmg.ship import CalibrationMark, Ship


def marked(calibrated: Ship, ship: Ship, trials: Sequence[Trial], name: str) -> Ship:
    """The ship ``calibrated`` with the ``name`` that was given, marked as calibrated today on ``trials`` from
    ``ship``."""
    hashes = sorted(trial.sha256 for trial in trials)  # one data set whatever the order of its files
    data = hashlib.sha256("\n".join(hashes).encode()).hexdigest() if all(hashes) else ""
    today = datetime.now(timezone.utc).date().isoformat()
    mark = CalibrationMark(name, today, data, ship.mark.name if ship.mark else ship.name)
    return replace(calibrated, name=name or calibrated.name, mark=mark)


def solved(calibration: Calibration, command: str) -> dict[str, Any]:
    """What the solver of a ``calibration`` says of itself, by attribute of the result; command: its maker."""
    solution, seg, noise = calibration.solution, calibration.segments, calibration.noise
    return {
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": command,
        "ship_name": calibration.ship.name,
        **{name: getattr(solution, name) for name in ("converged", "status", "advice", "objective", "iterations")},
        "constraint_violation": solution.violation,
        "condition_number": condition_number(calibration.covariance),
        "passes": calibration.passes,
        "starts": calibration.starts,
        "settings": calibration.settings,
        "versions": versions(),
        "compiled": not calibration.problem.kernels.interpreted_because,
        "windows": len(seg.run),
        "intervals": seg.intervals,
        "seconds_used": seg.duration,
        "sigma": dict(zip(STATES, calibration.sigma, strict=True)),
        "noise": {
            s: {"rms": noise.rms[i], "correlation_time_samples": noise.tau[i], "unit": UNITS[s]}
            for i, s in enumerate(STATES)
        },
        "fixed": [s for s in calibration.ship.symbols if s not in calibration.prior.symbols],
        "per_run": calibration.constants.rows()
        if calibration.constants and not calibration.problem.prior.campaign
        else None,
    }


def coefficient_rows(calibration: Calibration) -> dict[str, dict[str, Any]]:
    """What became of each free coefficient of a ``calibration``, by symbol, as of ``CoefficientRow``."""
    kept = {field.name for field in fields(CoefficientRow)}
    return {
        f.symbol: {name: value for name, value in vars(calibration.ship.coefficients[f.symbol]).items() if name in kept}
        | {"at_bound": f.bound or None, "prior_share": share}
        for f, share in zip(calibration.identifiability.findings, np.diag(calibration.covariance), strict=True)
    }


def correlation_of(calibration: Calibration) -> dict[str, Any]:
    """Correlation of the estimates of a ``calibration``, as of ``Correlation``: with the standard errors it is her
    covariance. That of the discounted information is weaker, so that together with robust errors sums and products of
    coefficients that trials know well would seem unknown, and figures up to three times as uncertain."""
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(np.diag(calibration.covariance))
        matrix = calibration.covariance / np.outer(size, size)
    return {"symbols": calibration.prior.symbols, "matrix": np.round(matrix, 6)}


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
                    calibration.segments.trials[run]: _most_moved(change[: len(symbols)], symbols)
                    for run, change in zip(by_run.run, changes_without_each(by_run) / sizes, strict=True)
                },
            },
        }
    }


def _most_moved(moved: np.ndarray, symbols: Sequence[str]) -> dict:
    """What leaving a run out moves, in standard errors: the coefficients it moves most."""
    most = np.argsort(-np.abs(np.nan_to_num(moved)))[:5]  # set by hand: what a person reads
    return {"largest": {symbols[i]: float(moved[i]) for i in most}, "rms": float(np.sqrt(np.mean(moved**2)))}
