"""Finding the execute: measured FRT-DS-ESSO runs read by eye, and noisy synthetic ones whose orders are known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cases.criteria.imo import assess, imo_figures_of_trials
from cases.criteria.measured_maneuvers import find_maneuvers
from cases.criteria.standard_runs import Run, figures_of, measured_runs
from cases.io.read import read_trial
from cases.maneuvers.definitions import Zigzag, parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate
from cases.trial import Span, Trial, left_out
from mmg.errors import Missing, UnknownName, UserError
from mmg.messages import has_code
from mmg_ident import simulate as simulated
from tests.support.records import foreign, logged, long_record

SHIP = load_ship("esso_osaka_3m")


EXECUTES = {
    "turn_14-Oct-2020_14_08_51": (200, 35, ()),
    "turn_14-Oct-2020_14_39_54": (110, 20, ()),
    "turn_14-Oct-2020_15_21_57": (110, -35, ()),
    "turn_14-Sep-2020_13_39_32": (120, 35, ()),
    "turn_14-Sep-2020_14_50_41": (160, 35, ()),
    "turn_14-Sep-2020_15_47_33": (142, -35, ()),
    "turn_cut_14-Sep-2020_16_09_02": (111, -20, ()),
    "zigzag_31-Jul-2020_13_04_24": (44, 20, (56, 77, 103)),
    "zigzag_31-Jul-2020_13_14_21": (18, 30, (30, 52, 76, 97)),
    "zigzag_31-Jul-2020_13_22_52": (36, 15, (61, 81, 135, 163)),
    "zigzag_31-Jul-2020_13_29_19": (42, 15, (58, 81, 117)),
    "zigzag_31-Jul-2020_13_50_28": (42, -30, (56, 89, 118, 150)),
    "zigzag_31-Jul-2020_13_57_45": (26, 20, (44, 60, 92)),
    "zigzag_31-Jul-2020_14_03_39": (35, -20, (49, 83, 111)),
}
"""File -> first execute [s], rudder [deg], reversals [s], read off the plotted records."""


@pytest.mark.data
@pytest.mark.parametrize("name", EXECUTES)
def test_runs_are_cut_where_the_rudder_goes_over_and_at_every_reversal(name: str, frt: Path) -> None:
    time, degrees, reversals = EXECUTES[name]
    trial = read_trial(next(frt.glob(f"*/{name}.csv")))
    execute = find_maneuvers(trial, 3.0)[0]
    assert execute.kind == ("zigzag" if reversals else "turning")
    assert execute.order_time == pytest.approx(time, abs=1.0) and execute.reversals == pytest.approx(reversals, abs=1.0)
    assert math.degrees(execute.rudder) == pytest.approx(degrees, abs=1.0)
    if reversals:
        assert math.degrees(execute.heading) == pytest.approx(abs(degrees), abs=4.0)
        return
    at = np.interp(execute.order_time + np.array([-0.2, 0.5]), trial.t - trial.t[0], trial["delta"])
    assert abs(at[0]) < 0.8 * abs(execute.rudder) and at[1] == pytest.approx(execute.rudder, abs=0.02)
    assert 0.2 < execute.speed < 0.45


@pytest.mark.data
def test_measured_turning_figures_are_those_of_a_turning_circle(frt: Path) -> None:
    """35 deg of rudder: tighter than 20 deg on the same day; a random run is refused unless read as something."""
    runs = {}
    for name in ("turn_14-Sep-2020_13_51_45", "turn_14-Sep-2020_15_58_08"):
        runs[name] = measured_runs(read_trial(frt / "turning" / f"{name}.csv"), 3.0)[0]
    hard, soft = (run.figures["tactical_diameter"] / 3.0 for run in runs.values())
    assert 2.0 < hard < 3.0 < 4.0 < soft < 4.6
    with pytest.raises(UnknownName):
        find_maneuvers(read_trial(frt / "random" / "random_31-Jul-2020_12_29_58.csv"), 3.0)[0]


@pytest.mark.parametrize("text", ["turning:35", "turning:-20", "zigzag:20/20", "zigzag:-10/10", "crash-stop"])
def test_noisy_runs_after_a_wandering_approach_give_the_figures_of_the_clean_ones(text: str) -> None:
    slow = math.radians(5.0) if text in ("turning:35", "zigzag:-10/10") else None
    maneuver = parse_maneuver(text, SHIP, rudder_rate=slow)
    clean = simulate(SHIP, maneuver)
    noisy = with_approach(add_noise(clean, SensorNoise.for_length(3.0), 4), 60.0)
    run = measured_runs(noisy, 3.0)[0]
    p, truth = maneuver.parameters, figures_of(clean, maneuver)
    assert run.kind == maneuver.kind
    assert run.order_time == pytest.approx(60.0 + p["order_time"], abs=0.25)
    assert run.rudder == pytest.approx(p.get("rudder", 0.0), abs=math.radians(0.5))
    assert run.speed == pytest.approx(maneuver.speed, rel=0.02)
    assert run.notes == ()
    if text.startswith("zigzag"):
        assert run.heading == pytest.approx(p["heading"], abs=math.radians(0.5))
    names = [n for n in truth if n in run.figures and "time" not in n and "lateral" not in n and "steady" not in n]
    assert len(names) >= 2
    for name in names:
        angle = name.startswith("overshoot")
        tolerance = {"abs": math.radians(0.5)} if angle else {"rel": 0.03, "abs": 0.03}
        assert run.figures[name] == pytest.approx(truth[name], **tolerance), name


def with_approach(trial: Trial, seconds: float) -> Trial:
    """The run after ``seconds`` on a straight course, with the helm swinging by 6 deg."""
    t = np.arange(0.0, seconds, 0.1)
    first = {name: values[0] for name, values in trial.columns.items()}
    before = {name: np.full(len(t), value) for name, value in first.items()}
    before["t"], before["delta"] = t, np.radians(6) * np.sin(2 * np.pi * t / 12.0)
    before["x"] = first["x"] + first["u"] * (t - seconds)
    rng = np.random.default_rng(5)
    for name, std in (("u", 0.004), ("v", 0.004), ("r", 0.0006), ("psi", 0.0015)):
        before[name] = np.median(trial[name][:40]) + std * rng.standard_normal(len(t))
    shifted = {**trial.columns, "t": trial.t + seconds}
    columns = {name: np.concatenate([before[name], shifted[name]]) for name in trial.columns}
    return Trial("run", columns)


def test_an_accelerating_or_turning_approach_is_named() -> None:
    noisy = with_approach(simulate(SHIP, parse_maneuver("turning:35", SHIP)), 60.0)
    u, r = noisy["u"].copy(), noisy["r"].copy()
    rows = noisy.t < 65.0
    u[rows] *= 0.6 + 0.4 * noisy.t[rows] / 65.0
    assert "+1" in find_maneuvers(noisy.with_columns(u=u), 3.0)[0].notes[0]
    r[rows] += 0.02
    late = Trial("late", {name: a[noisy.t > 62.0] for name, a in noisy.columns.items()})
    assert find_maneuvers(noisy.with_columns(r=r), 3.0)[0].notes and find_maneuvers(late, 3.0)[0].caveats


def test_what_is_not_in_the_data_is_not_found() -> None:
    straight = with_approach(simulate(SHIP, parse_maneuver("straight", SHIP, duration=20)), 60.0)
    calm = straight.with_columns(delta=0.3 * straight["delta"])
    with pytest.raises(Missing):
        find_maneuvers(calm, 3.0)[0]


MODEL, FULL_SIZE = "3 m tanker, hard, 10 Hz", "320 m tanker, mild and hard, 1 Hz"
SEED = 77


def test_a_5_1_with_many_reversals_is_one_zigzag_with_all_its_reversals() -> None:
    clean = simulate(SHIP, parse_maneuver("zigzag:5/1", SHIP, speed=0.5, duration=260.0), 0.2)
    trial = logged(dict(clean.columns), 3.0, np.random.default_rng(SEED))
    (found,) = find_maneuvers(trial, 3.0)
    assert found.title == "zigzag 5/1" and len(found.reversals) >= 8
    (measured,) = measured_runs(trial, 3.0)
    assert 0 < math.degrees(measured.figures["overshoot_1"]) < 5


@pytest.mark.slow
def test_several_manoeuvres_in_one_record_are_cut_judged_and_listed() -> None:
    trial, _, length = long_record("kvlcc2_full", ["zigzag:10/10", "turning:35", "zigzag:-20/20"], 1.0, SEED)
    found = imo_figures_of_trials([trial], length=length)
    assert [r.title for r in found.runs] == ["zigzag 10/10", "turning 35", "zigzag -20/20"]
    assert [r.name for r in found.runs] == [f"record {k} ({r.title})" for k, r in enumerate(found.runs, 1)]
    assert "1 of 1 runs, 3 manoeuvres" in found.heading
    rows = {(row.run, row.figure): row for row in found.rows}
    assert rows["record 2 (turning 35)", "advance"].verdict == "pass"
    assert rows["record 1 (zigzag 10/10)", "overshoot_1"].verdict == "pass"
    assert found.runs[0].end < found.runs[1].order_time < found.runs[1].end < found.runs[2].order_time


@pytest.fixture(scope="module")
def large_turn() -> Run:
    """A turning test of a 320 m ship."""
    return measured_runs(*foreign(FULL_SIZE, "turning", 1, (35, 0), np.random.default_rng(SEED)))[0]


@pytest.mark.slow
@pytest.mark.parametrize("begins", [-25.0, 3.0, 100.0])
def test_a_short_or_unrecorded_approach_is_judged_and_told_but_not_a_record_that_begins_in_the_turn(
    begins: float, large_turn: Run
) -> None:
    """begins: first sample after the order [s]."""
    trial, length = large_turn.trial, large_turn.length
    found = imo_figures_of_trials([trial[trial.t[0] + large_turn.order_time + begins :]], length=length)
    if begins == 100.0:
        assert {row.verdict for row in found.rows if row.limit} == {"not judged"}
        return
    row = next(row for row in found.rows if row.figure == "advance")
    assert row.verdict == "pass" and row.why
    assert row.value == pytest.approx(large_turn.figures["advance"] / length, abs=0.15)


@pytest.mark.slow
def test_a_turn_that_never_comes_round_says_what_it_does_not_reach(large_turn: Run) -> None:
    trial = large_turn.trial
    t, turned = trial.t - trial.t[0], np.abs(trial.psi_unwrapped - trial.psi_unwrapped[0])
    rows = (turned < math.radians(60)) | (t < large_turn.order_time)
    cut = Trial("cut", {n: v[rows] for n, v in trial.columns.items()})
    found = imo_figures_of_trials([cut], length=large_turn.length)
    assert {row.why for row in found.rows if row.figure == "advance"} == {"the run does not reach it"}
    wander = cut.with_columns(delta=0.02 * np.sin(cut.t / 30))
    with pytest.raises(Missing):
        imo_figures_of_trials([wander], length=large_turn.length)


def test_a_rudder_that_is_logged_off_its_zero_is_told() -> None:
    trial, length = foreign(MODEL, "zigzag", -1, (10, 10), np.random.default_rng(SEED))
    (found,) = find_maneuvers(trial.with_columns(delta=trial["delta"] + math.radians(2.5)), length)
    assert found.title == "zigzag -10/10"


def test_a_zigzag_with_the_rudder_logged_the_wrong_way_round_is_named_and_not_judged() -> None:
    trial, length = foreign(MODEL, "zigzag", 1, (10, 10), np.random.default_rng(SEED))
    found = imo_figures_of_trials([trial.with_columns(delta=-trial["delta"])], length=length, scale=108.0)
    assert found.runs[0].title == "zigzag 10/10"
    assert {row.verdict for row in found.rows if row.limit} == {"not judged"}


@dataclass
class LateZigzag(Zigzag):
    """A zigzag whose rudder begins to move a ``reaction`` [s] after the heading at which it is ordered over."""

    reaction: float = 0.0
    due: float | None = field(default=None, init=False)

    def ordered(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if self.due is None and self._beyond(state) >= -1e-9:
            self.due = t + self.reaction
        if self.due is not None and t >= self.due - 1e-9:
            self.side, self.count, self.due = -self.side, self.count + 1, None
        over = self.last_execute is not None and self.count >= self.last_execute
        return None if over else (self.n, self.side * self.rudder)


def late_run(name: str, steps: str, reaction: float, dt: float, seed: int | None = None) -> tuple[Trial, float]:
    """A zigzag of a ship of the library, sampled every ``dt`` [s], with noise where there is a seed; and her length."""
    ship = load_ship(name)
    maneuver = parse_maneuver(f"zigzag:{steps}", ship, sampled=True)
    made = maneuver.orders
    assert isinstance(made, partial)
    late = partial(LateZigzag, *made.args, reaction=reaction, **made.keywords)
    run, length = simulate(ship, replace(maneuver, orders=late), dt), ship.particulars["L"]
    return (run if seed is None else add_noise(run, SensorNoise.for_length(length), seed)), length


@pytest.mark.parametrize("steps", ["10/10", "20/10", "-15/5", "30/5", "20/20"])
@pytest.mark.parametrize(
    ("name", "reaction", "dt"), [("esso_osaka_3m", 0.8, 0.1), ("kvlcc2_full", 4.0, 1.0), ("mariner", 2.0, 0.5)]
)
def test_a_late_helm_does_not_make_another_zigzag(name: str, reaction: float, dt: float, steps: str) -> None:
    execute = find_maneuvers(*late_run(name, steps, reaction, dt, 1))[0]
    assert execute.title == f"zigzag {steps}"
    assert math.degrees(execute.heading) > float(steps.split("/")[1]) + 0.3  # the heading is told as it was


@pytest.mark.parametrize(("name", "dt"), [("esso_osaka_3m", 0.5), ("kvlcc2_full", 5.0), ("mariner", 3.0)])
@pytest.mark.parametrize("steps", ["10/10", "20/10", "15/5", "30/5"])
def test_a_record_of_few_samples_does_not_make_another_zigzag(name: str, dt: float, steps: str) -> None:
    ship = load_ship(name)
    run = simulate(ship, parse_maneuver(f"zigzag:{steps}", ship), dt)
    assert find_maneuvers(run, ship.particulars["L"])[0].title == f"zigzag {steps}"


@pytest.mark.parametrize(
    ("name", "dt", "steps"),
    [("esso_osaka_3m", 0.1, "10/12"), ("esso_osaka_3m", 0.1, "10/8"), ("kvlcc2_full", 0.2, "10/11")],
)
def test_an_unusual_heading_is_believed_where_every_reversal_shows_it(name: str, dt: float, steps: str) -> None:
    """After a reaction she would have turned less far at the first reversal, where her yaw rate is least."""
    run, length = late_run(name, steps, 0.0, dt)
    assert find_maneuvers(run, length)[0].title == f"zigzag {steps}"


@pytest.mark.parametrize("dt", [0.1, 0.5, 1.0])
def test_overshoots_do_not_depend_on_how_finely_a_slow_rudder_is_logged(dt: float) -> None:
    """At 2.5 deg/s a rudder has left the angle that it held 0.4 s after it began to move: 5 % of an overshoot."""
    ship = load_ship("kvlcc2_full")
    plan = parse_maneuver("zigzag:10/10", ship, rudder_rate=math.radians(2.5))
    run = simulate(ship, plan, dt)
    true = figures_of(run, plan)
    sampled = np.interp(run.t, run.t + dt / 2, run["delta"])  # simulated logs hold the means of the steps that follow
    measured = measured_runs(run.with_columns(delta=sampled), ship.particulars["L"])[0].figures
    for name in ("overshoot_1", "overshoot_2"):
        assert measured[name] == pytest.approx(true[name], abs=math.radians(0.02 + 0.1 * dt))


def test_a_zigzag_of_the_standard_that_was_reversed_too_late_says_so() -> None:
    run, length = late_run("kvlcc2_full", "10/10", 6.5, 0.5)
    measured = measured_runs(run, length)[0]
    assert measured.steps == (10, 10) and math.degrees(measured.heading) > 12
    whys = {row.why for row in assess(measured) if row.figure.startswith("overshoot")}
    assert all("2 deg" in why for why in whys)


@pytest.fixture(scope="module")
def zigzag() -> Trial:
    return simulated("esso_osaka_3m", "zigzag:20/20", duration=200.0)


@pytest.fixture(scope="module")
def turn() -> Trial:
    return simulated("esso_osaka_3m", "turning:35", duration=120.0)


def figures(trial: Trial) -> dict[str, float | None]:
    return {row.figure: row.value for row in imo_figures_of_trials([trial], length=3.0).rows}


def test_a_short_broken_stretch_is_bridged(zigzag: Trial) -> None:
    second = measured_runs(zigzag, 3.0)[0].reversals[0]
    broken = left_out(zigzag, [(second - 2.0, second - 1.5)], "test")
    found = imo_figures_of_trials([broken], length=3.0)
    assert has_code(found.notices, "left_out") and has_code(found.notices, "bridged")
    assert figures(broken) == pytest.approx(figures(zigzag), rel=0.02)


def test_a_zigzag_counts_up_to_the_reversal_before_a_stretch_that_decides(zigzag: Trial) -> None:
    last = measured_runs(zigzag, 3.0)[0].reversals[2]
    broken = left_out(zigzag, [(last + 0.5, last + 25.0)], "test")
    found, sound = figures(broken), figures(zigzag)
    assert found["overshoot_1"] == pytest.approx(sound["overshoot_1"], rel=0.02)
    assert found.get("overshoot_3") is None and all(v is None or np.isfinite(v) for v in found.values())


@pytest.mark.parametrize("moved", [True, False])
def test_a_turn_with_a_stretch_that_decides_is_refused_in_a_line(moved: bool, turn: Trial) -> None:
    (run,) = imo_figures_of_trials([turn], length=3.0).runs
    read = run.order_time + run.figures["time_90"]
    span: Span = (run.order_time + 20.0, run.order_time + 20.5) if moved else (read - 2.0, read + 2.0)
    broken = left_out(turn, [span], "test", [span] if moved else ())
    with pytest.raises(UserError, match="something else moved the ship" if moved else "turns by more than 5 deg"):
        imo_figures_of_trials([broken], length=3.0)
    many = imo_figures_of_trials([broken, turn], length=3.0)
    assert len(many.runs) == 1 and has_code(many.notices, "no_maneuver_found")


def test_a_turn_without_what_lies_between_its_readings_has_the_same_figures(turn: Trial) -> None:
    (run,) = imo_figures_of_trials([turn], length=3.0).runs
    first, second = (run.order_time + run.figures[name] for name in ("time_90", "time_180"))
    broken = left_out(turn, [(run.order_time + 2.0, first - 1.0), (first + 1.0, second - 1.0)], "test")
    whole = figures(turn)
    for figure, value in figures(broken).items():
        assert value == pytest.approx(whole[figure], rel=1e-3), figure
