"""Trials and true figures of ships that share nothing with the package: the plant of ``benchmarks.file_faults``.

Linear derivatives by Clarke et al. (1983), cross-flow drag by strips, RK45, coloured noise, wind that is logged without
its gusts. Resistance by the ITTC-1957 line, a propeller with straight lines of thrust in each quadrant, and an engine
that is reversed by a rule of its own. The start ship is one made from main particulars (``mmg ships --new``), whose
hull has another structure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.file_faults.plant import RHO, Hull, Order, Plant, Weather, circle, run, zigzag
from cases.criteria.imo import assess
from cases.criteria.standard_runs import measured_run
from cases.inputs import SAMPLED
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


@dataclass(frozen=True)
class Machinery:
    """Of one ship: diameter [m], ratio of pitch, wake, thrust deduction ahead and astern, and how she is reversed.

    delay, slowing, rise [s]: until the fuel is cut, of the propeller to the speed at which the ship turns it, of the
    revolutions astern by those of the approach; restart, astern: revolutions at which the engine can be reversed, and
    those reached astern, by those of the approach.
    """

    diameter: float
    pitch: float
    wake: float
    deduction: float
    deduction_astern: float
    delay: float
    slowing: float
    restart: float
    rise: float
    astern: float


def machinery_of(hull: Hull, seed: int) -> Machinery:
    """A propeller and an engine for a ``hull``: an electric motor for a model. seed: of the draws."""
    rng = np.random.default_rng([63, seed])
    diameter = hull.draught * rng.uniform(0.45, 0.65)
    common = diameter, rng.uniform(0.65, 0.85), rng.uniform(0.2, 0.4), rng.uniform(0.15, 0.25), rng.uniform(0.1, 0.3)
    if hull.length < 50:
        time = math.sqrt(hull.length / 3.0)
        return Machinery(*common, 0.0, time, 1.0, 2 * time, 1.0)
    return Machinery(*common, rng.uniform(5, 20), rng.uniform(15, 40), rng.uniform(0.2, 0.4), rng.uniform(40, 90),
                     rng.uniform(0.55, 0.75))  # fmt: skip


class DrivenPlant(Plant):
    """The plant with ``machinery`` and the resistance of a ship.

    n: her revolutions [1/s], at first those of the ``approach``, at which she keeps the speed of it.
    """

    def __init__(self, hull: Hull, weather: Weather, rng: np.random.Generator, machinery: Machinery) -> None:
        super().__init__(hull, weather, rng)
        self.machinery = machinery
        L, T = hull.length, hull.draught
        friction = 0.075 / (math.log10(hull.speed * L / 1.19e-6) - 2) ** 2
        wetted = L * (1.7 * T + hull.block * hull.beam)  # Denny-Mumford
        self.drag_ahead = 0.5 * RHO * wetted * (1.2 * friction + (4e-4 if L > 50 else 0.0) + 5e-4)
        low, high = 0.05, 200.0
        for _ in range(80):
            self.n = self.approach = 0.5 * (low + high)
            short = self.thrust(self.n, hull.speed) < self.drag_ahead * hull.speed**2
            low, high = (self.n, high) if short else (low, self.n)

    def thrust(self, n: float, u: float) -> float:
        """Thrust on the hull [N] at n [1/s] and u [m/s]: a straight line ahead, without the water's help astern."""
        m = self.machinery
        flow, size = u * (1 - m.wake), RHO * m.diameter**4
        if n >= 0:
            open_water = size * 0.5 * m.pitch * (n * n - n * flow / ((m.pitch + 0.08) * m.diameter))
            dragged = -0.25 * RHO * math.pi / 4 * m.diameter**2 * flow * abs(flow) * max(0.0, 1 - n / self.approach)
            return (1 - m.deduction) * open_water + dragged
        return -(1 - m.deduction_astern) * size * 0.36 * m.pitch * n * n

    def rates(self, t: float, state: np.ndarray, order: float) -> np.ndarray:
        """As of the plant, with thrust and resistance of its own. t, state, order: as there."""
        rates = super().rates(t, state, order)
        u = state[3]
        constant = self.resistance * (self.hull.speed**2 - u * abs(u))
        rates[3] += (self.thrust(self.n, u) - self.drag_ahead * u * abs(u) - constant) / (1.06 * self.mass)
        return rates


def start_ship(hull: Hull, machinery: Machinery | None = None) -> Ship:
    """The ship of these particulars that the package makes. hull, machinery: of the plant, None: not known."""
    p = {"L": hull.length, "B": hull.beam, "d": hull.draught, "C_b": hull.block, "U_0": hull.speed}
    p |= {"A_R": hull.rudder_area * hull.length * hull.draught, "x_G": 0.0, "rho": 1025.0}
    if machinery is not None:
        p |= {"D_P": machinery.diameter, "pitch_ratio": machinery.pitch}
    ship = new_ship("foreign", p)
    return replace(ship, particulars={**ship.particulars, "rudder_rate": hull.rudder_rate})


def stop(plant: DrivenPlant) -> tuple[float, float]:
    """Track reach and head reach [L] of a crash stop in calm water. plant: in the approach."""
    hull, m = plant.hull, plant.machinery
    approach, unit = plant.approach, hull.length / hull.speed
    share, t, fired, h = 1.0, 0.0, False, 0.02 * unit
    state = np.array([0.0, 0.0, 0.0, hull.speed, 0.0, 0.0, 0.0])
    way = 0.0
    while state[3] > 0 and t < 400 * unit:
        u = state[3]
        if t >= m.delay and not fired:
            turned = 0.6 * u / hull.speed if hull.length > 50 else 0.0
            share += h * (turned - share) / m.slowing
            fired = share <= m.restart
        elif fired:
            share = max(share - h / m.rise, -m.astern)
        plant.n = share * approach
        middle = state + 0.5 * h * plant.rates(t, state, 0.0)
        rates = plant.rates(t + 0.5 * h, middle, 0.0)
        state, t = state + h * rates, t + h
        way += h * math.hypot(middle[3], middle[4])
    plant.n = approach
    return way / hull.length, float(state[0]) / hull.length


def _moved(plant: DrivenPlant, kind: str, rudder: float, heading: float, helm: float = 0.05) -> dict[str, np.ndarray]:
    """The true columns of one run, to the north; n is that of the approach. helm: as of ``run``."""
    unit = plant.hull.length / plant.hull.speed
    begin = LEAD * unit
    order: Order = circle(rudder, 0.0, begin) if kind == "turning" else zigzag(rudder, 0.0, begin, heading)
    columns = run(plant, order, (LEAD + LONG) * unit, 0.05 * unit, 0.0, helm)
    return columns | {"n": np.full(len(columns["t"]), plant.n)}


def true_figures(hull: Hull, machinery: Machinery) -> dict[tuple[str, str], float]:
    """(run, figure) -> value in L or deg, in calm air. hull, machinery: of the plant."""
    plant = DrivenPlant(hull, Weather(), np.random.default_rng(0), machinery)
    found = {}
    for kind, rudder, heading in STANDARD:
        name = f"{kind}:{rudder:g}" + (f"/{heading:g}" if kind == "zigzag" else "")
        trial = Trial(name.replace("/", "_"), _moved(plant, kind, rudder, heading, 0.01), kind=kind)
        for row in assess(measured_run(trial, hull.length, kind)):
            if row.value is not None and row.unit in ("L", "deg"):
                found[name, row.figure] = row.value
    found["crash-stop", "track_reach"], found["crash-stop", "head_reach"] = stop(plant)
    return found


def foreign_trials(
    hull: Hull,
    machinery: Machinery,
    seed: int,
    runs: Sequence[tuple[str, float, float]] = TRIALS,
    first: int = 0,
) -> list[Trial]:
    """Noisy ``runs`` (kind, rudder, heading) [deg] in a light wind of which the mean alone is logged. hull, machinery:
    of the plant; seed: of all; first: number of the first run, of whose wind and noise it decides. The rudder is logged
    as it is at each sample."""
    made = []
    for number, (kind, rudder, heading) in enumerate(runs, first):
        rng = np.random.default_rng([62, seed, number])
        weather = Weather(0.4 * hull.speed, float(rng.uniform(-math.pi, math.pi)), 0.3)
        columns = _moved(DrivenPlant(hull, weather, rng, machinery), kind, rudder, heading)
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
        made.append(Trial(f"{kind}_{number}", columns | wind, kind=kind, meta={"inputs": SAMPLED}))
    return made
