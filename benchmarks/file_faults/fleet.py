"""Eight ships from 3 m to 320 m with their manoeuvres, and the instruments that log them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.file_faults.plant import Hull, Plant, Weather, circle, run, zigzag
from benchmarks.toml import tables


@dataclass(frozen=True)
class Set:
    """A hull, its manoeuvres (zigzag 20, turn 35), sampling interval [s], mean wind [m/s], steps of what is logged:
    positions [m], velocities [m/s], heading [rad], turn rate [rad/s]; standard deviation of positions [m]."""

    hull: Hull
    maneuvers: tuple[str, ...]
    dt: float
    wind: float
    grain: Sequence[float]
    wander: float
    current: float = 0.0


DEG = math.pi / 180


def _sets() -> Iterator[tuple[str, Set]]:
    for name, row in tables(Path(__file__).with_suffix(".toml")).items():
        yield name, Set(**{**row, "hull": Hull(*row["hull"]), "maneuvers": tuple(row["maneuvers"])})


SETS = dict(_sets())


def drawn(name: str, seed: int) -> list[dict[str, np.ndarray]]:
    """What the instruments of the set ``name`` log, file by file; headings, weather and noise by ``seed``."""
    some = SETS[name]
    rng = np.random.default_rng([seed, sorted(SETS).index(name)])
    side = rng.choice([-1.0, 1.0])
    return [_logged(some, _maneuver(some, words, side, rng), rng) for words in some.maneuvers]


def _maneuver(some: Set, words: str, side: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    kind, angle = words.split()
    hull, unit = some.hull, some.hull.length / some.hull.speed
    heading = float(rng.uniform(-math.pi, math.pi))
    towards = rng.uniform(-math.pi, math.pi)
    current = (some.current * math.cos(towards), some.current * math.sin(towards))
    weather = Weather(some.wind, float(rng.uniform(-math.pi, math.pi)), 0.2, current)
    plant = Plant(hull, weather, rng)
    begin, seconds = 4 * unit, (34 if kind == "zigzag" else 26) * unit
    order = (zigzag if kind == "zigzag" else circle)(side * float(angle), heading, begin)
    out = run(plant, order, seconds, some.dt, heading)
    share = np.where(out["t"] < 2 * unit, 1.0, 1.0 + 0.01 * np.sin(out["t"] / unit))
    out["n"] = hull.revolutions * share
    if some.wind:
        out["wind_speed"] = np.array([plant.wind_at(t) for t in out["t"]])
        out["wind_direction"] = np.full(len(out["t"]), weather.direction % (2 * math.pi))
    return out


def _coloured(count: int, dt: float, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Noise (count,) of standard deviation one that forgets itself within so many seconds."""
    keep = math.exp(-dt / seconds)
    out, white = np.empty(count), rng.standard_normal(count)
    out[0] = white[0]
    for k in range(1, count):
        out[k] = keep * out[k - 1] + math.sqrt(1 - keep**2) * white[k]
    return out


def _logged(some: Set, true: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The ``true`` columns with coloured and white noise, a compass slightly off, a gyro scale, and steps."""
    place, speed, heading, rate = some.grain
    count, dt, size = len(true["t"]), some.dt, some.hull.speed
    out = dict(true)
    for name in ("x", "y"):
        slow = some.wander * _coloured(count, dt, 60.0, rng)
        out[name] = true[name] + slow + 0.2 * some.wander * rng.standard_normal(count) * min(1.0, dt)
    for name in ("u", "v"):
        out[name] = true[name] + 0.005 * size * _coloured(count, dt, 3.0, rng)
    out["u"] = out["u"] * rng.uniform(0.985, 1.015)
    out["psi"] = true["psi"] + rng.uniform(-1.0, 1.0) * DEG + 0.1 * DEG * _coloured(count, dt, 2.0, rng)
    turn = float(np.sqrt(np.mean(true["r"] ** 2)))
    out["r"] = true["r"] * rng.uniform(0.99, 1.01) + 0.04 * turn * _coloured(count, dt, 0.5, rng)
    out["n"] = out["n"] * (1 + 0.002 * rng.standard_normal(count))
    steps = {"x": place, "y": place, "u": speed, "v": speed, "psi": heading, "r": rate, "delta": 0.1 * DEG, "n": 0.001}
    return {name: _stepped(out[name], steps.get(name, 1e-4)) for name in out}


def _stepped(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step
