from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.file_faults.simulated import FAULTS, contradictions
from cases.checks import CheckReport, check, inputs_are_constant, pooled
from cases.criteria.standard_runs import simulated_trial
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from mmg.errors import TooFewData
from mmg_ident import simulate
from mmg_ident.commands.main import app
from tests.support.trial_files import make_trial, motion_columns, shifted, write_csv


def one(trial):
    return check([trial])[0]


def kinematics(trial):
    return one(trial).numbers["kinematics"]


def text_of(report, level=None):
    return " ".join(f.text for f in report.findings if level is None or f.level == level)


def codes(report, level):
    return {f.code for f in report.findings if f.level == level}


def test_a_consistent_trial_is_ok():
    report = one(make_trial())
    assert report.verdict == "ok", text_of(report, "doubtful")
    numbers = report.numbers["kinematics"]
    assert set(numbers["lag_s"].values()) == {None}
    assert list(numbers["gain"].values()) == pytest.approx([1.0] * 3, abs=0.01)


def test_a_steady_circle_and_a_crash_stop_without_a_turn_are_sound():
    t = np.arange(0.0, 300.0, 0.5)
    psi = 0.02 * t
    place, still = 200.0 * np.exp(1j * (psi - np.pi / 2)), np.ones(len(t))
    circle = {"x": place.real, "y": place.imag, "psi": psi, "u": 4 * still, "v": 0 * still, "r": 0.02 * still}
    sound = one(Trial("circle", {"t": t, **circle, "n": still}))
    assert all(f.code != "frozen_channel" for f in sound.findings)
    turning = one(Trial("circle", {"t": t, **circle, "r": 0.01 * still, "n": still, "delta": 0.1 * still}))
    assert "frozen_channel" in codes(turning, "contradictory")
    for seed in range(3):  # heading and turn rate are noise, of which a lag explains nothing
        stop = simulate("kvlcc2_l7", "crash-stop", noise=True, dt=0.5, duration=300, seed=seed)
        derived = replace(stop, ancestors=dict.fromkeys("uv", ("x", "y", "psi")))
        assert [one(trial).verdict for trial in (stop, derived)] == ["ok", "consistent"]


@pytest.mark.parametrize("name", ["r", "u, v"])
@pytest.mark.parametrize("lag", [0.25, 0.73])
def test_a_lag_of_the_finished_columns_is_recovered_between_samples(name, lag):
    c = motion_columns()
    numbers = kinematics(make_trial(**{column: shifted(c[column], lag) for column in name.split(", ")}))
    assert numbers["lag_s"][name] == pytest.approx(lag, abs=0.15)


def test_a_late_satellite_velocity_turned_by_the_present_heading_is_distinguished_from_late_columns():
    c = motion_columns()
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * c["psi"])
    late = (shifted(w.real, 0.7) + 1j * shifted(w.imag, 0.7)) * np.exp(-1j * c["psi"])
    report = one(make_trial(u=late.real, v=late.imag))
    assert report.numbers["kinematics"]["lag_s"]["x, y"] == pytest.approx(-0.7, abs=0.15)
    assert "in the earth frame" in text_of(report, "info") and report.verdict == "ok"


@pytest.mark.parametrize("gain", [0.95, 0.987, 1.03])
def test_the_gain_of_a_gyro_is_recovered(gain):
    report = one(make_trial(r=gain * motion_columns()["r"]))
    assert report.numbers["kinematics"]["gain"]["r"] == pytest.approx(gain, abs=0.003)


def test_constant_inputs_leave_nothing_to_identify():
    t = motion_columns()["t"]
    trial = make_trial(n=np.full(len(t), 10.0), delta=np.zeros(len(t)))
    assert inputs_are_constant(trial)
    report = one(trial)
    assert report.verdict == "doubtful" and "nothing_to_identify" in codes(report, "doubtful")
    assert not inputs_are_constant(trial.with_columns(azimuth=np.where(t > t[len(t) // 2], 0.3, 0.0)))


def test_what_is_never_excited_is_said_per_file_and_together():
    ahead = make_trial("ahead")
    n = motion_columns()["n"].copy()
    n[1000:2000] = -8.0
    back = make_trial("back", n=n)
    alone, other = check([ahead, back])
    assert "Never n < 0." in text_of(alone)
    assert other.numbers["excitation"]["group_seconds"]["propeller_reversed"] == pytest.approx(100.0, abs=1.0)
    seconds, sentences = pooled([alone, other])
    assert seconds["propeller_reversed"] == pytest.approx(100.0, abs=1.0) and "Never n < 0" not in " ".join(sentences)
    osaka = pooled([alone], load_ship("esso_osaka_3m"))[1]
    assert any(t.startswith("Never n < 0: C_3, C_6, C_7, C_10, A_1, ") for t in osaka), osaka
    assert not any("C_3" in t for t in pooled([alone], load_ship("mariner"))[1])
    assert sum(alone.numbers["excitation"]["quadrants"].values()) == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 123.4])
def test_a_part_of_another_file_is_found_whatever_its_clock_says(offset):
    whole = make_trial("whole")
    part = Trial("part", {c: v[500:1500] for c, v in whole.columns.items()})
    part = part.with_columns(t=part.t + offset)
    stranger = Trial("stranger", motion_columns(seed=7))
    first, second, third = (report.numbers["duplicates"] for report in check([whole, stranger, part]))
    found = [third[0][key] for key in ("other", "relation", "rows", "other_rows")]
    assert len(third) == 1 and found == ["whole", "inside", [0, 999], [500, 1499]]
    assert first[0]["relation"] == "contains" and second == []


def test_an_exact_copy_is_found_and_a_ship_at_rest_is_not_a_duplicate():
    a, b = check([make_trial("a"), make_trial("b")])
    assert a.numbers["duplicates"][0]["relation"] == b.numbers["duplicates"][0]["relation"] == "copy"
    t = np.arange(0.0, 60.0, 0.1)
    rest = {c: np.zeros(len(t)) for c in ("psi", "u", "v", "r", "n", "delta")}
    reports = check([Trial("a", {"t": t, **rest}), Trial("b", {"t": t, **rest})])
    assert all(report.numbers["duplicates"] == [] for report in reports)


def test_a_copy_saved_with_fewer_digits_is_found():
    whole = make_trial("whole")
    rounded = Trial("rounded", {c: np.round(v[300:2000], 5) for c, v in whole.columns.items()})
    _, found, none = check([whole, rounded, Trial("stranger", motion_columns(seed=7))])
    (copy,) = found.numbers["duplicates"]
    assert (copy["other"], copy["relation"]) == ("whole", "inside") and none.numbers["duplicates"] == []


def test_gaps_and_uneven_sampling_are_counted():
    c = motion_columns()
    keep = np.ones(len(c["t"]), bool)
    keep[700:800] = False
    u = c["u"].copy()
    u[1500:1600] = np.nan
    report = one(Trial("run", {name: v[keep] for name, v in {**c, "u": u}.items()}))
    sampling = report.numbers["sampling"]
    assert sampling["gaps"] == 2 and sampling["longest_gap_s"] == pytest.approx(10.1)
    assert sampling["nan_share"]["u"] == pytest.approx(100 / 2900)
    assert "2 gap(s)" in text_of(report, "doubtful") and report.verdict == "doubtful"


def test_contradicting_wind_columns_are_found():
    c = motion_columns()
    angle = c["wind_direction"] + np.pi - c["psi"]
    report = one(make_trial(apparent_wind_speed=c["wind_speed"], apparent_wind_direction=angle))
    assert "where the wind goes to" in text_of(report, "contradictory")


def test_without_positions_or_wind_the_rest_is_still_checked():
    c = motion_columns()
    report = one(Trial("run", {name: c[name] for name in ("t", "psi", "u", "v", "r", "n", "delta")}))
    gain = report.numbers["kinematics"]["gain"]
    assert report.verdict == "ok" and [name for name, value in gain.items() if value is not None] == ["r"]


@pytest.mark.parametrize("rows", [2, 3, 10, 60])
def test_very_short_trials_do_not_break_the_checks(rows):
    report = one(Trial("run", {name: v[:rows] for name, v in motion_columns().items()}))
    json.dumps(report.as_dict(), allow_nan=False)


def test_numbers_that_are_not_finite_leave_the_json_document_valid():
    numbers = {"a": float("inf"), "b": [np.float64("nan"), np.int64(3)], "c": {"d": True, "e": None}}
    document = CheckReport("run", "", (), numbers).as_dict()
    assert document["numbers"] == {"a": None, "b": [None, 3.0], "c": {"d": True, "e": None}}
    json.dumps(document, allow_nan=False)


def test_the_command_prints_a_table_and_one_json_document(tmp_path):
    write_csv(tmp_path / "run.csv", motion_columns(), rows=None)
    human = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert human.exit_code == 0 and "run" in human.output and "verdict" in human.output
    assert max(map(len, human.output.splitlines())) <= 100
    machine = CliRunner().invoke(app, ["check", str(tmp_path / "run.csv"), "--json"])
    document = json.loads(machine.output)
    assert list(document) == ["files", "folders", "pooled"]
    assert document["folders"] == [{"path": str(tmp_path), "verdict": document["files"][0]["verdict"], "files": 1}]
    assert list(document["files"][0]) == ["name", "path", "verdict", "findings", "numbers"]
    assert all(set(f) == {"topic", "level", "code", "text"} and f["code"] for f in document["files"][0]["findings"])


@pytest.fixture(scope="module")
def reports(frt):
    return {report.name: report for report in check(read_trials(frt))}


@pytest.mark.slow
@pytest.mark.data
def test_the_cut_turn_is_found_inside_the_whole_one_and_nothing_else(reports):
    found = {name: r.numbers["duplicates"] for name, r in reports.items() if r.numbers["duplicates"]}
    assert set(found) == {"turn_14-Sep-2020_15_58_08", "turn_cut_14-Sep-2020_15_58_08"}
    (inside,) = found["turn_cut_14-Sep-2020_15_58_08"]
    assert inside["relation"] == "inside" and inside["other_rows"] == [0, 2868]


@pytest.mark.slow
@pytest.mark.data
def test_real_records_have_no_false_alarm(reports):
    warned = {name: text_of(r, "doubtful") for name, r in reports.items() if r.verdict != "ok"}
    assert set(warned) == {"turn_14-Sep-2020_15_58_08", "turn_cut_14-Sep-2020_15_58_08"}, warned


@pytest.mark.slow
@pytest.mark.data
def test_real_velocities_lag_the_track_and_the_gyro_reads_low(reports):
    notes = [f.text for r in reports.values() for f in r.findings if f.code == "lag"]
    lags = [float(text.split(" s late")[0].split()[-1]) for text in notes if "in the earth frame" in text]
    assert len(lags) == len(reports) and 0.6 < np.median(lags) < 0.95
    turns = [report for name, report in reports.items() if name.startswith("turn")]
    gains = [report.numbers["kinematics"]["gain"]["r"] for report in turns]
    assert np.median(gains) == pytest.approx(0.987, abs=0.004)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.data
def test_a_flipped_rudder_is_found_in_every_real_record(frt):
    for trial in read_trials(frt):
        assert one(trial.with_columns(delta=-trial["delta"])).verdict == "contradictory", trial.name


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.data
def test_earth_fixed_velocities_and_a_flipped_sway_are_found_in_every_real_record(frt):
    for trial in read_trials(frt):
        w = (trial["u"] + 1j * trial["v"]) * np.exp(1j * trial["psi"])
        assert text_of(one(trial.with_columns(u=w.real, v=w.imag)), "contradictory"), trial.name
        flipped = text_of(one(trial.with_columns(v=-trial["v"])), "contradictory")
        assert "v is positive to port" in flipped or "v has the opposite sign" in flipped, trial.name


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("share", [0.5, 0.9, 0.97, 0.99])
@pytest.mark.parametrize("seed", range(4))
def test_a_trial_of_gaps_is_checked_without_a_warning_of_numpy(share, seed):
    columns, rng = motion_columns(60.0), np.random.default_rng(seed)
    rows = len(columns["t"])
    holes = {k: v if k == "t" else np.where(rng.random(rows) < share, np.nan, v) for k, v in columns.items()}
    check([Trial("gaps", holes)])


@pytest.mark.filterwarnings("error")
def test_rows_that_are_never_whole_have_no_sigma():
    columns = motion_columns(60.0)
    odd = np.arange(len(columns["t"])) % 2 == 0
    columns |= {"u": np.where(odd, np.nan, columns["u"]), "v": np.where(odd, columns["v"], np.nan)}
    with pytest.raises(TooFewData):
        pooled_sigma([Trial("gaps", columns)])


@pytest.mark.parametrize("reading", ["as it is", "from the bow", "apparent", "turned twice"])
def test_a_true_wind_that_is_steadier_in_another_reading_is_doubted(reading: str) -> None:
    trial = simulate("esso_osaka_3m", "turning:35", dt=0.5)
    psi, body = trial["psi"], trial["u"] + 1j * trial["v"]
    air = -0.5 * np.exp(1j * (0.3 + 0.05 * np.random.default_rng(1).standard_normal(len(psi))))
    told = {
        "as it is": air, "from the bow": air * np.exp(-1j * psi), "apparent": air * np.exp(-1j * psi) - body,
        "turned twice": air * np.exp(1j * psi),
    }[reading]  # fmt: skip
    windy = trial.with_columns(wind_speed=np.abs(told), wind_direction=np.angle(-told) % (2 * np.pi))
    assert ("wind_direction" in codes(one(windy), "doubtful")) is (reading != "as it is")


@pytest.fixture(scope="module")
def mild() -> list[Trial]:
    ship = load_ship("kvlcc2_l7")
    return [simulated_trial(ship, maneuver, None, None, True, 5, 0.5) for maneuver in ("zigzag:5/5", "zigzag:10/10")]


@pytest.mark.parametrize("fault", ["none", *FAULTS])
def test_a_fault_of_mild_runs_is_named_and_nothing_else(fault: str, mild: list[Trial]) -> None:
    make, codes = FAULTS.get(fault, (lambda trial: trial, ()))
    said = contradictions([make(trial) for trial in mild])
    assert bool(said) is (fault != "none") and set(said) <= set(codes)


def test_a_remedy_names_the_file_and_the_line(mild: list[Trial]) -> None:
    reports = check([FAULTS["psi, v, r mirrored"][0](trial) for trial in mild])
    texts = [f.text for report in reports for f in report.findings if f.level == "contradictory"]
    line = "trials.toml, [default]: sign = { psi = -1, v = -1, r = -1 }"
    assert [line in text for text in texts] == [True] * len(mild)
