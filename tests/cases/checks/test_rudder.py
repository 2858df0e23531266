"""The turn rate against the low-passed rudder: the response is that of the equation, whatever the steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.checks import check
from cases.checks.single import following
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate
from cases.trial import Trial

T, SHARE = 4.0, 0.12
"""Time constant [s] and gain [1/s] of the ship's response."""

SHIP = load_ship("esso_osaka_3m")


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


def test_one_reversed_rudder_of_seven_files_is_a_doubt_without_a_line() -> None:
    calm = [sailed(f"zigzag:{angle}/{angle}", 0.0, k) for k, angle in enumerate((5, 8, 10, 15, 20, 25))]
    odd = sailed("turning:15", 0.0, 6, -1)
    assert levels([odd, *calm]) == [["doubtful"], *[[]] * 6]
    (text,) = [f.text for f in check([odd, *calm])[0].findings if f.code == "rudder_sign"]
    assert "trials.toml" not in text


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


def turning(t: np.ndarray) -> Trial:
    """A ship at the times ``t`` whose turn rate follows a rudder that is put over every 15 s."""
    delta = 0.3 * np.where(np.floor(t / 15.0) % 2 == 0, 1.0, -1.0)
    r = np.zeros(len(t))
    for k, step in enumerate(np.diff(t)):
        left = np.exp(-step / T)
        r[k + 1] = left * r[k] + (1 - left) * SHARE * delta[k]
    still = np.zeros(len(t))
    columns = {"t": t, "x": 2.0 * t, "y": still, "psi": still, "u": still + 2.0, "v": still, "r": r}
    return Trial("turning", columns | {"n": still + 10.0, "delta": delta})


def clocks() -> dict[str, np.ndarray]:
    """Even, uneven and broken clocks [s]."""
    even = np.round(np.arange(0.0, 300.0, 0.2), 9)
    rng = np.random.default_rng(3)
    uneven = np.cumsum(np.concatenate([[0.0], rng.uniform(0.05, 0.4, 1400)]))
    return {"even": even, "uneven": uneven, "gap": np.concatenate([even[:700], even[700:] + 900.0])}


@pytest.mark.parametrize("name", clocks())
def test_the_correlation_is_that_of_the_recursion(name: str) -> None:
    trial = turning(clocks()[name])
    found = following(trial)
    low, delta = np.zeros(len(trial)), trial["delta"]
    low[0] = delta[0]
    for k, step in enumerate(np.diff(trial.t)):
        left = np.exp(-step / found["time_constant_s"])
        low[k + 1] = left * low[k] + (1 - left) * delta[k + 1]
    expected = np.corrcoef(low, trial["r"])[0, 1]  # without means: a wind turns her too
    assert found["samples"] == len(trial)
    assert found["correlation"] == pytest.approx(expected, rel=1e-10)
    assert found["correlation"] > 0.95 and T / 3 < found["time_constant_s"] < 3 * T
