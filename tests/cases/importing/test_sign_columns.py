"""Numbers without a sign take it from a column of words, or are refused; hull motions are no actuators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.importing.written_trials import write_import
from cases.io.toml_file import validated
from tests.support import raw_logs
from tests.support.raw_logs import bridge, table

pytest.importorskip("pyproj", reason="needs the extra import")


def hemispheres(origin: tuple[float, float], titles: tuple[str, str], order: str = "apart") -> dict[str, object]:
    """A bridge's log without course: absolute latitude and longitude, and letters below ``titles``."""
    log = bridge(raw_logs.run(), origin)
    lat, lon = np.asarray(log.pop("Latitude")), np.asarray(log.pop("Longitude"))
    north, east = np.where(lat < 0, "S", "N"), np.where(lon < 0, "W", "E")
    pairs = [("Latitude", np.abs(lat)), (titles[0], north), ("Longitude", np.abs(lon)), (titles[1], east)]
    pairs = pairs if order == "apart" else [pairs[0], pairs[2], pairs[1], pairs[3]]
    return {"Time": log["Time"], **dict(pairs), **{k: log[k] for k in ("Heading [deg]", "RPM", "Rudder [deg]")}}


@pytest.mark.parametrize("origin", [(-33.86, 151.2), (-33.0, -71.6), (48.3, -4.4), (34.7, 135.4)])
@pytest.mark.parametrize(
    ("titles", "order"),
    [(("N/S", "E/W"), "apart"), (("Lat Hemi", "Lon Hemi"), "apart"), (("LatRef", "LonRef"), "together"),
     (("a", "b"), "together")],
)  # fmt: skip
def test_letters_of_hemispheres_are_signs(
    tmp_path: Path, origin: tuple[float, float], titles: tuple[str, str], order: str
) -> None:
    found = import_logs([table(tmp_path / "a.csv", hemispheres(origin, titles, order))])
    assert not found.problems and found.origin == pytest.approx(origin, abs=1e-3)
    assert np.abs(found.runs[0].columns["u"] - raw_logs.run()["u"])[20:-20].max() < 0.01


def test_a_large_log_and_its_map_keep_the_signs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = hemispheres((-33.0, -71.6), ("Lat Hemi", "Lon Hemi"))
    log["Shaft direction"] = ["ASTERN"] * len(raw_logs.run())
    path = table(tmp_path / "a.csv", log)
    small = import_logs([path])
    write_import(small, ImportMap(), tmp_path / "one")
    monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    monkeypatch.setattr("cases.io.block_means.MOST_KEPT", 100)
    for chosen in (ImportMap(), read_map(tmp_path / "one" / "import.toml")):
        large = import_logs([path], chosen)
        assert not large.problems and large.origin == pytest.approx((-33.0, -71.6), abs=1e-3)
        assert 85 < len(large.runs[0].columns["n"]) <= 100 and np.all(large.runs[0].columns["n"] < 0)
    assert np.all(small.runs[0].columns["n"] < 0)


def test_letters_elsewhere_are_no_hemispheres(tmp_path: Path) -> None:
    log = {"Mode": ["S"] * len(raw_logs.run()), **bridge(raw_logs.run()), "Alarm": ["W"] * len(raw_logs.run())}
    found = import_logs([table(tmp_path / "a.csv", log)])
    assert not found.problems and found.origin == pytest.approx((34.7, 135.4), abs=1e-3)
    assert set(found.runs[0].logs[0].unknown) == {"Mode", "Alarm"}


ASTERN = raw_logs.run().t > 90.0
"""Rows of a shaft that turns astern for a while."""


def reversing(title: str, ahead: str, astern: str, **more: object) -> dict[str, object]:
    log = bridge(raw_logs.run())
    return {**log, "RPM": np.abs(log["RPM"]), title: np.where(ASTERN, astern, ahead), **more}


@pytest.mark.parametrize(
    ("title", "ahead", "astern"),
    [("Shaft direction", "AHEAD", "ASTERN"), ("Gear", "FWD", "REV"), ("ME status", "Ahead", "Astern"),
     ("Shaft dir", "1", "-1"), ("Reversing", "0", "1"), ("dir", "forward", "backward")],
)  # fmt: skip
def test_revolutions_without_a_sign_are_negative_astern(tmp_path: Path, title: str, ahead: str, astern: str) -> None:
    found = import_logs([table(tmp_path / "a.csv", reversing(title, ahead, astern))])
    truth = np.where(ASTERN, -1, 1) * raw_logs.run()["n"]
    assert not found.problems and found.runs[0].columns["n"] == pytest.approx(truth)
    assert any(getattr(m, "code", "") == "sign" for m in found.runs[0].notices)


def test_a_direction_that_is_logged_when_it_changes_is_held(tmp_path: Path) -> None:
    words = [""] * len(ASTERN)
    words[0], words[int(np.argmax(ASTERN))] = "AHEAD", "ASTERN"
    found = import_logs([table(tmp_path / "a.csv", {**reversing("Direction", "", ""), "Direction": words})])
    assert np.array_equal(found.runs[0].columns["n"] < 0, ASTERN)


@pytest.mark.parametrize(
    ("title", "ahead", "astern"),
    [("Shaft direction", "CW", "CCW"), ("Propeller direction", "0", "1"), ("Telegraph", "Ahead", "Astern"),
     ("RPM order", "ahead", "astern")],
)  # fmt: skip
def test_a_direction_that_nobody_can_read_is_refused(tmp_path: Path, title: str, ahead: str, astern: str) -> None:
    """And an order, which comes before the shaft obeys; the map can say that the column is not used."""
    path = table(tmp_path / "a.csv", reversing(title, ahead, astern))
    found = import_logs([path])
    assert len(found.problems) == 1 and f"column '{title}'" in found.problems[0] and "'RPM'" in found.problems[0]
    kept = import_logs([path], ImportMap(ignore=[title]))
    assert not kept.problems and np.all(kept.runs[0].columns["n"] >= 0)


def test_numbers_with_signs_keep_them(tmp_path: Path) -> None:
    """The words of a lever come before the shaft turns round."""
    log = reversing("Shaft direction", "AHEAD", "ASTERN")
    log["RPM"] = np.where(np.roll(ASTERN, 10), -1, 1) * np.asarray(log["RPM"])
    found = import_logs([table(tmp_path / "a.csv", log)])
    assert np.array_equal(found.runs[0].columns["n"] < 0, np.roll(ASTERN, 10))


def test_each_shaft_has_its_own_direction(tmp_path: Path) -> None:
    log = reversing("Direction stbd", "Ahead", "Astern")
    log |= {"RPM stbd": log["RPM"], "RPM port": 0.5 * np.asarray(log.pop("RPM")), "Direction port": ["Ahead"] * 361}
    log = {name: list(values)[: len(ASTERN)] for name, values in log.items()}
    columns = import_logs([table(tmp_path / "a.csv", log)]).runs[0].columns
    assert np.array_equal(columns["n"] < 0, ASTERN) and np.all(columns["n_2"] >= 0)


@pytest.mark.parametrize(("title", "words"), [("Rudder side", "PS"), ("Rudder direction", ("PORT", "STBD"))])
def test_a_rudder_angle_takes_its_side(tmp_path: Path, title: str, words: tuple[str, str]) -> None:
    truth = raw_logs.run()["delta"]
    log = bridge(raw_logs.run())
    log["Rudder [deg]"] = np.degrees(np.abs(truth))
    log[title] = np.where(truth < 0, *words)
    found = import_logs([table(tmp_path / "a.csv", log)])
    assert not found.problems and found.runs[0].columns["delta"] == pytest.approx(truth)


def test_pitch_beside_roll_is_that_of_the_hull(tmp_path: Path) -> None:
    """It is asked for; a header of the propeller, or a pitch without other motions, is the blades'."""
    log, n = bridge(raw_logs.run()), len(raw_logs.run())
    motions = {"roll [deg]": np.ones(n), "pitch [deg]": np.full(n, 2.0)}
    found = import_logs([table(tmp_path / "a.csv", {**log, **motions})])
    assert not found.problems and "pitch" not in found.runs[0].columns
    assert [list(q.choices) for q in found.questions if q.file.name] == [["pitch", "nothing"]]
    for more in ({**motions, "Propeller pitch [deg]": np.full(n, 20.0)}, {"pitch [deg]": np.full(n, 20.0)}):
        found = import_logs([table(tmp_path / "a.csv", {**log, **more})])
        assert found.runs[0].columns["pitch"] == pytest.approx(np.radians(20.0))
    said = validated(ImportMap, {"columns": {"pitch": "pitch"}}, "map")
    found = import_logs([table(tmp_path / "a.csv", {**log, **motions})], said)
    assert found.runs[0].columns["pitch"] == pytest.approx(np.radians(2.0))


@pytest.mark.parametrize(("turned", "asked"), [(0.0, True), (180.0, False)])
def test_pods_that_stop_a_ship_without_a_sign_or_a_turn_are_asked_for(
    tmp_path: Path, turned: float, asked: bool
) -> None:
    t = np.arange(0.0, 100.0, 0.5)
    u = np.maximum(5.0 - 0.08 * t, -1.0)
    columns = {"time [s]": t, "x [m]": np.cumsum(u) * 0.5, "y [m]": 0.0 * t, "u [m/s]": u, "v [m/s]": 0.01 * np.sin(t)}
    columns |= {"heading [deg]": 10.0 + 0.1 * np.sin(t), "rot [deg/s]": 0.1 * np.cos(t), "azimuth rpm": 90.0 + 0.0 * t}
    columns |= {"azimuth angle [deg]": np.where(t > 20, turned, 0.0) + np.sin(t)}
    found = import_logs([table(tmp_path / "a.csv", columns)])
    assert bool(found.problems) is asked and (not asked or "azimuth rpm" in found.problems[0])
