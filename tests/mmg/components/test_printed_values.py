"""Printed coefficients as they act: wind loading by ship type, the torque of B4-70, the side force of one screw."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mmg.components.coefficients import names
from mmg.components.propeller import four_quadrant, hachii
from mmg.components.wind import blendermann
from mmg.motion.flow import Flow
from mmg.motion.smooth import Exact

# Wind: Blendermann (1994), the table that the Marine Systems Simulator prints; mean values where it gives a range

LOADING = """
car carrier                          | 0.95 0.55  0.60  0.80 1.2
cargo vessel loaded                  | 0.85 0.65  0.55  0.40 1.7
cargo vessel with containers on deck | 0.85 0.55  0.50  0.40 1.4
container ship loaded                | 0.90 0.55  0.55  0.40 1.4
destroyer                            | 0.85 0.60  0.65  0.65 1.1
diving support vessel                | 0.90 0.60  0.80  0.55 1.7
drilling vessel                      | 1.00 0.85  0.925 0.10 1.7
ferry                                | 0.90 0.45  0.50  0.80 1.1
fishing vessel                       | 0.95 0.70  0.70  0.40 1.1
gas carrier                          | 0.70 0.60  0.65  0.50 1.1
offshore supply vessel               | 0.90 0.55  0.80  0.55 1.2
passenger liner                      | 0.90 0.40  0.40  0.80 1.2
research vessel                      | 0.85 0.55  0.65  0.60 1.4
speed boat                           | 0.90 0.55  0.60  0.60 1.1
tanker loaded                        | 0.70 0.90  0.55  0.40 3.1
tanker in ballast                    | 0.70 0.75  0.55  0.40 2.2
tender                               | 0.85 0.55  0.55  0.65 1.1
""".strip().splitlines()
WORKS = SimpleNamespace(A_T=300.0, A_L=1000.0, L_OA=120.0, C=3.0, rho_a=1.2)


@pytest.mark.parametrize("line", LOADING, ids=lambda line: line.split("|")[0].strip())
def test_the_wind_force_of_each_type_of_ship_has_its_printed_coefficients(line: str) -> None:
    """Ahead and astern the drag on A_T, abeam that on A_L, at 45 degrees the cross-force parameter; heeling lever."""
    name, numbers = line.split("|")
    side, bow, stern, cross, heel = map(float, numbers.split())
    c = names({row.symbol: row.value for row in blendermann.coefficients_of(name.strip())})

    def at(degrees: float) -> tuple[float, float]:
        a = math.radians(degrees)
        force = blendermann.force(
            Flow(u=0.0, v=0.0, r=0.0, a_x=-10 * math.cos(a), a_y=10 * math.sin(a)), WORKS, c, Exact()
        )
        return float(force.X) / 60.0, float(force.Y) / 60.0

    assert at(0)[0] == pytest.approx(-bow * 300) and at(180)[0] == pytest.approx(stern * 300)
    assert at(90)[1] == pytest.approx(side * 1000)
    weaker = 1 - cross / 2 * (1 - bow * 0.3 / side)
    assert at(45)[1] == pytest.approx(side * 1000 * math.sqrt(0.5) / weaker)
    assert c.kappa_A == heel
    assert set(blendermann.TYPES) == {row.split("|")[0].strip() for row in LOADING}


# Propeller: van Lammeren, van Manen & Oosterveld (1969), B4-70 with P/D = 1.0


def coefficient(beta: float, A: tuple[float, ...], B: tuple[float, ...]) -> float:
    k = np.arange(len(A))
    return float(np.array(A) @ np.cos(k * beta) + np.array(B) @ np.sin(k * beta))


THRUST, TORQUE = (four_quadrant.A_T, four_quadrant.B_T), (four_quadrant.A_Q, four_quadrant.B_Q)


@pytest.mark.parametrize("beta", np.linspace(-3.1, 3.1, 23))
def test_thrust_and_torque_are_the_sums_of_their_harmonics(beta: float) -> None:
    """V_r^2 C* with the harmonics evaluated one by one: by sines and cosines of k beta, not by a recursion."""
    V_A, tip = 2.0 * math.sin(beta), 2.0 * math.cos(beta)
    for A, B in (THRUST, TORQUE):
        expected = 4.0 * coefficient(beta, A, B)
        assert float(four_quadrant.series(V_A, tip, A, B, Exact())) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    # of thrust the factor, at twice the diameter and n = 1 another angle
    expected = 3 * math.pi / 2 * (V_A**2 + (1.4 * math.pi) ** 2) * coefficient(math.atan2(V_A, 1.4 * math.pi), *THRUST)
    assert float(four_quadrant.thrust(V_A, 1.0, 2.0, 3.0)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("J", [0.2, 0.4, 0.6, 0.8])
def test_a_screw_reaches_most_of_the_ideal_efficiency_and_never_more(J: float) -> None:
    """eta_0 = J K_T / (2 pi K_Q) is 0.6 to 0.75 of that of an actuator disc, 2 / (1 + sqrt(1 + 8 K_T / (pi J^2)))."""
    K_T, K_Q = (
        math.pi / 8 * float(four_quadrant.series(J, 0.7 * math.pi, *each, Exact())) for each in (THRUST, TORQUE)
    )
    ideal = 2 / (1 + math.sqrt(1 + 8 * K_T / (math.pi * J**2)))
    assert 0.6 < J * K_T / (2 * math.pi * K_Q) / ideal < 0.75


def test_the_printed_harmonics_are_all_there() -> None:
    """Sums that no wrong digit or sign leaves unchanged, of the four rows as printed (in 1e-8)."""
    sums = [round(1e8 * sum(k * value for k, value in enumerate(row, start=1))) for row in (*THRUST, *TORQUE)]
    assert sums == [79546935, -75064575, 11573665, -10054194]


# Side force of the reversing propeller (Hachii 2004)


def test_the_side_force_of_one_right_handed_screw_is_the_printed_one() -> None:
    values = {row.symbol: row.value for row in hachii.COEFFICIENTS}
    A = [-7.90e-5, 7.99e-3, -4.93e-3, -5.87e-3, -5.58e-4, 5.08e-3, 1.70e-3, 9.16e-4]
    B = [3.50e-5, -3.17e-3, 1.96e-3, 2.33e-3, 2.25e-4, -2.16e-3, 6.27e-5, 6.25e-5]
    assert [values[f"A_{i}"] for i in range(1, 9)] == A
    assert [values[f"B_{i}"] for i in range(1, 9)] == B
