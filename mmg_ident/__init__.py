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
    from delivery.export import export_ship as export
    from delivery.full_scale.result import scale
    from diagnosis.inputs import DiagnosisOptions
    from diagnosis.result import Diagnosis
    from diagnosis.validation.gap import Gap
    from fitting.calibrate import FitOptions
    from fitting.prediction.score import Score
    from fitting.result import FitResult
    from fitting.settings import Settings
    from fitting.solvers.reduced import ReducedProblem
    from fitting.uncertainty.posterior import Posterior
    from mmg.components.coefficients import Coefficient
    from mmg.effects.effect import Parameter
    from mmg.errors import UserError
    from mmg.messages import Message, OnProgress, Progress
    from mmg.motion.flow import Force, Slipstream
    from mmg.ship import Ship
    from mmg_ident.api import (
        Prediction,
        calibrate,
        check,
        diagnose,
        load_run,
        predict,
        refit,
        score,
        simulate,
        simulate_many,
        train,
        write_report,
    )
    from mmg_ident.api import write_report as report
    from mmg_ident.model_gap import GapOptions, gap
    from mmg_ident.own_models import effect, force
    from mmg_ident.studies import card, compare, fleet, imo, import_logs, months, plan, select, view
    from mmg_ident.tracker import Tracker
    from residual.result import TrainResult
    from residual.settings import BlackBoxSettings, TrainSettings

# Public name -> the module it is taken from, and behind a colon its name there; else it is in ``mmg_ident.api``.
_HOMES = {
    "BlackBoxSettings": "residual.settings", "CheckReport": "cases.checks.report",
    "Coefficient": "mmg.components.coefficients", "Diagnosis": "diagnosis.result",
    "DiagnosisOptions": "diagnosis.inputs", "FitOptions": "fitting.calibrate", "FitResult": "fitting.result",
    "Force": "mmg.motion.flow", "Gap": "diagnosis.validation.gap", "GapOptions": "mmg_ident.model_gap", "Message":
    "mmg.messages", "OnProgress": "mmg.messages", "Parameter": "mmg.effects.effect", "Posterior":
    "fitting.uncertainty.posterior", "Progress": "mmg.messages", "ReducedProblem": "fitting.solvers.reduced", "Score":
    "fitting.prediction.score", "Settings": "fitting.settings", "Ship": "mmg.ship", "Slipstream": "mmg.motion.flow",
    "Tracker": "mmg_ident.tracker", "TrainResult": "residual.result", "TrainSettings": "residual.settings", "Trial":
    "cases.trial", "TrialSet": "cases.trial_set", "UserError": "mmg.errors", "effect": "mmg_ident.own_models", "export":
    "delivery.export:export_ship", "export_ship": "delivery.export", "force": "mmg_ident.own_models",
    "gap": "mmg_ident.model_gap", "load_ship": "cases.shipfiles.ship_file", "new_ship": "cases.shipfiles.new_ship",
    "read_trials": "cases.io.read", "report": "mmg_ident.api:write_report", "scale": "delivery.full_scale.result",
    **{name: "mmg_ident.studies" for name in ("card", "compare", "fleet", "imo", "import_logs", "months", "plan",
    "select", "view")},
}  # fmt: skip

__all__ = [
    "BlackBoxSettings", "CheckReport", "Coefficient", "Diagnosis", "DiagnosisOptions", "FitOptions", "FitResult",
    "Force", "Gap", "GapOptions", "Message", "OnProgress", "Parameter", "Posterior", "Prediction", "Progress",
    "ReducedProblem", "Score", "Settings", "Ship", "Slipstream", "Tracker", "TrainResult", "TrainSettings", "Trial",
    "TrialSet", "UserError", "__version__", "calibrate", "card", "check", "compare", "diagnose", "effect", "export",
    "export_ship", "fleet", "force", "gap", "imo", "import_logs", "load_run", "load_ship", "months", "new_ship", "plan",
    "predict", "read_trials", "refit", "report", "scale", "score", "select", "simulate", "simulate_many", "train",
    "view", "write_report",
]  # fmt: skip

__version__ = "0.2.0"


OURS = '"""The symbolic ship'  # How the first file of our ``mmg`` begins


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
    home, _, there = _HOMES.get(name, "mmg_ident.api").partition(":")
    value = getattr(import_module(home), there or name)
    globals()[name] = value  # from now on found without this function
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
