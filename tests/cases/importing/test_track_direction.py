"""Positions whose axes are exchanged or that lost a hemisphere are refused: course and heading tell."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.checks import check
from cases.importing.import_logs import import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.trial import Trial
from mmg_ident import simulate
from tests.support import raw_logs
from tests.support.raw_logs import answers, bridge, codes, imported, table

pytest.importorskip("pyproj", reason="needs the extra import")

TRUTH = raw_logs.run()
HEADING = ("SOG [kn]", "COG [deg]")  # Columns without which the heading alone tells
FEET = 0.3048  # m
Log = dict[str, Any]


def without(log: Log, *headers: str) -> Log:
    return {name: values for name, values in log.items() if name not in headers}


def exchanged(log: Log) -> Log:
    return {**log, "Latitude": log["Longitude"], "Longitude": log["Latitude"]}


def unsigned(log: Log) -> Log:
    return log | {name: np.abs(log[name]) for name in ("Latitude", "Longitude")}


def local(x: np.ndarray, y: np.ndarray) -> Log:
    """The log of a bridge with these positions [m]."""
    return without(bridge(TRUTH), "Latitude", "Longitude") | {"x [m]": x, "y [m]": y}


SWAPPED = {"latitude": "Longitude [deg]", "longitude": "Latitude [deg]"}
# Log, and the columns of the map that one of the printed lines gives
WRONG: dict[str, tuple[Log, dict[str, str]]] = {
    "latitude and longitude": (exchanged(bridge(TRUTH, (10.0, 50.0))), SWAPPED),
    "latitude and longitude, by the heading": (
        without(exchanged(bridge(TRUTH, (-12.0, 30.0))), *HEADING), SWAPPED),
    "south": (without(unsigned(bridge(TRUTH, (-33.86, 151.2))), *HEADING), {"latitude": "-Latitude [deg]"}),
    "west": (without(unsigned(bridge(TRUTH, (48.3, -4.4))), *HEADING), {"longitude": "-Longitude [deg]"}),
    "south and west": (
        unsigned(bridge(TRUTH, (-33.0, -71.6))), {"latitude": "-Latitude [deg]", "longitude": "-Longitude [deg]"}),
    "x to the east": (local(TRUTH["y"], TRUTH["x"]), {"x": "y [m]", "y": "x [m]"}),
    "positions in feet": (local(TRUTH["x"] / FEET, TRUTH["y"] / FEET), {"x": "x [ft]", "y": "y [ft]"}),
    "a speed in m/s": (
        local(TRUTH["x"], TRUTH["y"]) | {"SOG [kn]": raw_logs.KNOT * bridge(TRUTH)["SOG [kn]"]}, {"sog": "SOG [m/s]"}),
}  # fmt: skip


@pytest.mark.parametrize(("log", "columns"), WRONG.values(), ids=WRONG)
def test_positions_that_go_another_way_than_the_ship_are_refused_and_a_line_mends_them(
    tmp_path: Path, log: Log, columns: dict[str, str]
) -> None:
    path = table(tmp_path / "a.csv", log)
    maps = answers(path)
    said = [{q: f"{'-' * (c.sign == -1)}{c.header} [{c.unit}]" for q, c in one.columns.items()} for one in maps]
    assert columns in said, said
    found = imported(path, maps[said.index(columns)])
    assert np.abs(found.runs[0].columns["u"] - TRUTH["u"])[20:-20].max() < 0.02


def test_a_latitude_beyond_the_pole_is_no_lost_satellite(tmp_path: Path) -> None:
    """Exchanged in Japan; degrees and minutes in one number are read."""
    log = bridge(TRUTH)
    (problem,) = import_logs([table(tmp_path / "a.csv", exchanged(log))]).problems
    assert "column 'Latitude' reaches" in problem
    minutes = {name: np.floor(log[name]) * 100 + 60 * (log[name] % 1) for name in ("Latitude", "Longitude")}
    found = imported(table(tmp_path / "a.csv", {**log, **minutes}))
    assert np.abs(found.runs[0].columns["x"] - TRUTH["x"]).max() < 0.5


def test_logged_velocities_leave_exchanged_axes_to_the_check(tmp_path: Path) -> None:
    log = local(TRUTH["y"], TRUTH["x"]) | {"surge [m/s]": TRUTH["u"], "sway [m/s]": TRUTH["v"]}
    found = imported(table(tmp_path / "b.csv", log))
    findings = check([Trial("a", found.runs[0].columns)])[0].findings
    assert "swapped_positions" in [f.code for f in findings]


def test_a_position_at_a_pole_is_refused(tmp_path: Path) -> None:
    (problem,) = import_logs([table(tmp_path / "a.csv", bridge(TRUTH, (89.99999, 0.0)))]).problems
    assert "Latitude" in problem


def test_a_grid_whose_scale_is_not_one_is_noted(tmp_path: Path) -> None:
    for scale in (1.0, 1.5):
        found = imported(table(tmp_path / "a.csv", local(scale * TRUTH["x"], scale * TRUTH["y"])))
        assert ("scale_doubtful" in codes(found)) == (scale != 1.0)


def test_a_heading_interpolated_through_360_is_mended_before_a_turn_rate_is_derived(tmp_path: Path) -> None:
    truth = raw_logs.run("turning:35")
    log, t = bridge(truth), truth.t
    every = slice(None, None, 4)
    log["Heading [deg]"] = np.interp(t, t[every], np.asarray(log["Heading [deg]"], dtype=float)[every])
    found = imported(table(tmp_path / "a.csv", log))
    r = found.runs[0].columns["r"]
    assert "heading_mended" in codes(found) and np.abs(r - truth["r"][: len(r)])[20:-20].max() < 0.01


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
    imported(table(tmp_path / "a.csv", without(log, *left_out)))


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
