"""Finding the execute: measured FRT-DS-ESSO runs read by eye, and noisy synthetic ones whose orders are known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import savgol_filter

from cases.criteria.figures import parabolic
from cases.criteria.measured_maneuvers import find_maneuvers
from cases.criteria.standard_runs import figures_of, measured_runs
from cases.io.read import read_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.errors import Missing, UnknownName

SHIP = load_ship("esso_osaka_3m")

TURNS = {
    "turn_14-Oct-2020_14_08_51": (200, 35),
    "turn_14-Oct-2020_14_39_54": (110, 20),
    "turn_14-Oct-2020_15_21_57": (110, -35),
    "turn_14-Sep-2020_13_39_32": (120, 35),
    "turn_14-Sep-2020_14_50_41": (160, 35),
    "turn_14-Sep-2020_15_47_33": (142, -35),
    "turn_cut_14-Sep-2020_16_09_02": (111, -20),
}
"""File -> time of the order [s] and rudder [deg], read off the plotted records."""

ZIGZAGS = {
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
@pytest.mark.parametrize("name", TURNS)
def test_turning_runs_are_cut_where_the_rudder_goes_over(name: str, frt: Path) -> None:
    trial = read_trial(frt / "turning" / f"{name}.csv")
    time, degrees = TURNS[name]
    execute = find_maneuvers(trial, 3.0)[0]
    assert execute.kind == "turning" and execute.reversals == ()
    assert execute.order_time == pytest.approx(time, abs=1.0)
    assert math.degrees(execute.rudder) == pytest.approx(degrees, abs=1.0)
    t = trial.t - trial.t[0]
    before, after = (float(np.interp(execute.order_time + s, t, trial["delta"])) for s in (-0.2, 0.5))
    assert abs(before) < 0.8 * abs(execute.rudder) and after == pytest.approx(execute.rudder, abs=0.02)
    assert 0.2 < execute.speed < 0.45


@pytest.mark.data
@pytest.mark.parametrize("name", ZIGZAGS)
def test_zigzag_runs_are_cut_at_every_reversal(name: str, frt: Path) -> None:
    time, degrees, reversals = ZIGZAGS[name]
    execute = find_maneuvers(read_trial(frt / "zigzag" / f"{name}.csv"), 3.0)[0]
    assert execute.kind == "zigzag"
    assert execute.order_time == pytest.approx(time, abs=1.0)
    assert math.degrees(execute.rudder) == pytest.approx(degrees, abs=1.0)
    np.testing.assert_allclose(execute.reversals, reversals, atol=1.0)
    assert math.degrees(execute.heading) == pytest.approx(abs(degrees), abs=4.0)


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
@pytest.mark.parametrize("rudder_rate", [None, math.radians(5.0)])
def test_noisy_runs_after_a_wandering_approach_give_the_figures_of_the_clean_ones(
    text: str, rudder_rate: float | None
) -> None:
    maneuver = parse_maneuver(text, SHIP, rudder_rate=rudder_rate)
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
    with pytest.raises(Missing):
        find_maneuvers(straight, 3.0, "crash-stop")[0]
    turn = simulate(SHIP, parse_maneuver("turning:35", SHIP, duration=100))
    with pytest.raises(Missing):
        find_maneuvers(turn, 3.0, "zigzag")[0]


@pytest.mark.parametrize("count", [9, 10, 40])
def test_a_heading_is_smoothed_by_parabolas(count: int) -> None:
    values = np.random.default_rng(count).standard_normal(count)
    np.testing.assert_allclose(parabolic(values, 9), savgol_filter(values, 9, 2), atol=1e-12)
