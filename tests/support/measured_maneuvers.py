"""Records of manoeuvres of a ship that is not the package's, as instruments log them."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.file_faults.plant import SETS, Plant, Weather, circle, run, zigzag
from cases.trial import Trial


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
