"""Standard MMG propeller (see ``standard``) with the wake of Kijima et al. (1990): w_P = w_P0 exp(-4 beta_P^2)."""

from __future__ import annotations

from types import SimpleNamespace

from mmg.components.coefficients import Coefficient
from mmg.components.propeller import standard, wake
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = standard.PARTICULARS
INPUTS = standard.INPUTS


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Coefficients with their defaults; beta_t from the pitch ratio. p: particulars."""
    return standard.coefficients_with(wake.KIJIMA, p)


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Propeller force [N, N, N m] and slipstream. flow, p, c, s: as in mmg/motion/flow.py."""
    return standard.thrust(flow, wake.kijima(flow, p, c, s), p, c, s)
