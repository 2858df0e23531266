"""Positions whose axes are exchanged or that lost a hemisphere are refused: course and heading tell."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cases.checks import check
from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.io.toml_file import validated
from cases.trial import Trial
from mmg_ident import simulate
from tests.support import raw_logs
from tests.support.raw_logs import answers, bridge, table

pytest.importorskip("pyproj", reason="needs the extra import")

HEADING = ("SOG [kn]", "COG [deg]")  # Columns without which the heading alone tells


def without(log: dict[str, object], *headers: str) -> dict[str, object]:
    return {name: values for name, values in log.items() if name not in headers}


@pytest.mark.slow
@pytest.mark.parametrize(("left_out", "origin"), [((), (10.0, 50.0)), (HEADING, (-12.0, 30.0))])
def test_exchanged_latitude_and_longitude_are_refused_and_the_line_mends_it(
    tmp_path: Path, left_out: tuple[str, ...], origin: tuple[float, float]
) -> None:
    log = bridge(raw_logs.run(), origin)
    log["Latitude"], log["Longitude"] = log["Longitude"], log["Latitude"]
    path = table(tmp_path / "a.csv", without(log, *left_out))
    problems = import_logs([path]).problems
    assert len(problems) == 1 and '"Longitude"' in problems[0], problems
    chosen = validated(ImportMap, {"columns": {"latitude": "Longitude", "longitude": "Latitude"}}, "map")
    found = import_logs([path], chosen)
    assert not found.problems
    assert np.abs(found.runs[0].columns["u"] - raw_logs.run()["u"])[20:-20].max() < 0.02


def test_a_latitude_beyond_the_pole_is_no_lost_satellite(tmp_path: Path) -> None:
    """Exchanged in Japan; degrees and minutes in one number are read."""
    log = bridge(raw_logs.run())
    swapped = {**log, "Latitude": log["Longitude"], "Longitude": log["Latitude"]}
    problems = import_logs([table(tmp_path / "a.csv", swapped)]).problems
    assert len(problems) == 1 and "column 'Latitude' reaches" in problems[0], problems
    minutes = {name: np.floor(log[name]) * 100 + 60 * (log[name] % 1) for name in ("Latitude", "Longitude")}
    found = import_logs([table(tmp_path / "a.csv", {**log, **minutes})])
    assert not found.problems and np.abs(found.runs[0].columns["x"] - raw_logs.run()["x"]).max() < 0.5


@pytest.mark.parametrize(
    ("origin", "left_out", "signs"),
    [((-33.86, 151.2), HEADING, {"latitude"}), ((48.3, -4.4), HEADING, {"longitude"}),
     ((-33.0, -71.6), (), {"latitude", "longitude"})],
)  # fmt: skip
def test_a_hemisphere_that_no_column_holds_is_refused(
    tmp_path: Path, origin: tuple[float, float], left_out: tuple[str, ...], signs: set[str]
) -> None:
    log = bridge(raw_logs.run(), origin)
    log |= {name: np.abs(np.asarray(log[name], dtype=float)) for name in ("Latitude", "Longitude")}
    path = table(tmp_path / "a.csv", without(log, *left_out))
    first, *_ = answers(path)
    assert {name for name, column in first.columns.items() if column.sign == -1} == signs
    assert import_logs([path], first).origin == pytest.approx(origin, abs=1e-3)


def local(x: np.ndarray, y: np.ndarray) -> dict[str, object]:
    """The log of a bridge with these positions [m]."""
    return without(bridge(raw_logs.run()), "Latitude", "Longitude") | {"x [m]": x, "y [m]": y}


def test_x_to_the_east_is_refused_where_velocities_come_from_it(tmp_path: Path) -> None:
    """Logged velocities leave the frame to the check."""
    truth = raw_logs.run()
    log = local(truth["y"], truth["x"])
    path = table(tmp_path / "a.csv", log)
    found = import_logs([path], answers(path)[0])
    assert np.allclose(found.runs[0].columns["x"], truth["x"], atol=1e-6)
    found = import_logs([table(tmp_path / "b.csv", log | {"surge [m/s]": truth["u"], "sway [m/s]": truth["v"]})])
    findings = check([Trial("a", found.runs[0].columns)])[0].findings
    assert not found.problems and "swapped_positions" in [f.code for f in findings]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "speed", "lines"),
    [
        (1 / 0.3048, 1.0, {"x": {"from": "x", "unit": "ft"}, "y": {"from": "y", "unit": "ft"}}),
        (1.0, 0.5144, {"sog": {"from": "SOG", "unit": "m/s"}}),
    ],
)
def test_positions_at_another_speed_than_over_ground_are_refused_and_the_line_mends_it(
    tmp_path: Path, scale: float, speed: float, lines: dict[str, dict[str, str]]
) -> None:
    truth = raw_logs.run()
    log = local(scale * truth["x"], scale * truth["y"])
    path = table(tmp_path / "a.csv", {**log, "SOG [kn]": speed * np.asarray(log["SOG [kn]"], dtype=float)})
    said = [{q: c.model_dump(include={"header", "unit"}) for q, c in one.columns.items()} for one in answers(path)]
    chosen = validated(ImportMap, {"columns": lines}, "map")
    assert {q: c.model_dump(include={"header", "unit"}) for q, c in chosen.columns.items()} in said
    found = import_logs([path], chosen)
    assert not found.problems
    assert np.abs(found.runs[0].columns["u"] - truth["u"])[20:-20].max() < 0.02


def test_a_grid_whose_scale_is_not_one_is_noted(tmp_path: Path) -> None:
    truth = raw_logs.run()
    for scale in (1.0, 1.5):
        (run,) = import_logs([table(tmp_path / "a.csv", local(scale * truth["x"], scale * truth["y"]))]).runs
        assert ("scale_doubtful" in [note.code for note in run.notices]) == (scale != 1.0)


def test_a_heading_interpolated_through_360_is_mended_before_a_turn_rate_is_derived(tmp_path: Path) -> None:
    truth = raw_logs.run("turning:35")
    log, t = bridge(truth), truth.t
    every = slice(None, None, 4)
    log["Heading [deg]"] = np.interp(t, t[every], np.asarray(log["Heading [deg]"], dtype=float)[every])
    (run,) = import_logs([table(tmp_path / "a.csv", log)]).runs
    assert "heading_mended" in [note.code for note in run.notices]
    assert np.abs(run.columns["r"] - truth["r"][: len(run.columns["r"])])[20:-20].max() < 0.01


@pytest.mark.parametrize(
    ("maneuver", "left_out"),
    [("zigzag:5/5", HEADING), ("turning:35", ()), ("turning:-35", HEADING), ("crash-stop", ()), ("random:3", HEADING)],
)
def test_sound_runs_pass(tmp_path: Path, maneuver: str, left_out: tuple[str, ...]) -> None:
    """Also with noise of a receiver, with headings anywhere, and where the ship goes astern."""
    truth: Trial = simulate("esso_osaka_3m", maneuver, dt=0.5, duration=90, seed=1)
    log, rng = bridge(truth), np.random.default_rng(3)
    for name, size in (("Latitude", 2e-7), ("Longitude", 2e-7), ("Heading [deg]", 0.5), ("COG [deg]", 2.0)):
        log[name] = np.asarray(log[name], dtype=float) + rng.normal(0, size, len(truth))
    found = import_logs([table(tmp_path / "a.csv", without(log, *left_out))])
    assert not found.problems, found.problems


@lru_cache
def long_run(ship: str, maneuver: str, duration: float) -> Trial:
    return simulate(ship, maneuver, dt=0.5, duration=duration, seed=1)


def logs(folder: Path, truth: Trial, offset: float = 0.0, drift: float = 0.0) -> list[Path]:
    """Three files of a run; the gyro's clock shows so much more than the time [s], and gains ``drift`` [s per s]."""
    paths = raw_logs.apart(folder, truth)
    head, *lines = paths[1].read_text().splitlines()
    times = np.array([float(line.split(",")[0]) for line in lines])
    wrong = times + 1000 * offset + drift * (times - times[0])
    rest = [line.split(",", 1)[1] for line in lines]
    paths[1].write_text("\n".join([head, *(f"{t:.0f},{r}" for t, r in zip(wrong, rest, strict=True))]) + "\n")
    return paths


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ship", "maneuver", "duration"),
    [("kvlcc2_l7", "zigzag:20/20", 180), ("kvlcc2_l7", "turning:35", 300), ("esso_osaka_3m", "random:7", 300)],
)
def test_clocks_that_agree_are_no_problem(tmp_path: Path, ship: str, maneuver: str, duration: float) -> None:
    """Also in turns, where the course is late for long and the ship loses half its speed."""
    found = import_logs(logs(tmp_path, long_run(ship, maneuver, duration)))
    assert not found.problems and len(found.runs[0].logs) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("maneuver", "duration", "offset", "drift", "words"),
    [
        ("zigzag:20/20", 180, 5.0, 0.0, r"differ: the course changes 1\.\d s before the heading"),
        ("zigzag:10/10", 300, 0.0, -0.04, r"drift apart by 1[12] s in 2\d\d s.*gyro.csv is slow"),
        ("zigzag:10/10", 300, 20.0, 0.04, r"drift apart by 1[12] s.*clock_drift = -0.0\d+, clock_offset = -2\d"),
    ],
)
def test_clocks_that_do_not_agree_are_named_and_mended_by_the_line(
    tmp_path: Path, maneuver: str, duration: float, offset: float, drift: float, words: str
) -> None:
    truth = long_run("kvlcc2_l7", maneuver, duration)
    paths = logs(tmp_path, truth, offset, drift)
    found = import_logs(paths)
    assert not found.runs and len(found.problems) == 1 and re.search(words, found.problems[0]), found.problems
    table, line = re.search(r"add to the map: (\[files\.\"[^]]*\]) (.*?) \(or", found.problems[0]).groups()
    (tmp_path / "import.toml").write_text("\n".join([table, *line.split(", ")]) + "\n")
    mended = import_logs(paths, read_map(tmp_path / "import.toml"))
    assert not mended.problems
    run = mended.runs[0].columns
    inside = (run["t"] > 15) & (run["t"] < run["t"][-1] - 15)
    psi = np.interp(run["t"] + 0.3, truth.t, truth.psi_unwrapped)  # the actuators begin last, at 0.3 s
    off = np.angle(np.exp(1j * (run["psi"] - psi)))[inside]
    assert np.sqrt(np.mean(off**2)) < 0.06  # rad; a few seconds at 0.02 rad/s


def test_clocks_that_a_person_keeps_are_kept(tmp_path: Path) -> None:
    paths = logs(tmp_path, long_run("kvlcc2_l7", "zigzag:20/20", 180), 5.0)
    keep = ImportMap.model_validate({"files": {paths[1].name: {"clock_offset": 0.0}}})
    assert not import_logs(paths, keep).problems
