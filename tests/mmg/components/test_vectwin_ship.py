"""VecTwin ship of 3 m: symmetry, the two rudders as blades, the ship file and motion."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases.shipfiles.ship_file import dump_ship, parse_ship
from mmg.components.propeller import kang
from mmg.components.rudder import vectwin
from mmg.rollout import Simulator
from tests.mmg.components.test_vectwin import EXACT, SHIP, SMOOTH, C, P, flow, forces
from tests.support.force_numbers import xyn

# Symmetry


def mirrored() -> SimpleNamespace:
    """Coefficients whose port rudder is the mirror image of the starboard one, and a symmetric wake."""
    c = dict(vars(C), b_1=0.0, d_1=0.0)
    odd_powers = {"a": (1, 3), "b": (0, 1), "e": (0, 1, 2), "h": (0, 1, 2)}
    for letter in "abdeghk":
        for i in range(len([n for n in c if n.startswith(f"{letter}s_")])):
            sign = -1 if i in odd_powers.get(letter, ()) else 1
            c[f"{letter}p_{i}"] = sign * c[f"{letter}s_{i}"]
    for start, image in ((0, 12), (4, 8), (8, 4), (12, 0)):
        for i, sign in enumerate((1, 1, -1, -1)):
            c[f"rp_{image + i}"] = sign * c[f"rs_{start + i}"]
    for start, image in ((0, 3), (1, 2), (2, 1), (3, 0)):
        c[f"Cp_{image}"] = c[f"Cs_{start}"]
    return SimpleNamespace(**c)


outward = st.floats(-35.0, 105.0)


@settings(max_examples=200, deadline=None)
@given(st.floats(-0.4, 0.5), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(-5, 15), outward, outward)
def test_mirrored_motion_gives_mirrored_forces(u: float, v: float, r: float, n: float, one: float, two: float) -> None:
    """Up to the switches that rest on one side of zero (angle of the rudder, yaw rate): beyond 5 widths of them."""
    c = mirrored()
    here = forces(flow(u, v, r, n, one, -two), c, SMOOTH)
    there = forces(flow(u, -v, -r, n, two, -one), c, SMOOTH)
    motion = flow(u, v, r, n, one, -two).with_(slipstream=here[0].slipstream)
    angles = [float(ca.DM(vectwin.inflow(motion, port, P, c, SMOOTH)[2])) for port in (False, True)]
    if min(map(abs, angles)) < 0.15 or abs(r) < 0.02:
        return
    np.testing.assert_allclose(xyn(there[0]), xyn(here[0]) * (1, -1, -1), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(xyn(there[1]), xyn(here[1]) * (1, -1, -1), rtol=1e-4, atol=1e-5)


def test_the_published_rudders_are_not_mirror_images() -> None:
    one, other = (xyn(forces(flow(0.3, 0, 0, 10, a, b), C, EXACT)[1]) for a, b in ((60, -10), (10, -60)))
    assert np.abs(other - one * (1, -1, -1)).max() > 1e-2


# Blades


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.4, 0.5), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), outward, outward)
def test_the_rudders_are_two_blades(u: float, v: float, r: float, one: float, two: float) -> None:
    _, rudders = forces(flow(u, v, r, 10, one, -two), C, SMOOTH)
    assert len(rudders.blades) == 2
    total = sum(np.array([float(ca.DM(x)) for x in (b.X, b.Y, b.N)]) for b in rudders.blades)
    np.testing.assert_allclose(total, xyn(rudders), rtol=1e-12, atol=1e-12)
    assert all(0 <= float(ca.DM(b.sin2_alpha)) <= 1 for b in rudders.blades)
    without = forces(flow(u, v, r, 10, one, -two), SimpleNamespace(**{**vars(C), "k_N": 0.0}), SMOOTH)[1]
    np.testing.assert_array_equal(xyn(without), 0.0)


def test_sine_of_the_angle_of_attack_belongs_to_its_blade() -> None:
    motion = flow(0.3, 0, 0, 10, 20, 20)
    for blade, degrees in zip(forces(motion, C, EXACT)[1].blades, (23.53, 14.56), strict=True):
        assert float(ca.DM(blade.sin2_alpha)) == pytest.approx(np.sin(np.radians(degrees)) ** 2, abs=2e-4)


# The ship


def test_ship_file_is_complete_and_returns_unchanged() -> None:
    assert SHIP.notices == ()
    assert SHIP.actuators == ("n", "delta_port", "delta_starboard", "n_bow")
    again = parse_ship(dump_ship(SHIP))
    assert again.coefficients == SHIP.coefficients and again.particulars == SHIP.particulars


def test_defaults_of_the_models_are_the_values_of_the_file() -> None:
    """The models carry the only published set; what a file leaves out is not something else."""
    for row in (*kang.COEFFICIENTS, *vectwin.COEFFICIENTS):
        assert SHIP.coefficients[row.symbol].value == row.value
        assert SHIP.coefficients[row.symbol].fixed == row.fixed


def test_empirical_cross_flow_coefficients_are_those_of_the_file() -> None:
    assert pytest.approx(0.52 * P.L / P.B - 1.062, abs=1e-5) == C.C_rY
    assert pytest.approx(0.0742 * P.L / P.d - 0.297, abs=1e-5) == C.C_rN


def test_the_ship_turns_ahead_and_backs() -> None:
    """Rudders to starboard turn it to starboard; rudders at 105 deg take it astern from rest."""
    controls = np.zeros((6, 2))
    controls[0] = 10.0
    controls[1] = np.radians((35.0, -105.0))
    controls[2] = np.radians((35.0, 105.0))
    path = Simulator(SHIP).run(np.zeros((6, 2)), np.tile(controls, (600, 1, 1)), 0.1)
    assert path[-1, 3, 0] > 0.1 and path[-1, 5, 0] > 0.01
    assert path[-1, 3, 1] < -0.015
