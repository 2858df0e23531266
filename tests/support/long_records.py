"""A long record of a ship of the library: manoeuvres one after the other, a straight course between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cases.maneuvers.definitions import Maneuver, Orders, parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import parse_wind
from cases.simulation.simulate import SensorNoise, add_noise, simulate
from cases.trial import Trial


@dataclass
class Program:
    """The orders of ``plans`` in turn; before each one the course is kept for ``rest`` [s] at the revolutions n [1/s].

    times: of the first order of each one, once it was given [s].
    """

    plans: Sequence[Maneuver]
    rest: float
    n: float
    course_time: float
    times: list[float] = field(default_factory=list)
    number: int = 0
    since: float = 0.0
    course: float | None = None
    running: Orders | None = None
    ends: float = 0.0

    def __call__(self, t: float, state: np.ndarray) -> tuple[float, float] | None:
        if self.course is None:
            self.course = float(state[2])
        if self.running is None and t - self.since >= self.rest:
            if self.number == len(self.plans):
                return None
            plan = self.plans[self.number]
            lead = plan.parameters.get("order_time", 0.0)
            self.running, self.since, self.number = plan.orders(), t - lead, self.number + 1
            self.ends = t + plan.duration
            self.times.append(t)
        if self.running is not None:
            order = self.running(t - self.since, state)
            if order is not None and t < self.ends:
                return order
            self.running, self.since, self.course = None, t, float(state[2])
        off = float(state[2]) - self.course
        return self.n, float(np.clip(-1.0 * off - self.course_time * float(state[5]), -0.3, 0.3))


def long_record(
    name: str, texts: Sequence[str], dt: float, noise: int | None = None, wind: str | None = None
) -> tuple[Trial, list[float], float]:
    """The record, times of the orders [s], and the length of the ship [m].

    name: of the ship; texts: as for ``parse_maneuver``; dt: sampling interval [s]; noise: seed of the sensors' noise;
    wind: "speed:direction".
    """
    ship = load_ship(name)
    length = ship.particulars["L"]
    plans, usual = [parse_maneuver(text, ship) for text in texts], parse_maneuver("straight", ship)
    unit = length / usual.speed
    program = Program(plans, 20 * unit, usual.n, 2 * unit)
    speed = plans[0].speed if texts[0] == "acceleration" else usual.speed
    whole = replace(usual, speed=speed, orders=lambda: program, duration=2000 * unit, sampled=True)
    trial = simulate(ship, whole, dt, parse_wind(wind) if wind else None)
    trial = replace(trial, name="record", kind="")
    return (trial if noise is None else add_noise(trial, SensorNoise.for_length(length), noise)), program.times, length
