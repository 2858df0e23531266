"""Wind force by Blendermann (1994): a few loading coefficients per ship type.

X_A = -1/2 rho_a U_A^2 A_L CD_l cos a / D,  Y_A = 1/2 rho_a U_A^2 A_L CD_t sin a / D,
N_A = Y_A L_OA [C / L_OA - 0.18 (|a| - pi / 2)],  D = 1 - delta / 2 (1 - CD_l / CD_t) sin^2 2a,
CD_l = CD_lAF A_T / A_L with the bow value of CD_lAF for wind from ahead of the beam and the stern value abaft of it.
a is the apparent wind angle counter-clockwise from the bow: U_A cos a = -a_x, U_A sin a = a_y. The two values of
CD_lAF are blended over +- 3 deg about the beam, where cos a is small. Heel (kappa) is kept for a model with roll.
Structure and rows as in the public MSS toolbox (one source).
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from mmg.components.coefficients import Coefficient, table
from mmg.motion.flow import Flow, Force
from mmg.motion.smooth import Smoothing

PARTICULARS = ("A_T", "A_L", "L_OA", "C", "rho_a")

# Ship type -> CD_t, CD_lAF of bow and stern, delta, kappa (Blendermann 1994, as in MSS).
TYPES = {
    "car carrier": (0.95, 0.55, 0.60, 0.80, 1.2),
    "cargo vessel loaded": (0.85, 0.65, 0.55, 0.40, 1.7),
    "cargo vessel with containers on deck": (0.85, 0.55, 0.50, 0.40, 1.4),
    "container ship loaded": (0.90, 0.55, 0.55, 0.40, 1.4),
    "destroyer": (0.85, 0.60, 0.65, 0.65, 1.1),
    "diving support vessel": (0.90, 0.60, 0.80, 0.55, 1.7),
    "drilling vessel": (1.0, 0.85, 0.925, 0.10, 1.7),
    "ferry": (0.90, 0.45, 0.50, 0.80, 1.1),
    "fishing vessel": (0.95, 0.70, 0.70, 0.40, 1.1),
    "gas carrier": (0.70, 0.60, 0.65, 0.50, 1.1),
    "offshore supply vessel": (0.90, 0.55, 0.80, 0.55, 1.2),
    "passenger liner": (0.90, 0.40, 0.40, 0.80, 1.2),
    "research vessel": (0.85, 0.55, 0.65, 0.60, 1.4),
    "speed boat": (0.90, 0.55, 0.60, 0.60, 1.1),
    "tanker loaded": (0.70, 0.90, 0.55, 0.40, 3.1),
    "tanker in ballast": (0.70, 0.75, 0.55, 0.40, 2.2),
    "tender": (0.85, 0.55, 0.55, 0.65, 1.1),
}

# Width of the blend of bow and stern values, in the cosine of the wind angle: 3 deg about the beam.
BEAM_WIDTH = 0.05  # set by hand: it rounds a step of the published law


def coefficients_of(ship_type: str) -> tuple[Coefficient, ...]:
    """Coefficient table for ``ship_type``, a key of ``TYPES``; KeyError with the choices for any other.

    kappa is fixed: there is no roll here.
    """
    if ship_type not in TYPES:
        raise KeyError(f"ship type {ship_type!r} is unknown; known: {', '.join(TYPES)}")
    CD_t, CD_bow, CD_stern, delta_A, kappa_A = TYPES[ship_type]
    source = f"Blendermann (1994), {ship_type}, as in MSS"
    return (
        *table(
            source,
            ("CD_t", CD_t, 0.15, 0.3, 1.5, "", "wind: transverse resistance, on A_L"),
            ("CD_bow", CD_bow, 0.15, 0.1, 1.5, "", "wind: longitudinal resistance, wind from ahead, on A_T"),
            ("CD_stern", CD_stern, 0.15, 0.1, 1.5, "", "wind: longitudinal resistance, wind from aft, on A_T"),
            ("delta_A", delta_A, 0.15, 0.0, 0.95, "", "wind: cross-force parameter"),
        ),
        *table(
            source, ("kappa_A", kappa_A, 0.3, 0.5, 4.0, "", "wind: heeling lever (no effect without roll)"), fixed=True
        ),
    )


COEFFICIENTS = coefficients_of("tanker loaded")


def force(flow: Flow, p: SimpleNamespace, c: SimpleNamespace, s: Smoothing) -> Force:
    """Wind force X, Y [N], N [N m] about midship of the air velocity relative to the ship; zero in still air. flow, p,
    c, s: as in mmg/motion/flow.py."""
    squared = flow.a_x**2 + flow.a_y**2
    U_A = s.root(squared, s.speed)
    cos_a, sin_a = s.divide(-flow.a_x, U_A, 0.0), s.divide(flow.a_y, U_A, 0.0)
    ahead = s.step(cos_a, BEAM_WIDTH)
    CD_l = (c.CD_stern + (c.CD_bow - c.CD_stern) * ahead) * p.A_T / p.A_L
    # of the wind angle counter-clockwise from the bow; (2 sin a cos a)^2 is sin^2 2a
    D = 1.0 - 0.5 * c.delta_A * (1.0 - CD_l / c.CD_t) * (2.0 * sin_a * cos_a) ** 2
    pressure = 0.5 * p.rho_a * squared * p.A_L
    Y = pressure * c.CD_t * sin_a / D
    # forward of midship [m]; |a|, as the point of attack is the same for wind from either side
    lever = p.C - 0.18 * (s.angle(-flow.a_x, flow.a_y, s.speed) - ca.pi / 2) * p.L_OA
    return Force(-pressure * CD_l * cos_a / D, Y, Y * lever)
