"""Effects: neutral values leave no trace, derivatives agree with finite differences, and each does what it says."""

from __future__ import annotations

import math
from dataclasses import fields
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, with_effects
from cases.shipfiles.ship_file import check_needs, load_ship
from cases.simulation.simulate import Wind, simulate, simulate_controls
from cases.trial import Trial
from mmg.components.hull import unified
from mmg.components.rigid_body import Inertia
from mmg.effects import EFFECTS
from mmg.effects.effect import Setting
from mmg.errors import UserError
from mmg.model import Model, assemble
from mmg.motion.flow import Blade, Flow, Force
from mmg.motion.froude import time_scale
from mmg.motion.memory import Memory, delayed, lagged, played, rate_limited
from mmg.motion.smooth import Smooth
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship
from tests.support.force_numbers import particulars_and_coefficients

MORE = {"velocity_filter", "gyro"}  # Effects beyond those of a diagnosis: of the measurement model
CONTRACT = {
    "current", "wind_force", "wind_sensor_bias", "shallow_water", "bank", "wave_drift", "rudder_lag",
    "rudder_backlash", "rudder_offset", "propeller_side_force", "rudder_stall", "fouling", "draft", "antenna_offset",
    "heading_bias", "log_scale", "control_delay", "gnss_delay", "hull_memory", "tow",
}  # fmt: skip

ESSO = load_ship("esso_osaka_3m")
CALM = ESSO.without("wind")
SHIPS = ("esso_osaka_3m", "kvlcc2_l7", "vectwin_3m")


def states_and_controls(ship: Ship, count: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random states (6, count) and inputs (C, count); the first few at rest, stopped, or both."""
    rng = np.random.default_rng(seed)
    k = math.sqrt(ship.particulars["L"] / 3)
    state = rng.uniform(-1, 1, (6, count)) * np.array([[9.0], [9.0], [3.0], [0.4 * k], [0.1 * k], [0.06 / k]])
    inputs = {"n": 12.0, "n_bow": 20.0, "wind_north": 2.0, "wind_east": 2.0, "time": 50.0}
    controls = np.array([rng.uniform(-1, 1, count) * inputs.get(name, 0.6) for name in ship.inputs])
    state[3:, 0] = 0.0
    state[3:, 1], controls[:, 1] = 0.0, 0.0
    controls[0, 2] = 0.0
    return state, controls


@cache
def bare(name: str) -> Model:
    return assemble(load_ship(name))


def usable(ship: Ship) -> list[str]:
    return [name for name, e in EFFECTS.items() if not e.lacking(ship.components)]


def test_the_library_has_the_effects_of_the_contract() -> None:
    assert set(EFFECTS) == CONTRACT | MORE
    for name, effect in EFFECTS.items():
        assert effect.enters
        for p in effect.parameters(ESSO.namespace, dict(ESSO.components)):
            assert p.lower < p.neutral < p.upper or p.neutral in (p.lower, p.upper), name
            assert p.typical > 0 and p.description


def test_what_belongs_to_a_place_and_what_is_an_instrument_is_neither_the_ship_nor_a_cause() -> None:
    at_a_place = {"bank", "current", "shallow_water", "tow", "wave_drift", "wind_force", "wind_sensor_bias"}
    instruments = {"antenna_offset", "gnss_delay", "gyro", "heading_bias", "log_scale", "velocity_filter"}
    assert {name for name in EFFECTS if EFFECTS[name].surroundings} == at_a_place
    assert {name for name in EFFECTS if EFFECTS[name].measures} == instruments


@pytest.mark.parametrize("ship_name", SHIPS)
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_at_its_neutral_value_an_effect_changes_nothing_to_the_last_bit(name: str, ship_name: str) -> None:
    ship = load_ship(ship_name)
    if name not in usable(ship):
        with pytest.raises(UserError, match=f"{name} needs a"):
            check_needs(ship, name, "here")
        return
    touched = ship.with_effect(name)
    plain, model = bare(ship_name), assemble(touched)
    state, controls = states_and_controls(touched)
    rng = np.random.default_rng(1)
    for z, c in zip(state.T, controls.T, strict=True):
        expected = np.array(plain.rates(z, c[: len(plain.controls)], ship.values)).ravel()
        whole = np.array(model.initial(z, c, touched.values)).ravel()
        whole[6:] += rng.normal(size=len(whole) - 6)  # whatever it remembers
        assert np.array_equal(np.array(model.rates(whole, c, touched.values)).ravel()[:6], expected)
        assert np.array_equal(np.array(model.columns(whole, touched.values)).ravel(), z)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_neutral_effect_leaves_a_synthetic_trial_as_it_is(name: str) -> None:
    plan = parse_maneuver("zigzag:20/20", ESSO, n=10.0, duration=20.0)
    plain, touched = (simulate(ship, plan, 0.1, Wind(1.0, 0.5, True), 3) for ship in (ESSO, ESSO.with_effect(name)))
    assert plain.columns.keys() == touched.columns.keys()
    for column in plain.columns:
        assert np.array_equal(plain[column], touched[column]), column


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_derivatives_are_finite_at_rest_too_and_some_parameter_has_influence(name: str) -> None:
    """Of rates and logged columns by the parameters, second ones of the rates by states and inputs; at neutral and at
    typical values."""
    rows = EFFECTS[name].parameters(ESSO.namespace, dict(ESSO.components))
    ship = ESSO.with_effect(name, {"distance": 12.0} if name == "bank" else {})
    symbols = [f"{name}.{p.symbol}" for p in rows]
    model = assemble(ship, symbols)
    z, c, q = ca.SX.sym("z", len(model.states)), ca.SX.sym("c", len(model.controls)), ca.SX.sym("q", len(symbols))
    rates = model.rates(z, c, q)
    J = ca.jacobian(ca.vertcat(rates, model.columns(z, q)), q)
    H = ca.hessian(ca.sum1(rates), ca.vertcat(z, c))[0]
    both = ca.Function("both", [z, c, q], [J, H])
    state, controls = states_and_controls(ship, 12)
    neutral, rng = np.array([ship.coefficients[s].value for s in symbols]), np.random.default_rng(2)
    for values in (neutral, neutral + np.array([p.typical for p in rows])):
        found = [both(np.zeros(z.numel()), np.zeros(c.numel()), values)]
        for column in range(state.shape[1]):
            point = np.array(model.initial(state[:, column], controls[:, column], values)).ravel()
            point[6:] += 0.1 * model.sizes * rng.normal(size=len(point) - 6)
            found.append(both(point, controls[:, column], values))
        assert all(np.isfinite(np.array(part)).all() for parts in found for part in parts)
        assert max(np.abs(np.array(first)).max() for first, _ in found) > 0, "no parameter has any influence"


# What each effect does


@lru_cache(maxsize=1)
def inputs(duration: float = 60.0, dt: float = 0.1) -> Trial:
    """A trial with a moving rudder and reversals, to be followed in open loop from headway."""
    t = np.arange(0, duration + dt / 2, dt)
    columns = dict.fromkeys(("x", "y", "psi", "v", "r"), np.zeros(len(t)))
    columns |= {"t": t, "u": np.full(len(t), 0.35), "n": np.where(t > 40, -8.0, 10.0)}
    columns["delta"] = 0.5 * np.sign(np.sin(2 * math.pi * t / 23.0 + 0.3)) * (t > 3)
    return Trial("inputs", columns)


def followed(*texts: str, ship: Ship = ESSO) -> Trial:
    return simulate_controls(with_effects(ship, texts), inputs())


def test_a_steady_current_carries_the_whole_motion_along() -> None:
    """In a uniform current the ship moves as in still water, plus the current (Galilean invariance, no air)."""
    still = simulate_controls(CALM, inputs())
    carried = inputs().with_columns(u=inputs()["u"] + 0.03, v=inputs()["v"] + 0.02)
    drifting = simulate_controls(with_effects(CALM, ["current:x=0.03,y=0.02"]), carried)
    np.testing.assert_allclose(drifting["x"], still["x"] + 0.03 * still.t, atol=1e-9)
    np.testing.assert_allclose(drifting["y"], still["y"] + 0.02 * still.t, atol=1e-9)
    np.testing.assert_allclose(drifting["r"], still["r"], atol=1e-10)


def test_a_drifting_ship_takes_up_a_changing_current() -> None:
    """x_rate is the rate of the water: a ship at rest in accelerating water is carried with it, as the water itself."""
    ship = with_effects(ESSO.with_effect("wind_force", {"X": 0, "Y": 0, "N": 0}), ["current:x=0,x_rate=0.001"])
    simulator = Simulator(ship, compiled=False)
    controls = np.zeros((200, len(ship.inputs), 1))
    controls[:, -1, 0] = np.arange(200) + 0.5
    path = simulator.run(np.zeros((6, 1)), controls, 1.0)
    assert path[-1, 3, 0] == pytest.approx(0.2, rel=1e-3)


def test_two_screws_that_turn_against_each_other_walk_by_their_difference() -> None:
    """Also by the side force that the effect brings for a propeller model without one: as of the model that has it."""
    walking = true_ship("twin")
    lent = walking.with_models(propeller="standard_kijima").with_effect("propeller_side_force", factor=1.0)
    bare = lent.without_effect("propeller_side_force")
    for n, n_2 in ((-8.0, -8.0), (-8.0, 0.0), (-4.0, -9.0)):
        still, controls = np.zeros(6), {"n": n, "n_2": n_2, "delta_port": 0.0, "delta_starboard": 0.0}
        own, added, without = (ship.rhs.forces(still, controls).loc["propeller"] for ship in (walking, lent, bare))
        np.testing.assert_allclose(added["Y [N]"], own["Y [N]"], rtol=1e-9, atol=1e-12)
        assert without["Y [N]"] == 0.0 and (added["Y [N]"] != 0.0) == (n != n_2)
        assert (added["N [N m]"] - without["N [N m]"] != 0.0) == (n != n_2)


def test_rudder_lag_and_delay_make_the_turn_late() -> None:
    """Late by the mean of the lag, exactly so by a delay of whole samples in the synthetic trial."""
    plain, delayed = followed(), followed("control_delay:tau=0.5")
    late = np.searchsorted(plain.t, 3.0)
    np.testing.assert_array_equal(delayed["r"][: late + 5], 0.0)
    late_inputs = {name: np.concatenate([inputs()[name][:1].repeat(5), inputs()[name][:-5]]) for name in ("n", "delta")}
    shifted = inputs().with_columns(**late_inputs)
    np.testing.assert_allclose(delayed["r"], simulate_controls(ESSO, shifted)["r"], atol=1e-12)
    lagged = followed("rudder_lag:T=2.0")
    start = slice(late, late + 60)
    assert np.all(np.abs(lagged["r"][start][10:]) < np.abs(plain["r"][start][10:]))


# Text and ship files


def test_an_effect_of_a_fit_is_free_and_held_as_asked() -> None:
    ship = freeing_effects(ESSO, ["current:x_rate,x=0.01", "bank:distance=5"])
    free = {"current.x", "current.y", "current.x_rate", "bank.suction", "bank.moment"}
    assert {s for s in ship.free if "." in s} == free
    assert ship.coefficients["bank.distance"].value == 5 and ship.coefficients["current.x"].value == 0.01


@pytest.mark.parametrize(
    ("ship", "text", "words"),
    [
        (ESSO, "curent", "'curent'"), (ESSO, "current:z=1", "'z'"), (ESSO, "current:x=fast", "fast"),
        (ESSO, "rudder_lag:T=-1", "T.* 0 "), (ESSO, "shallow_water:d_h=1.5", "0.9"),
        (CALM, "wind_sensor_bias", "wind"), (load_ship("mariner"), "fouling:share=0.2", "needs a resistance apart"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.name,
)  # fmt: skip
def test_effects_that_make_no_sense_are_refused(ship: Ship, text: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        with_effects(ship, [text])


def test_what_a_gyro_logs_is_corrected_back_to_the_true_turn_rate() -> None:
    gyro, p, e = EFFECTS["gyro"], load_ship("kvlcc2_full").namespace, SimpleNamespace(T=6.0, share=0.05)
    t = np.arange(0.0, 600.0)
    r = 0.01 * np.tanh((t - 300) / 40) + 0.002 * np.sin(t / 60)
    late = gyro.samples(t, [*np.zeros((5, len(t))), r], SimpleNamespace(), e, p)  # type: ignore[arg-type]
    back = gyro.corrected(t, late, e, p)
    assert back is not None
    inner = slice(40, -40)  # it begins settled
    assert np.abs(late[5] - r)[inner].max() > 1e-3 > 10 * np.abs(back[5] - r)[inner].max()
    assert EFFECTS["fouling"].corrected(t, late, e, p) is None


# What each effect adds, against its formula worked out by hand: directions, signs, and what it leaves alone


P = SimpleNamespace(L=4.0, B=0.7, d=0.25, m=600.0, x_G=0.1, rho=1000.0)
S = Smooth.for_length(4.0)
HULL = Force(-3.0, 5.0, 7.0)
COLUMNS = [10.0, 20.0, 0.4, 0.5, -0.1, 0.05]
MOVING = Flow(u=0.5, v=-0.1, r=0.05, x=3.0, y=2.0, psi=0.4)


def values(name: str, **given: float) -> SimpleNamespace:
    """Parameters of an effect: as ``given``, all others at their neutral value."""
    rows = EFFECTS[name].parameters(P, {"hull": "unified", "propeller": "hachii", "rudder": "single"})
    return SimpleNamespace(**({row.symbol: row.neutral for row in rows} | given))


def added(name: str, flow: Flow = MOVING, parts: dict[str, Force] | None = None, **given: float) -> dict[str, Force]:
    at = Setting(P, {"hull": "unified", "rudder": "single"}, SimpleNamespace(), Memory(), S)
    return EFFECTS[name].forces({"hull": HULL, **(parts or {})}, flow, values(name, **given), at)


def components(force: Force) -> tuple[float, float, float]:
    return float(force.X), float(force.Y), float(force.N)


# Forces


def test_a_tow_is_its_three_components() -> None:
    parts = added("tow", X=1.0, Y=2.0, N=3.0)
    assert components(parts["tow"]) == (1.0, 2.0, 3.0) and parts["hull"] is HULL


def test_wave_drift_is_whole_on_the_side_and_smaller_on_the_bow() -> None:
    """Drift to the north of a ship that heads north comes along it; of one that heads east from its starboard side."""
    along, across = (added("wave_drift", MOVING.with_(psi=psi), x=2.0)["wave_drift"] for psi in (0.0, math.pi / 2))
    assert components(along) == pytest.approx((0.6, 0.0, 0.0)) and components(across) == pytest.approx((0, -2, 0))


def test_a_bank_sucks_by_the_square_of_speed_and_fades_over_its_length() -> None:
    """A bank to starboard: suction to starboard, bow turned away; half as strong on the line, e^-1 more per decay."""
    east = {"distance": 10.0, "bearing": math.pi / 2, "decay": 1.5, "suction": 0.03, "moment": 0.01}
    unit = 0.5 * P.rho * P.L * P.d

    def at(y: float, u: float = 0.5, psi: float = 0.0) -> tuple[float, float, float]:
        return components(added("bank", Flow(u=u, v=0.0, r=0.0, x=33.0, y=y, psi=psi), **east)["bank"])

    assert at(10.0) == pytest.approx((0, 0.5 * 0.03 * unit * 0.25, -0.5 * 0.01 * unit * P.L * 0.25))
    for y in (4.0, 7.0, 9.5):
        assert at(y)[1] == pytest.approx(0.03 * unit * 0.25 / (1 + math.exp((10.0 - y) / 1.5)))
    assert at(9.0, u=1.0) == pytest.approx(np.multiply(at(9.0), 4))
    assert at(9.0, psi=math.pi) == pytest.approx(np.negative(at(9.0)))
    assert at(9.0, psi=math.pi / 2)[1] == pytest.approx(0)
    on_the_line = Flow(u=0.5, v=0.0, r=0.0, x=10.0, y=5.0, psi=math.pi / 2)
    north = added("bank", on_the_line, **(east | {"bearing": 0.0}))["bank"]
    assert components(north) == pytest.approx(np.negative(at(10.0)))  # on its port side


def test_shallow_water_grows_with_draught_over_clearance() -> None:
    """Force and added mass grow with g = d / (h - d): 1 at a depth of twice the draught. The ship's own mass stays."""
    assert components(added("shallow_water", d_h=0.5)["hull"]) == pytest.approx((-3 * 1.15, 5 * 1.5, 7 * 1.5))
    assert components(added("shallow_water", d_h=0.2)["hull"])[0] == pytest.approx(-3 * (1 + 0.15 * 0.25))
    shelf = {"d_h": 0.5, "line": 8.0, "bearing": math.pi / 2, "width": 2.0}
    for y, share in ((8.0, 0.5), (10.0, 0.5 * (1 + math.tanh(1.0))), (-40.0, 0.0)):
        ratio = 0.5 * share
        grown = components(added("shallow_water", MOVING.with_(y=y), **shelf)["hull"])
        assert grown[1] == pytest.approx(5 * (1 + 0.5 * ratio / (1 - ratio)))
    north = components(added("shallow_water", MOVING.with_(x=8.0), **(shelf | {"bearing": 0.0}))["hull"])
    assert north[1] == pytest.approx(5 * (1 + 0.5 * 0.25 / 0.75))
    own = (P.L / 4) ** 2 * P.m + P.x_G**2 * P.m
    deep = Inertia(P.m, 20.0, 400.0, 60.0, own + 300.0)
    shallow = EFFECTS["shallow_water"].inertia(deep, MOVING, values("shallow_water", d_h=0.5), P, S)
    assert (shallow.m_x, shallow.m_y, shallow.I_z) == pytest.approx((20 * 1.2, 400 * 1.65, own + 300 * 1.3))
    assert (shallow.m, shallow.moment) == (deep.m, deep.moment)


def test_beyond_stall_a_share_of_each_rudder_is_lost() -> None:
    one, other = Blade(-1.0, 2.0, -3.0, 0.9), Blade(-0.5, 1.0, -2.0, math.sin(0.35) ** 2)
    parts = {"rudder": Force(-1.5, 3.0, -5.0, blades=(one, other))}
    left = components(added("rudder_stall", parts=parts, loss=0.4, alpha_s=0.35, width=0.06)["rudder"])
    assert left == pytest.approx((-1.5 + 0.4 * (1 + 0.25), 3 - 0.4 * (2 + 0.5), -5 + 0.4 * (3 + 1.0)), rel=1e-6)
    near = {"rudder": Force(-1.0, 2.0, -3.0, blades=(Blade(-1.0, 2.0, -3.0, math.sin(0.35) ** 2 + 0.03),))}
    stalled = added("rudder_stall", parts=near, loss=0.4, alpha_s=0.35)["rudder"]
    assert components(stalled)[1] == pytest.approx(2 * (1 - 0.4 * 0.5 * (1 + math.tanh(0.5))))


def test_factors_on_wind_and_propeller_act_on_each_component() -> None:
    at = Setting(P, {"wind": "fujiwara", "propeller": "hachii"}, SimpleNamespace(), Memory(), S)
    parts = {"wind": Force(1.0, 2.0, 3.0), "propeller": Force(4.0, 5.0, 6.0)}
    wind = EFFECTS["wind_force"].forces(parts, MOVING, SimpleNamespace(X=0.5, Y=2.0, N=3.0), at)["wind"]
    assert components(wind) == (0.5, 4.0, 9.0)
    walk = EFFECTS["propeller_side_force"].forces(parts, MOVING, SimpleNamespace(factor=3.0), at)["propeller"]
    assert components(walk) == (4.0, 15.0, 18.0)


def test_the_upper_works_that_are_not_known_are_those_of_the_esso_osaka_by_length() -> None:
    """So the ship from which the ratios come gets its own within their two or three digits."""
    from mmg.effects.wind_force import upper_works

    esso = load_ship("esso_osaka_3m").particulars
    found = vars(upper_works(SimpleNamespace(L=esso["L"], B=esso["B"])))
    for name in ("A_T", "A_L", "A_OD", "C", "C_BR", "H_BR", "H_C"):
        assert found[name] == pytest.approx(esso[name], rel=0.02), name
    assert found["rho_a"] == 1.225 and upper_works(SimpleNamespace(L=4.0, B=0.7, A_T=9.0)).A_T == 9.0
    double = vars(upper_works(SimpleNamespace(L=2 * esso["L"], B=2 * esso["B"])))
    for name, power in (("A_T", 2), ("A_L", 2), ("A_OD", 2), ("C", 1), ("C_BR", 1), ("H_BR", 1), ("H_C", 1)):
        assert double[name] == pytest.approx(found[name] * 2**power), name


def test_the_lag_of_the_hull_leaves_the_surge_force_alone() -> None:
    """Settled on other forces, sway and yaw are those remembered by the share T / tau of the lag."""
    memory = Memory()
    at = Setting(P, {"hull": "unified"}, SimpleNamespace(), memory, S)
    force = EFFECTS["hull_memory"].forces({"hull": HULL}, MOVING, SimpleNamespace(T=1.5), at)["hull"]
    everything = ca.vertcat(force.X, force.Y, force.N, *memory.rates)
    got = np.array(ca.Function("f", memory.symbols, [everything])(1.0, 2.0)).ravel()
    tau = math.hypot(1.5, 0.5 * time_scale(P.L))
    kept = 1.5 / tau
    assert got == pytest.approx([-3, 5 - kept * 4, 7 - kept * 5, 4 / tau, 5 / tau])


# Inputs


def test_a_rudder_offset_is_added_to_every_rudder_and_to_nothing_else() -> None:
    given = MOVING.with_(delta=ca.SX(0.1), delta_port=ca.SX(-0.2), n=ca.SX(7.0))
    moved = EFFECTS["rudder_offset"].actuators(given, Memory(), SimpleNamespace(delta=0.03), P, S)
    assert [float(ca.DM(ca.SX(x))) for x in (moved.delta, moved.delta_port, moved.n)] == pytest.approx([0.13, -0.17, 7])
    assert moved.delta_starboard == 0.0


def test_what_is_not_said_of_a_flow_is_at_rest() -> None:
    """Actuators that a ship does not have stand still, and there is no wind."""
    plain = Flow(u=1.0, v=2.0, r=3.0)
    others = {f.name: getattr(plain, f.name) for f in fields(Flow) if f.name not in ("u", "v", "r")}
    assert others.pop("slipstream") is None and set(others.values()) == {0.0}
    assert components(Force()) == (0.0, 0.0, 0.0)


def test_a_wind_sensor_bias_is_added_to_the_air() -> None:
    assert EFFECTS["wind_sensor_bias"].air(1.0, 2.0, SimpleNamespace(x=0.3, y=-0.4)) == pytest.approx((1.3, 1.6))


def test_a_current_flows_on_at_its_rate() -> None:
    e = SimpleNamespace(x=0.1, y=0.2, x_rate=0.01, y_rate=-0.02)
    assert EFFECTS["current"].water(MOVING.with_(time=5.0), e) == pytest.approx((0.15, 0.1, 0.01, -0.02))


def test_a_fouled_hull_resists_as_much_more_as_in_straight_motion_at_her_speed() -> None:
    p, c = particulars_and_coefficients("esso_osaka_3m")
    at = Setting(p, {"hull": "unified"}, c, Memory(), S)
    straight = unified.force(Flow(u=0.5, v=0.0, r=0.0), at.p, at.c, S)
    fouled = EFFECTS["fouling"].forces({"hull": HULL}, MOVING, SimpleNamespace(share=0.2), at)["hull"]
    assert float(straight.X) < 0
    assert components(fouled) == pytest.approx((HULL.X + 0.2 * float(straight.X), HULL.Y, HULL.N))


def test_more_draught_is_more_mass() -> None:
    loaded = EFFECTS["draft"].particulars(P, SimpleNamespace(share=0.2))
    assert (loaded.d, loaded.m, loaded.L) == pytest.approx((0.3, 720.0, 4.0))


# Measurement


def logged(name: str, **given: float) -> list[Any]:
    return EFFECTS[name].columns(COLUMNS, MOVING, Memory(), values(name, **given), P)


COS, SIN = math.cos(0.4), math.sin(0.4)
LOGGED = [
    # ahead it lies to the north by cos psi, to starboard to the east by cos psi; it moves by r x arm
    ("antenna_offset", {"x": 1.0}, [10 + COS, 20 + SIN, 0.4, 0.5, -0.1 + 0.05, 0.05]),
    ("antenna_offset", {"y": 1.0}, [10 - SIN, 20 + COS, 0.4, 0.5 - 0.05, -0.1, 0.05]),
    ("antenna_offset", {"alone_x": 1.0}, [10 + COS, 20 + SIN, 0.4, 0.5, -0.1, 0.05]),
    ("antenna_offset", {"alone_y": 1.0}, [10 - SIN, 20 + COS, 0.4, 0.5, -0.1, 0.05]),
    ("heading_bias", {"alone": 0.1}, [10, 20, 0.5, 0.5, -0.1, 0.05]),
    ("log_scale", {"share": 0.1}, [10, 20, 0.4, 0.55, -0.1, 0.05]),
]


@pytest.mark.parametrize(("name", "given", "expected"), LOGGED)
def test_instruments_log_what_is_true_at_their_place_and_by_their_scale(
    name: str, given: dict[str, float], expected: list[float]
) -> None:
    assert logged(name, **given) == pytest.approx(expected)


def test_a_turned_compass_turns_the_logged_velocity_back() -> None:
    """The velocity over ground is what it is: u, v turned by the logged heading give the same as by the true one."""
    x, y, psi, u, v, r = logged("heading_bias", psi=0.1)
    assert (x, y, psi, r) == pytest.approx((10, 20, 0.5, 0.05))
    true = 0.5 * math.cos(0.4) + 0.1 * math.sin(0.4), 0.5 * math.sin(0.4) - 0.1 * math.cos(0.4)
    assert (u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi)) == pytest.approx(true)


def test_a_gyro_is_wrong_by_a_share() -> None:
    t, y = np.arange(3.0), [np.array(3 * [x]) for x in COLUMNS]
    gyro = EFFECTS["gyro"].samples(t, y, MOVING, values("gyro", share=0.1), P)
    assert [float(c[2]) for c in gyro] == pytest.approx([10, 20, 0.4, 0.5, -0.1, 0.055])


def test_a_gyro_lags_as_a_first_order_system() -> None:
    """Behind a step that lasts one sample, and behind a ramp, which it follows T late in the end; exact solutions."""
    t = np.arange(0.0, 40.0, 0.5)
    ramp = 0.01 * t
    y = [*(np.zeros(len(t)) for _ in range(5)), ramp]
    late = EFFECTS["gyro"].samples(t, y, MOVING, values("gyro", T=2.0), P)[5]
    assert late == pytest.approx(ramp - 0.01 * 2.0 * (1 - np.exp(-t / 2.0)), abs=1e-12)
    step = np.where(t < 1.0, 0.0, 0.1)
    after = EFFECTS["gyro"].samples(t, [*y[:5], step], MOVING, values("gyro", T=2.0), P)[5]
    assert after[2] == pytest.approx(0.1 - 0.2 * 2.0 * (1 - math.exp(-0.25)))  # a ramp within the sample
    assert after[3:] == pytest.approx(0.1 - (0.1 - after[2]) * np.exp(-(t[3:] - 1.0) / 2.0), abs=1e-12)


def logging_of(name: str, e: SimpleNamespace) -> ca.Function:
    """(true columns (6,), what is remembered) -> logged columns (6,), rates of what is remembered."""
    memory, y = Memory(), ca.SX.sym("y", 6)
    rows = EFFECTS[name].columns([y[i] for i in range(6)], MOVING, memory, e, P)
    return ca.Function("f", [y, ca.vertcat(*memory.symbols)], [ca.vertcat(*rows), ca.vertcat(*memory.rates)])


def turning(t: np.ndarray) -> list[np.ndarray]:
    """Exact columns of a steady turn that began with the first sample, straight before."""
    u, v, r = 0.5, -0.1, 0.04
    psi = 0.3 + r * t
    speed, angle = math.hypot(u, v), math.atan2(v, u)
    x = speed / r * (np.sin(psi + angle) - math.sin(0.3 + angle))
    y = -speed / r * (np.cos(psi + angle) - math.cos(0.3 + angle))
    return [x, y, psi, np.full(len(t), u), np.full(len(t), v), np.full(len(t), r)]


LATE = [("gnss_delay", "tau"), ("gnss_delay", "alone"), ("gnss_delay", "finished"), ("velocity_filter", "tau")]


@pytest.mark.parametrize(("name", "symbol"), LATE)
def test_late_instruments_log_what_was_true_before(name: str, symbol: str) -> None:
    """In a steady turn, of 0.8 s ago: position and velocity over ground; the heading is of now. ``alone`` is of the
    position, ``finished`` of u and v as they were; before the first sample the ship went straight on."""
    t, late = np.arange(0.0, 20.0, 0.1), 0.8
    now, before = turning(t), turning(t - late)
    got = EFFECTS[name].samples(t, now, MOVING, values(name, **{symbol: late}), P)
    inside = t > late
    place = now if name == "velocity_filter" else before
    for i in (0, 1):
        assert got[i][inside] == pytest.approx(place[i][inside], abs=1e-4)
    if symbol == "tau":  # the velocity of before, in the axes of now
        back = complex(0.5, -0.1) * complex(math.cos(0.04 * late), -math.sin(0.04 * late))
        u, v = back.real, back.imag
    else:
        u, v = 0.5, -0.1
    assert got[3][inside] == pytest.approx(u, abs=1e-4) and got[4][inside] == pytest.approx(v, abs=1e-4)
    assert np.array_equal(got[2], now[2]) and np.array_equal(got[5], now[5])
    if name == "gnss_delay":
        ahead = complex(0.5, -0.1) * complex(math.cos(0.3), math.sin(0.3))
        assert (got[0][0], got[1][0]) == pytest.approx((-late * ahead.real, -late * ahead.imag))


@pytest.mark.parametrize(("name", "symbol"), LATE)
def test_the_model_of_a_late_instrument_is_late_by_as_much(name: str, symbol: str) -> None:
    """On a straight course the position lags by speed times delay, at any size of the delay, and the velocity by none;
    after a change the logged velocity lags by the delay in the mean."""
    for late in (0.02, 3.0):
        f = logging_of(name, values(name, **{symbol: late}))
        now, states = np.array([0.0, 0.0, 0.3, 0.5, -0.1, 0.0]), np.zeros(f.size1_in(1))
        missing = np.zeros(2)
        for _ in range(1500):  # from rest, as if velocity had jumped
            logged_now, rate = (np.array(a).ravel() for a in f(now, states))
            missing += 0.02 * (now[3:5] - logged_now[3:5])
            states += 0.02 * rate
        shift = 0.0 if name == "velocity_filter" else late
        over_ground = complex(0.5, -0.1) * complex(math.cos(0.3), math.sin(0.3))
        assert logged_now[:2] == pytest.approx([-shift * over_ground.real, -shift * over_ground.imag], abs=1e-6)
        assert logged_now[2:] == pytest.approx(now[2:], abs=1e-6)
        slow = 0.0 if symbol == "alone" else late
        assert missing == pytest.approx([0.5 * slow, -0.1 * slow], abs=0.02 * abs(slow) + 1e-6)


@pytest.mark.parametrize("tau", [0.02, 0.4, 3.0])
def test_a_filter_in_body_axes_leaves_a_steady_turn_and_is_late_after_a_change(tau: float) -> None:
    """There u and v do not change, though the velocity over ground turns; a change arrives late by tau in the mean, in
    the model as in the columns of the generator, which are an exact low pass."""
    e = values("velocity_filter", tau=tau, body_axes=1.0)
    t = np.arange(0.0, 40.0, 0.02)
    steady = turning(t)
    assert np.allclose(EFFECTS["velocity_filter"].samples(t, steady, MOVING, e, P)[3:5], steady[3:5])
    changed = [*steady[:3], 0.5 + np.where(t < 1.0, 0.0, 0.1), steady[4], steady[5]]
    exact = EFFECTS["velocity_filter"].samples(t, changed, MOVING, e, P)[3]
    assert exact[t > 1.1] == pytest.approx(0.6 - 0.1 * np.exp(-(t[t > 1.1] - 0.99) / tau), abs=1e-3)
    f = logging_of("velocity_filter", e)
    states, missing = np.array([0.5, -0.1]), 0.0
    for psi in steady[2]:
        logged, rate = (np.array(a).ravel() for a in f([0.0, 0.0, psi, 0.6, -0.1, 0.04], states))
        missing += 0.02 * (0.6 - logged[3])
        states += 0.02 * rate
        assert logged[4] == pytest.approx(-0.1)
    assert missing == pytest.approx(0.1 * tau, rel=0.02)


# What remembers


def rates_and_value(build: Any, x: float, state: float) -> tuple[float, float]:
    memory = Memory()
    value = build(memory, ca.SX(x))
    rate, out = ca.Function("f", memory.symbols, [memory.rates[0], value])(state)
    return float(rate), float(out)


def test_memories_follow_their_equations() -> None:
    """Lag, delay, play and rate limit at one point of their phase plane, worked out by hand."""
    lag, delay = (rates_and_value(lambda m, x, f=f: f(m, "a", x, 3.0, 4.0, 1.0), 2.0, 1.0) for f in (lagged, delayed))
    assert lag == pytest.approx((1 / 5.0, 2 - 0.6)) and delay == pytest.approx((2 / 5.0, 2 - 1.2))  # tau: hypot(3, 4)
    limited = rates_and_value(lambda m, x: rate_limited(m, "a", x, 0.5, 2.0, 1.0), 2.0, 1.0)
    assert limited == pytest.approx((0.5 * math.tanh(1.0), 1.0))
    no_play = rates_and_value(lambda m, x: played(m, "a", x, 0.0, 0.25, 2e-3, 1.0), 2.0, 1.0)
    assert no_play == pytest.approx((1 / 0.25, 2.0))
    wide = rates_and_value(lambda m, x: played(m, "a", x, 0.1, 0.25, 2e-3, 1.0), 2.0, 1.0)
    assert wide == pytest.approx((0.9 / 0.25, 1.9), rel=1e-6)
    inside = rates_and_value(lambda m, x: played(m, "a", x, 0.1, 0.25, 2e-3, 1.0), 1.05, 1.0)
    assert inside == pytest.approx((0.0, 1.0), abs=1e-4)
