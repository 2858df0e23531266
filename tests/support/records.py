"""Records of ships: manoeuvres one after the other, single ones as they were measured, and logs of operation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.file_faults.plant import SETS, Plant, Weather, circle, run, zigzag
from cases.maneuvers.definitions import Maneuver, Orders, parse_maneuver
from cases.quantities import UNITS
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import SensorNoise, add_noise, parse_wind, simulate
from cases.trial import Trial
from mmg.rollout import Simulator


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


# Records of manoeuvres of a ship that is not the package's, as instruments log them
def foreign(name: str, kind: str, side: int, steps: tuple[int, int], rng: np.random.Generator) -> tuple[Trial, float]:
    """A record of the foreign ship ``name``, and her length [m]."""
    some = SETS[name]
    hull, unit = some.hull, some.hull.length / some.hull.speed
    heading, towards = rng.uniform(-math.pi, math.pi, 2)
    drift = some.current * float(rng.uniform(0, 1))
    weather = Weather(0.3 * some.wind, float(rng.uniform(-math.pi, math.pi)), 0.2,
                      (drift * math.cos(towards), drift * math.sin(towards)))  # fmt: skip
    plant, begin = Plant(hull, weather, rng), float(rng.uniform(0.5, 5.0)) * unit
    rudder = side * steps[0]
    order = zigzag(rudder, heading, begin, steps[1]) if kind == "zigzag" else circle(rudder, heading, begin)
    dt = float(rng.choice([0.1, 0.2, 0.5, 1.0])) if hull.length > 20 else float(rng.choice([0.1, 0.2, 0.5]))
    out = run(plant, order, begin + 30 * unit, dt, heading)
    return logged(out | {"n": np.full(len(out["t"]), hull.revolutions)}, hull.length, rng), hull.length


def logged(columns: dict[str, np.ndarray], length: float, rng: np.random.Generator) -> Trial:
    """What instruments log of the true ``columns``: noise, a rudder zero that is off, steps of 0.1 deg, headings in
    (-180, 180]."""
    count, unit = len(columns["t"]), math.sqrt(length / 3.0)
    out = dict(columns)
    sizes = dict.fromkeys("xy", 0.01 * length / 3) | dict.fromkeys("uv", 0.004 * unit)
    sizes |= {"r": 0.0006 / unit, "psi": 0.0015, "delta": math.radians(rng.choice([0.0, 0.1, 0.3]))}
    for name, size in sizes.items():
        out[name] = out[name] + size * rng.standard_normal(count)
    out["delta"] = np.radians(np.round(np.degrees(out["delta"] + math.radians(rng.uniform(-1.5, 1.5))), 1))
    out["psi"] = np.mod(out["psi"] + math.pi, 2 * math.pi) - math.pi
    return Trial("run", out)


# Small logs of operation: a 3 m model that weaves at sea, with what is wanted of gaps, rest and changes
NOISE = {"x": 0.02, "y": 0.02, "psi": 0.002, "u": 0.005, "v": 0.005, "r": 5e-4}


def sailed(hours: float, fouling: float = 0.0, at: float = 0.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Canonical columns at 1 Hz of the ESSO OSAKA model under random rudder orders, in calm air.

    Her resistance is larger by the share ``fouling`` from the hour ``at`` on.
    """
    ship = with_effects(load_ship("esso_osaka_3m"), ["fouling:share=0"])
    rng, count = np.random.default_rng(seed), round(3600 * hours)
    ordered = np.repeat(rng.uniform(-0.35, 0.35, count // 20 + 1) * (rng.random(count // 20 + 1) < 0.5), 20)[:count]
    n = np.repeat(rng.uniform(9.0, 12.0, count // 200 + 1), 200)[:count]
    simulator, parts = Simulator(ship), []
    state = np.array([[0.0], [0.0], [0.3], [0.7], [0.0], [0.0]])
    split = round(3600 * at)
    for rows, share in ((slice(0, split), 0.0), (slice(split, count), fouling)):
        if rows.start == rows.stop:
            continue
        theta = ship.values.copy()
        theta[ship.symbols.index("fouling.share")] = share
        given = {"n": np.repeat(n[rows], 2), "delta": np.repeat(ordered[rows], 2)}
        inputs = np.column_stack([given.get(name, np.zeros(2 * (rows.stop - rows.start))) for name in ship.inputs])
        states = simulator.run(state, inputs, 0.5, theta)[::2, :6, 0]
        parts.append(states[:-1])
        state = states[-1][:, None]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), np.concatenate(parts).T, strict=True))
    columns = {name: values + NOISE[name] * rng.standard_normal(count) for name, values in columns.items()}
    return {"t": np.arange(count, dtype=float), **columns, "n": n, "delta": ordered}


def write_log(folder: Path, columns: Mapping[str, np.ndarray], parts: int) -> list[Path]:
    """Write ``columns`` as so many parts of a log below ``folder``; returns their paths."""
    paths = []
    for k, rows in enumerate(np.array_split(np.arange(len(columns["t"])), parts)):
        path = folder / f"day={k + 1:02d}" / "part-0.parquet"
        path.parent.mkdir(parents=True)
        names = {f"{name} [{UNITS[name]}]": values[rows] for name, values in columns.items()}
        pq.write_table(pa.table(names), path, row_group_size=500)
        paths.append(path)
    return paths
