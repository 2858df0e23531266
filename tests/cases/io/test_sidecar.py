from __future__ import annotations

import numpy as np
import pytest

from cases.io.read import read_trial, read_trials
from cases.io.sidecar import SidecarEntry, sidecar_entry
from cases.io.toml_file import validated
from mmg.errors import UserError
from tests.support.trial_files import motion_columns, write_csv


def sidecar(folder, text):
    (folder / "trials.toml").write_text(text)


def test_a_file_entry_wins_over_the_default_and_tables_are_merged(tmp_path):
    sidecar(
        tmp_path,
        """
[default]
kind = "zigzag"
units = { u = "kn", n = "rpm" }
[files."a.csv"]
role = "test"
kind = "turning"
units = { n = "rps" }
""",
    )
    settings = sidecar_entry(tmp_path / "a.csv")
    assert (settings.kind, settings.role) == ("turning", "test")
    assert settings.units == {"u": "kn", "n": "rps"}
    assert sidecar_entry(tmp_path / "b.csv").units == {"u": "kn", "n": "rpm"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[default]\nrudder = "port"', "unknown key 'rudder'"),
        ('[defaults]\nkind = "x"', "unknown section"),
        ('[default]\nrudder_positive = "left"', 'rudder_positive = "left": must be "starboard" or "port"'),
        ('[default]\nunits = { u = "mph" }', "unknown unit 'mph'"),
        ('[default]\nunits = { speed = "kn" }', "not a canonical column"),
        ("[default]\nsign = { r = 2 }", "must be 1 or -1"),
        ('[default]\nreference_point = "bow"', "reference_point must be"),
        ('[files."a.csv"]\nname = "../../evil"', '"a.csv"] name = "../../evil": must be plain words'),
        ("[default\n", "not a valid TOML"),
        ("[default]\n[all]\n", "keep one"),
    ],
)
def test_a_wrong_sidecar_is_one_line(tmp_path, text, said):
    write_csv(tmp_path / "a.csv")
    sidecar(tmp_path, text)
    with pytest.raises(UserError, match=said) as error:
        read_trial(tmp_path / "a.csv")
    assert "\n" not in str(error.value)


def test_an_entry_for_no_file_of_the_folder_is_an_error(tmp_path):
    write_csv(tmp_path / "a.csv")
    sidecar(tmp_path, '[files."b.csv"]\nkind = "x"')
    with pytest.raises(UserError, match="names no file of this folder"):
        read_trials([tmp_path])


def test_foreign_headers_units_and_rudder_sign_are_converted_and_said(tmp_path):
    truth = motion_columns(20.0)
    stored = {**truth, "u": truth["u"] / (1852 / 3600), "n": truth["n"] * 60, "delta": -truth["delta"]}
    write_csv(tmp_path / "a.csv", stored, {"u": "SOG", "n": "Shaft [rpm]", "t": "time"})
    sidecar(
        tmp_path,
        """
[all]
rudder_positive = "port"
columns = { u = "SOG", n = "Shaft", t = "time" }
units = { u = "kn", t = "s" }
""",
    )
    trial = read_trial(tmp_path / "a.csv")
    for name in ("t", "u", "n", "delta"):
        np.testing.assert_allclose(trial[name], truth[name], rtol=1e-12)
    assert any("positive to port" in notice for notice in trial.notices)


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


def test_earth_fixed_velocities_are_turned_into_body_axes(tmp_path):
    truth = motion_columns(20.0)
    w = (truth["u"] + 1j * truth["v"]) * np.exp(1j * truth["psi"])
    write_csv(tmp_path / "a.csv", {**truth, "u": w.real, "v": w.imag})
    trial = read_trial(tmp_path / "a.csv", {"velocity_frame": "earth"})
    np.testing.assert_allclose(trial["u"], truth["u"], atol=1e-12)
    np.testing.assert_allclose(trial["v"], truth["v"], atol=1e-12)


def test_a_wind_that_goes_to_is_turned_round(tmp_path):
    write_csv(tmp_path / "a.csv")
    trial = read_trial(tmp_path / "a.csv", {"wind_direction": "to"})
    np.testing.assert_allclose(trial["wind_direction"], 1.0 + np.pi)


def test_settings_without_a_file_refuse_the_same_things():
    point = validated(SidecarEntry, {"reference_point": [1, 2]}, "settings").reference_point
    assert (point.x, point.y, point.applies_to) == (1.0, 2.0, "both")
    with pytest.raises(UserError, match="unknown key"):
        validated(SidecarEntry, {"port": True}, "settings")
