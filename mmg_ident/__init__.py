"""Manoeuvring models (MMG) of ships, calibrated from trial data.

``trials = read_trials("trials/")``, ``fit = calibrate("esso_osaka_3m", trials)``, ``score(fit, held_out)``: each name
here is loaded when it is first used, so that the import itself is quick.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cases.checks.report import CheckReport
    from cases.io.read import read_trials
    from cases.shipfiles.new_ship import new_ship
    from cases.shipfiles.ship_file import load_ship
    from cases.trial import Trial
    from cases.trial_set import TrialSet
    from delivery.export import export_ship
    from delivery.full_scale.result import scale
    from diagnosis.result import Diagnosis
    from diagnosis.validation.gap import Gap
    from fitting.prediction.score import Score
    from fitting.result import FitResult
    from fitting.solvers.reduced import ReducedProblem
    from mmg.errors import UserError
    from mmg.messages import Message
    from mmg.progress import OnProgress, Progress
    from mmg.ship import Ship
    from mmg_ident.api import (
        Prediction,
        calibrate,
        check,
        diagnose,
        gap,
        load_run,
        predict,
        refit,
        score,
        simulate,
        train,
        write_report,
    )
    from residual.result import TrainResult

_HOMES = {
    "CheckReport": "cases.checks.report", "Diagnosis": "diagnosis.result", "FitResult": "fitting.result",
    "Gap": "diagnosis.validation.gap",
    "Message": "mmg.messages", "OnProgress": "mmg.progress", "Progress": "mmg.progress",
    "ReducedProblem": "fitting.solvers.reduced",
    "Score": "fitting.prediction.score", "Ship": "mmg.ship", "TrainResult": "residual.result", "Trial": "cases.trial",
    "TrialSet": "cases.trial_set", "UserError": "mmg.errors", "export_ship": "delivery.export",
    "load_ship": "cases.shipfiles.ship_file", "new_ship": "cases.shipfiles.new_ship", "read_trials": "cases.io.read",
    "scale": "delivery.full_scale.result",
}  # fmt: skip
"""Public name -> the module it is taken from, where that is not ``mmg_ident.api``."""

__all__ = [
    "CheckReport", "Diagnosis", "FitResult", "Gap", "Message", "OnProgress", "Prediction", "Progress", "ReducedProblem",
    "Score", "Ship", "TrainResult", "Trial", "TrialSet", "UserError", "__version__", "calibrate", "check", "diagnose",
    "export_ship", "gap", "load_run", "load_ship", "new_ship", "predict", "read_trials", "refit", "scale", "score",
    "simulate", "train", "write_report",
]  # fmt: skip

__version__ = "0.2.0"


OURS = '"""The symbolic ship'
"""How the first file of our ``mmg`` begins."""


def shadowing_mmg() -> str:
    """One line about another package ``mmg``, as the package index has one, that Python would import in place of ours;
    empty where there is none. Nothing of that package is executed."""
    spec = find_spec("mmg")
    origin = Path(spec.origin) if spec and spec.origin else None
    if origin is not None and origin.is_file() and origin.read_text(errors="replace").startswith(OURS):
        return ""
    where = f"{origin.parent} is another package 'mmg'" if origin else "the package 'mmg' is missing"
    return f"{where}, which stands before that of mmg-ident: install mmg-ident in a virtual environment of its own"


def __getattr__(name: str) -> Any:
    """The public ``name``, loaded at its first use. Raises ImportError where another package ``mmg`` is in the way."""
    if name not in __all__:
        raise AttributeError(f"module 'mmg_ident' has no attribute {name!r}")
    if in_the_way := shadowing_mmg():
        raise ImportError(in_the_way)
    value = getattr(import_module(_HOMES.get(name, "mmg_ident.api")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
