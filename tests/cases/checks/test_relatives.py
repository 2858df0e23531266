"""What was derived from one another is not compared, and said; how a ship moves tells instead."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.file_faults.simulated import filtered, judged_sound
from cases.checks import CheckReport, check
from cases.checks.single import doubtful_revolutions, steady_ahead
from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import revolutions_for
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate, write_trial
from cases.trial import Trial
from mmg_ident import simulate as simulated
from mmg_ident.commands.main import app
from tests.support.trial_files import motion_columns, write_csv

TRACK = {"u": ("psi", "x", "y", "sog", "cog"), "v": ("psi", "x", "y", "sog", "cog")}
ALL = {**TRACK, "r": ("psi",)}


def derived(trial: Trial, offset: float = 0.0, arm: float = 0.0) -> Trial:
    """``trial`` with u, v and r from positions and a heading that is off by ``offset`` [rad], of a point ``arm`` [m]
    ahead of midship."""
    psi = trial["psi"] + offset
    w = (trial["u"] + 1j * (trial["v"] + arm * trial["r"])) * np.exp(-1j * offset)
    return replace(trial.with_columns(psi=psi, u=w.real, v=w.imag), ancestors=ALL)


def codes(report: CheckReport, level: str = "doubtful") -> set[str]:
    return {f.code for f in report.findings if f.level == level}


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


def test_a_folder_is_consistent_and_never_ok(tmp_path) -> None:
    write_csv(tmp_path / "a.csv", motion_columns(seed=1), rows=None)
    write_csv(tmp_path / "b.csv", motion_columns(seed=2), rows=None)
    (tmp_path / "trials.toml").write_text('[files."a.csv"]\nderived = { u = ["x", "y"], v = ["x", "y"] }\n')
    document = json.loads(CliRunner().invoke(app, ["check", str(tmp_path), "--json"]).output)
    assert [row["verdict"] for row in document["files"]] == ["consistent", "ok"]
    assert [row["verdict"] for row in document["folders"]] == ["consistent"]
    assert "not_checked" not in codes(check(read_trials(tmp_path))[1], "info")


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


def test_a_wind_that_turns_with_the_ship_is_none_over_ground(circle: Trial) -> None:
    speed, rng = np.full(len(circle), 5.0), np.random.default_rng(1)
    gusts = 0.2 * rng.standard_normal(len(circle))
    over_ground = circle.with_columns(wind_speed=speed, wind_direction=1.0 + gusts)
    with_ship = circle.with_columns(wind_speed=speed, wind_direction=circle["psi"] + 1.0 + gusts)
    assert "wind_direction" not in codes(check([over_ground])[0])
    assert "wind_direction" in codes(check([with_ship])[0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 12])
def test_filtered_velocities_refute_nothing(seed: int) -> None:
    assert judged_sound(filtered(seed))[0] == "quiet"


def test_a_course_in_place_of_the_heading_is_a_doubt_in_a_turn(circle: Trial) -> None:
    course = np.unwrap(circle["psi"] + np.arctan2(circle["v"], circle["u"]))
    speed = np.hypot(circle["u"], circle["v"])
    trial = replace(circle.with_columns(psi=course, u=speed, v=0.0 * speed), ancestors=ALL)
    assert "course_heading" in codes(check([trial])[0])


def test_a_wind_that_turns_a_ship_less_than_a_quarter_moves_no_antenna() -> None:
    t, rng = np.arange(0.0, 400.0, 0.5), np.random.default_rng(1)
    for turn, codes_expected in ((0.6, set()), (2.0, {"lever_arm"})):
        psi, r = turn * np.sin(0.05 * t), 0.05 * turn * np.cos(0.05 * t)
        columns = {"t": t, "psi": psi, "u": 1.0 + 0.0 * t, "v": 2.0 * r + 0.01 * rng.standard_normal(len(t)), "r": r}
        columns |= {"n": 5.0 + 0.0 * t, "delta": 0.01 * np.sin(t), "x": 0.5 * np.cumsum(np.cos(psi))}
        columns |= {"y": 0.5 * np.cumsum(np.sin(psi))}
        found = codes(check([Trial("drifts", columns, ancestors=TRACK)])[0])
        assert found & {"lever_arm"} == codes_expected


def test_a_heading_frozen_over_the_record_is_refuted_by_the_track(circle: Trial) -> None:
    frozen = np.full(len(circle), 0.3)
    ground = (circle["u"] + 1j * circle["v"]) * np.exp(1j * (circle["psi"] - frozen))
    trial = replace(circle.with_columns(psi=frozen, r=0.0 * frozen, u=ground.real, v=ground.imag), ancestors=ALL)
    assert "frozen_channel" in codes(check([trial])[0], "contradictory")


def test_revolutions_astern_that_never_stop_the_ship_have_the_other_sign() -> None:
    orders = ("zigzag:20/20", "turning:35")
    runs = [simulated("kvlcc2_l7", order, noise=True, dt=0.2, duration=250, seed=3) for order in orders]
    turned = [trial.with_columns(n=-trial["n"]) for trial in runs]
    reports = check(turned)
    assert [codes(report, "contradictory") for report in reports] == [{"revolutions_sign"}] * 2
    texts = {f.text for report in reports for f in report.findings if f.code == "revolutions_sign"}
    assert len(texts) == 1 and "[default]: sign = { n = -1 }" in texts.pop()
    pitch = [trial.with_columns(pitch=np.full(len(trial), -0.7)) for trial in turned]
    stop = simulated("kvlcc2_full", "crash-stop", noise=True, dt=1.0, duration=1500)
    astern = stop[float(stop.t[stop["n"] < 0][0]) :]
    stopped = stop.with_columns(n=np.zeros(len(stop)))
    for sound in ([*runs, astern], pitch, [stop], [astern], [astern[: astern.t[0] + 250.0]], [stopped]):
        assert not any("revolutions_sign" in codes(report, "contradictory") for report in check(sound))


@pytest.mark.parametrize(("angle", "code"), [(np.pi, "u_sign"), (0.2, "")])
def test_pods_ahead_do_not_push_a_ship_astern(angle: float, code: str) -> None:
    t = np.arange(0.0, 100.0, 0.5)
    speed = 3.0 * np.exp(1j * angle) * (1 + 0.05 * np.sin(0.3 * t))
    columns = {"t": t, "psi": 0.1 * np.sin(0.1 * t), "r": 0.01 * np.cos(0.1 * t), "u": speed.real, "v": speed.imag}
    columns |= {"n_azimuth": 2.0 + 0.0 * t, "azimuth": 0.2 * np.sin(0.1 * t), "n": 0.0 * t, "delta": 0.0 * t}
    found = codes(check([Trial("pods", columns)])[0])
    assert {"u_sign"} & found == ({code} if code else set())


def test_r_against_the_heading_that_u_and_v_come_from_has_two_readings_and_no_line() -> None:
    c = motion_columns()
    for ancestors, lines in (({}, True), (TRACK, False)):
        (report,) = check([Trial("run", {**c, "r": -c["r"]}, ancestors=ancestors)])
        (text,) = [f.text for f in report.findings if f.code == "r_sign"]
        assert ("trials.toml" in text) is lines


SHIP = load_ship("esso_osaka_3m")


def zigzag(factor: float = 1.0) -> Trial:
    """A zigzag whose revolutions are logged with this ``factor``."""
    trial = simulate(SHIP, parse_maneuver("zigzag:20/20", SHIP, duration=80.0), 0.2)
    return trial.with_columns(n=factor * trial["n"])


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (1.3, False), (0.8, False), (0.5, True), (60.0, True)])
def test_revolutions_that_do_not_fit_are_told_of(factor: float, said: bool) -> None:
    trial, needed = zigzag(factor), zigzag()["n"][0]
    n, u = steady_ahead(trial, SHIP.particulars["L"])
    assert factor * revolutions_for(SHIP, u) == pytest.approx(n, rel=0.02)
    found = doubtful_revolutions(SHIP, [trial])
    assert [doubt.code for doubt in found] == ["revolutions"] * said
    assert all(f"{needed:.3g}" in words and f"have {factor * needed:.3g}" in words for words in found)


def test_a_ship_made_of_particulars_fits_a_foreign_plant_and_trials_that_never_go_straight_say_nothing() -> None:
    length, speed = 7.0, 1.2
    particulars = {"L": length, "B": 1.18, "d": 0.443, "C_b": 0.775, "U_0": speed, "A_R": 0.0603, "x_G": 0.0}
    ship = new_ship("foreign", {**particulars, "rho": 1025.0, "D_P": 0.2414, "pitch_ratio": 0.698})
    t = np.arange(0.0, 60.0, 0.5)
    still = {name: np.zeros(len(t)) for name in ("x", "y", "psi", "v", "r", "delta")}
    n = revolutions_for(ship, speed)
    ahead = Trial("ahead", {"t": t, **still, "u": np.full(len(t), speed), "n": np.full(len(t), n)})
    assert doubtful_revolutions(ship, [ahead]) == []
    assert len(doubtful_revolutions(ship, [ahead.with_columns(n=ahead["n"] / 2.4)])) == 1
    turning = ahead.with_columns(n=ahead["n"] / 2.4, delta=np.full(len(t), 0.5))
    assert steady_ahead(turning, length) is None and doubtful_revolutions(ship, [turning]) == []


def test_the_check_says_it_with_a_ship(tmp_path) -> None:
    path = tmp_path / "zigzag_1.csv"
    write_trial(zigzag(0.5), path)
    plain = json.loads(CliRunner().invoke(app, ["check", str(path), "--json"]).stdout)
    own = json.loads(CliRunner().invoke(app, ["check", str(path), "--ship", "esso_osaka_3m", "--json"]).stdout)
    assert not any("propeller does not fit" in s for s in plain["pooled"]["sentences"])
    assert own["pooled"]["sentences"][0].startswith("The propeller does not fit: at ")


def sailed(order: str, wind: float, direction: float, sign: int = 1) -> Trial:
    """The 3 m ship under an ``order``, in a steady ``wind`` [m/s] from ``direction`` [deg], delta times ``sign``."""
    maneuver = parse_maneuver(order, SHIP, duration=150.0)
    trial = simulate(SHIP, maneuver, 0.5, Wind(wind, np.radians(direction)))
    return replace(trial, columns={**trial.columns, "delta": sign * trial["delta"]})


def levels(trials: list[Trial]) -> list[list[str]]:
    """Level of what is said of the sign of the rudder of each of the ``trials``, which are of one folder."""
    return [[f.level for f in report.findings if f.code == "rudder_sign"] for report in check(trials)]


@pytest.mark.parametrize(("order", "direction"), [("turning:15", 210), ("turning:15", 240), ("turning:15", 270),
                         ("zigzag:10/10", 120), ("zigzag:10/10", 210), ("zigzag:10/10", 270)])  # fmt: skip
def test_a_wind_that_turns_the_ship_does_not_turn_the_sign_of_her_rudder(order: str, direction: int) -> None:
    assert levels([sailed(order, 2.5, direction)]) == [[]]


@pytest.mark.slow
def test_one_reversed_rudder_of_seven_files_is_a_doubt_without_a_line() -> None:
    calm = [sailed(f"zigzag:{angle}/{angle}", 0.0, k) for k, angle in enumerate((5, 8, 10, 15, 20, 25))]
    odd = sailed("turning:15", 0.0, 6, -1)
    assert levels([odd, *calm]) == [["doubtful"], *[[]] * 6]
    (text,) = [f.text for f in check([odd, *calm])[0].findings if f.code == "rudder_sign"]
    assert "trials.toml" not in text


@pytest.mark.slow
@pytest.mark.parametrize("files", [1, 7])
def test_rudders_that_are_all_reversed_or_all_else_mirrored_cannot_be_told(files: int) -> None:
    """Both lines are said, and none is advised."""
    trials = [sailed(f"zigzag:{angle}/{angle}", 0.0, 0, -1) for angle in (5, 8, 10, 15, 20, 25, 30)[:files]]
    assert levels(trials) == [["contradictory"]] * files
    texts = [f.text for report in check(trials) for f in report.findings if f.code == "rudder_sign"]
    lines = ('rudder_positive = "port"', "sign = { y = -1, psi = -1, v = -1, r = -1 }")
    assert all(line in text for text in texts for line in lines)
    assert all("trials.toml" not in text for text in texts)


def test_a_reversed_rudder_that_is_held_while_she_turns_round_is_found() -> None:
    maneuver = parse_maneuver("turning:35", SHIP, duration=300.0)
    columns = simulate(SHIP, maneuver, 0.5).columns
    held = Trial("held", {name: (-1 if name == "delta" else 1) * values[80:] for name, values in columns.items()})
    assert np.ptp(held["delta"]) < 1e-9 and levels([held]) == [["contradictory"]]
