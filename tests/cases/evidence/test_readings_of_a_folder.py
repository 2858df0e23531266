"""Frames, signs, units, lags and lever arms of all files of a folder together."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cases.checks import CheckReport, check
from cases.evidence.competition import judged, scores
from cases.evidence.signals import signals
from cases.io.read import read_trial, read_trials
from tests.support.trial_files import make_trial, motion_columns, shifted, write_csv

Columns = dict[str, np.ndarray]


def straight(columns: Columns) -> Columns:
    """A run due north at constant speed, on which earth and body axes are the same."""
    t = columns["t"]
    none = np.zeros(len(t))
    speed = 0.3 + 0.01 * np.sin(0.2 * t)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    return {**columns, "x": way, "y": none, "psi": none, "u": speed, "v": none, "r": none}


def earth(c: Columns) -> Columns:
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * c["psi"])
    return {**c, "u": w.real, "v": w.imag}


def said(folder: Path, files: list[Columns], labels: dict[str, str] | None = None) -> list[CheckReport]:
    for number, columns in enumerate(files):
        headers = {name: f"{name} [{unit}]" for name, unit in (labels or {}).items()}
        write_csv(folder / f"run_{number}.csv", columns, headers, rows=None)
    return check(read_trials(folder))


def loud(report: CheckReport) -> set[str]:
    return {f.code for f in report.findings if f.level in ("contradictory", "doubtful")}


def advice(reports: list[CheckReport]) -> list[tuple[str, str]]:
    texts = "\n".join(f.text for report in reports for f in report.findings)
    return list(dict.fromkeys(re.findall(r"trials\.toml, (\[.+?\]): (.+?)\.(?:$|\n)", texts)))


def followed(folder: Path, reports: list[CheckReport]) -> list[CheckReport]:
    """What is said once the printed lines stand in the sidecar."""
    lines = [f"{table}\n" + line.replace(" and ", "\n") for table, line in advice(reports)]
    (folder / "trials.toml").write_text("\n".join(lines) + "\n")
    return check(read_trials(folder))


def test_a_file_that_says_nothing_follows_its_folder(tmp_path: Path) -> None:
    weaving = [motion_columns(seed=k) for k in (1, 2)]
    reports = said(tmp_path, [*map(earth, weaving), straight(weaving[0])])
    assert [loud(r) & {"velocity_frame"} for r in reports] == [{"velocity_frame"}] * 3
    assert advice(reports) == [("[default]", 'velocity_frame = "earth"')]


@pytest.mark.parametrize("count", [2, 3])
def test_one_wrong_file_is_named_alone(count: int, tmp_path: Path) -> None:
    files = [motion_columns(seed=k + 1) for k in range(count)]
    reports = said(tmp_path, [earth(files[0]), *files[1:]])
    assert [bool(loud(r)) for r in reports] == [True, *[False] * (count - 1)]
    assert advice(reports) == [('[files."run_0.csv"]', 'velocity_frame = "earth"')]


def test_a_file_of_a_folder_that_nobody_looked_at_is_not_changed(tmp_path: Path) -> None:
    files = [earth(motion_columns(seed=k)) for k in (1, 2)]
    said(tmp_path, files)
    reports = check(read_trials([tmp_path / "run_0.csv"]))
    assert advice(reports) == [('[files."run_0.csv"]', 'velocity_frame = "earth"')]


@pytest.mark.parametrize(("port", "starboard", "folder"), [(0.6, 0.7, -1), (0.6, 0.8, 1)])
def test_a_folder_is_not_read_as_what_all_its_files_together_speak_against(
    port: float, starboard: float, folder: int
) -> None:
    """Four files turn to port with the rudder to starboard, as in a wind, two more clearly to starboard."""
    trial = make_trial()
    correlations = [-port] * 4 + [starboard] * 2
    found = judged([scores(trial, signals(trial), correlation) for correlation in correlations])
    assert [one.reading.rudder for one in found] == [-1] * 4 + [1] * 2
    assert {one.folder.rudder for one in found} == {folder}


DEG = 180 / np.pi
FAULTS = {
    "swapped": (
        lambda c: {"x": c["y"], "y": c["x"]}, {}, "swapped_positions", 'columns = { x = "y [m]", y = "x [m]" }',
    ),
    "east": (
        lambda c: {"psi": np.pi / 2 - c["psi"], "r": -c["r"]}, {}, "heading_from_east",
        'sign = { psi = -1, r = -1 } and heading_from = "east"',
    ),
    "ms": (lambda c: {"t": 1000 * c["t"]}, {}, "unit", 'units = { t = "ms" }'),
    "knots": (lambda c: {"u": 1.943844 * c["u"], "v": 1.943844 * c["v"]}, {}, "unit", 'units = { u = "kn", v = "kn" }'),
    "deg/min": (lambda c: {"r": DEG * 60 * c["r"]}, {"r": "deg/s"}, "unit", 'units = { r = "deg/min" }'),
    "deg": (lambda c: {"psi": np.mod(DEG * c["psi"], 360)}, {}, "unit", 'units = { psi = "deg" }'),
    "rpm": (lambda c: {"n": 60 * c["n"]}, {}, "unit", 'units = { n = "rpm" }'),
    "rudder in deg": (lambda c: {"delta": DEG * c["delta"]}, {}, "unit", 'units = { delta = "deg" }'),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_is_named_and_its_line_mends_it(fault: str, tmp_path: Path) -> None:
    change, labels, code, line = FAULTS[fault]
    columns = motion_columns(seed=4)
    reports = said(tmp_path, [{**columns, **change(columns)}], labels)
    assert loud(reports[0]) == {code}
    assert advice(reports) == [("[default]", line)]
    assert not loud(followed(tmp_path, reports)[0])


def test_a_lag_is_named_and_mended(tmp_path: Path) -> None:
    columns = motion_columns(seed=4)
    reports = said(tmp_path, [{**columns, "r": shifted(columns["r"], 2.0)}])
    assert loud(reports[0]) == {"lag"}
    ((_, line),) = advice(reports)
    assert float(line.removeprefix("lag = { r = ").removesuffix(" }")) == pytest.approx(2.0, abs=0.1)
    assert not loud(followed(tmp_path, reports)[0])


def test_a_heading_behind_the_turn_rate_is_late_and_velocities_made_with_it_follow(tmp_path: Path) -> None:
    c = motion_columns(seed=4)
    late = shifted(c["psi"], 2.0)
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * (c["psi"] - late))
    relatives = '[default]\nderived = { u = ["psi", "x", "y"], v = ["psi", "x", "y"] }\n'
    (tmp_path / "trials.toml").write_text(relatives)
    reports = said(tmp_path, [{**c, "psi": late, "u": w.real, "v": w.imag}])
    ((_, line),) = advice(reports)
    seconds = float(line.removeprefix("lag = { psi = ").removesuffix(" }"))
    assert loud(reports[0]) == {"lag"} and seconds == pytest.approx(2.0, abs=0.1)
    (tmp_path / "trials.toml").write_text(f"{relatives}{line}\n")
    (trial,) = read_trials(tmp_path)
    assert not loud(check([trial])[0])
    rows = slice(30, -30)  # at the begin the heading is held
    for name in "uv":
        assert np.allclose(trial[name][rows], np.interp(trial.t, c["t"], c[name])[rows], atol=0.005)


def test_a_turn_rate_ahead_of_all_else_gives_no_line(tmp_path: Path) -> None:
    columns = motion_columns(seed=4)
    reports = said(tmp_path, [{**columns, "r": shifted(columns["r"], -2.0)}])
    assert loud(reports[0]) == {"lag"} and not advice(reports)


@pytest.mark.slow
@pytest.mark.parametrize("arm", [0.4 + 0.0j, -1.0 + 0.5j, -0.4j])
def test_the_lever_arm_of_the_positions_is_named_and_mended(arm: complex, tmp_path: Path) -> None:
    c = motion_columns(seed=5)
    place = c["x"] + 1j * c["y"] + arm * np.exp(1j * c["psi"])
    reports = said(tmp_path, [{**c, "x": place.real, "y": place.imag}])
    assert loud(reports[0]) == {"lever_arm"}
    ((_, line),) = advice(reports)
    x, y = map(float, re.findall(r"[xy] = (-?[\d.e-]+)", line))
    assert x == pytest.approx(arm.real, abs=0.05) and y == pytest.approx(arm.imag, abs=0.05)
    assert not loud(followed(tmp_path, reports)[0])


@pytest.mark.parametrize("name", ["r", "psi"])
def test_a_channel_that_stands_still_is_frozen_and_nothing_else(name: str) -> None:
    (report,) = check([make_trial(**{name: np.full(len(motion_columns()["t"]), 0.2)})])
    assert {f.code for f in report.findings if f.level == "contradictory"} == {"frozen_channel"}


def test_numbers_that_stand_for_no_value_are_missing_and_said(tmp_path: Path) -> None:
    c = motion_columns(seed=6)
    rows = np.arange(100, len(c["t"]), 150)
    c["u"][rows], c["x"][rows + 3] = -999.0, 9999.0
    reports = said(tmp_path, [c])
    assert {"sentinel"} <= loud(reports[0]) <= {"sentinel", "gaps"}
    trial = read_trial(tmp_path / "run_0.csv")
    assert np.isnan(trial["u"][rows]).all() and np.isnan(trial["x"][rows + 3]).all()
    kept = read_trial(tmp_path / "run_0.csv", {"sentinels": []})
    assert (kept["u"][rows] == -999.0).all()


def test_a_lag_takes_a_column_back_and_cuts_what_is_then_unknown(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", motion_columns(), rows=None)
    plain, back = read_trial(path, {}), read_trial(path, {"lag": {"u": 1.0}})
    assert len(back) == len(plain) - 10 and back.t[0] == plain.t[0]
    assert np.allclose(back["u"], plain["u"][10:]) and np.allclose(back["v"], plain["v"][:-10])
