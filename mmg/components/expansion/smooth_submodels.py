"""Generated polynomial about rest with blended sub-models: hull, propeller, rudder and thrusters in one (Abkowitz-MMG).

F = 1/2 rho L d V^2 sum c_i w_i m_i for X and Y, by L more for N; V = 0.1 sqrt(g L). Each coefficient of the ship file
states its monomial m_i with the conditions w_i under which it acts, such as "ahead u |v| sin(delta_port)"; the words
are those of mmg/components/expansion/words.py. A condition is a blend, 11 mm/s wide in u and 2 deg wide in an angle for
a 3 m model. Miyauchi et al. (2023), Abkowitz-MMG hybrid model, made dimensionless by a constant speed.

Worth: as good as the trials that it was fitted to, and no better beyond them: it holds no hydrodynamics.
"""

from functools import partial

from mmg.components.coefficients import Coefficient
from mmg.components.expansion.series import series_force

PARTICULARS = ("L", "d", "rho")
COEFFICIENTS: tuple[Coefficient, ...] = ()  # each ship has her own

force = partial(series_force, hard=False)
