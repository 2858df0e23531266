"""A zigzag is named by the heading at which the rudder was ordered over, not by that at which it began to move."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest

from cases.criteria.imo import assess
from cases.criteria.measured_maneuvers import find_maneuvers
from cases.criteria.rudder_steps import nominal, ordered_heading
from cases.criteria.standard_runs import measured_runs
from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.orders import Zigzag
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate
from cases.trial import Trial


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


@pytest.mark.parametrize("seed", [None, 1])
@pytest.mark.parametrize("steps", ["10/10", "20/10", "-15/5", "30/5", "20/20"])
@pytest.mark.parametrize(
    ("name", "reaction", "dt"), [("esso_osaka_3m", 0.8, 0.1), ("kvlcc2_full", 4.0, 1.0), ("mariner", 2.0, 0.5)]
)
def test_a_late_helm_does_not_make_another_zigzag(
    name: str, reaction: float, dt: float, steps: str, seed: int | None
) -> None:
    run, length = late_run(name, steps, reaction, dt, seed)
    rudder, heading = steps.split("/")
    execute = find_maneuvers(run, length)[0]
    assert execute.title == f"zigzag {rudder}/{heading}"
    assert math.degrees(execute.heading) > float(heading) + 0.3  # the heading itself is told as it was


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


def test_a_rudder_is_named_by_a_usual_angle_or_in_whole_degrees() -> None:
    assert [nominal(math.radians(degrees)) for degrees in (3.0, 7.9, 12.2, 33.1, 10.5)] == [3, 8, 12, 35, 10]


@pytest.mark.parametrize(("scatter", "named"), [(0.2, 12.0), (1.5, 10.0)])
def test_a_heading_is_named_by_what_its_own_scatter_allows(scatter: float, named: float) -> None:
    """Eight reversals at 11.6 deg without delay, of which each is off by ``scatter`` [deg] to this side or that."""
    sides = (-1.0) ** np.arange(8)
    off = scatter * np.array([1, 1, -1, -1, 1, 1, -1, -1])
    headings = np.radians(sides * (11.6 + off)) * np.ones((2, 1))
    assert ordered_heading(headings, np.array([-0.1, 0.1]), sides, np.full(8, 1e-3), 20.0) == named


def test_a_zigzag_of_the_standard_that_was_reversed_too_late_says_so() -> None:
    run, length = late_run("mariner", "10/10", 3.5, 0.5)
    measured = measured_runs(run, length)[0]
    assert measured.steps == (10, 10) and math.degrees(measured.heading) > 12
    whys = {row.why for row in assess(measured) if row.figure.startswith("overshoot")}
    assert all("2 deg" in why for why in whys)
