"""Runs come out of raw logs as they went in, whatever the format, the clock, the units and the words for a sign."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.checks import check
from cases.importing.assembled_run import globe_positions
from cases.importing.import_logs import import_logs, write_import
from cases.importing.import_map import POINT, ImportMap, read_map
from cases.inputs import STANDARD, is_sampled, model_inputs
from cases.io.read import read_trials
from cases.io.sidecar import read_sidecar
from cases.io.toml_file import parse_toml, validated
from cases.trial import Trial
from mmg.errors import Conflict, TargetExists, UserError
from mmg.messages import has_code
from tests.support import raw_logs
from tests.support.raw_logs import UNITS, bridge, chosen, codes, errors, imported, plain, table

openpyxl = pytest.importorskip("openpyxl", reason="needs the extra import")
pytest.importorskip("pynmeagps", reason="needs the extra import")
pytest.importorskip("pyproj", reason="needs the extra import")

PORT = ImportMap(rudder_positive="port")
TRUTH = raw_logs.run()
LIMITS = {"x": 0.02, "y": 0.02, "psi": 1e-3, "u": 3e-3, "v": 6e-3, "r": 8e-4, "n": 1e-4, "delta": 0.03}
SEMICOLONS = {"decimal_commas", "clock", "derived", "local_frame"}
# How a log is written -> the map, by how much its clock is late [s], what is said of it, columns of wider errors
LOGS: dict[str, tuple[Callable[[Path, Trial], Any], ImportMap | None, float, set[str], str]] = {
    "semicolons, decimal commas, knots, the globe": (
        lambda d, run: raw_logs.semicolons(d / "a.csv", run), PORT, 0.0, SEMICOLONS, "xyuvr"),
    "an Excel sheet with a title and a line of units": (
        lambda d, run: raw_logs.excel(d / "a.xlsx", run), None, 0.0, set(), "xyuv"),
    "NMEA with a damaged line": (lambda d, run: raw_logs.nmea(d / "a.nmea", run), None, 0.0, set(), "xyuv"),
    "three files with their own clocks": (raw_logs.apart, None, 0.3, {"joined"}, "xyuv"),
}  # fmt: skip


def close(columns: dict[str, np.ndarray], truth: Trial, late: float = 0.0) -> bool:
    off = errors(columns, truth, late)
    return all(off[name] < LIMITS[name] for name in LIMITS)


@pytest.mark.parametrize("name", LOGS)
def test_a_run_comes_out_of_a_log_as_it_went_in(tmp_path: Path, name: str) -> None:
    """The check of the written trial finds nothing wrong, and the map that is written repeats the import."""
    write, given, late, said, derived = LOGS[name]
    truth = raw_logs.run("zigzag:10/10" if "NMEA" in name else "zigzag:20/20")
    (tmp_path / "logs").mkdir()
    write(tmp_path / "logs", truth)
    found = imported(tmp_path / "logs", given)
    assert len(found.runs) == 1 and close(found.runs[0].columns, truth, late), errors(found.runs[0].columns, truth)
    assert found.runs[0].day == "2026-05-04" and said <= codes(found), codes(found)
    (file,) = write_import(found, given or ImportMap(), tmp_path / "one")
    (trial,) = read_trials(file)
    (report,) = check([trial])
    assert report.verdict not in ("contradictory", "doubtful"), [f.text for f in report.findings]
    again = read_map(tmp_path / "one" / "import.toml")
    (second,) = write_import(imported(tmp_path / "logs", again), again, tmp_path / "two")
    assert second.name == file.name and second.read_bytes() == file.read_bytes()
    assert set(trial.std) == set(derived)


def test_an_import_goes_into_a_folder_with_files_only_when_asked(tmp_path: Path) -> None:
    found = imported(raw_logs.semicolons(tmp_path / "zigzag.csv", TRUTH), PORT)
    assert found.runs[0].logs[0].unknown == ("Mood",)
    target = tmp_path / "out"
    write_import(found, PORT, target)
    with pytest.raises(TargetExists):
        write_import(found, PORT, target)
    assert write_import(found, PORT, target, force=True) == [target / "zigzag.csv"]
    assert not list(tmp_path.glob(".out*"))


@pytest.mark.parametrize(
    ("zone", "place"), [("56S", (-33.857, 151.215)), ("32N", (58.9, 10.4)), ("54T", (41.5, 140.0))]
)
def test_a_zone_names_its_hemisphere(zone: str, place: tuple[float, float]) -> None:
    pyproj = pytest.importorskip("pyproj", reason="needs the extra import")
    east, north = pyproj.Proj(proj="utm", zone=int(zone[:2]), south=place[0] < 0, ellps="WGS84")(place[1], place[0])
    found = globe_positions(np.array([north]), np.array([east]), zone, "log")
    assert [float(x[0]) for x in found] == pytest.approx(place, abs=1e-8)


@pytest.mark.parametrize("inputs", ["", "held"])
def test_actuators_of_a_log_are_samples_unless_the_map_says_that_they_are_held(tmp_path: Path, inputs: str) -> None:
    given = chosen(inputs=inputs) if inputs else ImportMap()
    found = imported(plain(tmp_path / "a.txt", UNITS), given)
    trial = read_trials(write_import(found, given, tmp_path / "one"))[0]
    assert is_sampled(trial) is not bool(inputs)
    delta = model_inputs(trial).array[:-1, STANDARD.index("delta")]
    at_samples = trial["delta"]
    assert delta == pytest.approx(at_samples[:-1] if inputs else 0.5 * (at_samples[:-1] + at_samples[1:]), abs=1e-9)
    assert ("inputs" in codes(found)) is not bool(inputs)
    again = read_map(tmp_path / "one" / "import.toml")
    write_import(imported(tmp_path / "a.txt", again), again, tmp_path / "two")
    assert (tmp_path / "one" / "trials.toml").read_bytes() == (tmp_path / "two" / "trials.toml").read_bytes()


def antenna_log(path: Path, l_x: float, l_y: float = 0.0) -> Path:
    """A bridge's log of a receiver so far ahead of midship and to starboard [m]."""
    c, s, r = np.cos(TRUTH["psi"]), np.sin(TRUTH["psi"]), TRUTH["r"]
    moved = {"x": TRUTH["x"] + l_x * c - l_y * s, "y": TRUTH["y"] + l_x * s + l_y * c}
    moved |= {"u": TRUTH["u"] - l_y * r, "v": TRUTH["v"] + l_x * r}
    return table(path, bridge(TRUTH.with_columns(**moved)))


def test_an_antenna_that_the_map_gives_is_taken_to_midship_once(tmp_path: Path) -> None:
    given = chosen(reference_point={"x": 3.0, "y": 0.5})
    found = imported(antenna_log(tmp_path / "a.csv", 3.0, 0.5), given)
    assert close(found.runs[0].columns, TRUTH) and "reference_point" in codes(found) and not found.questions
    trial = read_trials(write_import(found, given, tmp_path / "out"))[0]
    assert np.abs(trial["x"] - found.runs[0].columns["x"]).max() < 1e-6
    with (tmp_path / "out" / "trials.toml").open("a") as sidecar:
        sidecar.write('[files."a.csv".reference_point]\nx = 3.0\n')
    with pytest.raises(Conflict):  # it would be applied a second time
        write_import(found, given, tmp_path / "out", force=True)


def test_an_unknown_antenna_is_said_with_the_line_that_answers_it_and_widens_the_errors(tmp_path: Path) -> None:
    log = antenna_log(tmp_path / "a.csv", 3.0)
    found = imported(log)
    (said,) = [m for m in found.runs[0].notices if has_code([m], "reference_point_unknown")]
    for line in re.findall(r'reference_point = (?:\{[^}]*\}|"\w+")', said):
        validated(ImportMap, parse_toml(line, "line"), "line")
    assert [list(q.choices) for q in found.questions] == [[POINT, "unknown"]]
    lever = 3.0 * np.sqrt(np.mean(raw_logs.run()["r"] ** 2))
    assert lever < found.runs[0].std["v"] < 2 * lever
    for map_ in ({"reference_point": "unknown"}, {"reference_point": "unknown", "length": 14.0}):
        answered = imported(log, chosen(**map_))
        assert not answered.questions and "reference_point_unknown" in codes(answered)
    assert answered.runs[0].std["v"] == pytest.approx(7 / 3 * lever, rel=1e-3)
    for wrong in ("unknown_one", {"x": "12"}, {"x": 1.0, "z": 2.0}, [1.0]):
        with pytest.raises(UserError, match="reference_point"):
            chosen(reference_point=wrong)


@pytest.mark.slow
def test_force_replaces_what_an_import_wrote_and_keeps_what_a_person_wrote(tmp_path: Path) -> None:
    logs, out, path = tmp_path / "logs", tmp_path / "out", tmp_path / "out" / "trials.toml"
    for name, maneuver in (("a", "zigzag:20/20"), ("b", "turning:35")):
        table(logs / f"{name}.csv", bridge(raw_logs.run(maneuver)))

    def written(log: Path, given: ImportMap) -> str:
        write_import(imported(log, given), given, out, force=True)
        return path.read_text()

    first = written(logs, ImportMap())
    assert written(logs, ImportMap()) == first
    mine = '# seen by me\n[files."a.csv"]\nkind = "zigzag"  # of mine'
    path.write_text(first.replace('[files."a.csv"]', mine).replace('"2026-05-04"', '"2026-05-05"', 1))
    text, said = written(logs / "a.csv", chosen(inputs="held")), read_sidecar(path)
    a, b = (said.entry(out / f"{name}.csv") for name in "ab")
    assert "# seen by me" in text and "# of mine" in text
    assert (a.day, a.kind, a.inputs) == ("2026-05-05", "zigzag", "held") and b.std  # the file is still there
    (out / "b.csv").unlink()
    written(logs / "a.csv", chosen(inputs="held"))
    assert set(read_sidecar(path).files) == {"a.csv"}
    path.write_text("colour = 1\n")
    with pytest.raises(UserError, match="colour"):
        written(logs / "a.csv", ImportMap())
    assert path.read_text() == "colour = 1\n"


@pytest.mark.parametrize("zone", ["Z", "+02:00", "+00"])
def test_a_zone_for_stamps_that_have_one_is_refused(tmp_path: Path, zone: str) -> None:
    """Also for one of two digits, behind a blank instead of a T."""
    log, nine = bridge(TRUTH), ImportMap(zone_hours=9.0)
    cells = [raw_logs.stamp(t)[:-6].replace("T", " ") for t in TRUTH.t]
    path = table(tmp_path / "a.csv", {**log, "Time": [cell + zone for cell in cells]})
    found = import_logs([path], nine)
    assert found.problems and found.runs[0].day == "2026-05-04" and found.runs[0].logs
    imported(table(path, {**log, "Time": cells}), nine)


def test_a_trial_file_is_imported_as_it_is(tmp_path: Path) -> None:
    """Also with units at the end of headers, and with the headers of the FRT-DS-ESSO records, to the last row."""
    names = {"x": "x_position_mid", "y": "y_position_mid", "psi": "psi_hat", "u": "u_velo", "v": "vm_velo"}
    names |= {"r": "r_angvelo", "n": "n_prop", "delta": "delta_rudder"}
    frame = TRUTH.to_pandas()
    parts = [cell.split() for cell in frame.columns]
    for number, renamed in enumerate(({}, names)):
        headers = [f"{renamed.get(name, name)} {unit}" for name, unit in parts]
        frame.set_axis(headers, axis=1).to_csv(tmp_path / f"{number}.csv", index=False)
    for path in (plain(tmp_path / "a.txt", UNITS), tmp_path / "0.csv", tmp_path / "1.csv"):
        (run,) = imported(path).runs
        assert len(run.columns["t"]) == len(TRUTH) and not run.std
        assert max(errors(run.columns, TRUTH, inside=-1.0).values()) < 1e-9


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("yaw_rate", 180 / np.pi, "deg/s"), ("yaw_rate", 10800 / np.pi, "deg/min"), ("surge", 3600 / 1852, "kn"),
     ("surge", 3.6, "km/h"), ("surge", 1.0, "m/s")],
)  # fmt: skip
def test_units_that_nobody_wrote_are_found_by_other_columns(
    tmp_path: Path, name: str, factor: float, unit: str
) -> None:
    column, written = ("r", "yaw_rate_rad_s") if name == "yaw_rate" else ("u", "surge_mps")
    path = plain(tmp_path / "a.txt", UNITS.replace(written, name), **{column: factor * TRUTH[column]})
    found = imported(path)
    assert errors(found.runs[0].columns, TRUTH)[column] < 1e-9
    said = [m for m in found.runs[0].notices if getattr(m, "code", "") == "unit_found"]
    assert len(said) == 1 and f"in {unit}:" in said[0]


def test_what_nothing_shows_is_asked_for(tmp_path: Path) -> None:
    """A unit, and what a wind is."""
    path = plain(tmp_path / "a.txt", UNITS.replace("shaft_rps", "shaft_speed"))
    found = import_logs([path])
    assert len(found.problems) == 1 and "'shaft_speed'" in found.problems[0]
    assert [list(q.choices)[:2] for q in found.questions] == [["rps", "rpm"]]
    answered = imported(path, chosen(columns={"n": {"from": "shaft_speed", "unit": "rps"}}))
    assert errors(answered.runs[0].columns, TRUTH)["n"] < 1e-12
    more = {"w": np.full(len(TRUTH), 5.0), "d": np.full(len(TRUTH), 1.0)}
    found = import_logs([plain(tmp_path / "a.txt", f"{UNITS} wind_speed_mps wind_dir_rad", **more)])
    assert [list(q.choices) for q in found.questions] == [
        [f"wind_{of}", f"apparent_wind_{of}", "nothing"] for of in ("speed", "direction")
    ]
    assert "wind_speed" not in found.runs[0].columns


def test_numbers_for_nothing_lost_satellites_and_a_channel_that_stands_still(tmp_path: Path) -> None:
    truth, rng = TRUTH, np.random.default_rng(0)
    sizes = {"x": 0.02, "y": 0.02, "u": 0.01, "r": 1e-3}
    x, y, u, r = (truth[c] + rng.normal(0, s, len(truth)) for c, s in sizes.items())
    u[50:55], u[60:65], x[100:103], y[100:103] = -999.0, 327.67, 1e5, -2e5
    r[200:240] = r[200]
    found = imported(plain(tmp_path / "a.txt", UNITS, x=x, y=y, u=u, r=r))
    columns = found.runs[0].columns
    assert np.isnan(columns["u"][[*range(50, 55), *range(60, 65)]]).all()
    assert np.isfinite(columns["u"]).sum() == len(truth) - 10
    assert np.isnan(columns["x"][100:103]).all() and np.isfinite(columns["x"]).sum() == len(truth) - 3
    assert np.isnan(columns["r"][201:240]).all() and np.isfinite(columns["r"]).sum() == len(truth) - 39
    assert {"sentinel", "position_lost", "frozen"} <= codes(found)


def test_zeros_of_a_logger_without_values_stand_for_nothing(tmp_path: Path) -> None:
    """Of a rudder only where a heading or a speed is lost as well: one amidships is zero, too."""
    truth = TRUTH
    lost = np.zeros(len(truth), dtype=bool)
    lost[42:47] = True  # the rudder lies at 20 deg
    changed = {c: np.where(lost, 0.0, truth[c] + off) for c, off in (("psi", 1.0), ("u", 0.0), ("delta", 0.0))}
    columns = imported(plain(tmp_path / "a.txt", UNITS, **changed)).runs[0].columns
    sound = imported(plain(tmp_path / "b.txt", UNITS, delta=changed["delta"])).runs[0].columns
    assert all(np.array_equal(np.isnan(columns[c]), lost) for c in changed)
    assert np.isfinite(sound["delta"]).all()


def test_sound_noisy_logs_lose_nothing(tmp_path: Path) -> None:
    """Also coarsely rounded ones: no number is taken for nothing, no channel stands still."""
    truth, rng = TRUTH, np.random.default_rng(1)
    sizes = {"x": 0.02, "y": 0.02, "psi": 2e-3, "u": 0.01, "v": 0.01, "r": 1e-3}
    for digits in (5, 2):
        noisy = {c: np.round(truth[c] + rng.normal(0, s, len(truth)), digits) for c, s in sizes.items()}
        found = imported(plain(tmp_path / f"{digits}.txt", UNITS, **noisy))
        assert all(np.isfinite(values).all() for values in found.runs[0].columns.values())


def hemispheres(origin: tuple[float, float], titles: tuple[str, str], order: str = "apart") -> dict[str, Any]:
    """A bridge's log without course: absolute latitude and longitude, and letters below ``titles``."""
    log = bridge(TRUTH, origin)
    lat, lon = np.asarray(log.pop("Latitude")), np.asarray(log.pop("Longitude"))
    north, east = np.where(lat < 0, "S", "N"), np.where(lon < 0, "W", "E")
    pairs = [("Latitude", np.abs(lat)), (titles[0], north), ("Longitude", np.abs(lon)), (titles[1], east)]
    pairs = pairs if order == "apart" else [pairs[0], pairs[2], pairs[1], pairs[3]]
    return {"Time": log["Time"], **dict(pairs), **{k: log[k] for k in ("Heading [deg]", "RPM", "Rudder [deg]")}}


@pytest.mark.parametrize(
    ("origin", "titles", "order"),
    [((-33.86, 151.2), ("N/S", "E/W"), "apart"), ((-33.0, -71.6), ("Lat Hemi", "Lon Hemi"), "apart"),
     ((48.3, -4.4), ("LatRef", "LonRef"), "together"), ((34.7, 135.4), ("a", "b"), "together")],
)  # fmt: skip
def test_letters_of_hemispheres_are_signs(
    tmp_path: Path, origin: tuple[float, float], titles: tuple[str, str], order: str
) -> None:
    found = imported(table(tmp_path / "a.csv", hemispheres(origin, titles, order)))
    assert found.origin == pytest.approx(origin, abs=1e-3)
    assert np.abs(found.runs[0].columns["u"] - TRUTH["u"])[20:-20].max() < 0.01


def test_a_large_log_and_its_map_keep_the_signs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = hemispheres((-33.0, -71.6), ("Lat Hemi", "Lon Hemi")) | {"Shaft direction": ["ASTERN"] * len(TRUTH)}
    path = table(tmp_path / "a.csv", log)
    small = import_logs([path])
    write_import(small, ImportMap(), tmp_path / "one")
    monkeypatch.setattr("cases.io.text_table.BLOCK", 9000)
    monkeypatch.setattr("cases.io.text_table.MOST_KEPT", 100)
    for given in (ImportMap(), read_map(tmp_path / "one" / "import.toml")):
        large = imported(path, given)
        assert large.origin == pytest.approx((-33.0, -71.6), abs=1e-3)
        assert 85 < len(large.runs[0].columns["n"]) <= 100 and np.all(large.runs[0].columns["n"] < 0)
    assert np.all(small.runs[0].columns["n"] < 0)


def test_letters_elsewhere_are_no_hemispheres(tmp_path: Path) -> None:
    log = {"Mode": ["S"] * len(TRUTH), **bridge(TRUTH), "Alarm": ["W"] * len(TRUTH)}
    found = imported(table(tmp_path / "a.csv", log))
    assert found.origin == pytest.approx((34.7, 135.4), abs=1e-3)
    assert set(found.runs[0].logs[0].unknown) == {"Mode", "Alarm"}


ASTERN = TRUTH.t > 90.0  # Rows of a shaft that turns astern for a while
SIGN = np.where(ASTERN, -1, 1)
FIRST = int(np.argmax(ASTERN))
CHANGES = np.array([{0: "AHEAD", FIRST: "ASTERN"}.get(i, "") for i in range(len(ASTERN))])
RPM, DELTA = 60 * TRUTH["n"], TRUTH["delta"]
DEGREES = np.degrees(np.abs(DELTA))


def beside(title: str, words: Any, **more: Any) -> dict[str, Any]:
    """A bridge's log of revolutions without a sign, and a column of words: for ahead and astern, or one for each row.

    more: columns that come in place of others, or right of them.
    """
    words = np.where(ASTERN, words[1], words[0]) if len(words) == 2 else words
    return bridge(TRUTH) | {"RPM": RPM, title: words, **more}


# Log -> the columns that come out of it
SIGNED: dict[str, tuple[dict[str, Any], dict[str, np.ndarray]]] = {
    **{title: (beside(title, words), {"n": SIGN * TRUTH["n"]}) for title, words in (
        ("Shaft direction", ("AHEAD", "ASTERN")), ("Gear", ("FWD", "REV")), ("ME status", ("Ahead", "Astern")),
        ("Shaft dir", ("1", "-1")), ("Reversing", ("0", "1")), ("dir", ("forward", "backward")),
        ("Direction", CHANGES),  # logged where it changes, and held
    )},
    "numbers with signs keep them: words of a lever come before the shaft turns": (
        beside("Shaft direction", ("AHEAD", "ASTERN"), RPM=np.roll(SIGN, 10) * RPM),
        {"n": np.roll(SIGN, 10) * TRUTH["n"]}),
    "each shaft has its own direction": (
        beside("Direction stbd", ("Ahead", "Astern"), **{
            "RPM": [""] * len(RPM), "RPM stbd": RPM, "RPM port": 0.5 * RPM, "Direction port": ["Ahead"] * len(RPM)}),
        {"n": SIGN * TRUTH["n"], "n_2": 0.5 * TRUTH["n"]}),
    **{title: (beside(title, np.where(DELTA < 0, *words), **{"Rudder [deg]": DEGREES}), {"delta": DELTA})
       for title, words in (("Rudder side", ("P", "S")), ("Rudder direction", ("PORT", "STBD")))},
    "the side of the wind": (
        bridge(TRUTH) | {"AWS [kn]": 9 + 0 * DELTA, "AWA [deg]": DEGREES, "AWA side": np.where(DELTA < 0, "P", "S")},
        {"apparent_wind_direction": DELTA % (2 * np.pi)}),
}  # fmt: skip


@pytest.mark.parametrize("name", SIGNED)
def test_a_column_of_words_gives_a_sign(tmp_path: Path, name: str) -> None:
    log, expected = SIGNED[name]
    found = imported(table(tmp_path / "a.csv", log))
    assert ("sign" in codes(found)) is not ("keep" in name)
    for name, values in expected.items():
        assert found.runs[0].columns[name] == pytest.approx(values), name


@pytest.mark.parametrize(
    ("title", "words"),
    [("Shaft direction", ("CW", "CCW")), ("Propeller direction", ("0", "1")), ("Telegraph", ("Ahead", "Astern")),
     ("RPM order", ("ahead", "astern"))],
)  # fmt: skip
def test_a_direction_that_nobody_can_read_is_refused(tmp_path: Path, title: str, words: tuple[str, str]) -> None:
    """And an order, which comes before the shaft obeys; the map can say that the column is not used."""
    path = table(tmp_path / "a.csv", beside(title, words))
    (problem,) = import_logs([path]).problems
    assert f"column '{title}'" in problem and "'RPM'" in problem
    assert np.all(imported(path, ImportMap(ignore=[title])).runs[0].columns["n"] >= 0)


@pytest.mark.parametrize("form", ["{side} {angle}", "{angle} {side}", "{side}{angle} deg"])
@pytest.mark.parametrize("words", ["PS", ("Port", "Stbd")])
def test_a_side_beside_the_number_of_a_rudder_is_its_sign(tmp_path: Path, form: str, words: tuple[str, str]) -> None:
    cells = [form.format(side=words[int(d > 0)], angle=f"{np.degrees(abs(d)):.4f}") for d in DELTA]
    cells[0] = "0"
    log = bridge(TRUTH) | {"Rudder [deg]": cells}
    found = imported(table(tmp_path / "a.csv", log))
    assert errors(found.runs[0].columns, TRUTH)["delta"] < 1e-3 * np.abs(DELTA).max() and "sign" in codes(found)
    cells[5] = "12.0"  # of neither side
    (problem,) = import_logs([table(tmp_path / "b.csv", log)]).problems
    assert "row 6," in problem


def test_pitch_beside_roll_is_that_of_the_hull(tmp_path: Path) -> None:
    """It is asked for; a header of the propeller, or a pitch without other motions, is the blades'."""
    log, n = bridge(TRUTH), len(TRUTH)
    motions = {"roll [deg]": np.ones(n), "pitch [deg]": np.full(n, 2.0)}
    path = table(tmp_path / "hull.csv", {**log, **motions})
    found = imported(path)
    assert "pitch" not in found.runs[0].columns
    assert [list(q.choices) for q in found.questions if q.file.name] == [["pitch", "nothing"]]
    said = imported(path, chosen(columns={"pitch": "pitch"}))
    assert said.runs[0].columns["pitch"] == pytest.approx(np.radians(2.0))
    for more in ({**motions, "Propeller pitch [deg]": np.full(n, 20.0)}, {"pitch [deg]": np.full(n, 20.0)}):
        found = imported(table(tmp_path / "a.csv", {**log, **more}))
        assert found.runs[0].columns["pitch"] == pytest.approx(np.radians(20.0))


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
