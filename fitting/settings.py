"""How to calibrate: the settings of ``estimate_coefficients`` and what a start of it ended with."""

from __future__ import annotations

from dataclasses import dataclass, field

from mmg.errors import UserError


@dataclass(frozen=True)
class Settings:
    """How to calibrate.

    window: length of a window [s], None: the horizon; horizon: time over which the calibrated ship is to predict [s],
    None: 100 steps; step: integration and sampling step [s], None: ``default_step``;
    interval: Runge-Kutta steps per shooting interval; passes: solves, the noise being re-estimated between them;
    starts: of the last solve, all but the first random; workers: processes over which further starts are spread;
    tolerance, max_iterations, time_limit [s, of the whole calibration]: of IPOPT; sigma: fixed residual standard
    deviations (6,) instead of estimated ones; compiled: use a C compiler if there is one; loss: cost of residuals, one
    of ``loss.LOSSES``; weight: share of its information with which a run counts, 1: as its residuals say.
    """

    window: float | None = None
    horizon: float | None = None
    step: float | None = None
    interval: int = 5
    passes: int = 3
    starts: int = 1
    workers: int = 1
    seed: int = 0
    tolerance: float = 1e-6
    max_iterations: int = 300
    time_limit: float | None = None
    sigma: tuple[float, ...] | None = None
    compiled: bool = True
    loss: str = "gaussian"
    weight: float = 1.0


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
"""The mean of two estimates (``fitting.selection.two_estimates``), or multiple shooting alone."""


def check_estimator(name: str) -> None:
    """Raises UserError unless ``name`` is one of ESTIMATORS."""
    if name not in ESTIMATORS:
        raise UserError(f"estimator {name}: unknown; choose one of {', '.join(ESTIMATORS)}")
