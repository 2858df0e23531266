"""Standard MMG propeller (see ``standard``) with the wake of Kijima et al. (1990): w_P = w_P0 exp(-4 beta_P^2)."""

from functools import partial

from mmg.components.propeller import standard, wake

PARTICULARS, INPUTS = standard.PARTICULARS, standard.INPUTS

coefficients = partial(standard.coefficients_with, wake.KIJIMA)
force = partial(standard.force_with, wake.kijima)
