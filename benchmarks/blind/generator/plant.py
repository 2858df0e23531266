"""The true plant: equations of motion of a batch of runs, with the hidden effects, and its integration.

(m + m_x) u' - (m + m_y) v r - x_G m r^2 = X, (m + m_y) v' + (m + m_x) u r + x_G m r' = Y,
I_z r' + x_G m (v' + u r) = N about midship (Yasukawa & Yoshimura 2015, Eq. 4), in velocities through the water; the
state holds x, y, psi and velocities over ground, then the states of the effects. Heun steps on a fixed grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.blind.generator import forces as own
from benchmarks.blind.generator.effect import Drawn, Effect, Parts
from benchmarks.blind.generator.forces import Array, Moment
from benchmarks.blind.generator.world import WORLDS, World

Active = tuple[Effect, SimpleNamespace]


@dataclass
class Signals:
    """What acts on the runs, on the grid of the plant: real n, delta, wind over ground, unmodelled force, and for twin
    rudders the port one and the bow thruster; (K, B)."""

    n: Array
    delta: Array
    north: Array
    east: Array
    force: Array  # (K, 3, B)
    port: Array
    bow: Array

    def inputs(self, k: int) -> tuple[Array, ...]:
        """Row k of all but the force."""
        return self.n[k], self.delta[k], self.north[k], self.east[k], self.port[k], self.bow[k]


@dataclass
class Plant:
    """Truth of a batch of B runs: particulars, coefficients (numbers or (B,)), wind series, effects with numbers, the
    step of the integration and of all signals [s]; low_pass: time constant of the filter of the logged u and v (B,)
    [s], None: they are logged as they are."""

    p: dict[str, Any]
    c: dict[str, Any]
    series: dict[str, float]
    effects: list[Active]
    runs: int
    own: ModuleType = own
    runge_kutta: bool = False
    dt: float = 0.05
    low_pass: Array | None = None

    @property
    def twin(self) -> bool:
        """Whether there are two rudders and a bow thruster."""
        return hasattr(self.own, "thruster")

    @property
    def states(self) -> int:
        """States of the effects."""
        return sum(effect.states for effect, _ in self.effects)


def plant_of(
    p: dict[str, float],
    coefficients: Sequence[dict[str, float]],
    drawn: Sequence[list[tuple[Effect, Drawn]]],
    runs: int,
    world: World = WORLDS["pond"],
    low_pass: Array | None = None,
) -> Plant:
    """The plant of several cases of ``runs`` runs each, side by side; an effect is neutral where it was not drawn;
    low_pass: as of ``Plant``."""
    c = {name: np.repeat([one[name] for one in coefficients], runs) for name in coefficients[0]}
    total = runs * len(coefficients)
    found: dict[str, Active] = {}
    for case, effects in enumerate(drawn):
        for effect, draw in effects:
            if effect.name not in found:
                start = {key: np.full(total, float(value)) for key, value in effect.neutral.items()}
                found[effect.name] = (effect, SimpleNamespace(**start))
            for key, value in draw.inside.items():
                getattr(found[effect.name][1], key)[case * runs : (case + 1) * runs] = value
    active = [found[name] for name in sorted(found)]
    numbers = {**p, "resistance": world.resistance, "soft": world.soft}
    series = world.forces.wind_series(p)
    return Plant(numbers, c, series, active, total, world.forces, world.runge_kutta, world.step, low_pass)


def parts_of(plant: Plant, state: Array, inputs: Sequence[Array], t: Array) -> tuple[Parts, Moment, dict, Array, tuple]:
    """Forces by part, the moment, the particulars, the rates of the effects' states, and (u_c, v_c, rates)."""
    p = dict(plant.p)
    for effect, e in plant.effects:
        effect.particulars(p, e)
    x, y, psi, u, v, r = state[:6]
    n, delta, north, east, *more = inputs
    for effect, e in plant.effects:
        north, east = effect.air(north, east, t, e)
    cosine, sine = np.cos(psi), np.sin(psi)
    m = Moment(x, y, psi, u, v, r, n, delta, north * cosine + east * sine - u, east * cosine - north * sine - v, t)
    m.port, m.bow = more or (delta, 0.0 * delta)
    water = np.zeros((4, plant.runs))
    for effect, e in plant.effects:
        found = effect.water(m, e)
        if found is not None:
            water = water + np.stack(np.broadcast_arrays(*found))
    u_c, a_u = (water[i] * cosine + water[i + 1] * sine for i in (0, 2))
    v_c, a_v = (water[i + 1] * cosine - water[i] * sine for i in (0, 2))
    m.u, m.v = u - u_c, v - v_c
    for effect, e in plant.effects:
        effect.inflow(m, e)
    model = plant.own
    parts: Parts = {"hull": model.hull(m, p, plant.c), "wind": model.wind(m, p, plant.series)}
    one_minus_w = model.wake(m, p, plant.c)
    m.u_P = m.u * one_minus_w
    parts["propeller"], loading = model.propeller(m, one_minus_w, p, plant.c)
    parts["rudder"], m.alpha = model.rudder(m, model.rudder_inflow(m, one_minus_w, loading, p, plant.c), p, plant.c)
    if plant.twin:
        parts["thruster"] = model.thruster(m, p, plant.c)
    rates, at = np.zeros((plant.states, plant.runs)), 0
    for effect, e in plant.effects:
        z = state[6 + at : 6 + at + effect.states]
        found = effect.forces(parts, m, e, z, p)
        if effect.states:
            rates[at : at + effect.states] = found
        at += effect.states
    return parts, m, p, rates, (u_c, v_c, a_u, a_v)


def rates(plant: Plant, state: Array, inputs: Sequence[Array], extra: Array, t: Array) -> Array:
    """d state / dt (6 + S, B); inputs n, delta, wind north and east, perhaps port rudder and bow
    thruster, (B,) each, extra force (3, B), time (B,) [s]."""
    parts, m, p, memory, (u_c, v_c, a_u, a_v) = parts_of(plant, state, inputs, t)
    X, Y, N = (sum(part[i] for part in parts.values()) + extra[i] for i in range(3))
    unit = 0.5 * p["rho"] * p["L"] ** 2 * p["d"]
    mass = {
        "m": p["m"],
        "m_x": plant.c["m_x"] * unit,
        "m_y": plant.c["m_y"] * unit,
        "I_z": plant.c["I_J_z"] * unit * p["L"] ** 2 + p["x_G"] ** 2 * p["m"],
    }
    for effect, e in plant.effects:
        effect.inertia(mass, m, e, p)
    lever, surge, sway = p["x_G"] * mass["m"], mass["m"] + mass["m_x"], mass["m"] + mass["m_y"]
    du = (X + sway * m.v * m.r + lever * m.r**2) / surge
    f_Y, f_N = Y - surge * m.u * m.r, N - lever * m.u * m.r
    determinant = sway * mass["I_z"] - lever**2
    dv = (f_Y * mass["I_z"] - lever * f_N) / determinant
    dr = (f_N * sway - lever * f_Y) / determinant
    u, v, r, psi = state[3], state[4], state[5], state[2]
    cosine, sine = np.cos(psi), np.sin(psi)
    over_ground = (du + r * v_c + a_u, dv - r * u_c + a_v)
    return np.vstack([u * cosine - v * sine, u * sine + v * cosine, r, *over_ground, dr, memory])


def step(plant: Plant, state: Array, signals: Signals, k: int, t: Array) -> Array:
    """The state one step after row k of the signals, by Heun or Runge and Kutta; t: time of row k (B,) [s]."""
    now, then = signals.inputs(k), signals.inputs(k + 1)
    dt = plant.dt
    first = rates(plant, state, now, signals.force[k], t)
    if plant.runge_kutta:
        half = tuple(0.5 * (a + b) for a, b in zip(now, then, strict=True))
        push, mid = 0.5 * (signals.force[k] + signals.force[k + 1]), t + 0.5 * dt
        two = rates(plant, state + 0.5 * dt * first, half, push, mid)
        three = rates(plant, state + 0.5 * dt * two, half, push, mid)
        four = rates(plant, state + dt * three, then, signals.force[k + 1], t + dt)
        return state + dt / 6 * (first + 2 * two + 2 * three + four)
    second = rates(plant, state + dt * first, then, signals.force[k + 1], t + dt)
    return state + 0.5 * dt * (first + second)
