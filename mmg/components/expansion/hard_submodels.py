"""Generated polynomial about rest with hard sub-models: as ``smooth_submodels``, but conditions switch at once.

As the algorithms of Miyauchi et al. (2023) do. The force jumps where a condition changes; a fit by derivatives takes
``smooth_submodels``, and this model is for comparing with it.
"""

from functools import partial

from mmg.components.coefficients import Coefficient
from mmg.components.expansion.series import series_force

PARTICULARS = ("L", "d", "rho")
COEFFICIENTS: tuple[Coefficient, ...] = ()  # each ship has her own

force = partial(series_force, hard=True)
