from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from cases.io.site import Site, read_site
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from mmg.errors import Conflict, Missing, UserError

SHIP = load_ship("esso_osaka_3m")


def site(folder, text):
    (folder / "site.toml").write_text(text)
    return read_site([folder / "a.csv"], SHIP)


def distance_to_bank(held, x, y):
    """m, as the effect has it: positive in the water."""
    return held["distance"] - x * math.cos(held["bearing"]) - y * math.sin(held["bearing"])


def beyond_the_shelf(held, x, y):
    """m, as the effect has it: positive over the shelf."""
    return x * math.cos(held["bearing"]) + y * math.sin(held["bearing"]) - held["line"]


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("side", ["greater", "less"])
@pytest.mark.parametrize("value", [-6.0, 4.0])
def test_lines_lie_where_the_file_says(tmp_path, axis, side, value):
    text = f'[bank]\n{axis} = {value}\nwater_side = "{side}"\n[shelf]\n{axis} = {value}\nshallow_side = "{side}"'
    held = site(tmp_path, text).held
    for offset in (-3.0, 0.0, 2.0):
        place = (value + offset, 77.0) if axis == "x" else (77.0, value + offset)
        expected = offset if side == "greater" else -offset
        assert distance_to_bank(held["bank"], *place) == pytest.approx(expected, abs=1e-9)
        assert beyond_the_shelf(held["shallow_water"], *place) == pytest.approx(expected, abs=1e-9)
    assert set(held["bank"]) == {"distance", "bearing"} and set(held["shallow_water"]) == {"line", "bearing"}


def test_the_bank_of_the_contract_pulls_towards_it(tmp_path):
    held = site(tmp_path, '[bank]\ny = -6.0\nwater_side = "greater"').held["bank"]
    assert held == pytest.approx({"distance": 6.0, "bearing": -math.pi / 2})
    from mmg.effects import effect
    from mmg.effects.effect import Setting
    from mmg.motion.flow import Flow

    values = SHIP.with_effect("bank", {**held, "suction": 0.03}).parameters_of("bank")
    e = effect("bank")
    at = Setting(**{**dict.fromkeys(Setting.__dataclass_fields__), "p": SHIP.namespace})
    near, far = (
        float(ca.DM(e.forces({}, Flow(u=0.5, v=0.0, r=0.0, psi=0.0, x=0.0, y=y), values, at)["bank"].Y))
        for y in (-5.0, 5.0)
    )
    assert near < 10 * far < 0


def test_lengths_and_depth_are_taken_over(tmp_path):
    text = '[bank]\nx = 1\nwater_side = "less"\ndecay = 2\n[shelf]\ny = 0\nshallow_side = "less"\nwidth = 0.7\n'
    held, start, notices = site(tmp_path, text + "[water]\ndepth = 2.0")
    assert held["bank"]["decay"] == 2.0 and held["shallow_water"]["width"] == 0.7
    assert start == {"shallow_water": {"d_h": pytest.approx(SHIP.particulars["d"] / 2.0)}}
    assert notices == ()
    ship = SHIP
    for name in held:
        ship = ship.with_effect(name, {**held[name], **start.get(name, {})})
    assert ship.parameters_of("bank").decay == 2.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[bank\n", "not a valid TOML"),
        ("[quay]\nx = 1", "'quay'"),
        ("bank = 3", r"bank = 3: must be a table, \[bank\]"),
        ('[bank]\nz = 1\nwater_side = "less"', r"\[bank\] unknown key 'z'; known: x, y, water_side, decay"),
        ('[bank]\nx = 1\ny = 2\nwater_side = "less"', r"\[bank\] give either x or y .* not both"),
        ('[shelf]\nshallow_side = "less"', r"\[shelf\] give either x or y .* neither"),
        ('[bank]\nx = "1"\nwater_side = "less"', '= "1"'),
        ("[bank]\nx = true", "x = true: must be a number"),
        ('[bank]\nx = nan\nwater_side = "less"', "x = nan: must be a finite number in m"),
        ('[bank]\nx = 1e9\nwater_side = "less"', "= 1000000000"),
        ("[bank]\nx = 1", "water_side ="),
        ('[shelf]\ny = 1\nshallow_side = "east"', "shallow_side ="),
        ('[bank]\nx = 1\nwater_side = "less"\ndecay = -1', "= -1"),
        ('[shelf]\nx = 1\nshallow_side = "less"\nwidth = 0', "= 0"),
        ("[water]\ndepth = 0.1", "= 0.1"),
        ("[water]", "depth is missing"),
    ],
)
def test_a_wrong_file_is_one_line_that_names_it(tmp_path, text, said):
    with pytest.raises(UserError, match=said) as error:
        site(tmp_path, text)
    assert "\n" not in str(error.value) and str(tmp_path / "site.toml") in str(error.value)


def test_no_file_is_no_knowledge(tmp_path):
    trial = Trial("a", {"t": np.arange(3.0)})
    assert read_site([tmp_path, tmp_path / "a.csv", trial], SHIP) == Site({}, {})


def test_folders_must_agree_and_one_without_a_file_is_said(tmp_path):
    a, b, c = (tmp_path / name for name in "abc")
    for folder in (a, b, c):
        folder.mkdir()
    (a / "site.toml").write_text("[water]\ndepth = 2.0")
    trial = Trial("run", {"t": np.arange(3.0)}, path=c / "run.csv")
    found = read_site([a, trial], SHIP)
    assert found.start and str(c) in found.notices[0]
    (b / "site.toml").write_text("[water]\ndepth = 2  # the same")
    assert read_site([a, b / "x.csv"], SHIP).notices == ()
    (b / "site.toml").write_text("[water]\ndepth = 3.0")
    with pytest.raises(Conflict):
        read_site([a, b], SHIP)
    assert read_site([a, b], SHIP, explicit=b / "site.toml").start["shallow_water"]["d_h"] < 0.1
    with pytest.raises(Missing):
        read_site([a], SHIP, explicit=c / "site.toml")
