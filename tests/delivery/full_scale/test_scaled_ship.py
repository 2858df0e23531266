"""From model to ship: friction, wake and rudder inflow; Froude's law, by which what has a unit grows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases.criteria.imo import REFERENCES
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.particulars import BY_RULE
from cases.shipfiles.ship_file import dump_ship, library, load_ship, parse_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import draw_coefficients
from delivery.full_scale.scaled_ship import Scaling, scaled_ship
from delivery.full_scale.similarity import Similarity, dropped_effects, similar_bands, similar_network, similar_ship
from delivery.full_scale.viscous import Change, HullInWater, ship_values
from fitting.prediction.bands import SIZES, Process, bands_of, process_dict
from fitting.prediction.envelope import HeldMotion, held_dict, held_of
from mmg.components.coefficients import PARTICULARS
from mmg.components.friction import allowance, form_factor, friction_line, wetted_surface
from mmg.effects import EFFECTS
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale
from tests.support.networks import random_network

# Friction, wake and rudder inflow of the ship: limiting cases, published values, errors carried along
MODEL = load_ship("kvlcc2_l7")
"""KVLCC2, 7 m."""


def test_the_friction_line_has_its_published_values() -> None:
    assert friction_line(1e7) == pytest.approx(0.0030, abs=1e-6)
    assert friction_line(1e9) == pytest.approx(0.075 / 49, abs=1e-9)
    assert 0.15 < form_factor(320, 58, 20.8, 0.8098) < 0.4
    assert wetted_surface(320, 58, 20.8, 0.8098) == pytest.approx(27194 - 0.03 * 27194, rel=0.02)
    assert allowance(7.0, 1e7) == 0 and 1e-4 < allowance(320.0, 2e9) < 4e-4


@pytest.mark.parametrize("name", ["kvlcc2_l7", "kvlcc2_full", "esso_osaka_3m", "vectwin_3m"])
def test_the_same_length_changes_nothing(name: str) -> None:
    model = load_ship(name)
    found = scaled_ship(model, Scaling(model.particulars["L"]))
    assert found.ship.values == pytest.approx(model.values, rel=1e-12)
    ours, theirs = ([one.coefficients[s].std for s in model.symbols] for one in (found.ship, model))
    assert ours == pytest.approx(theirs, rel=1e-6)
    assert found.correlation == pytest.approx(np.eye(len(found.symbols)), abs=1e-6)
    assert found.ship.particulars | {"scale": 1} == {**model.particulars, "scale": 1}


def test_kvlcc2_has_the_wake_of_the_published_full_scale_ship() -> None:
    found, full = scaled_ship(MODEL, Scaling(320.0)), load_ship("kvlcc2_full")
    wake = found.ship.coefficients["w_P0"]
    assert abs(wake.value - full.coefficients["w_P0"].value) < wake.std
    assert wake.value < MODEL.coefficients["w_P0"].value
    for name in ("L", "d", "m", "U_0", "rudder_rate", "A_R", "D_P"):
        assert found.ship.particulars[name] == pytest.approx(full.particulars[name], rel=2e-3), name
    model = replace(MODEL, sources={"rudder_rate": "measured in zigzag", "U_0": "rule: typical"})
    for given, rules in (({}, {"rudder_rate", "U_0"}), ({"speed": 8.0}, {"rudder_rate"})):
        sources = scaled_ship(model, Scaling(320.0, **given)).ship.sources  # a rate of the model is a rule for the ship
        assert sources.keys() == rules and all(words.startswith(BY_RULE) for words in sources.values())


def test_scaling_with_the_published_changes_alone_is_the_published_ship() -> None:
    """By Froude's law with the wake of the full-scale tests the library's two KVLCC2 are one."""
    found = scaled_ship(MODEL, Scaling(320.0, froude_only=True)).ship.with_values({"w_P0": 0.35})
    ours, theirs = ({s: c.value for s, c in one.coefficients.items()} for one in (found, load_ship("kvlcc2_full")))
    assert ours == pytest.approx(theirs, rel=1e-3)
    assert "kvlcc2_full" in REFERENCES


def waters(**changes: float) -> Change:
    model = HullInWater(7.0, 1.27, 0.455, 0.81, 1.18, 1000.0)
    ship = HullInWater(320.0, 58.0, 20.8, 0.81, 7.97, 1025.0)
    return Change(model, replace(ship, **changes))


def test_the_wake_never_grows_with_the_ship_and_keeps_the_part_of_rudder_and_thrust() -> None:
    change = waters()
    for w in np.linspace(0.0, 0.8, 9):
        for t in (0.0, 0.2, 0.4):
            found = change.wake(w, t)
            assert found <= w + 1e-12
            assert found >= min(w, t + 0.04) - 1e-12
    assert waters(roughness=5e-3).wake(0.4, 0.2) > change.wake(0.4, 0.2)


def test_resistance_falls_with_friction_and_grows_with_roughness() -> None:
    smooth, rough = waters().resistance(0.022), waters(roughness=1e-3).resistance(0.022)
    assert 0.005 < smooth < rough < 0.022
    known = replace(waters(), form_factor=0.2)
    total = 0.022 / known.model.surface
    wanted = total - 1.2 * (known.model.C_F - known.ship.C_F) + known.ship.allowance
    assert known.resistance(0.022) == pytest.approx(known.ship.surface * wanted)


def test_what_the_race_adds_at_the_rudder_stays() -> None:
    values = {s: c.value for s, c in MODEL.coefficients.items()}
    found = ship_values(values, waters())
    assert found["kappa"] * found["epsilon"] == pytest.approx(values["kappa"] * values["epsilon"])
    assert 1.0 < found["epsilon"] < values["epsilon"]


def test_errors_of_the_model_are_carried_to_the_ship() -> None:
    """Draws of the model, each scaled, scatter as the covariance of the ship says without what scaling adds."""
    model = load_ship("esso_osaka_3m")
    symbols = tuple(model.free)
    matrix = np.eye(len(symbols))
    i, j = symbols.index("w_P0"), symbols.index("t_P")
    matrix[i, j] = matrix[j, i] = -0.6
    model = model.with_coefficients({
        s: c.with_(std=0.1 * c.std, lower=-np.inf, upper=np.inf) for s, c in model.coefficients.items()
    })  # fmt: skip
    found = scaled_ship(model, Scaling(325.0), symbols, matrix)
    assert found.change is not None
    drawn = draw_coefficients(model, 4000, 1, (symbols, matrix))
    values = [{s: float(drawn[s][k]) for s in symbols} for k in range(4000)]
    scaled = [ship_values(v, found.change) for v in values]
    for s in ("w_P0", "X_0F", "epsilon", "tau"):
        spread = np.std([v[s] for v in scaled])
        added = found.doubts[s].std if s in found.doubts else 0.0
        assert found.ship.coefficients[s].std == pytest.approx(np.hypot(spread, added), rel=0.05), s
    place = {s: k for k, s in enumerate(found.symbols)}
    scatter = {s: np.array([v[s] for v in scaled]) for s in ("w_P0", "epsilon")}
    std = [found.ship.coefficients[s].std for s in scatter]
    ours = found.correlation[place["w_P0"], place["epsilon"]]
    assert ours == pytest.approx(np.cov(*scatter.values())[0, 1] / (std[0] * std[1]), abs=0.05)


def test_a_ship_with_hardly_a_wake_is_scaled() -> None:
    """As of twin screws: its wake may be none within its error, and what belongs to it stays then."""
    esso = load_ship("esso_osaka_3m")
    model = esso.with_coefficients({"w_P0": esso.coefficients["w_P0"].with_(value=0.02, std=0.05, lower=-0.1)})
    found = scaled_ship(model, Scaling(320.0))
    assert {"w_P0", "C_P"} <= set(found.symbols) and np.isfinite(found.correlation).all()


def test_scaling_never_makes_a_coefficient_more_certain_by_itself() -> None:
    found = scaled_ship(MODEL, Scaling(320.0))
    kept = [s for s in found.doubts if s not in found.changed]
    assert {"gamma_R_plus", "ell_R", "Y_v", "t_P", "k_0"} <= set(kept)
    assert all(found.ship.coefficients[s].std > MODEL.coefficients[s].std for s in kept)
    fixed = scaled_ship(MODEL.fixing(["Y_v"]), Scaling(320.0))
    assert "Y_v" not in fixed.doubts


@pytest.mark.parametrize(
    ("length", "more", "kind", "words"),
    [
        *((length, {}, OutOfRange, f"--length {length:g}") for length in (0.0, float("nan"), 1000.0)),
        (320.0, {"speed": -1.0}, OutOfRange, "--speed -1"), (320.0, {"density": 5.0}, OutOfRange, "--rho 5"),
        (320.0, {"form_factor": 9.0}, OutOfRange, "--form-factor 9"),
        (320.0, {"roughness": -1.0}, OutOfRange, "--roughness -1"), (320.0, {"speed": "8"}, BadValue, "speed"),
        (320.0, {"form_factor": []}, BadValue, "form_factor"), (320.0, {"roughness": None}, BadValue, "roughness"),
    ],
)  # fmt: skip
def test_what_no_ship_has_and_what_is_no_number_is_refused(
    length: float, more: dict[str, Any], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        scaled_ship(MODEL, Scaling(length, **more))


def test_particulars_that_are_lacking_are_named() -> None:
    bare = replace(MODEL, particulars={s: v for s, v in MODEL.particulars.items() if s not in ("B", "C_b")})
    with pytest.raises(Missing, match="B, C_b"):
        scaled_ship(bare, Scaling(320.0))
    assert scaled_ship(bare, Scaling(320.0, froude_only=True)).ship.particulars["L"] == pytest.approx(320.0)
    with pytest.raises(Missing):
        scaled_ship(load_ship("mariner"), Scaling(5.0))


@pytest.mark.parametrize("speed", [0.2, 0.4, 0.8, 1.6])
@pytest.mark.parametrize("R", [0.012, 0.018, 0.022, 0.03])
def test_whatever_the_resistance_the_same_water_changes_nothing(speed: float, R: float) -> None:
    model = HullInWater(3.0, 0.489, 0.201, 0.83, speed, 998.0)
    same = Change(model, model)
    assert same.resistance(R) == pytest.approx(R)
    assert same.resistance_std(R) == pytest.approx(0.0, abs=1e-12)
    assert same.wake(0.5, 0.2) == pytest.approx(0.5)
    ship = HullInWater(325.0, 53.0, 21.8, 0.83, speed * np.sqrt(325 / 3), 1025.0)
    assert 0.002 < Change(model, ship).resistance(R) < R


# Froude's law: what has a unit grows by it, and motions of the scaled ship are those of the model
LAW = Similarity(100.0, 1.025)
FACTORS = np.array([100.0, 100, 1, 10, 10, 0.1])
"""Of x, y, psi, u, v, r."""


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("", 1.0), ("rad", 1.0), ("m", 100.0), ("m²", 1e4), ("s", 10.0), ("m/s", 10.0), ("m/s^2", 1.0), ("rad/s", 0.1),
        ("1/s^2", 0.01), ("rps", 0.1), ("kg", 1.025e6), ("kg/m³", 1.025), ("N", 1.025e6), ("N m", 1.025e8),
        ("kg m²", 1.025e10),
    ],
)  # fmt: skip
def test_units_grow_by_froudes_law(unit: str, factor: float) -> None:
    assert LAW.factor(unit) == pytest.approx(factor)


def test_every_unit_of_the_physics_is_known() -> None:
    units = {name: unit for name, (_, unit) in PARTICULARS.items()} | {name: unit for name, (_, unit) in INPUTS.items()}
    for name in library():
        ship = load_ship(name)
        units |= {s: c.unit for s, c in ship.coefficients.items()}
        for effect in (e for e in EFFECTS.values() if set(e.needs) <= set(ship.components)):
            rows = effect.parameters(ship.namespace, dict(ship.components))
            units |= {f"{effect.name}.{p.symbol}": p.unit for p in rows}
    assert len(units) > 200
    assert all(LAW.factor(unit, name) > 0 for name, unit in units.items())


def test_an_unknown_unit_is_named() -> None:
    with pytest.raises(UnknownName, match=r"T_E.*parsec"):
        LAW.factor("parsec", "T_E")


@pytest.mark.parametrize("name", ["kvlcc2_l7", "esso_osaka_3m", "vectwin_3m", "mariner"])
@pytest.mark.parametrize("text", ["turning:35", "crash-stop"])
def test_tracks_of_the_similar_ship_are_those_of_the_model_in_lengths(name: str, text: str) -> None:
    model = load_ship(name)
    if name == "mariner" and text == "crash-stop":
        pytest.skip("no propeller in its model")
    ship = similar_ship(model, Similarity(320 / model.particulars["L"], 1.0), "big")
    runs = []
    for one in (model, ship):
        L = one.particulars["L"]
        plan = parse_maneuver(text, one, speed=0.14 * math.sqrt(9.80665 * L), duration=60 * time_scale(L))
        plan = replace(plan, engine=None)  # a diesel is not similar to the motor of a model
        runs.append(simulate(one, plan, 0.1 * time_scale(L)).states / [L, L, 1, L**0.5, L**0.5, L**-0.5])
    assert runs[0].shape == runs[1].shape
    assert np.abs(runs[0] - runs[1]).max() < 1e-6 * np.abs(runs[0]).max()


def test_effects_of_place_instruments_and_steering_gear_stay_with_the_model() -> None:
    ship = load_ship("esso_osaka_3m")
    for name in ("current", "rudder_lag", "antenna_offset", "rudder_stall", "propeller_side_force"):
        ship = ship.with_effect(name)
    assert set(dropped_effects(ship)) == {"current", "rudder_lag", "antenna_offset"}
    found = similar_ship(replace(ship, campaigns={"spring": {"antenna_offset.x": 0.3}}), LAW, "big")
    assert set(found.effects) == {"rudder_stall", "propeller_side_force"}
    assert parse_ship(dump_ship(found)).effects == found.effects, "values by campaign of what it lacks"


def test_the_scale_of_a_model_is_used_up() -> None:
    model = load_ship("esso_osaka_3m")
    assert "scale" not in similar_ship(model, Similarity(108.33), "big").particulars
    assert similar_ship(model, Similarity(10.0), "larger").particulars["scale"] == pytest.approx(10.833)


def test_a_learned_residual_is_the_same_at_equal_froude_number() -> None:
    ship = load_ship("esso_osaka_3m")
    network = random_network(ship)
    x = np.random.default_rng(3).normal(size=(len(ship.features), 5))
    scaled = similar_network(network, LAW)
    factors = np.array([LAW.feature(name) for name in network.features])
    wanted = network.accelerations(x) * np.array([1.0, 1.0, 0.01])[:, None]
    assert scaled.accelerations(x * factors[:, None]) == pytest.approx(wanted)
    assert (scaled.outside(x * factors[:, None]) == network.outside(x)).all()


def test_motions_are_as_new_to_the_ship_as_to_the_model() -> None:
    rng, names = np.random.default_rng(8), load_ship("esso_osaka_3m").inputs
    held = HeldMotion(names, np.array([0.3, 0.1, 0.2, 5.0, 0.3, 2.0, 2.0]), rng.normal(size=(20, 7)), 0.4)
    content = {"acceleration_memory_s": {}, "error_decay_s": {}, "noise": {}, "held": held_dict(held)}
    content["acceleration_std"] = {"r": dict.fromkeys(SIZES, 1.0)}
    scaled = similar_bands(content, LAW)
    assert scaled is not None
    theirs = held_of(scaled["held"], names)
    assert theirs is not None
    states, inputs = rng.normal(0.2, 0.2, (9, 6, 2)), rng.normal(size=(9, len(names), 2))
    growth = np.array([LAW.factor({"n": "rps", "delta": "rad"}.get(name, "m/s")) for name in names])[:, None]
    ours = held.novelty(states, inputs, 3.0)
    assert ours.max() > 0
    assert theirs.novelty(states * FACTORS[:, None], inputs * growth, 300.0) == pytest.approx(ours, abs=0.05)


def test_bands_grow_as_the_motion_and_lose_the_noise_of_instruments() -> None:
    model = load_ship("esso_osaka_3m")
    ship = similar_ship(model, LAW, "big")
    size = np.array([[0.01, 0.02, 0.1], [0.02, 0.01, 0.2], [0.005, 0.01, 0.05]])
    horizons, factor = np.array([5.0, 50.0]), np.array([np.full(6, 0.7), np.full(6, 1.4)])
    process = Process(np.array([2.0, 2, 3]), np.array([15.0, 10, 5]), size, np.full(6, 0.01), factor, factor, horizons)
    content = {"bands": process_dict(process)}
    before, after = bands_of(content, model), bands_of({"bands": similar_bands(content["bands"], LAW)}, ship)
    assert before and after and (after.process.noise == 0).all()
    times, states = np.linspace(0, 30, 31)[:, None], np.random.default_rng(5).normal(0.1, 0.05, (31, 6, 1))
    ours = before.process_variance(times, states, 3.0)
    theirs = after.process_variance(10 * times, states * FACTORS[:, None], 300.0)
    assert theirs == pytest.approx(ours * FACTORS[:, None] ** 2)
    assert after.process.factor_at(10 * times) == pytest.approx(before.process.factor_at(times))
