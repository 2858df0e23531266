"""Froude's law: what has a unit grows by it, and motions of the scaled ship are those of the model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, library, load_ship, parse_ship
from cases.simulation.simulate import simulate
from delivery.full_scale.similarity import Similarity, dropped_effects, similar_bands, similar_network, similar_ship
from fitting.prediction.bands import SIZES, Process, bands_of, process_dict
from fitting.prediction.envelope import HeldMotion, held_dict, held_of
from mmg.components.particulars import PARTICULARS
from mmg.effects import EFFECTS
from mmg.errors import UnknownName
from mmg.motion.flow import INPUTS
from mmg.motion.froude import time_scale
from tests.support.networks import random_network

LAW = Similarity(100.0, 1.025)
FACTORS = np.array([100.0, 100, 1, 10, 10, 0.1])
"""Of x, y, psi, u, v, r."""


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("", 1.0), ("rad", 1.0), ("m", 100.0), ("m²", 1e4), ("s", 10.0), ("m/s", 10.0), ("m/s^2", 1.0), ("rad/s", 0.1),
        ("1/s^2", 0.01), ("rps", 0.1), ("kg", 1.025e6), ("kg/m³", 1.025), ("N", 1.025e6), ("N m", 1.025e8),
        ("W", 1.025e7), ("kg m²", 1.025e10),
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
