"""The walk-through "one file each" works as it is written: an effect, a force model, a ship."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.components import catalogue
from mmg.effects import EFFECTS
from mmg.rollout import Simulator
from tests.docs.pages import ROOT, blocks

EFFECT, FORCE, SHIP = blocks(ROOT / "docs" / "how-to" / "extending.md", "python")
STATE = np.array([[0.0, 0.0, 0.0, 0.3, 0.05, 0.02]]).T


def module_of(code: str, name: str) -> ModuleType:
    module = ModuleType(name)
    exec(compile(code, name, "exec"), module.__dict__)
    return module


def test_an_effect_in_one_file_enters_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    module = module_of(EFFECT, "sway_scale")
    monkeypatch.setitem(sys.modules, "sway_scale", module)
    effect = module.SwayScale()
    assert effect.summary
    monkeypatch.setitem(EFFECTS, effect.name, effect)
    bare = load_ship("esso_osaka_3m")
    neutral, larger = bare.with_effect(effect.name), bare.with_effect(effect.name, {"share": 0.1})
    logged = [Simulator(ship, compiled=False).columns(STATE)[4, 0] for ship in (bare, neutral, larger)]
    assert logged[0] == logged[1] and np.isclose(logged[2], 1.1 * logged[0])


def test_a_force_model_in_one_file_is_a_choice_of_a_ship(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mmg.components.wind.flat_plate", module_of(FORCE, "flat_plate"))
    monkeypatch.setitem(catalogue.MODELS["wind"], "flat_plate", "wind.flat_plate")
    bare = load_ship("kvlcc2_l7")
    components = {**bare.components, "wind": "flat_plate"}
    particulars = {**bare.particulars, "A_T": 0.5, "A_L": 1.5, "C": 0.1, "rho_a": 1.2}
    rows = catalogue.coefficient_table(components, particulars)
    coefficients = {symbol: bare.coefficients.get(symbol, row) for symbol, row in rows.items()}
    ship = replace(bare, components=components, particulars=particulars, coefficients=coefficients)
    simulator = Simulator(ship, compiled=False)
    controls = np.zeros((len(ship.inputs), 1))
    calm = simulator.rates(STATE, controls)
    controls[ship.inputs.index("wind_east")] = 5.0
    assert simulator.rates(STATE, controls)[4, 0] > calm[4, 0]  # wind to the east pushes a ship that heads north


def test_a_ship_in_one_file_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module_of(SHIP, "ship_walk_through")
    assert load_ship("my_ship.toml").coefficients["m_x"].fixed
