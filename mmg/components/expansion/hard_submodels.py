"""Generated polynomial about rest with hard sub-models: as ``smooth_submodels``, but conditions switch at once.

As the algorithms of Miyauchi et al. (2023) do. The force jumps where a condition changes; a fit by derivatives takes
``smooth_submodels``, and this model is for comparing with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

from mmg.components.coefficients import Coefficient
from mmg.components.expansion.series import series_force
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("L", "d", "rho")
COEFFICIENTS: tuple[Coefficient, ...] = ()


def force(
    flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing, monomials: Mapping[str, str] | None = None
) -> Force:
    """Sum of the terms [N, N, N m]. flow, p, c, s: as in mmg/motion/flow.py; monomials: by symbol of coefficient."""
    return series_force(flow, p, c, s, monomials or {}, hard=True)
