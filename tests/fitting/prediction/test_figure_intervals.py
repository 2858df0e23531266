"""Error bars of manoeuvring figures: what widens them, what they are called, and what is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.criteria import imo
from cases.criteria.imo import Assessment, assess, with_value
from cases.criteria.standard_runs import figures_of_each
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import simulate
from cases.simulation.simulate_batch import draw_coefficients, simulate_batch
from fitting.prediction.bands import Process, process_dict
from fitting.prediction.envelope import held_dict, held_motion, untried
from fitting.prediction.figure_intervals import (
    FigureScatter,
    carried_on,
    drawn_figures,
    judged_row,
    maneuver_scatter,
    with_intervals,
)
from fitting.prediction.stretches import record_of
from mmg.errors import UserError
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg_ident.commands.main import main
from tests.support.commands import shown

SPEED = 0.5
WIDE = {"u": [-0.3, 0.8], "v": [-0.4, 0.4], "r": [-0.3, 0.3], "n": [-30.0, 30.0], "delta": [-1.0, 1.0],
        "beta": [-3.2, 3.2]}  # fmt: skip


def some_ship() -> Any:
    """The model with a few uncertain coefficients, the others fixed."""
    ship = load_ship("esso_osaka_3m")
    kept = ship.free[:2]
    rows = {s: ship.coefficients[s].with_(std=0.03 * abs(ship.coefficients[s].value)) for s in kept}
    return ship.fixing([s for s in ship.free if s not in kept]).with_coefficients(rows)


def content(ship: Any, size: float = 0.002, envelope: dict | None = None) -> dict[str, Any]:
    """What a result.json says of the ship: correlation, process, envelope."""
    free, one, sizes = list(ship.free), np.ones((1, 6)), np.zeros((3, 3))
    sizes[:, 0] = (size, size, size / 3)
    process = Process(np.full(3, 5.0), np.full(3, 20.0), sizes, np.zeros(6), one, one, np.array([30.0]))
    return {
        "correlation": {"symbols": free, "matrix": np.eye(len(free)).tolist()},
        "bands": process_dict(process),
        "envelope": envelope or WIDE,
    }


@pytest.fixture(scope="module")
def figures() -> tuple[Any, Assessment]:
    ship = some_ship()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(imo, "STANDARD", ("turning:35", "zigzag:10/10", "crash-stop"))
        return ship, imo.imo_figures(ship, SPEED, scale=325 / 3)


@pytest.fixture(scope="module")
def turning(figures: tuple[Any, Assessment]) -> tuple[Any, Assessment]:
    """The turning circle alone."""
    ship, found = figures
    return ship, replace(found, rows=found.rows[:3], runs=found.runs[:1])


@pytest.mark.slow
def test_intervals_hold_the_figure_and_grow_with_what_is_not_known(figures: tuple[Any, Assessment]) -> None:
    ship, found = figures
    known = content(ship)
    judged = with_intervals(found, ship, known, 50)
    sure = with_intervals(found, ship, {k: v for k, v in known.items() if k != "bands"}, 50)
    doubled = {s: ship.coefficients[s].with_(std=2 * ship.coefficients[s].std) for s in ship.free}
    wider = with_intervals(found, ship.with_coefficients(doubled), known, 50)
    assert len(judged.rows) == len(found.rows) == 8
    for row, plain, wide in zip(judged.rows, sure.rows, wider.rows, strict=True):
        low, high = row.interval_90
        assert low < row.value < high and row.value == row.median
        assert row.extrapolated is False
        assert plain.interval_90_trial == plain.interval_90
        # so little is not known that the linear figures of a calibrated ship are those of whole draws
        assert plain.interval_90 == pytest.approx(row.interval_90, rel=1e-6 if row.run == "crash-stop" else 5e-3)
        if row.run != "crash-stop":  # where the coefficients are not what makes it wide
            assert np.ptp(row.interval_90_trial) > np.ptp(row.interval_90)  # gusts belong to a single trial
            assert 1.5 < np.ptp(wide.interval_90) / np.ptp(row.interval_90) < 2.7
        assert (row.probability is None) == (row.limit is None)
    named = {"value", "interval_90", "criterion", "probability", "extrapolated"}
    assert all(named <= set(row) for row in judged.to_dict()["rows"])


ASTERN = (("n", -19.0, 5.0),)
"""How a crash stop leaves trials without revolutions astern."""


@pytest.mark.parametrize(("reach", "median", "verdict"), [(18.0, 8.0, "pass"), (8.0, 17.0, "fail"), (8.0, 8.1, "pass")])
def test_the_value_is_the_median_of_its_draws_and_is_judged_by_it(
    figures: tuple[Any, Assessment], reach: float, median: float, verdict: str
) -> None:
    run = figures[1].runs[-1]
    run = replace(run, figures={name: reach * run.length for name in run.figures})
    draws = {name: run.length * np.linspace(0.8, 1.2, 41) * median for name in run.figures}
    for row in assess(run, 325 / 3):
        judged = judged_row(row, run, FigureScatter(draws, draws, (), 0, ()))
        assert row.value == pytest.approx(reach) and judged.value == pytest.approx(median)
        assert judged.interval_90[0] < judged.value < judged.interval_90[1]
        assert judged.verdict == (verdict if row.limit else "-")
        assert ("20 L" in judged.why) == (judged.verdict == "fail")  # what an Administration may allow
        meeting = None if row.limit is None else np.mean(draws[row.figure] <= row.limit * run.length)
        assert judged.probability == (None if meeting is None else pytest.approx(meeting))
        assert meeting is None or (meeting > 0.5) == (verdict == "pass")
        untried = judged_row(row, run, FigureScatter(draws, draws, ASTERN, 0, ()))
        assert untried.verdict == ("not judged" if row.limit else "-")
        assert (untried.value, untried.probability) == (judged.value, judged.probability)
        never = judged_row(row, run, FigureScatter({}, {}, (), 0, ()))
        assert never.value is None and never.verdict == ("not judged" if row.limit else "-")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "limits", "verdict", "count"),
    [
        ({}, {"track_reach": 0.1}, "fail", 0),
        ({"n": [0.0, 30.0]}, {"track_reach": 0.1}, "not judged", 5),
        ({"n": [0.0, 30.0]}, {"track_reach": 99.0, "advance": 0.1}, "fail", 4),
    ],
)
def test_what_no_trial_supports_has_no_say_in_the_verdict(
    figures: tuple[Any, Assessment], more: dict[str, Any], limits: dict[str, float], verdict: str, count: int
) -> None:
    """What trials support has it alone, and that is said."""
    ship, found = figures
    limited = (replace(row, limit=limits.get(row.figure, row.limit)) for row in found.rows)
    rows = tuple(with_value(row, row.value) for row in limited)
    judged = with_intervals(replace(found, rows=rows), ship, content(ship, envelope=WIDE | more), 20)
    assert judged.to_dict()["verdict_basis"] == judged.basis and judged.basis in judged.conclusion
    assert judged.verdict == verdict
    assert not more or (int(judged.basis.split()[0]) == count and judged.basis.endswith("crash-stop"))


def test_a_figure_is_extrapolated_where_the_trials_held_no_such_motion(turning: tuple[Any, Assessment]) -> None:
    """Not by revolutions a hair off; nothing is known of it without an envelope, and little without trials."""
    ship, found = turning
    n = float(found.runs[0].trial["n"][0])
    for more, extrapolated in (({"n": [1.002 * n, 1.002 * n]}, False), ({"r": [-0.02, 0.02]}, True)):
        judged = with_intervals(found, ship, content(ship, envelope=WIDE | more), 20)
        assert {row.extrapolated for row in judged.rows} == {extrapolated}
        said = [str(note) for note in judged.notices if note.code == "outside_the_trials"]
        assert bool(said) == extrapolated == ("turning:35" in "".join(said))
    unknown = {key: value for key, value in content(ship).items() if key != "envelope"}
    assert all(row.extrapolated is None for row in with_intervals(found, ship, unknown, 20).rows)
    assert found.basis == "" and found.conclusion.endswith(f": {found.verdict}")
    alone = with_intervals(found, ship, {}, 20)
    assert alone.verdict == "pass" and alone.basis


def test_draws_that_never_come_so_far_count_as_beyond(turning: tuple[Any, Assessment]) -> None:
    ship, found = turning
    one = with_intervals(found, ship, content(ship), 40).scatter["turning:35"]
    values = np.where(np.arange(40) < 6, np.nan, one.ship["tactical_diameter"])  # six of forty never turn so far
    row = judged_row(found.rows[2], found.runs[0], replace(one, ship={**one.ship, "tactical_diameter": values}))
    assert row.reached == pytest.approx(34 / 40) and row.interval_90[1] == float("inf")
    assert row.interval_90[0] < row.median < 10 and row.probability == pytest.approx(34 / 40)


@pytest.mark.slow
def test_figures_of_a_calibrated_ship_are_linear_in_the_draws() -> None:
    """Also where the coefficient is hardly known, and the manoeuvre far from linear in it."""
    ship = load_ship("esso_osaka_3m")
    few = ship.fixing([s for s in ship.free if s != "N_r"])
    value = few.coefficients["N_r"].value
    few = few.with_coefficients({"N_r": few.coefficients["N_r"].with_(std=0.4 * abs(value))})
    plan = parse_maneuver("zigzag:10/10", few, speed=SPEED)
    drawn = draw_coefficients(few, 60, 2)
    wide = content(few, 1e-9)
    found, motions = drawn_figures(Simulator(few), plan, drawn, wide, 0, tracks=60)
    steps = {"N_r": value * (1 + 0.01 * np.array([-1.0, 1.0]))}
    few_steps, _ = drawn_figures(Simulator(few), plan, steps, {}, 0)
    whole = figures_of_each(motions, plan)
    for name in ("overshoot_1", "overshoot_2"):
        slope = np.diff(np.log(few_steps.ship[name]))[0] / np.diff(steps["N_r"])[0]
        expected = few_steps.ship[name].mean() * np.exp(slope * (drawn["N_r"] - value))
        assert np.log(found.ship[name]) == pytest.approx(np.log(expected), abs=0.15)
        assert np.ptp(np.log(found.ship[name])) > 0.5
        nonlinear = np.array([one.get(name, np.nan) for one in whole])  # their motions are those of whole draws
        assert np.nanmax(np.abs(np.log(nonlinear / expected))) > 0.2
        assert np.nanmedian(np.abs(np.log(nonlinear / expected))) < 0.2


@pytest.mark.slow
def test_few_runs_make_figures_less_certain_as_student_s_t() -> None:
    """Quantiles of Abramowitz & Stegun 1964, table 26.10, with a degree of freedom less than runs, at least two."""
    few = some_ship()
    plan, model = parse_maneuver("turning:35", few, speed=SPEED), Simulator(few)
    drawn, known = draw_coefficients(few, 60, 3), content(few)

    def advance(draws: dict[str, np.ndarray], **more: Any) -> np.ndarray:
        return drawn_figures(model, plan, draws, known | more, 0)[0].ship["advance"]

    plain = np.log(advance(drawn)).std()
    for runs, quantile in ((1, 2.919986), (3, 2.919986), (5, 2.131847), (100_001, 1.644854)):
        spread = np.log(advance(drawn, uncertainty={"runs": runs})).std()
        assert spread / plain == pytest.approx(quantile / 1.644854, rel=0.01), runs
    # bands have the few runs already: what pushes her outside of the trials is not widened again
    trial = simulate(few, parse_maneuver("zigzag:10/10", few, speed=SPEED))
    held: Any = held_motion([record_of(trial, few.inputs)], few.inputs, few.particulars["L"])
    known["bands"] |= {"held": held_dict(held)}
    still = {s: np.full(60, few.coefficients[s].value) for s in drawn}
    pushed = [advance(still, **told) for told in ({"uncertainty": {"runs": 3}}, {})]
    assert (pushed[0] == pushed[1]).all() and np.ptp(pushed[0]) > 0


def test_linear_figures_lie_about_those_of_fine_steps_and_add_what_a_single_trial_changes() -> None:
    """By ratios where all are positive, else by differences; what the ship does not reach stays as it is."""
    coarse, exact = {"a": 2.0, "b": -1.0, "c": math.nan}, {"a": 3.0, "b": 1.0, "c": 5.0}
    ships, trials = carried_on(
        coarse,
        exact,
        {"a": np.array([2.0, 2.0 * 1.1]), "b": np.array([-0.9, 0.2]), "c": np.ones(2)},
        {"a": np.array([2.2, 2.0 * 1.1]), "b": np.array([-0.8, 0.2]), "c": np.ones(2)},
        0.5,
    )
    assert ships["a"] == pytest.approx([3.0, 3.0 * 1.21]) and trials["a"] == pytest.approx([3.3, 3.0 * 1.21])
    assert ships["b"] == pytest.approx([1.2, 3.4]) and trials["b"] == pytest.approx([1.3, 3.4])  # signs differ: added
    assert ships["c"] == pytest.approx([1.0, 1.0])


def test_draws_beyond_a_bound_take_their_partners_along() -> None:
    ship = some_ship()
    a, b = ship.free[:2]
    c = ship.coefficients[a]
    bounded = ship.with_coefficients({a: c.with_(lower=c.value - 0.1 * c.std)})
    matrix = np.eye(len(ship.free))
    matrix[0, 1] = matrix[1, 0] = 0.99
    drawn = draw_coefficients(bounded, 4000, 0, (list(ship.free), matrix))
    first, second = ((drawn[s] - ship.coefficients[s].value) / ship.coefficients[s].std for s in (a, b))
    assert first.min() == pytest.approx(-0.1)
    on_bound = first < -0.0999
    assert on_bound.mean() == pytest.approx(0.46, abs=0.03)  # Phi(-0.1)
    # given that the first is at its bound, the second is about 0.99 times that, with little left of its own
    assert second[on_bound].mean() == pytest.approx(-0.099, abs=0.02) and second[on_bound].std() < 0.2


@pytest.mark.parametrize("count", [5, 10**6])
def test_counts_that_make_no_sense_are_one_line(figures: tuple[Any, Assessment], count: int) -> None:
    ship, found = figures
    with pytest.raises(UserError, match="give 20 to"):
        with_intervals(found, ship, content(ship), count)


@pytest.mark.slow
def test_draws_that_take_longer_to_stop_than_the_ship_go_on_being_pushed() -> None:
    ship = load_ship("kvlcc2_full")
    few = ship.fixing([s for s in ship.free if s not in ("R_0", "k_0")])
    plan = parse_maneuver("crash-stop", few)
    drawn = draw_coefficients(few, 20, 1)
    found, trials = drawn_figures(Simulator(few), plan, drawn, content(few, 1e-3), 0, dt=5.0)
    nominal = simulate_batch(few, plan, dt=5.0)
    assert len(trials.t) > len(nominal.t) and np.isfinite(found.trial["track_reach"]).all()
    assert np.median(found.ship["track_reach"]) == pytest.approx(12.3 * 320, rel=0.2)


# One manoeuvre of many drawn ships: the intervals of the table of the standard, a criterion, tracks, a figure
@pytest.mark.slow
def test_one_manoeuvre_has_the_intervals_of_the_table_of_the_standard(turning: tuple[Any, Assessment]) -> None:
    ship, one = turning
    plan = parse_maneuver("turning:35", ship, speed=SPEED)
    found = maneuver_scatter(ship, plan, content(ship), 60, seed=4)
    rows = {row["figure"]: row for row in found.rows}
    for row in with_intervals(one, ship, content(ship), 60, seed=4).rows:
        mine = rows[row.figure]
        assert row.interval_90 == pytest.approx([x / 3 for x in mine["interval_90"]], rel=1e-9)
        assert row.interval_90_trial == pytest.approx([x / 3 for x in mine["interval_90_trial"]], rel=1e-9)
        assert mine["probability"] == row.probability
        assert mine["limit"] == (None if row.limit is None else pytest.approx(3 * row.limit))
        assert mine["value"] == pytest.approx(3 * row.value, rel=2e-3)
    assert not found.drawn.outside
    tracks = found.tracks()
    assert sorted(tracks["run"].unique()) == list(range(61)) and np.isfinite(tracks.to_numpy()).all()


def test_a_stop_that_no_trial_held_is_the_priors_and_without_a_calibration_coefficients_alone_are_drawn() -> None:
    ship = some_ship()
    plan = parse_maneuver("crash-stop", ship, speed=SPEED)
    narrow = content(ship, envelope={"u": [0.0, 0.8], "n": [0.0, 30.0]})
    assert has_code(maneuver_scatter(ship, plan, narrow, 20).notices, "outside_the_trials")
    turn = parse_maneuver("turning:35", ship, speed=SPEED)
    found = maneuver_scatter(ship, turn, {}, 10)
    assert has_code(found.notices, "independent_draws") and all(row["interval_90_trial"] is None for row in found.rows)
    assert maneuver_scatter(ship, turn, {}, 10).rows == found.rows  # by the same seed
    for plan, count in ((turn, 1), (turn, 10**6), (parse_maneuver("spiral:15/5", ship, speed=SPEED), 10)):
        with pytest.raises(UserError):
            maneuver_scatter(ship, plan, {}, count)


@pytest.mark.slow
def test_the_command_prints_both_intervals_and_the_criterion_and_draws_the_tracks(tmp_path: Path) -> None:
    run, ship = tmp_path / "run", some_ship()
    run.mkdir()
    (run / "ship.toml").write_text(dump_ship(ship, "a run"), encoding="utf-8")
    (run / "result.json").write_text(json.dumps({"kind": "calibration", **content(ship)}), encoding="utf-8")
    options = ("simulate", run, "--maneuver", "zigzag:10/10", "--scatter", 20, "--speed", SPEED)
    rows = {row["figure"]: row for row in shown(*options, "--plot", tmp_path / "tracks.png")["figures"]}
    first = rows["overshoot_1"]
    assert first["limit"] == pytest.approx(math.radians(20.0)) and 0 <= first["probability"] <= 1
    assert first["interval_90_trial"][0] < first["interval_90_trial"][1]
    assert (tmp_path / "tracks.png").stat().st_size > 10_000
    assert main([*map(str, options), "--out", str(tmp_path / "tracks.csv")]) == 0
    assert (tmp_path / "tracks.csv").read_text().startswith("run,t [s],x [m],y [m],psi [rad]")


@pytest.mark.parametrize(("limit", "is_untried"), [(2.0, True), (-0.5, True), (-2.4, False)])
def test_a_stop_is_the_priors_alone_unless_trials_came_near_it(limit: float, is_untried: bool) -> None:
    assert bool(untried("crash-stop", (("n", -4.0, limit),))) == is_untried
