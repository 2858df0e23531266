"""Actuators that follow orders, play, and the roll option, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.simulate import simulate
from mmg.components.roll import linear
from mmg.model import assemble
from mmg.motion.flow import Flow, Force
from mmg.motion.froude import GRAVITY
from mmg.motion.memory import Memory, clip
from mmg.ship import Ship

ESSO = load_ship("esso_osaka_3m")


def with_role(ship: Ship, role: str, name: str, **particulars: float) -> Ship:
    """The ship with one more component at its default coefficients."""
    return replace(ship, particulars={**ship.particulars, **particulars}).with_models(**{role: name})


def test_the_clip_is_smooth_and_stays_within_its_limits() -> None:
    x = np.linspace(-1, 1, 2001)
    y = np.array([float(clip(v, 0.05, 2e-3)) for v in x])
    assert np.abs(y).max() <= 0.05 + 1e-12
    inside = np.abs(x) < 0.03
    np.testing.assert_allclose(y[inside], x[inside], atol=1e-3)


@pytest.mark.parametrize("name", ["rate_limited", "lag"])
def test_a_ship_with_actuators_follows_orders(name: str) -> None:
    """Orders are steps in the trial; the ship turns later than with an ideal rudder, and it is a ship file."""
    ship = parse_ship(dump_ship(with_role(ESSO, "actuators", name)))
    model = assemble(ship)
    assert model.states[6:] == ("delta", "n")
    plan = parse_maneuver("turning:35", ship, n=10.0, duration=40.0)
    turned = simulate(ship, plan)
    assert set(np.round(np.unique(turned["delta"]), 12)) == {0.0, round(math.radians(35), 12)}
    ideal = simulate(ESSO, plan)
    assert turned["r"][60] < ideal["r"][60]
    assert turned["r"][-1] == pytest.approx(ideal["r"][-1], rel=0.02)


# Roll

ROLLING = with_role(ESSO, "roll", "linear", GM=0.02)


def test_the_steady_heel_balances_the_moments() -> None:
    plan = parse_maneuver("turning:35", ROLLING, n=10.0, duration=200.0)
    run, plain = simulate(ROLLING, plan), simulate(ESSO, plan)
    assert np.array_equal(run["r"], plain["r"])
    model = assemble(ROLLING)
    state = np.array([0, 0, 0, run["u"][-1], run["v"][-1], run["r"][-1], run["phi"][-1], run["p"][-1]])
    forces = np.array(model.forces(state, [10.0, run["delta"][-1], 0, 0], ROLLING.values))
    c = {s: ROLLING.coefficients[s].value for s in ("z_H", "z_R", "z_A", "z_G")}
    by_role = dict(zip(model.roles, forces[:, 1], strict=True))
    K = -(c["z_H"] * by_role["hull"] + c["z_R"] * by_role["rudder"] + c["z_A"] * by_role["wind"])
    heel = K / (ROLLING.particulars["m"] * GRAVITY * 0.02)
    assert math.sin(run["phi"][-1]) == pytest.approx(heel, rel=1e-3)
    assert run["phi"][-1] != 0


def test_the_rate_of_roll_is_that_of_its_equation() -> None:
    """At one moving, heeled and rolling state, with a centre of gravity below the waterline, worked out by hand."""
    p = SimpleNamespace(m=500.0, GM=0.03, B=0.6, d=0.2)
    c = SimpleNamespace(k_x_roll=0.24, zeta_roll=0.08, z_H=0.1, z_R=0.12, z_A=-0.3, z_G=0.05)
    parts = {
        role: Force(0, Y, 0) for role, Y in zip(("hull", "rudder", "wind", "propeller"), (7, -3, 2, 50), strict=True)
    }
    memory = Memory()
    linear.roll(Flow(u=0.8, v=-0.1, r=0.2), parts, 0.3, memory, p, c)
    rates = ca.Function("f", memory.symbols, [ca.vertcat(*memory.rates)])(0.2, 0.4)
    inertia, stiffness = 500.0 * 0.24**2, 500.0 * GRAVITY * 0.03
    K = -(0.1 * 7.0 + 0.12 * -3.0 - 0.3 * 2.0) + 500.0 * 0.05 * (0.3 + 0.8 * 0.2)
    moment = K - 2 * 0.08 * math.sqrt(inertia * stiffness) * 0.4 - stiffness * math.sin(0.2)
    assert np.array(rates).ravel() == pytest.approx([0.4, moment / inertia])
    assert memory.names == ["phi", "p"] and memory.targets == [0.0, 0.0]
