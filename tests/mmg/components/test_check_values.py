"""Published check values of ESSO OSAKA 3 m: forces, accelerations, wind, cross-flow (Miyauchi et al. 2022).

The numbers come from running the public simulator. The exact branches must reproduce them; the smooth model
deviates by stated amounts.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.components.coefficients import names
from mmg.components.hull import harbour, unified
from mmg.components.hull.unified import cross_flow
from mmg.components.wind import fujiwara
from mmg.model import Model, assemble
from mmg.motion.flow import Flow
from mmg.motion.frames import wind_vector
from mmg.motion.smooth import Exact, Smooth
from tests.support.force_numbers import particulars_and_coefficients, table_values, xyn

SHIP = load_ship("esso_osaka_3m")

# u, v [m/s], r [rad/s], n [1/s], rudder [deg] of rows 1 to 6.
MOTIONS = (
    (0.3, 0.0, 0.0, 10, 0), (0.3, -0.05, 0.03, 10, 20), (0.2, 0.1, -0.05, -10, -30), (-0.1, 0.05, 0.02, 10, 15),
    (-0.15, -0.05, 0.02, -8, 15), (0.0, 0.0, 0.05, 10, 35),
)  # fmt: skip
ACCELERATIONS = (
    (1.730580e-3, 0.0, 0.0), (-1.499789e-3, 2.393777e-3, 2.630696e-3), (-1.344432e-2, -1.342714e-2, 6.278277e-3),
    (6.929676e-3, -2.835568e-3, 1.095844e-3), (-1.824839e-3, 6.101366e-3, -8.846714e-3),
    (4.446776e-3, -2.265330e-4, -8.939005e-4),
)  # fmt: skip
# X, Y [N], N [N m] per component and row, printed with five decimals; no wind force is printed for row 6.
FORCES = {
    "hull": ((-0.57966, 0.0, 0.0), (-0.59185, 4.20008, 0.26272), (-0.27232, -8.71524, 0.44727),
             (0.09482, -1.92093, 0.04225), (0.22738, 1.67764, -1.73546), (0.0, 0.0, -0.40246)),
    "propeller": ((1.0814, 0.0, 0.0), (0.95212, 0.0, 0.0), (-1.24716, -0.42097, 0.50338),
                  (1.41518, 0.08535, 0.00796), (-0.32226, -0.07587, 0.09178), (1.27043, 0.0, 0.0)),
    "rudder": ((0.0, 0.0, 0.0), (-0.08898, -0.42043, 0.61286), (-0.00238, 0.00707, -0.01031),
               (-0.01016, -0.06524, 0.09509), (0.03843, 0.24665, -0.35954), (-0.05238, -0.12864, 0.18752)),
    "wind": ((-0.00543, 0.0, 0.0), (-0.00566, 0.00483, 0.0025), (-0.00317, -0.0074, -0.00328),
             (0.00077, -0.00185, 0.00117), (0.00153, 0.00256, -0.00174)),
}  # fmt: skip

LAST_DIGIT = 0.5e-5 * (1 + 1e-6)  # Half a unit of the last printed decimal of a force
EXACT_TOLERANCE = 1e-5

SMOOTH_TOLERANCES = (1e-3, 1e-3, 2e-3, 2e-4, 5e-5, 5e-2)
"""Relative deviation of the smooth model's accelerations per row, each component by its own printed value.

Measured largest deviation, and its cause found by making one blend at a time exact:
row 1  6.6e-4 surge: share of the astern resistance; |beta| is held above 1 mm/s over 0.3 m/s
row 2  7.0e-4 yaw: wake; |v' + x_P' r'| rounded over 0.01 and U over 10 mm/s, through the rudder inflow
row 3  1.2e-3 surge: J_s = -0.238 sits on the branch point C_10 = -0.233 of reverse thrust, blended over 0.02
row 4  1.1e-4 yaw: U_R at the rudder and |u| in N_H, rounded over 1 mm/s
row 5  2.1e-5 surge: U_A of the wind rounded over 10 mm/s, U of the hull over 1 mm/s
row 6  4.3e-2 sway: u = 0 sits on the branch point of headway: 4.7 % of the side force in sternway is there;
       in units of the row's largest force over the mass this is 1.9e-3
"""

# Largest deviation of a component of the smooth model by the largest force of its row (row 6: 3.7e-3).
SMOOTH_FORCE_TOLERANCE = 5e-3


@cache
def model(exact: bool) -> Model:
    return assemble(SHIP, exact=exact)


def arguments(row: int, wind: tuple[float, float] = (0.0, 0.0)) -> tuple[list[float], list[float], np.ndarray]:
    """State, controls and coefficients of a row; wind = (speed [m/s], coming-from direction [rad])."""
    u, v, r, n, degrees = MOTIONS[row]
    return [0, 0, 0, u, v, r], [n, np.radians(degrees), *wind_vector(*wind)], SHIP.values


def accelerations(row: int, exact: bool) -> np.ndarray:
    return np.array(model(exact).rates(*arguments(row))).ravel()[3:]


def components(row: int, exact: bool, **wind: tuple[float, float]) -> dict[str, np.ndarray]:
    chosen = model(exact)
    return dict(zip(chosen.roles, np.array(chosen.forces(*arguments(row, **wind))), strict=True))


def reference_quadrature_error() -> float:
    """Error of the reference's Simpson rule on 100 points in I_Y of row 6 [m^2/s^2]; I_Y itself is zero.

    Ninety-nine intervals are odd in number: the rule is Simpson on the first 98, and the parabola through
    the last three points on the last one, so that an antisymmetric integrand leaves a remainder.
    """
    _, v, r, *_ = MOTIONS[5]
    b = SHIP.coefficients["C_rY"].value * r * SHIP.particulars["L"]
    xi, h = np.linspace(-0.5, 0.5, 100, retstep=True)
    f = np.abs(v + b * xi) * (v + b * xi)
    simpson = h / 3 * (f[0] + 4 * f[1:98:2].sum() + 2 * f[2:97:2].sum() + f[98])
    return float(simpson + h * (5 * f[99] + 8 * f[98] - f[97]) / 12)


def expected_accelerations(row: int) -> np.ndarray:
    """Published accelerations, row 6 without the reference's quadrature error."""
    published = np.array(ACCELERATIONS[row])
    if row == 5:
        p, c = SHIP.particulars, {name: c.value for name, c in SHIP.coefficients.items()}
        unit = 0.5 * p["rho"] * p["L"] * p["d"]
        mass = p["m"] + c["m_y"] * unit * p["L"]
        inertia = c["I_J_z"] * unit * p["L"] ** 3 + p["x_G"] ** 2 * p["m"]
        determinant = mass * inertia - (p["x_G"] * p["m"]) ** 2
        excess = -c["C_D"] * unit * reference_quadrature_error()
        published[1] -= excess * inertia / determinant
    return published


@pytest.mark.parametrize("row", range(6))
def test_exact_accelerations_agree_with_the_published_ones_to_1e_5(row: int) -> None:
    np.testing.assert_allclose(accelerations(row, True), expected_accelerations(row), rtol=EXACT_TOLERANCE, atol=1e-15)


def test_row_6_sway_needs_the_quadrature_error_of_the_reference() -> None:
    """As printed it deviates by 2.3e-5: the reference's Simpson rule leaves 9.5e-9 m^2/s^2 where 0 is due.

    The closed form leaves none; the sway acceleration of this row is small, so the remainder shows.
    """
    assert reference_quadrature_error() == pytest.approx(9.4979e-9, rel=1e-3)
    deviation = accelerations(5, True)[1] / ACCELERATIONS[5][1] - 1
    assert 2e-5 < abs(deviation) < 2.5e-5
    assert accelerations(5, True)[1] == pytest.approx(expected_accelerations(5)[1], rel=EXACT_TOLERANCE)


@pytest.mark.parametrize(("role", "row"), [(role, row) for role, rows in FORCES.items() for row in range(len(rows))])
def test_exact_forces_agree_with_the_published_ones_to_the_last_printed_digit(role: str, row: int) -> None:
    np.testing.assert_allclose(components(row, True)[role], FORCES[role][row], rtol=0, atol=LAST_DIGIT)


@pytest.mark.parametrize("row", range(6))
def test_smooth_accelerations_agree_with_the_published_ones_to_the_stated_tolerance(row: int) -> None:
    published = np.array(ACCELERATIONS[row])
    np.testing.assert_allclose(accelerations(row, False), published, rtol=SMOOTH_TOLERANCES[row], atol=1e-15)


@pytest.mark.parametrize("row", range(6))
def test_smooth_forces_agree_with_the_exact_ones_by_the_largest_of_the_row(row: int) -> None:
    exact, smooth = components(row, True), components(row, False)
    largest = max(np.abs(force).max() for force in exact.values())
    for role, force in exact.items():
        np.testing.assert_allclose(smooth[role], force, rtol=0, atol=SMOOTH_FORCE_TOLERANCE * largest)


@pytest.mark.parametrize(("exact", "tolerance"), [(True, LAST_DIGIT), (False, 2e-5)])
def test_wind_force_in_true_wind_from_60_degrees(exact: bool, tolerance: float) -> None:
    """Row 2 with 1.5 m/s true wind. The smooth model rounds U_A over 10 mm/s: 1.9e-5 relative in Y_A."""
    wind = components(1, exact, wind=(1.5, np.radians(60.0)))["wind"]
    np.testing.assert_allclose(wind, (-0.13406, -0.70057, -0.20012), rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("symbol", "value"),
    [
        ("X_A0", -0.0104662), ("X_A1", -0.8219920), ("X_A3", 0.0602736), ("X_A5", 0.0445582),
        ("Y_A1", 1.0581721), ("Y_A3", 0.0023215), ("Y_A5", -0.0152935),
        ("N_A1", -0.0307278), ("N_A2", 0.1041164), ("N_A3", -0.0008803),
    ],
)  # fmt: skip
def test_fujiwara_regression_gives_the_published_coefficients(symbol: str, value: float) -> None:
    assert fujiwara.regression(names(dict(SHIP.particulars)))[symbol] == pytest.approx(value, abs=0.51e-7)
    assert SHIP.coefficients[symbol].value == pytest.approx(value, abs=0.51e-7)


@pytest.mark.parametrize(
    ("degrees", "published"),
    [
        (0, (-0.7276, 0, 0)), (30, (-0.7609, 0.5238, 0.0739)), (60, (-0.4595, 0.9296, 0.0636)),
        (90, (-0.0105, 1.0406, -0.0298)), (120, (0.4385, 0.9296, -0.1168)), (150, (0.7400, 0.5238, -0.1064)),
        (180, (0.7067, 0, 0)),
    ],
)  # fmt: skip
def test_wind_series_by_apparent_angle(degrees: float, published: tuple[float, float, float]) -> None:
    """Angle counter-clockwise from the bow: U_A cos = -a_x, U_A sin = a_y; from port it pushes right."""
    angle, speed = np.radians(degrees), 7.0
    flow = Flow(u=0.0, v=0.0, r=0.0, a_x=-speed * np.cos(angle), a_y=speed * np.sin(angle))
    p, coefficients = particulars_and_coefficients("esso_osaka_3m")
    pressure = 0.5 * p.rho_a * speed**2
    units = pressure * np.array([p.A_T, p.A_L, p.A_L * p.L])
    for smoothing, tolerance in ((Exact(), 0.51e-4), (Smooth(), 0.55e-4)):
        got = xyn(fujiwara.force(flow, p, coefficients, smoothing)) / units
        np.testing.assert_allclose(got, published, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("a", "b", "published_Y", "published_N"),
    [
        (0.1, 0.3, 0.01722222, 0.00512731), (0.0, 0.3, 0.0, 0.0028125), (-0.1, 0.15, -0.011875, 0.0025),
        (-0.03, 0.9, -0.01352, 0.02553733),
    ],
)  # fmt: skip
@pytest.mark.parametrize(("width", "tolerance"), [(1e-6, 0.51e-8), (1e-3, 2e-8)])
def test_cross_flow_closed_form_check_values(
    a: float, b: float, published_Y: float, published_N: float, width: float, tolerance: float
) -> None:
    I_Y, I_N = (float(ca.DM(value)) for value in cross_flow(a, b, width))
    assert published_Y == pytest.approx(I_Y, abs=tolerance)
    assert published_N == pytest.approx(I_N, abs=tolerance)


@pytest.mark.parametrize("s", [Exact(), Smooth.for_length(76.2)])
def test_linear_damping_of_a_supply_vessel_is_added_to_the_unified_hull(s: Exact | Smooth) -> None:
    """Fossen et al. (1996): 0.0358, 0.1183, 0.0308 by m sqrt(g/L), m L^2 sqrt(g/L), here rounded to two digits."""
    p = names({"L": 76.2, "d": 6.25, "rho": 1025.0})
    c, motion = table_values(harbour.COEFFICIENTS), np.array([0.3, -0.2, 0.01])
    flow = Flow(*motion)
    added = xyn(harbour.force(flow, p, c, s)) - xyn(unified.force(flow, p, c, s))
    published = 6000e3 * np.sqrt(9.81 / 76.2) * np.array([0.0358, 0.1183, 0.0308 * 76.2**2])
    np.testing.assert_allclose(added, -published * motion, rtol=0.01)
