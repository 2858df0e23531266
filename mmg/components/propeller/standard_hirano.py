"""Standard MMG propeller (see ``standard``) with the wake of Hirano type.

w_P = w_P0 - tau |a| - tau_a a - C_P a^2, a = v' + x_P' r', as in ``hachii``.
"""

from functools import partial

from mmg.components.propeller import standard, wake

PARTICULARS, INPUTS = standard.PARTICULARS, standard.INPUTS

coefficients = partial(standard.coefficients_with, wake.HIRANO)
force = partial(standard.force_with, wake.hirano)
