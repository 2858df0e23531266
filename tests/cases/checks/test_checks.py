"""What a check says of files and folders; what was derived from one another is not compared, and said: how a ship moves
tells instead."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.file_faults.simulated import FAULTS, contradictions, filtered, judged_sound
from cases.checks import CheckFinding, CheckReport, check, inputs_are_constant, pooled
from cases.checks.folders import duplicates
from cases.checks.single import doubtful_revolutions, steady_ahead
from cases.criteria.standard_runs import simulated_trial
from cases.evidence.competition import wrong_inputs
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import Wind, simulate, write_trial
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from mmg.errors import TooFewData
from mmg_ident import simulate as simulated
from mmg_ident.commands.main import app
from tests.support.trial_files import make_trial, motion_columns, shifted, write_csv


def one(trial):
    return check([trial])[0]


def text_of(report, level=None):
    return " ".join(f.text for f in report.findings if level is None or f.level == level)


def codes(report, level="doubtful"):
    return {f.code for f in report.findings if f.level == level}


def lags_of(report):
    """The lags [s] that are said."""
    return [float(f.text.split(" s late")[0].split()[-1]) for f in report.findings if f.code == "lag"]


def gains_of(report):
    """The gains, in per cent off, that are said."""
    return [float(f.text.split("%")[0].split()[-1]) for f in report.findings if f.code == "gain"]


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
        stop = simulated("kvlcc2_l7", "crash-stop", noise=True, dt=0.5, duration=300, seed=seed)
        derived = replace(stop, ancestors=dict.fromkeys("uv", ("x", "y", "psi")))
        assert [one(trial).verdict for trial in (stop, derived)] == ["ok", "consistent"]


@pytest.mark.parametrize("name", ["r", "u, v"])
@pytest.mark.parametrize("lag", [0.25, 0.73])
def test_a_lag_of_the_finished_columns_is_recovered_between_samples(name, lag):
    c = motion_columns()
    report = one(make_trial(**{column: shifted(c[column], lag) for column in name.split(", ")}))
    assert lags_of(report) == [pytest.approx(lag, abs=0.15)]


def test_a_late_satellite_velocity_turned_by_the_present_heading_is_distinguished_from_late_columns():
    c = motion_columns()
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * c["psi"])
    late = (shifted(w.real, 0.7) + 1j * shifted(w.imag, 0.7)) * np.exp(-1j * c["psi"])
    report = one(make_trial(u=late.real, v=late.imag))
    assert lags_of(report) == [pytest.approx(0.7, abs=0.15)]
    assert "in the earth frame" in text_of(report, "info") and report.verdict == "ok"


@pytest.mark.parametrize("gain", [0.95, 0.987, 1.0, 1.03])
def test_the_gain_of_a_gyro_is_recovered_and_a_consistent_trial_is_ok(gain):
    report = one(make_trial(r=gain * motion_columns()["r"]))
    assert gains_of(report) == ([pytest.approx(100 * abs(gain - 1), abs=0.3)] if gain != 1.0 else [])
    assert not lags_of(report) and (report.verdict == "ok" or gain != 1.0)


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


@pytest.mark.parametrize(("offset", "digits"), [(0.0, 17), (123.4, 17), (0.0, 5)])
def test_a_part_of_another_file_is_found_whatever_its_clock_and_digits_say(offset, digits):
    whole = make_trial("whole")
    part = Trial("part", {c: np.round(v[500:1500], digits) for c, v in whole.columns.items()})
    part = part.with_columns(t=part.t + offset)
    found = duplicates([whole, Trial("s", motion_columns(seed=7)), part])
    (first, second, third), said = ([each[k] for each in found] for k in (0, 1))
    assert (first, second, third) == ([2], [], [0])
    assert said[2][0][2].startswith("Is contained in whole: rows 0-999 are its rows 500-1499; ")


def test_an_exact_copy_is_found_and_a_ship_at_rest_is_not_a_duplicate():
    assert [found for found, _ in duplicates([make_trial("a"), make_trial("b")])] == [[1], [0]]
    rest = {c: np.zeros(600) for c in ("psi", "u", "v", "r", "n", "delta")} | {"t": 0.1 * np.arange(600)}
    assert [found for found, _ in duplicates([Trial("a", rest), Trial("b", rest)])] == [[], []]


def test_gaps_and_uneven_sampling_are_counted():
    c = motion_columns()
    keep = np.ones(len(c["t"]), bool)
    keep[700:800] = False
    u = c["u"].copy()
    u[1500:1600] = np.nan
    report = one(Trial("run", {name: v[keep] for name, v in {**c, "u": u}.items()}))
    assert "2 gap(s) in the states; the longest lasts 10.1 s" in text_of(report, "doubtful")


def test_contradicting_wind_columns_are_found():
    c = motion_columns()
    angle = c["wind_direction"] + np.pi - c["psi"]
    report = one(make_trial(apparent_wind_speed=c["wind_speed"], apparent_wind_direction=angle))
    assert "where the wind goes to" in text_of(report, "contradictory")


def test_without_positions_or_wind_the_rest_is_still_checked():
    c = motion_columns()
    report = one(Trial("run", {name: c[name] for name in ("t", "psi", "u", "v", "r", "n", "delta")}))
    assert report.verdict == "ok" and not gains_of(report)
    assert gains_of(
        one(Trial("run", {name: c[name] for name in ("t", "psi", "u", "v", "n", "delta")} | {"r": 0.9 * c["r"]}))
    )


@pytest.mark.parametrize("rows", [2, 3, 10, 60])
def test_very_short_trials_do_not_break_the_checks(rows):
    report = one(Trial("run", {name: v[:rows] for name, v in motion_columns().items()}))
    json.dumps(report.as_dict(), allow_nan=False)


def test_numbers_that_are_not_finite_leave_the_json_document_valid():
    numbers = {"a": float("inf"), "b": [np.float64("nan"), np.int64(3)], "c": {"d": True, "e": None}}
    document = CheckReport("run", "", (), numbers).as_dict()
    assert document["numbers"] == {"a": None, "b": [None, 3.0], "c": {"d": True, "e": None}}
    json.dumps(document, allow_nan=False)


def test_the_command_prints_a_table_and_one_json_document_that_also_says_what_no_file_alone_shows(tmp_path):
    """A folder with a file of relatives is consistent, never ok; with a ship, revolutions that do not fit are told."""
    for seed, name in enumerate("ab", 1):
        write_csv(tmp_path / f"{name}.csv", motion_columns(seed=seed), rows=None)
    (tmp_path / "trials.toml").write_text('[files."a.csv"]\nderived = { u = ["x", "y"], v = ["x", "y"] }\n')
    human = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert human.exit_code == 0 and "a" in human.output and "verdict" in human.output
    assert max(map(len, human.output.splitlines())) <= 100
    document = json.loads(CliRunner().invoke(app, ["check", str(tmp_path), "--json"]).output)
    assert list(document) == ["files", "folders", "pooled"]
    assert [row["verdict"] for row in document["files"]] == ["consistent", "ok"]
    assert document["folders"] == [{"path": str(tmp_path), "verdict": "consistent", "files": 2}]
    assert list(document["files"][0]) == ["name", "path", "verdict", "findings", "numbers"]
    assert all(set(f) == {"topic", "level", "code", "text"} and f["code"] for f in document["files"][0]["findings"])
    write_trial(zigzag(0.5), tmp_path / "c.csv")
    said = CliRunner().invoke(app, ["check", str(tmp_path / "c.csv"), "--ship", "esso_osaka_3m", "--json"]).stdout
    assert json.loads(said)["pooled"]["sentences"][0].startswith("The propeller does not fit: at ")
    assert not any("propeller does not fit" in sentence for sentence in document["pooled"]["sentences"])


@pytest.fixture(scope="module")
def reports(frt):
    return {report.name: report for report in check(read_trials(frt))}


@pytest.mark.slow
@pytest.mark.data
def test_the_cut_turn_is_found_inside_the_whole_one_and_no_other_real_record_is_doubted(reports):
    whole, cut = "turn_14-Sep-2020_15_58_08", "turn_cut_14-Sep-2020_15_58_08"
    found = {name: f.text for name, r in reports.items() for f in r.findings if f.code == "duplicate"}
    assert set(found) == {whole, cut} == {name for name, r in reports.items() if r.verdict != "ok"}
    assert found[cut].startswith("Is contained in") and "its rows 0-2868" in found[cut]


@pytest.mark.slow
@pytest.mark.data
def test_real_velocities_lag_the_track_and_the_gyro_reads_low(reports):
    lags = [lag for r in reports.values() if "in the earth frame" in text_of(r) for lag in lags_of(r)]
    assert len(lags) == len(reports) and 0.6 < np.median(lags) < 0.95
    turns = [report for name, report in reports.items() if name.startswith("turn")]
    gains = [gain for report in turns for gain in gains_of(report)]
    assert np.median(gains) == pytest.approx(1.3, abs=0.4)


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("fault", ["rudder positive to port", "velocities earth-fixed", "v positive to port"])
def test_a_fault_is_found_in_every_real_record(fault, frt):
    make, named = FAULTS[fault]
    for trial in read_trials(frt):
        assert codes(one(make(trial)), "contradictory") & set(named), trial.name


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
    trial = simulated("esso_osaka_3m", "turning:35", dt=0.5)
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


# Relatives, and how she moves
TRACK = {"u": ("psi", "x", "y", "sog", "cog"), "v": ("psi", "x", "y", "sog", "cog")}
ALL = {**TRACK, "r": ("psi",)}


def derived(trial: Trial, offset: float = 0.0, arm: float = 0.0) -> Trial:
    """``trial`` with u, v and r from positions and a heading that is off by ``offset`` [rad], of a point ``arm`` [m]
    ahead of midship."""
    psi = trial["psi"] + offset
    w = (trial["u"] + 1j * (trial["v"] + arm * trial["r"])) * np.exp(-1j * offset)
    return replace(trial.with_columns(psi=psi, u=w.real, v=w.imag), ancestors=ALL)


@pytest.mark.parametrize(("ancestors", "notes"), [({}, 0), (TRACK, 1), ({"r": ("psi",)}, 1), (ALL, 2), ({"v": ()}, 1)])
def test_a_comparison_of_relatives_is_none(ancestors: dict[str, tuple[str, ...]], notes: int) -> None:
    trial = Trial("run", motion_columns(), ancestors=ancestors)
    (report,) = check([trial])
    assert [f.code for f in report.findings].count("not_checked") == notes
    assert report.verdict == ("consistent" if notes else "ok")


@pytest.mark.parametrize("fault", [{"x": -1.0}, {"u": 1.944, "v": 1.944}, {"y": -1.0}])
def test_what_relatives_say_of_each_other_is_no_contradiction(fault: dict[str, float]) -> None:
    c = motion_columns()
    wrong = {name: factor * c[name] for name, factor in fault.items()}
    (alone,) = check([Trial("run", {**c, **wrong})])
    (related,) = check([Trial("run", {**c, **wrong}, ancestors=ALL)])
    assert alone.verdict == "contradictory" and related.verdict == "consistent"


def test_a_rudder_to_port_is_found_beside_relatives_and_its_rival_is_a_mirrored_world() -> None:
    c = motion_columns()
    (report,) = check([Trial("run", {**c, "delta": -c["delta"]}, ancestors=ALL)])
    (text,) = [f.text for f in report.findings if f.level == "contradictory"]
    assert 'rudder_positive = "port"' in text and "sign = { y = -1, psi = -1, v = -1, r = -1 }" in text


@pytest.fixture(scope="module")
def circle() -> Trial:
    return simulated("esso_osaka_3m", "turning:20", dt=0.2, duration=300, noise=True)


def legs() -> list[Trial]:
    """Straight legs in four directions, in a current."""
    out = []
    for k in range(4):
        trial = simulated("esso_osaka_3m", "zigzag:2/2", dt=0.2, duration=200, noise=True, seed=k)
        heading = trial["psi"] + k * np.pi / 2
        current = 0.05 * np.exp(-1j * (heading - 0.4))
        out.append(trial.with_columns(psi=heading, u=trial["u"] + current.real, v=trial["v"] + current.imag))
    return out


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 0.07, -0.1])
def test_a_heading_error_is_told_from_a_current_by_legs_both_ways(offset: float) -> None:
    reports = check([derived(trial, offset) for trial in legs()])
    assert all(("heading_offset" in codes(report)) == (offset != 0.0) for report in reports)
    (one,) = check([derived(legs()[0], offset)])
    assert "heading_offset" not in codes(one)


@pytest.mark.parametrize(
    ("offset", "arm", "doubts"),
    [(0.0, 0.0, set()), (0.0, 0.5, set()), (0.0, 3.0, {"lever_arm"}), (np.pi, 0.0, {"u_sign"})],
)
def test_sway_with_the_turn_is_of_a_point_ahead_of_the_pivot_and_sternway_under_ahead_revolutions_a_doubt(
    circle: Trial, offset: float, arm: float, doubts: set[str]
) -> None:
    found = codes(check([derived(circle, offset, arm)])[0]) & {"lever_arm", "u_sign"}
    assert doubts <= found and (doubts or not found)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 12])
def test_filtered_velocities_refute_nothing(seed: int) -> None:
    assert judged_sound(filtered(seed))[0] == "quiet"


def test_a_course_in_place_of_the_heading_is_a_doubt_in_a_turn(circle: Trial) -> None:
    course = np.unwrap(circle["psi"] + np.arctan2(circle["v"], circle["u"]))
    speed = np.hypot(circle["u"], circle["v"])
    trial = replace(circle.with_columns(psi=course, u=speed, v=0.0 * speed), ancestors=ALL)
    assert "course_heading" in codes(check([trial])[0])


@pytest.mark.parametrize(("turn", "expected"), [(0.6, set()), (2.0, {"lever_arm"})])
def test_a_wind_that_turns_a_ship_less_than_a_quarter_moves_no_antenna(turn: float, expected: set[str]) -> None:
    t, rng = np.arange(0.0, 400.0, 0.5), np.random.default_rng(1)
    psi, r = turn * np.sin(0.05 * t), 0.05 * turn * np.cos(0.05 * t)
    columns = {"t": t, "psi": psi, "u": 1.0 + 0.0 * t, "v": 2.0 * r + 0.01 * rng.standard_normal(len(t)), "r": r}
    columns |= {"n": 5.0 + 0.0 * t, "delta": 0.01 * np.sin(t)}
    columns |= {"x": 0.5 * np.cumsum(np.cos(psi)), "y": 0.5 * np.cumsum(np.sin(psi))}
    assert codes(check([Trial("drifts", columns, ancestors=TRACK)])[0]) & {"lever_arm"} == expected


def test_a_heading_frozen_over_the_record_is_refuted_by_the_track(circle: Trial) -> None:
    frozen = np.full(len(circle), 0.3)
    ground = (circle["u"] + 1j * circle["v"]) * np.exp(1j * (circle["psi"] - frozen))
    trial = replace(circle.with_columns(psi=frozen, r=0.0 * frozen, u=ground.real, v=ground.imag), ancestors=ALL)
    assert "frozen_channel" in codes(check([trial])[0], "contradictory")


def test_revolutions_astern_that_never_stop_the_ship_have_the_other_sign(tmp_path: Path) -> None:
    orders = ("zigzag:20/20", "turning:35")
    runs = [simulated("kvlcc2_l7", order, noise=True, dt=0.2, duration=250, seed=3) for order in orders]
    turned = [trial.with_columns(n=-trial["n"]) for trial in runs]
    reports = check(turned)
    assert [codes(report, "contradictory") for report in reports] == [{"revolutions_sign"}] * 2
    for trial in turned:
        write_trial(trial, tmp_path / f"{trial.name}.csv")
    logged = check(read_trials(tmp_path))
    texts = {f.text for report in logged for f in report.findings if f.code == "revolutions_sign"}
    assert len(texts) == 1 and "[default]: sign = { n = -1 }" in texts.pop()
    one = [trial.with_columns(n_2=-trial["n"]) for trial in runs]  # of two shafts
    assert ["n_2 is positive" in f.text for f in check(one)[0].findings if f.level == "contradictory"] == [True]
    pitch = [trial.with_columns(pitch=np.full(len(trial), -0.7)) for trial in turned]
    stop = simulated("kvlcc2_full", "crash-stop", noise=True, dt=1.0, duration=1500)
    astern = stop[float(stop.t[stop["n"] < 0][0]) :]
    stopped = stop.with_columns(n=np.zeros(len(stop)))
    for sound in ([*runs, astern], pitch, [stop], [astern], [astern[: astern.t[0] + 250.0]], [stopped]):
        assert not any("revolutions_sign" in codes(report, "contradictory") for report in check(sound))


@pytest.mark.parametrize(("angle", "expected"), [(np.pi, {"u_sign"}), (0.2, set())])
def test_pods_ahead_do_not_push_a_ship_astern(angle: float, expected: set[str]) -> None:
    t = np.arange(0.0, 100.0, 0.5)
    speed = 3.0 * np.exp(1j * angle) * (1 + 0.05 * np.sin(0.3 * t))
    columns = {"t": t, "psi": 0.1 * np.sin(0.1 * t), "r": 0.01 * np.cos(0.1 * t), "u": speed.real, "v": speed.imag}
    columns |= {"n_azimuth": 2.0 + 0.0 * t, "azimuth": 0.2 * np.sin(0.1 * t), "n": 0.0 * t, "delta": 0.0 * t}
    assert codes(check([Trial("pods", columns)])[0]) & {"u_sign"} == expected


def test_r_against_the_heading_that_u_and_v_come_from_has_two_readings_and_no_line(tmp_path: Path) -> None:
    c = motion_columns()
    (trial,) = read_trials(write_csv(tmp_path / "run.csv", {**c, "r": -c["r"]}, rows=None))
    for ancestors, lines in (({}, True), (TRACK, False)):
        (report,) = check([replace(trial, ancestors=ancestors)])
        (text,) = [f.text for f in report.findings if f.code == "r_sign"]
        assert ("trials.toml" in text) is lines


SHIP = load_ship("esso_osaka_3m")


def zigzag(factor: float = 1.0) -> Trial:
    """A zigzag whose revolutions are logged with this ``factor``."""
    trial = simulate(SHIP, parse_maneuver("zigzag:20/20", SHIP, duration=80.0), 0.2)
    return trial.with_columns(n=factor * trial["n"])


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (1.3, False), (0.8, False), (0.5, True), (60.0, True)])
def test_revolutions_that_do_not_fit_are_told_of_where_the_ship_goes_straight(factor: float, said: bool) -> None:
    trial, needed = zigzag(factor), zigzag()["n"][0]
    n, u = steady_ahead(trial, SHIP.particulars["L"])
    assert factor * revolutions_for(SHIP, u) == pytest.approx(n, rel=0.02)
    found = doubtful_revolutions(SHIP, [trial])
    assert [doubt.code for doubt in found] == ["revolutions"] * said
    assert all(f"{needed:.3g}" in words and f"have {factor * needed:.3g}" in words for words in found)
    turning = trial.with_columns(delta=np.full(len(trial), 0.5))
    assert steady_ahead(turning, SHIP.particulars["L"]) is None and doubtful_revolutions(SHIP, [turning]) == []


def sailed(order: str, wind: float, direction: float, sign: int = 1) -> Trial:
    """The 3 m ship under an ``order``, in a steady ``wind`` [m/s] from ``direction`` [deg], delta times ``sign``."""
    maneuver = parse_maneuver(order, SHIP, duration=150.0)
    trial = simulate(SHIP, maneuver, 0.5, Wind(wind, np.radians(direction)))
    return replace(trial, columns={**trial.columns, "delta": sign * trial["delta"]})


def test_a_stop_with_the_rudder_at_rest_under_a_noisy_sensor_says_nothing_of_its_unit() -> None:
    stop = simulated("esso_osaka_3m", "crash-stop", dt=1.0, duration=900)
    noise = np.random.default_rng(0).normal(size=len(stop))
    assert wrong_inputs(stop.with_columns(delta=np.radians(0.05) * noise), 0.9) == []
    turn = simulated("kvlcc2_full", "zigzag:10/10", dt=1.0, duration=900)
    assert [name for name, *_ in wrong_inputs(turn.with_columns(delta=turn["delta"] / 57.3), 0.9)] == ["delta"]


def rudder_signs(trials: list[Trial]) -> list[list[CheckFinding]]:
    """What is said of the sign of the rudder of each of the ``trials``, which are of one folder."""
    return [[f for f in report.findings if f.code == "rudder_sign"] for report in check(trials)]


@pytest.mark.parametrize(("order", "direction"), [("turning:15", 210), ("turning:15", 240), ("turning:15", 270),
                         ("zigzag:10/10", 120), ("zigzag:10/10", 210), ("zigzag:10/10", 270)])  # fmt: skip
def test_a_wind_that_turns_the_ship_does_not_turn_the_sign_of_her_rudder(order: str, direction: int) -> None:
    assert rudder_signs([sailed(order, 2.5, direction)]) == [[]]


@pytest.mark.slow
def test_one_reversed_rudder_of_seven_files_is_a_doubt_without_a_line() -> None:
    calm = [sailed(f"zigzag:{angle}/{angle}", 0.0, k) for k, angle in enumerate((5, 8, 10, 15, 20, 25))]
    said = rudder_signs([sailed("turning:15", 0.0, 6, -1), *calm])
    assert [[f.level for f in one] for one in said] == [["doubtful"], *[[]] * 6]
    assert "trials.toml" not in said[0][0].text


@pytest.mark.slow
@pytest.mark.parametrize("files", [1, 7])
def test_rudders_that_are_all_reversed_or_all_else_mirrored_cannot_be_told(files: int) -> None:
    """Both lines are said, and none is advised."""
    said = rudder_signs([sailed(f"zigzag:{a}/{a}", 0.0, 0, -1) for a in (5, 8, 10, 15, 20, 25, 30)[:files]])
    assert [[f.level for f in one] for one in said] == [["contradictory"]] * files
    lines = ('rudder_positive = "port"', "sign = { y = -1, psi = -1, v = -1, r = -1 }")
    assert all(line in f.text and "trials.toml" not in f.text for one in said for f in one for line in lines)


def test_a_reversed_rudder_that_is_held_while_she_turns_round_is_found() -> None:
    columns = simulate(SHIP, parse_maneuver("turning:35", SHIP, duration=300.0), 0.5).columns
    held = Trial("held", {name: (-1 if name == "delta" else 1) * values[80:] for name, values in columns.items()})
    assert np.ptp(held["delta"]) < 1e-9 and rudder_signs([held])[0][0].level == "contradictory"
