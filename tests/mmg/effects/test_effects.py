"""Effects: neutral values leave no trace, derivatives agree with finite differences, and each does what it says."""

from __future__ import annotations

import math
from functools import cache, lru_cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, with_effects
from cases.shipfiles.ship_file import check_needs, load_ship
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate, simulate_controls
from cases.trial import Trial
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.model import Model, assemble
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.actuator_ships import true_ship

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
