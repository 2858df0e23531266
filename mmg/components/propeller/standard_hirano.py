"""Standard MMG propeller (see ``standard``) with the wake of Hirano type.

w_P = w_P0 - tau |a| - tau_a a - C_P a^2, a = v' + x_P' r', as in ``hachii``.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

from mmg.components.coefficients import Coefficient
from mmg.components.propeller import standard, wake

PARTICULARS, INPUTS = standard.PARTICULARS, standard.INPUTS


def coefficients(p: SimpleNamespace) -> tuple[Coefficient, ...]:
    """Coefficients of thrust and wake. p: particulars."""
    return standard.coefficients_with(wake.HIRANO, p) + wake.ASYMMETRY


force = partial(standard.force_with, wake.hirano)
