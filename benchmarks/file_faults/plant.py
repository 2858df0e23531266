"""A plant that shares nothing with the package: linear derivatives by regression, cross-flow drag, RK45.

Sway and yaw: Clarke, Gedling and Hine (1983), from length, beam, draught and block coefficient; cross-flow drag by
strips (Faltinsen 1990); rudder: normal force of a wing (Fujii); surge: quadratic resistance that the propeller balances
at the speed of approach. Wind by constant coefficients of the areas, gusts as an Ornstein-Uhlenbeck process.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import RK45
from scipy.signal import lfilter

from benchmarks.toml import tables

RHO, AIR = 1025.0, 1.225
"""Densities of water and air [kg/m^3]."""
DEG = math.pi / 180


@dataclass(frozen=True)
class Hull:
    """Length, beam, draught [m], block coefficient, speed of approach [m/s], revolutions there [1/s], greatest rate of
    the rudder [rad/s], share of rudder area in length times draught."""

    length: float
    beam: float
    draught: float
    block: float
    speed: float
    revolutions: float
    rudder_rate: float
    rudder_area: float = 1 / 55


@dataclass(frozen=True)
class Weather:
    """Mean wind [m/s] and where it comes from [rad], share of gusts, current north and east [m/s]."""

    wind: float = 0.0
    direction: float = 0.0
    gusts: float = 0.2
    current: tuple[float, float] = (0.0, 0.0)


Order = Callable[[float, np.ndarray], float]
"""Time [s] and state (x, y, psi, u, v, r, delta) -> ordered rudder angle [rad]."""


class Plant:
    """A hull in weather; ``rates`` of (x, y, psi, u, v, r, delta), u and v through the water."""

    def __init__(self, hull: Hull, weather: Weather, rng: np.random.Generator) -> None:
        self.hull, self.weather = hull, weather
        L, B, T, cb = hull.length, hull.beam, hull.draught, hull.block
        s, bt, bl = math.pi * (T / L) ** 2, B / T, B / L
        mass = RHO * cb * L * B * T
        q1, q2 = 0.5 * RHO * L**2, 0.5 * RHO * L**3
        self.mass, self.inertia = mass, mass * (0.25 * L) ** 2
        self.y_dv = -s * (1 + 0.16 * cb * bt - 5.1 * bl**2) * q2
        self.y_dr = -s * (0.67 * bl - 0.0033 * bt**2) * q2 * L
        self.n_dv = -s * (1.1 * bl - 0.041 * bt) * q2 * L
        self.n_dr = -s * (1 / 12 + 0.017 * cb * bt - 0.33 * bl) * q2 * L**2
        self.y_v, self.y_r = -s * (1 + 0.4 * cb * bt) * q1, -s * (-0.5 + 2.2 * bl - 0.08 * bt) * q1 * L
        self.n_v, self.n_r = -s * (0.5 + 2.4 * T / L) * q1 * L, -s * (0.25 + 0.039 * bt - 0.56 * bl) * q1 * L**2
        self.strips = np.linspace(-L / 2, L / 2, 21)
        self.drag = 0.5 * RHO * T * 0.7 * L / 21
        self.resistance = 0.5 * RHO * L * T * 0.06
        self.rudder = 0.5 * RHO * hull.rudder_area * L * T * 6.13 * 1.8 / (1.8 + 2.25) * 1.3
        step = max(0.2, L / hull.speed / 10)
        self.gust_step, keep = step, math.exp(-step / (3 * L / hull.speed))
        gusts = np.zeros(4000)
        for k in range(1, len(gusts)):
            gusts[k] = keep * gusts[k - 1] + math.sqrt(1 - keep**2) * rng.standard_normal()
        self.gusts = gusts

    def wind_at(self, t: float) -> float:
        """Speed of the true wind [m/s] at ``t`` [s]."""
        at = min(t / self.gust_step, len(self.gusts) - 2)
        k = int(at)
        gust = self.gusts[k] + (at - k) * (self.gusts[k + 1] - self.gusts[k])
        return max(self.weather.wind * (1 + self.weather.gusts * gust), 0.0)

    def rates(self, t: float, state: np.ndarray, order: float) -> np.ndarray:
        """Rates (7,) of the ``state`` (7,) at ``t`` [s] with an ordered rudder angle [rad]."""
        _, _, psi, u, v, r, delta = state
        hull, L = self.hull, self.hull.length
        speed = math.hypot(u, v)
        across = v + self.strips * r
        local = across * np.abs(across)
        normal = self.rudder * speed**2 * math.sin(delta + 0.6 * math.atan2(v - 0.45 * L * r, max(u, 0.1)))
        x = self.resistance * (hull.speed**2 - u * abs(u)) - normal * math.sin(delta)
        y = (self.y_v * v + self.y_r * r) * speed - self.drag * local.sum() - normal * math.cos(delta)
        n = (self.n_v * v + self.n_r * r) * speed - self.drag * (self.strips * local).sum()
        n += 0.48 * L * normal * math.cos(delta)
        x, y, n = self._blown(t, state, x, y, n)
        du = (x + 1.3 * self.mass * v * r) / (1.06 * self.mass)
        matrix = np.array([[self.mass - self.y_dv, -self.y_dr], [-self.n_dv, self.inertia - self.n_dr]])
        dv, dr = np.linalg.solve(matrix, [y - self.mass * u * r, n])
        north, east = self.weather.current
        moved = (u + 1j * v) * np.exp(1j * psi) + north + 1j * east
        steer = float(np.clip((order - delta) / 0.3, -hull.rudder_rate, hull.rudder_rate))
        return np.array([moved.real, moved.imag, r, du, dv, dr, steer])

    def _blown(self, t: float, state: np.ndarray, x: float, y: float, n: float) -> tuple[float, float, float]:
        if self.weather.wind == 0:
            return x, y, n
        psi, u, v = state[2], state[3], state[4]
        hull = self.hull
        air = -self.wind_at(t) * np.exp(1j * (self.weather.direction - psi)) - (u + 1j * v)
        size = 0.5 * AIR * abs(air)
        side = 0.9 * size * air.imag * hull.length * hull.beam * 0.35
        front = 0.7 * size * air.real * hull.beam**2 * 0.6
        return x + front, y + side, n + 0.08 * hull.length * side


def run(
    plant: Plant, order: Order, seconds: float, dt: float, heading: float, helm: float = 0.05
) -> dict[str, np.ndarray]:
    """True columns every ``dt`` [s] for ``seconds``: t, x, y, psi, u, v (over ground), r, delta; steered by ``order``.

    heading: of approach [rad], which the ship keeps for a tenth of the time; helm: longest time between two looks at
    the compass, in lengths run at the speed of approach.
    """
    begin = np.array([0.0, 0.0, heading, plant.hull.speed, 0.0, 0.0, 0.0])
    now = [0.0]
    step = helm * plant.hull.length / plant.hull.speed
    solver = RK45(lambda t, s: plant.rates(t, s, now[0]), 0.0, begin, seconds, max_step=step, rtol=1e-5)
    clock = np.arange(0.0, seconds, dt)
    states = np.zeros((len(clock), 7))
    while solver.status == "running":
        now[0] = order(solver.t, solver.y)
        before = solver.t
        solver.step()
        rows = np.flatnonzero((clock >= before) & (clock <= solver.t))
        if len(rows):
            states[rows] = solver.dense_output()(clock[rows]).T
    x, y, psi, u, v, r, delta = states.T
    north, east = plant.weather.current
    ground = u + 1j * v + (north + 1j * east) * np.exp(-1j * psi)
    return {"t": clock, "x": x, "y": y, "psi": psi, "u": ground.real, "v": ground.imag, "r": r, "delta": delta}


def zigzag(angle: float, heading: float, begin: float, switch: float | None = None) -> Order:
    """A zigzag of ``angle``/``switch`` [deg], to starboard first where it is positive, around a ``heading`` [rad], from
    ``begin`` [s]; before that the course is kept. switch: default the angle."""
    size, side = math.radians(abs(angle)), [math.copysign(1.0, angle)]
    turn = size if switch is None else math.radians(switch)

    def order(t: float, s: np.ndarray) -> float:
        off = s[2] - heading
        if t < begin:
            return float(np.clip(-1.0 * off - 2.0 * s[5] * begin / 20, -0.1, 0.1))
        if off * side[0] >= turn:
            side[0] = -side[0]
        return side[0] * size

    return order


def circle(angle: float, heading: float, begin: float) -> Order:
    """A turn with ``angle`` [deg] from ``begin`` [s]; before that the ``heading`` [rad] is kept."""
    keep = zigzag(1.0, heading, 1e9)
    return lambda t, s: math.radians(angle) if t >= begin else keep(t, s)


# Eight ships from 3 m to 320 m with their manoeuvres (fleet.toml), and the instruments that log them


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


def _sets() -> Iterator[tuple[str, Set]]:
    for name, row in tables(Path(__file__).with_name("fleet.toml")).items():
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
    keep, white = math.exp(-dt / seconds), rng.standard_normal(count)
    late = lfilter([math.sqrt(1 - keep**2)], [1.0, -keep], white[1:], zi=[keep * white[0]])[0]
    return np.concatenate([white[:1], late])


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
