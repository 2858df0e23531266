"""Frames, signs, units, lags, gains and lever arms of all files of a folder together: a lag is told by the motion."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from benchmarks.file_faults.faults import FAULTS
from cases.checks import CheckReport, check
from cases.criteria.standard_runs import simulated_trial
from cases.evidence import tails
from cases.evidence.competition import judged, scores
from cases.evidence.shifts import TRACK, TURN, candidates, scale, shifts
from cases.evidence.signals import signals, white_noise
from cases.io.read import read_trial, read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
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


def said(folder: Path, files: list[Columns], labels: Mapping[str, str] | None = None) -> list[CheckReport]:
    for number, columns in enumerate(files):
        headers = {name: f"{name} [{unit}]" for name, unit in (labels or {}).items()}
        write_csv(folder / f"run_{number}.csv", columns, headers, rows=None)
    return check(read_trials(folder))


def loud(report: CheckReport) -> set[str]:
    return {f.code for f in report.findings if f.level in ("contradictory", "doubtful")}


def advice(reports: list[CheckReport]) -> list[tuple[str, str]]:
    texts = "\n".join(f.text for report in reports for f in report.findings)
    return list(dict.fromkeys(re.findall(r"trials\.toml, (\[.+?\]): (.+?)\.(?:$|\n)", texts)))


def numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(r"= (-?\d[\d.e-]*)", line)]


def named_and_mended(folder: Path, columns: Columns, labels: Mapping[str, str] | None = None) -> tuple[str, str]:
    """The code and the line of what is said of a file, which is said no more once the line stands in the sidecar."""
    reports = said(folder, [columns], labels)
    ((table, line),) = advice(reports)
    (code,) = loud(reports[0])
    before = sidecar.read_text() if (sidecar := folder / "trials.toml").exists() else f"{table}\n"
    sidecar.write_text(before + line.replace(" and ", "\n") + "\n")
    assert table == "[default]" and not loud(check(read_trials(folder))[0])
    return code, line


def test_a_file_that_says_nothing_follows_its_folder(tmp_path: Path) -> None:
    weaving = [motion_columns(seed=k) for k in (1, 2)]
    reports = said(tmp_path, [*map(earth, weaving), straight(weaving[0])])
    assert [loud(r) & {"velocity_frame"} for r in reports] == [{"velocity_frame"}] * 3
    assert advice(reports) == [("[default]", 'velocity_frame = "earth"')]


@pytest.mark.parametrize("count", [2, 3])
def test_one_wrong_file_is_named_alone_and_files_that_nobody_looked_at_are_not_changed(
    count: int, tmp_path: Path
) -> None:
    files = [motion_columns(seed=k + 1) for k in range(count)]
    reports = said(tmp_path, [earth(files[0]), *files[1:]])
    assert [bool(loud(r)) for r in reports] == [True, *[False] * (count - 1)]
    for some in (reports, check(read_trials([tmp_path / "run_0.csv"]))):
        assert advice(some) == [('[files."run_0.csv"]', 'velocity_frame = "earth"')]


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


LINES = {
    "x and y swapped": 'columns = { x = "y [m]", y = "x [m]" }',
    "heading from east, counter-clockwise": 'sign = { psi = -1, r = -1 } and heading_from = "east"',
    "milliseconds as s": 'units = { t = "ms" }',
    "knots as m/s": 'units = { u = "kn", v = "kn" }',
    "r in deg/min as deg/s": 'units = { r = "deg/min" }',
    "psi in deg as rad": 'units = { psi = "deg" }',
    "rpm as rps": 'units = { n = "rpm" }',
    "delta in deg as rad": 'units = { delta = "deg" }',
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(LINES))
def test_a_fault_is_named_and_its_line_mends_it(name: str, tmp_path: Path) -> None:
    fault, columns = FAULTS[name], motion_columns(seed=4)
    changed = {**columns, **fault.change(columns, 3.0, 1.0, np.random.default_rng(0))}
    assert named_and_mended(tmp_path, changed, fault.labels) == (fault.codes[0], LINES[name])


def test_a_lag_is_named_and_mended(tmp_path: Path) -> None:
    columns = motion_columns(seed=4)
    code, line = named_and_mended(tmp_path, {**columns, "r": shifted(columns["r"], 2.0)})
    assert code == "lag" and line.startswith("lag = { r = ") and numbers(line) == [pytest.approx(2.0, abs=0.1)]


def test_a_heading_behind_the_turn_rate_is_late_and_velocities_made_with_it_follow(tmp_path: Path) -> None:
    c = motion_columns(seed=4)
    late = shifted(c["psi"], 2.0)
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * (c["psi"] - late))
    relatives = '[default]\nderived = { u = ["psi", "x", "y"], v = ["psi", "x", "y"] }\n'
    (tmp_path / "trials.toml").write_text(relatives)
    code, line = named_and_mended(tmp_path, {**c, "psi": late, "u": w.real, "v": w.imag})
    assert code == "lag" and line.startswith("lag = { psi = ") and numbers(line) == [pytest.approx(2.0, abs=0.1)]
    (trial,) = read_trials(tmp_path)
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
    code, line = named_and_mended(tmp_path, {**c, "x": place.real, "y": place.imag})
    assert code == "lever_arm" and numbers(line) == pytest.approx([arm.real, arm.imag], abs=0.05)


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


# Lags and gains, with their errors
EVERY, NOISE = 20, 0.9
"""Rows of 0.1 s between two that are logged, and error of the positions [m]: of a tanker of 320 m."""


SHIP = load_ship("kvlcc2_full")


def coarse_trials() -> list[Trial]:
    found = []
    for k, words in enumerate(("zigzag:20/20", "turning:35")):
        run, rng = simulated_trial(SHIP, words, None, None, False, k), np.random.default_rng(k)
        thin = {name: values[::EVERY].copy() for name, values in run.columns.items()}
        for name in ("x", "y"):
            thin[name] += rng.normal(scale=NOISE, size=len(thin[name]))
        found.append(replace(run, columns=thin, name=f"coarse_{k}"))
    return found


@pytest.mark.slow
def test_noisy_positions_of_a_slow_ship_are_not_late_and_late_ones_are() -> None:
    """With straight lines between rows these positions were 1 to 2 s late, whatever the truth."""
    trials = coarse_trials()
    known = [s for t in trials if (s := signals(t)) is not None]
    assert len(known) == len(trials)
    assert shifts(candidates(known, 40.0)) == [None] * len(trials)
    late = [s.shifted(-12.0, "place") for s in known]
    found = [shift for shift in shifts(candidates(late, 40.0)) if shift is not None]
    assert len(found) == len(trials) and {shift.name for shift in found} == {"place"}
    assert [float(np.real(shift.value)) for shift in found] == pytest.approx([12.0] * len(trials), abs=1.5)


def test_the_noise_on_a_slow_motion_is_recovered_and_unmeasured_columns_have_none() -> None:
    rng, t = np.random.default_rng(0), np.arange(4000) * 0.1
    sizes = np.array([0.01, 0.02, 0.003, 0.004, 0.005, 0.0006])
    states = np.sin(0.05 * t)[:, None] + sizes * rng.standard_normal((len(t), 6))
    np.testing.assert_allclose(white_noise([states[:2000], states[2000:], states[:2]]), sizes, rtol=0.1)
    states[:, :2] = np.nan
    assert white_noise([states]).tolist() == [0.0] * 6
    noise = white_noise([states], slice(2, None))
    assert noise[:2].tolist() == [0.0, 0.0] and noise[5] == pytest.approx(sizes[5], rel=0.1)


def straight_run(seed: int, gain: float, seconds: float = 100.0) -> Trial:
    """A straight run of 3 m/s at 2 Hz with satellite positions, whose u and v are ``gain`` times the true ones."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.5)
    still = np.zeros(len(t))
    psi = 0.7 + 0.001 * rng.standard_normal(len(t))
    place = 3.0 * t * np.exp(0.7j) + rng.normal(scale=0.05, size=(len(t), 2)) @ [1.0, 1j]
    u, v = (gain * (true + 0.01 * rng.standard_normal(len(t))) for true in (3.0, 0.0))
    columns = {"t": t, "x": place.real, "y": place.imag, "psi": psi, "u": u, "v": v, "r": still, "n": still + 1.0}
    return Trial("straight", {**columns, "delta": still})


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.98, 1.0, 1.03])
def test_a_gain_shows_in_100_s_of_straight_track(gain: float) -> None:
    for seed in range(4):
        (report,) = check([straight_run(seed, gain)])
        said = [(f.level, float(f.text.split("%")[0].split()[-1])) for f in report.findings if f.code == "gain"]
        assert said == ([("doubtful", pytest.approx(100 * abs(gain - 1), abs=0.3))] if gain != 1.0 else [])


def test_a_receiver_that_repeats_and_skips_fixes_hides_no_gain() -> None:
    """Fixes of 0.5 Hz on a clock of 2 Hz: of a third of the seconds the way is half or twice as long."""
    trial = straight_run(1, 1 / 1.0204, 600.0)
    rng, t = np.random.default_rng(2), trial.t
    place, fixes = 3.0 * t * np.exp(0.7j), np.arange(0, len(t), 4)
    shown = np.interp(t, t[fixes] + 1.0 * (rng.random(len(fixes)) < 0.3), place[fixes].real)
    shown = shown + 1j * shown * np.tan(0.7)
    found = scale([trial.with_columns(x=shown.real, y=shown.imag)], TRACK[:6])
    assert found is not None and found.matters("u")
    assert found.values["u"] == pytest.approx(0.0204, abs=4 * found.std["u"]) and found.std["u"] < 0.004


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("noise", [True, False])
def test_noise_of_a_column_is_no_gain_of_it(noise: bool) -> None:
    """A straight run has no sway and no turn but noise, which no regression may take for a small gain."""
    for seed in range(3 if noise else 1):
        trial = simulated_trial(SHIP, parse_maneuver("straight", SHIP, duration=900), None, None, noise, seed, 1.0)
        for names in (TRACK[:6], TURN):
            found = scale([trial], names)
            assert found is None or not any(found.matters(name) for name in names if name in "uvr")


def test_a_current_against_a_log_is_told_from_its_gain_by_legs_both_ways() -> None:
    out, back = straight_run(1, 1.0, 300.0), straight_run(2, 1.0, 300.0)
    back = back.with_columns(psi=back["psi"] + np.pi, x=-back["x"], y=-back["y"])
    set_by = 0.2
    both = [trial.with_columns(x=trial["x"] + set_by * trial.t) for trial in (out, back)]
    one, two = scale(both[:1], TRACK[:6]), scale(both, TRACK)
    assert one is not None and two is not None
    assert one.matters("u") and not two.significant("u")
    assert two.values["drift_x"] == pytest.approx(set_by, abs=0.01)


def test_a_gain_of_one_file_is_said_of_that_file_alone() -> None:
    files = [straight_run(seed, 0.97 if seed == 3 else 1.0) for seed in range(4)]
    doubts = [[f.code for f in r.findings if f.level == "doubtful" and f.code == "gain"] for r in check(files)]
    assert doubts == [[], [], [], ["gain"]]


def test_tails_and_quantiles_are_those_of_scipy() -> None:
    for value in (-1.0, 0.0, 0.3, 4.0, 60.0):
        assert tails.normal_tail(value) == pytest.approx(stats.norm.sf(value), rel=1e-12)
        assert tails.chi2_tail(value, 3) == pytest.approx(stats.chi2.sf(value, 3), rel=1e-12)
        assert tails.f_tail(value, 3, 17) == pytest.approx(stats.f.sf(value, 3, 17), rel=1e-9)
        assert tails.gamma_tail(value, 1.7, 2.0) == pytest.approx(stats.gamma.sf(value, 1.7, scale=2.0), rel=1e-12)
    for probability in (1e-300, 0.01, 0.5, 0.9):
        assert tails.student_quantile(probability, 5) == pytest.approx(stats.t.ppf(probability, 5), rel=1e-9)
