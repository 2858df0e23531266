"""Runs come out of raw logs as they went in, whatever the format, the clock and the units."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cases.importing.assembled_run import globe_positions
from cases.importing.import_logs import Imported, import_logs, write_import
from cases.importing.import_map import POINT, ImportMap, read_map
from cases.inputs import STANDARD, is_sampled, model_inputs
from cases.io.read import read_trials
from cases.io.sidecar import read_sidecar
from cases.io.toml_file import parse_toml, validated
from cases.trial import Trial
from mmg.errors import Conflict, TargetExists, UserError
from mmg.messages import has_code
from tests.support import raw_logs
from tests.support.raw_logs import UNITS, bridge, plain, table

openpyxl = pytest.importorskip("openpyxl", reason="needs the extra import")
pytest.importorskip("pynmeagps", reason="needs the extra import")
pytest.importorskip("pyproj", reason="needs the extra import")

PORT = ImportMap(rudder_positive="port")


def imported(path: Path, chosen: ImportMap | None = None) -> Imported:
    found = import_logs([path], chosen)
    assert not found.problems, found.problems
    return found


def errors(found: Imported, truth: Trial, late: float = 0.0, inside: float = 5.0) -> dict[str, float]:
    """Largest difference of each column from the ``truth``, whose clock is ``late`` behind, away from the ends."""
    run = found.runs[0]
    t = run.columns["t"]
    rows = (t > inside) & (t < t[-1] - inside)
    out = {}
    for name in ("x", "y", "u", "v", "r", "n", "delta"):
        out[name] = float(np.abs(run.columns[name] - np.interp(t + late, truth.t, truth[name]))[rows].max())
    turned = np.interp(t + late, truth.t, truth.psi_unwrapped) - run.columns["psi"]
    out["psi"] = float(np.abs(np.angle(np.exp(1j * turned)))[rows].max())
    return out


LIMITS = {"x": 0.02, "y": 0.02, "psi": 1e-3, "u": 3e-3, "v": 6e-3, "r": 8e-4, "n": 1e-4, "delta": 0.03}


def check_errors(found: Imported, truth: Trial, late: float = 0.0) -> None:
    off = errors(found, truth, late)
    assert all(off[name] < LIMITS[name] for name in LIMITS), off


def codes(found: Imported) -> set[str]:
    return {getattr(m, "code", "") for m in found.runs[0].notices}


@pytest.mark.parametrize(
    ("zone", "place"), [("56S", (-33.857, 151.215)), ("32N", (58.9, 10.4)), ("54T", (41.5, 140.0))]
)
def test_a_zone_names_its_hemisphere(zone: str, place: tuple[float, float]) -> None:
    pyproj = pytest.importorskip("pyproj", reason="needs the extra import")
    east, north = pyproj.Proj(proj="utm", zone=int(zone[:2]), south=place[0] < 0, ellps="WGS84")(place[1], place[0])
    found = globe_positions(np.array([north]), np.array([east]), zone, "log")
    assert [float(x[0]) for x in found] == pytest.approx(place, abs=1e-8)


def test_semicolons_decimal_commas_knots_and_the_globe(tmp_path: Path) -> None:
    """And the import goes into a folder with files only when asked."""
    found = imported(raw_logs.semicolons(tmp_path / "zigzag.csv", raw_logs.run()), PORT)
    check_errors(found, raw_logs.run())
    assert found.runs[0].day == "2026-05-04" and found.origin == (34.7, 135.4)
    assert {"decimal_commas", "separator", "clock", "derived", "local_frame", "lines_before_header"} <= codes(found)
    assert found.runs[0].logs[0].unknown == ("Mood",)
    target = tmp_path / "out"
    write_import(found, PORT, target)
    with pytest.raises(TargetExists):
        write_import(found, PORT, target)
    assert write_import(found, PORT, target, force=True) == [target / "zigzag.csv"]
    assert not list(tmp_path.glob(".out*"))


def test_an_excel_sheet_with_a_title_and_a_line_of_units(tmp_path: Path) -> None:
    truth = raw_logs.run("turning:35")
    check_errors(imported(raw_logs.excel(tmp_path / "turn.xlsx", truth)), truth)


def test_nmea_sentences_and_a_damaged_line(tmp_path: Path) -> None:
    truth = raw_logs.run("zigzag:10/10")
    found = imported(raw_logs.nmea(tmp_path / "zigzag.nmea", truth))
    check_errors(found, truth)
    assert "nmea_damaged" in codes(found)


def test_three_files_of_one_run_with_their_own_clocks(tmp_path: Path) -> None:
    raw_logs.apart(tmp_path, raw_logs.run())
    found = imported(tmp_path)
    assert [run.name for run in found.runs] == ["run7"] and len(found.runs[0].logs) == 3
    check_errors(found, raw_logs.run(), late=0.3)


def test_the_map_that_is_written_repeats_the_import(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    raw_logs.semicolons(tmp_path / "logs" / "a.csv", raw_logs.run())
    raw_logs.apart(tmp_path / "logs", raw_logs.run())
    first = import_logs([tmp_path / "logs"], PORT)
    files = write_import(first, PORT, tmp_path / "one")
    again = read_map(tmp_path / "one" / "import.toml")
    second = write_import(import_logs([tmp_path / "logs"], again), again, tmp_path / "two")
    assert [f.name for f in files] == [f.name for f in second] == ["a.csv", "run7.csv"]
    for one, two in zip(files, second, strict=True):
        assert one.read_bytes() == two.read_bytes()
    trials = read_trials(tmp_path / "one")
    assert all(set(t.std) == {"x", "y", "u", "v"} | ({"r"} if t.name == "a" else set()) for t in trials)


@pytest.mark.parametrize("inputs", ["", "held"])
def test_actuators_of_a_log_are_samples_unless_the_map_says_that_they_are_held(tmp_path: Path, inputs: str) -> None:
    chosen = validated(ImportMap, {"inputs": inputs} if inputs else {}, "map")
    found = imported(plain(tmp_path / "a.txt", UNITS), chosen)
    trial = read_trials(write_import(found, chosen, tmp_path / "one"))[0]
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
    truth = raw_logs.run()
    c, s, r = np.cos(truth["psi"]), np.sin(truth["psi"]), truth["r"]
    moved = {"x": truth["x"] + l_x * c - l_y * s, "y": truth["y"] + l_x * s + l_y * c}
    moved |= {"u": truth["u"] - l_y * r, "v": truth["v"] + l_x * r}
    return raw_logs.table(path, raw_logs.bridge(truth.with_columns(**moved)))


def test_an_antenna_that_the_map_gives_is_taken_to_midship_once(tmp_path: Path) -> None:
    truth, log = raw_logs.run(), antenna_log(tmp_path / "a.csv", 3.0, 0.5)
    chosen = validated(ImportMap, {"reference_point": {"x": 3.0, "y": 0.5}}, "map")
    found = imported(log, chosen)
    check_errors(found, truth)
    assert "reference_point" in codes(found) and not found.questions
    trial = read_trials(write_import(found, chosen, tmp_path / "out"))[0]
    assert np.abs(trial["x"] - found.runs[0].columns["x"]).max() < 1e-6
    with (tmp_path / "out" / "trials.toml").open("a") as sidecar:
        sidecar.write('[files."a.csv".reference_point]\nx = 3.0\n')
    with pytest.raises(Conflict):  # it would be applied a second time
        write_import(found, chosen, tmp_path / "out", force=True)


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
        answered = imported(log, validated(ImportMap, map_, "map"))
        assert not answered.questions and "reference_point_unknown" in codes(answered)
    assert answered.runs[0].std["v"] == pytest.approx(7 / 3 * lever, rel=1e-3)
    for wrong in ("unknown_one", {"x": "12"}, {"x": 1.0, "z": 2.0}, [1.0]):
        with pytest.raises(UserError, match="reference_point"):
            validated(ImportMap, {"reference_point": wrong}, "map")


@pytest.mark.slow
def test_force_replaces_what_an_import_wrote_and_keeps_what_a_person_wrote(tmp_path: Path) -> None:
    for name, maneuver in (("a", "zigzag:20/20"), ("b", "turning:35")):
        raw_logs.table(tmp_path / "logs" / f"{name}.csv", raw_logs.bridge(raw_logs.run(maneuver)))
    out, chosen = tmp_path / "out", ImportMap()
    write_import(imported(tmp_path / "logs"), chosen, out)
    path = out / "trials.toml"
    first = path.read_text()
    write_import(imported(tmp_path / "logs"), chosen, out, force=True)
    assert path.read_text() == first
    mine = '# seen by me\n[files."a.csv"]\nkind = "zigzag"  # of mine'
    path.write_text(first.replace('[files."a.csv"]', mine).replace('"2026-05-04"', '"2026-05-05"', 1))
    held = validated(ImportMap, {"inputs": "held"}, "map")
    write_import(imported(tmp_path / "logs" / "a.csv", held), held, out, force=True)
    text, said = path.read_text(), read_sidecar(path)
    assert "# seen by me" in text and "# of mine" in text
    assert said.entry(out / "a.csv").day == "2026-05-05" and said.entry(out / "a.csv").kind == "zigzag"
    assert said.entry(out / "a.csv").inputs == "held" and said.entry(out / "b.csv").std  # the file is still there
    (out / "b.csv").unlink()
    write_import(imported(tmp_path / "logs" / "a.csv", held), held, out, force=True)
    assert set(read_sidecar(path).files) == {"a.csv"}
    path.write_text("colour = 1\n")
    with pytest.raises(UserError, match="colour"):
        write_import(imported(tmp_path / "logs" / "a.csv"), chosen, out, force=True)
    assert path.read_text() == "colour = 1\n"


@pytest.mark.parametrize("zone", ["Z", "+02:00", "+00"])
def test_a_zone_for_stamps_that_have_one_is_refused(tmp_path: Path, zone: str) -> None:
    """Also for one of two digits, behind a blank instead of a T."""
    log, nine = raw_logs.bridge(raw_logs.run()), ImportMap(zone_hours=9.0)
    log["Time"] = [raw_logs.stamp(t)[:-6].replace("T", " ") + zone for t in raw_logs.run().t]
    path = raw_logs.table(tmp_path / "a.csv", log)
    found = import_logs([path], nine)
    assert found.problems and found.runs[0].day == "2026-05-04" and found.runs[0].logs
    log["Time"] = [cell.removesuffix(zone) for cell in log["Time"]]
    imported(raw_logs.table(path, log), nine)


def test_a_trial_file_is_imported_as_it_is(tmp_path: Path) -> None:
    """Also with units at the end of headers, and with the headers of the FRT-DS-ESSO records, to the last row."""
    found = imported(plain(tmp_path / "a.txt", UNITS))
    assert max(errors(found, raw_logs.run()).values()) < 1e-12 and not found.runs[0].std
    truth = raw_logs.run("zigzag:10/10")
    names = {"x": "x_position_mid", "y": "y_position_mid", "psi": "psi_hat", "u": "u_velo", "v": "vm_velo"}
    names |= {"r": "r_angvelo", "n": "n_prop", "delta": "delta_rudder"}
    frame = truth.to_pandas()
    for number, renamed in enumerate(({}, names)):
        path = tmp_path / f"{number}.csv"
        parts = [cell.split() for cell in frame.columns]
        frame.set_axis([f"{renamed.get(name, name)} {unit}" for name, unit in parts], axis=1).to_csv(path, index=False)
        found = imported(path)
        assert len(found.runs[0].columns["t"]) == len(truth)
        assert max(errors(found, truth, inside=-1.0).values()) < 1e-9 and not found.runs[0].std


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("yaw_rate", 180 / np.pi, "deg/s"), ("yaw_rate", 10800 / np.pi, "deg/min"), ("surge", 3600 / 1852, "kn"),
     ("surge", 3.6, "km/h"), ("surge", 1.0, "m/s")],
)  # fmt: skip
def test_units_that_nobody_wrote_are_found_by_other_columns(
    tmp_path: Path, name: str, factor: float, unit: str
) -> None:
    column = "r" if name == "yaw_rate" else "u"
    header = UNITS.replace("yaw_rate_rad_s", "yaw_rate") if column == "r" else UNITS.replace("surge_mps", "surge")
    found = imported(plain(tmp_path / "a.txt", header, **{column: factor * raw_logs.run()[column]}))
    assert errors(found, raw_logs.run())[column] < 1e-9
    said = [m for m in found.runs[0].notices if getattr(m, "code", "") == "unit_found"]
    assert len(said) == 1 and f"in {unit}:" in said[0]


def test_a_unit_that_nothing_shows_is_asked_for(tmp_path: Path) -> None:
    path = plain(tmp_path / "a.txt", UNITS.replace("shaft_rps", "shaft_speed"))
    found = import_logs([path])
    assert len(found.problems) == 1 and "'shaft_speed'" in found.problems[0]
    assert [list(q.choices)[:2] for q in found.questions] == [["rps", "rpm"]]
    chosen = validated(ImportMap, {"columns": {"n": {"from": "shaft_speed", "unit": "rps"}}}, "map")
    assert errors(imported(path, chosen), raw_logs.run())["n"] < 1e-12


def test_what_a_column_may_be_is_asked(tmp_path: Path) -> None:
    truth = raw_logs.run()
    more = {"w": np.full(len(truth), 5.0), "d": np.full(len(truth), 1.0)}
    path = plain(tmp_path / "a.txt", f"{UNITS} wind_speed_mps wind_dir_rad", **more)
    found = import_logs([path])
    assert [list(q.choices) for q in found.questions] == [
        ["wind_speed", "apparent_wind_speed", "nothing"],
        ["wind_direction", "apparent_wind_direction", "nothing"],
    ]
    assert "wind_speed" not in found.runs[0].columns


def test_numbers_for_nothing_lost_satellites_and_a_channel_that_stands_still(tmp_path: Path) -> None:
    truth, rng = raw_logs.run(), np.random.default_rng(0)
    sizes = {"x": 0.02, "y": 0.02, "u": 0.01, "r": 1e-3}
    x, y, u, r = (truth[c] + rng.normal(0, s, len(truth)) for c, s in sizes.items())
    u[50:55], x[100:103], y[100:103] = -999.0, 1e5, -2e5
    r[200:240] = r[200]
    found = imported(plain(tmp_path / "a.txt", UNITS, x=x, y=y, u=u, r=r))
    columns = found.runs[0].columns
    assert np.isnan(columns["u"][50:55]).all() and np.isfinite(columns["u"]).sum() == len(truth) - 5
    assert np.isnan(columns["x"][100:103]).all() and np.isfinite(columns["x"]).sum() == len(truth) - 3
    assert np.isnan(columns["r"][201:240]).all() and np.isfinite(columns["r"]).sum() == len(truth) - 39
    assert {"sentinel", "position_lost", "frozen"} <= codes(found)


def test_zeros_of_a_logger_without_values_stand_for_nothing(tmp_path: Path) -> None:
    """Of a rudder only where a heading or a speed is lost as well: one amidships is zero, too."""
    truth = raw_logs.run()
    lost = np.zeros(len(truth), dtype=bool)
    lost[42:47] = True  # the rudder lies at 20 deg
    changed = {c: np.where(lost, 0.0, truth[c] + off) for c, off in (("psi", 1.0), ("u", 0.0), ("delta", 0.0))}
    columns = imported(plain(tmp_path / "a.txt", UNITS, **changed)).runs[0].columns
    sound = imported(plain(tmp_path / "b.txt", UNITS, delta=changed["delta"])).runs[0].columns
    assert all(np.array_equal(np.isnan(columns[c]), lost) for c in changed)
    assert np.isfinite(sound["delta"]).all()


def test_sound_noisy_logs_lose_nothing(tmp_path: Path) -> None:
    """Also coarsely rounded ones: no number is taken for nothing, no channel stands still."""
    truth, rng = raw_logs.run(), np.random.default_rng(1)
    sizes = {"x": 0.02, "y": 0.02, "psi": 2e-3, "u": 0.01, "v": 0.01, "r": 1e-3}
    for digits in (5, 2):
        noisy = {c: np.round(truth[c] + rng.normal(0, s, len(truth)), digits) for c, s in sizes.items()}
        found = imported(plain(tmp_path / f"{digits}.txt", UNITS, **noisy))
        assert all(np.isfinite(values).all() for values in found.runs[0].columns.values())


def hemispheres(origin: tuple[float, float], titles: tuple[str, str], order: str = "apart") -> dict[str, object]:
    """A bridge's log without course: absolute latitude and longitude, and letters below ``titles``."""
    log = bridge(raw_logs.run(), origin)
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
    monkeypatch.setattr("cases.io.text_table.MOST_KEPT", 100)
    for chosen in (ImportMap(), read_map(tmp_path / "one" / "import.toml")):
        large = import_logs([path], chosen)
        assert not large.problems and large.origin == pytest.approx((-33.0, -71.6), abs=1e-3)
        assert 85 < len(large.runs[0].columns["n"]) <= 100 and np.all(large.runs[0].columns["n"] < 0)
    assert np.all(small.runs[0].columns["n"] < 0)


def test_letters_elsewhere_are_no_hemispheres(tmp_path: Path) -> None:
    log = {"Mode": ["S"] * len(raw_logs.run()), **bridge(raw_logs.run()), "Alarm": ["W"] * len(raw_logs.run())}
    found = imported(table(tmp_path / "a.csv", log))
    assert found.origin == pytest.approx((34.7, 135.4), abs=1e-3)
    assert set(found.runs[0].logs[0].unknown) == {"Mode", "Alarm"}


ASTERN = raw_logs.run().t > 90.0  # Rows of a shaft that turns astern for a while


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
    assert not found.problems and found.runs[0].columns["n"] == pytest.approx(truth) and "sign" in codes(found)


def test_a_direction_that_is_logged_when_it_changes_is_held(tmp_path: Path) -> None:
    """And numbers with signs keep them: the words of a lever come before the shaft turns round."""
    words = [""] * len(ASTERN)
    words[0], words[int(np.argmax(ASTERN))] = "AHEAD", "ASTERN"
    found = import_logs([table(tmp_path / "a.csv", {**reversing("Direction", "", ""), "Direction": words})])
    assert np.array_equal(found.runs[0].columns["n"] < 0, ASTERN)
    log = reversing("Shaft direction", "AHEAD", "ASTERN")
    log["RPM"] = np.where(np.roll(ASTERN, 10), -1, 1) * np.asarray(log["RPM"])
    found = import_logs([table(tmp_path / "b.csv", log)])
    assert np.array_equal(found.runs[0].columns["n"] < 0, np.roll(ASTERN, 10))


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


@pytest.mark.parametrize("form", ["{side} {angle}", "{angle} {side}", "{side}{angle} deg"])
@pytest.mark.parametrize("words", ["PS", ("Port", "Stbd")])
def test_a_side_beside_the_number_of_a_rudder_is_its_sign(tmp_path: Path, form: str, words: tuple[str, str]) -> None:
    truth = raw_logs.run()
    degrees = np.degrees(truth["delta"])
    cells = [form.format(side=words[int(d > 0)], angle=f"{abs(d):.4f}") for d in degrees]
    cells[0] = "0"
    log = raw_logs.bridge(truth)
    rudder = next(name for name in log if name.lower().startswith("rudder"))
    found = import_logs([raw_logs.table(tmp_path / "a.csv", {**log, rudder: cells})])
    assert not found.problems and errors(found, truth)["delta"] < 1e-3 * np.abs(truth["delta"]).max()
    assert "sign" in {m.code for m in found.runs[0].notices}
    cells[5] = "12.0"  # of neither side
    problems = import_logs([raw_logs.table(tmp_path / "b.csv", {**log, rudder: cells})]).problems
    assert len(problems) == 1 and "row 6," in problems[0]


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
