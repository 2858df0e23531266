"""How to calibrate: the settings of ``estimate_coefficients`` and what a start of it ended with."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from mmg.errors import UnknownName, refusing

LOSSES = ("gaussian", "huber", "student")  # Costs of a residual, explained in fitting/nlp/loss.py


def setting(default: Any, words: str, **more: Any) -> Any:
    """A field of a dataclass of settings, of which options of a command and keys of its settings file are made
    (``mmg_ident.settings``): its ``default``, what it is in ``words``, and more: limits "gt", "ge", "lt", "le" or
    "choices", the name of its "option" where that is not its own, and the "count" of its numbers."""
    return field(default=default, metadata={"help": words, **more})


@refusing
@dataclass(frozen=True)
class Settings:
    """How to calibrate."""

    window: float | None = setting(None, "Window length [s]; default 100 steps.", gt=0)
    step: float | None = setting(None, "Step of integration [s]; default 0.05 L/U.", gt=0)
    interval: int = setting(5, "Runge-Kutta steps per shooting interval.", ge=1, le=100)
    passes: int = setting(3, "Solves; the noise is estimated anew between them.", ge=1)
    starts: int = setting(1, "Starts of the last solve.", ge=1)
    workers: int = setting(1, "Processes over which tasks are spread.", ge=1)
    seed: int = setting(0, "Seed of the random starts.")
    tolerance: float = setting(1e-6, "Of IPOPT.", gt=0)
    max_iterations: int = setting(300, "Limit of IPOPT per solve.", ge=0)
    time_limit: float | None = setting(None, "Limit of the calibration [s].", gt=0)
    sigma: tuple[float, ...] | None = setting(None, "Sigma of x,y,psi,u,v,r; default estimated.", count=6)
    compiled: bool = setting(True, "Use a C compiler if there is one.")
    loss: str = setting("gaussian", "Cost: gaussian, huber, student.", choices=LOSSES)
    weight: float = setting(1.0, "Share of a run's information that counts.", option="--run-weight", gt=0, le=1)


@refusing
@dataclass(frozen=True)
class Rules:
    """How the polynomials of all candidates for a structure are generated."""

    order: int = setting(3, "Highest order of the polynomials.")
    actuators: str | None = setting(None, "Such as 'n+n_2, delta', + mirrors; default the ship's.")
    asymmetric: bool = setting(False, "Port and starboard differ: keep all.")
    duplicates: str = setting("paper", "Left out of sin^2 + cos^2: paper, identity, none.")
    moduli: str = setting("paper", "Squares as moduli: paper, full, none.")
    hard: bool = setting(False, "Sub-models switch at once, not blended.")


@refusing
@dataclass(frozen=True)
class Wish:
    """What is asked of a planned trial.

    area: "60x25" [m]; seconds: how long [s]; coefficients: symbols, parts of the ship or "all"; figures: of
    ``fitting.design.plan.FIGURES``; rudder_limit: largest angle ordered [rad], that of merchant ships at full rudder
    (SOLAS II-1, 29); time_limit: set by hand.
    """

    area: str
    seconds: float
    coefficients: tuple[str, ...] = setting((), "Symbols, hull, propeller, rudder or all; default hull.")
    figures: tuple[str, ...] = setting((), "Instead: advance, tactical_diameter, first_overshoot_10, ...")
    speed_limit: float | None = setting(None, "Highest [m/s]; default that of the trials.")
    margin: float | None = setting(None, "From the edges [m]; default half a beam.")
    seed: int = setting(0, "Seed of all random numbers.", ge=0)
    effort: float = setting(1.0, "Factor on the length of the search.", gt=0, le=100)
    rudder_limit: float = math.radians(35.0)
    time_limit: float = setting(150.0, "Limit of the search [s].", gt=0)
    workers: int = setting(1, "Processes over which tasks are spread.", ge=1)


@dataclass(frozen=True)
class Start:
    """One start of the multi-start: seed number, objective, whether it converged, largest |p - p_best|.

    restarted: it was solved again with damping; apart: for one in another optimum, the coefficients that differ most
    from the best start's, in prior standard deviations.
    """

    number: int
    objective: float
    converged: bool
    distance: float
    restarted: bool = False
    apart: dict[str, float] = field(default_factory=dict)


ESTIMATORS = ("both", "windows")  # The mean of two estimates (``fitting.calibration``), or multiple shooting alone


def check_estimator(name: str) -> None:
    """Raises UserError unless ``name`` is one of ESTIMATORS."""
    if name not in ESTIMATORS:
        raise UnknownName(f"estimator {name}: unknown; choose one of {', '.join(ESTIMATORS)}")
