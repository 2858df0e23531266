from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_map import FileMap, ImportMap
from cases.io.read import read_trial, read_trials
from cases.io.sidecar import ReferencePoint, Sidecar, SidecarEntry, sidecar_entry
from cases.io.site import Site, read_site
from cases.io.toml_file import validated
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from mmg.errors import BadValue, Conflict, Missing, UserError
from mmg.messages import has_code
from tests.support.trial_files import motion_columns, write_csv


def sidecar(folder, text):
    (folder / "trials.toml").write_text(text)


def test_a_file_entry_wins_over_the_default_and_tables_are_merged(tmp_path):
    text = '[default]\nkind = "zigzag"\nunits = { u = "kn", n = "rpm" }\n'
    sidecar(tmp_path, f'{text}[files."a.csv"]\nrole = "test"\nkind = "turning"\nunits = {{ n = "rps" }}\n')
    settings = sidecar_entry(tmp_path / "a.csv")
    assert (settings.kind, settings.role) == ("turning", "test")
    assert settings.units == {"u": "kn", "n": "rps"}
    assert sidecar_entry(tmp_path / "b.csv").units == {"u": "kn", "n": "rpm"}


NINES = "9" * 4000
WRONG = {
    '[default]\nrudder = "port"': "'rudder'",
    '[defaults]\nkind = "x"': "unknown section",
    '[default]\nrudder_positive = "left"': "rudder_positive =",
    '[default]\nunits = { u = "mph" }': "'mph'",
    '[default]\nunits = { speed = "kn" }': "not a canonical column",
    "[default]\nsign = { r = 2 }": "-1",
    '[default]\nreference_point = "bow"': "reference_point",
    '[files."a.csv"]\nname = "../../evil"': '= "../../evil"',
    "[default\n": "not a valid TOML",
    "[default]\n[all]\n": "keep one",
    **{f"[default]\nreference_point = {{x = {x}, y = 0.0}}": "trials.toml" for x in ("nan", "inf", "1e300", NINES)},
    f"[default]\nsign = {{u = {NINES}{NINES}}}": "trials.toml",
    **{f"[default]\nkind = {deep}": "trials.toml" for deep in (
        "[" * 3000 + "]" * 3000, "[" * 400 + "]" * 400, "{a = " * 400 + "1" + "}" * 400)},
    '[default]\nname = "\\u0000"': "trials.toml",
}  # fmt: skip


@pytest.mark.parametrize(("text", "said"), WRONG.items(), ids=[text[:50] for text in WRONG])
def test_a_wrong_sidecar_is_one_line(tmp_path, text, said):
    write_csv(tmp_path / "a.csv")
    sidecar(tmp_path, text)
    with pytest.raises(UserError, match=said) as error:
        read_trial(tmp_path / "a.csv")
    assert "\n" not in str(error.value) and len(str(error.value)) < 1000


def test_a_sidecar_beside_a_part_of_its_files_is_said_and_no_error(tmp_path):
    write_csv(tmp_path / "a.csv")
    sidecar(tmp_path, '[files."a.csv"]\nkind = "x"\n[files.b]\nkind = "y"')
    (trial,) = read_trials([tmp_path])
    assert trial.kind == "x" and has_code(trial.notices, "sidecar_file_absent")
    write_csv(tmp_path / "b.csv")
    assert not any(has_code(trial.notices, "sidecar_file_absent") for trial in read_trials([tmp_path]))


def test_foreign_headers_units_and_rudder_sign_are_converted_and_said(tmp_path):
    truth = motion_columns(20.0)
    stored = {**truth, "u": truth["u"] / (1852 / 3600), "n": truth["n"] * 60, "delta": -truth["delta"]}
    write_csv(tmp_path / "a.csv", stored, {"u": "SOG", "n": "Shaft [rpm]", "t": "time"})
    text = '[all]\nrudder_positive = "port"\ncolumns = { u = "SOG", n = "Shaft", t = "time" }\n'
    sidecar(tmp_path, text + 'units = { u = "kn", t = "s" }\n')
    trial = read_trial(tmp_path / "a.csv")
    for name in ("t", "u", "n", "delta"):
        np.testing.assert_allclose(trial[name], truth[name], rtol=1e-12)
    assert has_code(trial.notices, "sign")


@pytest.mark.parametrize("applies", ["position", "velocity", "both"])
def test_a_reference_point_off_midship_is_moved_to_midship(tmp_path, applies):
    truth = motion_columns(20.0)
    l_x, l_y, c, s = 1.2, -0.3, np.cos(truth["psi"]), np.sin(truth["psi"])
    stored = dict(truth)
    if applies != "velocity":
        stored["x"], stored["y"] = truth["x"] + l_x * c - l_y * s, truth["y"] + l_x * s + l_y * c
    if applies != "position":
        stored["u"], stored["v"] = truth["u"] - l_y * truth["r"], truth["v"] + l_x * truth["r"]
    write_csv(tmp_path / "a.csv", stored)
    trial = read_trial(tmp_path / "a.csv", {"reference_point": {"x": l_x, "y": l_y, "applies_to": applies}})
    for name in ("x", "y", "u", "v"):
        np.testing.assert_allclose(trial[name], truth[name], atol=1e-12)


def test_earth_fixed_velocities_are_turned_into_body_axes_and_a_wind_that_goes_to_round(tmp_path):
    truth = motion_columns(20.0)
    w = (truth["u"] + 1j * truth["v"]) * np.exp(1j * truth["psi"])
    write_csv(tmp_path / "a.csv", {**truth, "u": w.real, "v": w.imag})
    trial = read_trial(tmp_path / "a.csv", {"velocity_frame": "earth", "wind_direction": "to"})
    np.testing.assert_allclose(trial["u"], truth["u"], atol=1e-12)
    np.testing.assert_allclose(trial["v"], truth["v"], atol=1e-12)
    np.testing.assert_allclose(trial["wind_direction"], 1.0 + np.pi)


def test_settings_without_a_file_refuse_the_same_things():
    point = validated(SidecarEntry, {"reference_point": [1, 2]}, "settings").reference_point
    assert (point.x, point.y, point.applies_to) == (1.0, 2.0, "both")
    with pytest.raises(BadValue):
        validated(SidecarEntry, {"port": True}, "settings")


ROOT = Path(__file__).parents[3]


def keys_of_page(name: str) -> set[str]:
    """Keys in the TOML examples of a page of the documentation, also those of tables on one line."""
    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / name).read_text(encoding="utf-8"), re.S)
    lines = [line.split("#")[0] for block in blocks for line in block.splitlines()]
    return {key for line in lines for key in re.findall(r"(\w+) = ", line)} | {
        table for block in blocks for table in re.findall(r"^\[(\w+)", block, re.M)
    }


def test_the_documentation_lists_every_key() -> None:
    sidecar = {*SidecarEntry.model_fields, *ReferencePoint.model_fields, *Sidecar.model_fields} - {"all"}
    assert sidecar - keys_of_page("reference/trials.md") == set()
    chosen = {*ImportMap.model_fields, *FileMap.model_fields, "from", "unit", "sign"}
    assert chosen - keys_of_page("how-to/import.md") == set()


def test_a_line_to_add_names_its_sidecar_and_table(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", headers={"psi": "heading [rad]"})
    with pytest.raises(Missing) as error:
        read_trial(path)
    table, line = re.search(r"add to .*trials\.toml, (\[files\..*?\]): (.*)$", str(error.value)).groups()
    assert str(tmp_path / "trials.toml") in str(error.value)
    (tmp_path / "trials.toml").write_text(f"{table}\n{line}\n".replace("HEADER", "heading"))
    assert "psi" in read_trial(path)


SHIP = load_ship("esso_osaka_3m")


def site(folder, text):
    (folder / "site.toml").write_text(text)
    return read_site([folder / "a.csv"], SHIP)


def beyond(held, line, x, y):
    """m, as the effects have it: how far a place lies beyond a line, in its bearing."""
    return x * math.cos(held["bearing"]) + y * math.sin(held["bearing"]) - held[line]


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("side", ["greater", "less"])
@pytest.mark.parametrize("value", [-6.0, 4.0])
def test_lines_lie_where_the_file_says(tmp_path, axis, side, value):
    text = f'[bank]\n{axis} = {value}\nwater_side = "{side}"\n[shelf]\n{axis} = {value}\nshallow_side = "{side}"'
    held = site(tmp_path, text).held
    for offset in (-3.0, 0.0, 2.0):
        place = (value + offset, 77.0) if axis == "x" else (77.0, value + offset)
        expected = offset if side == "greater" else -offset
        assert beyond(held["bank"], "distance", *place) == pytest.approx(-expected, abs=1e-9)  # positive on land
        assert beyond(held["shallow_water"], "line", *place) == pytest.approx(expected, abs=1e-9)  # over the shelf
    assert set(held["bank"]) == {"distance", "bearing"} and set(held["shallow_water"]) == {"line", "bearing"}


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
