"""How to calibrate: the settings of ``estimate_coefficients`` and what a start of it ended with."""

from __future__ import annotations

from dataclasses import dataclass, field

from mmg.errors import UnknownName

LOSSES = ("gaussian", "huber", "student")
"""Costs of a residual, explained in fitting/nlp/loss.py."""


@dataclass(frozen=True)
class Settings:
    """How to calibrate.

    The metadata of a field say in "help" what it is, and within which limits it lies: the options of ``mmg fit`` and
    the keys of its settings file are made from them (``mmg_ident.settings``).
    """

    window: float | None = field(default=None, metadata={"help": "Window length [s]; default 100 steps.", "gt": 0})
    step: float | None = field(default=None, metadata={"help": "Step of integration [s]; default 0.05 L/U.", "gt": 0})
    interval: int = field(default=5, metadata={"help": "Runge-Kutta steps per shooting interval.", "ge": 1})
    passes: int = field(default=3, metadata={"help": "Solves; the noise is estimated anew between them.", "ge": 1})
    starts: int = field(default=1, metadata={"help": "Starts of the last solve.", "ge": 1})
    workers: int = field(default=1, metadata={"help": "Processes over which tasks are spread.", "ge": 1})
    seed: int = field(default=0, metadata={"help": "Seed of the random starts."})
    tolerance: float = field(default=1e-6, metadata={"help": "Of IPOPT.", "gt": 0})
    max_iterations: int = field(default=300, metadata={"help": "Limit of IPOPT per solve.", "ge": 0})
    time_limit: float | None = field(default=None, metadata={"help": "Limit of the calibration [s].", "gt": 0})
    sigma: tuple[float, ...] | None = field(
        default=None, metadata={"help": "Sigma of x,y,psi,u,v,r; default estimated.", "count": 6}
    )
    compiled: bool = field(default=True, metadata={"help": "Use a C compiler if there is one."})
    loss: str = field(default="gaussian", metadata={"help": "Cost: gaussian, huber, student.", "choices": LOSSES})
    weight: float = field(
        default=1.0,
        metadata={"help": "Share of a run's information that counts.", "option": "--run-weight", "gt": 0, "le": 1},
    )


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


ESTIMATORS = ("both", "windows")
"""The mean of two estimates (``fitting.calibration``), or multiple shooting alone."""


def check_estimator(name: str) -> None:
    """Raises UserError unless ``name`` is one of ESTIMATORS."""
    if name not in ESTIMATORS:
        raise UnknownName(f"estimator {name}: unknown; choose one of {', '.join(ESTIMATORS)}")
