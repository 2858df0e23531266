"""Trials and true figures of ships that share nothing with the package: the plant of ``benchmarks.file_faults``.

Linear derivatives by Clarke et al. (1983), cross-flow drag by strips, RK45, coloured noise, wind that is logged without
its gusts. The start ship is one made from main particulars (``mmg ships --new``), whose hull has another structure.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.file_faults.plant import Hull, Order, Plant, Weather, circle, run, zigzag
from cases.criteria.imo import assess
from cases.criteria.standard_runs import measured_run
from cases.shipfiles.new_ship import new_ship
from cases.trial import Trial
from mmg.ship import Ship

HULLS = (
    Hull(7.0, 1.27, 0.46, 0.81, 1.2, 5.0, 0.3),
    Hull(161.0, 23.2, 7.5, 0.59, 7.7, 2.0, 0.045),
    Hull(320.0, 58.0, 20.8, 0.81, 7.9, 1.5, 0.04),
)
"""A tanker's model, a cargo ship, a tanker; each ship differs from them by a few per cent."""
TRIALS = (("zigzag", 20.0, 20.0), ("zigzag", -10.0, 10.0), ("turning", 35.0, 0.0), ("turning", -20.0, 0.0))
STANDARD = (
    ("turning", 35.0, 0.0), ("turning", -35.0, 0.0), ("zigzag", 10.0, 10.0), ("zigzag", -10.0, 10.0),
    ("zigzag", 20.0, 20.0), ("zigzag", -20.0, 20.0),
)  # fmt: skip
LEAD, LONG = 8.0, 40.0
"""Approach and length of a run, in ship lengths run at the speed of approach."""


def drawn_hull(seed: int) -> Hull:
    """One of ``HULLS`` with particulars that differ by 5 % and a rudder by 15 %. seed: of the draw."""
    rng, hull = np.random.default_rng([61, seed]), HULLS[seed % len(HULLS)]
    by = np.exp(rng.normal(0.0, [0.05, 0.05, 0.03, 0.15]))
    return replace(
        hull, beam=hull.beam * by[0], draught=hull.draught * by[1], block=min(hull.block * by[2], 0.86),
        rudder_area=hull.rudder_area * by[3],
    )  # fmt: skip


def start_ship(hull: Hull) -> Ship:
    """The ship of these particulars that the package makes. hull: of the plant."""
    p = {"L": hull.length, "B": hull.beam, "d": hull.draught, "C_b": hull.block, "U_0": hull.speed}
    p |= {"A_R": hull.rudder_area * hull.length * hull.draught, "x_G": 0.0, "rho": 1025.0}
    ship = new_ship("foreign", p)
    return replace(ship, particulars={**ship.particulars, "rudder_rate": hull.rudder_rate})


def _moved(plant: Plant, kind: str, rudder: float, heading: float) -> dict[str, np.ndarray]:
    """The true columns of one run, to the north; n is that of the approach."""
    unit = plant.hull.length / plant.hull.speed
    begin = LEAD * unit
    order: Order = circle(rudder, 0.0, begin) if kind == "turning" else zigzag(rudder, 0.0, begin, heading)
    columns = run(plant, order, (LEAD + LONG) * unit, 0.05 * unit, 0.0)
    return columns | {"n": np.full(len(columns["t"]), plant.hull.revolutions)}


def true_figures(hull: Hull) -> dict[tuple[str, str], float]:
    """(run, figure) -> value in L or deg, in calm air. hull: of the plant."""
    plant = Plant(hull, Weather(), np.random.default_rng(0))
    found = {}
    for kind, rudder, heading in STANDARD:
        name = f"{kind}:{rudder:g}" + (f"/{heading:g}" if kind == "zigzag" else "")
        trial = Trial(name.replace("/", "_"), _moved(plant, kind, rudder, heading), kind=kind)
        for row in assess(measured_run(trial, hull.length, kind)):
            if row.value is not None and row.unit in ("L", "deg"):
                found[name, row.figure] = row.value
    return found


def foreign_trials(hull: Hull, seed: int) -> list[Trial]:
    """Noisy runs of ``TRIALS`` in a light wind of which the mean alone is logged. hull: of the plant; seed: of all."""
    made = []
    for number, (kind, rudder, heading) in enumerate(TRIALS):
        rng = np.random.default_rng([62, seed, number])
        weather = Weather(0.4 * hull.speed, float(rng.uniform(-math.pi, math.pi)), 0.3)
        columns = _moved(Plant(hull, weather, rng), kind, rudder, heading)
        unit, count = hull.length / hull.speed, len(columns["t"])
        sizes = {"x": 5e-4 * hull.length, "y": 5e-4 * hull.length, "psi": 2e-3, "u": 4e-3 * hull.speed,
                 "v": 4e-3 * hull.speed, "r": 2e-3 / unit}  # fmt: skip
        keep = math.exp(-0.05 / 0.3)
        for name, size in sizes.items():
            noise, fresh = np.zeros(count), rng.standard_normal(count)
            for k in range(1, count):
                noise[k] = keep * noise[k - 1] + math.sqrt(1 - keep**2) * fresh[k]
            columns[name] = columns[name] + size * noise
        wind = {"wind_speed": np.full(count, weather.wind), "wind_direction": np.full(count, weather.direction)}
        made.append(Trial(f"{kind}_{number}", columns | wind, kind=kind))
    return made
