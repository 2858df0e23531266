"""What a ship's instruments log of its motion: measurement effects, white noise."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from cases.controller import MODEL_LENGTH
from cases.trial import STATES, Trial
from mmg.effects import effect
from mmg.flow import Flow
from mmg.frames import body_to_earth, earth_to_body
from mmg.memory import Memory
from mmg.ship import Ship


def logged(ship: Ship, t: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Columns x, y, psi, u, v, r (N, 6) as the ship's measurement effects make them of the true ones (N, 6) at t.

    Delays and lags are exact here, on the samples, where the model of a fit approximates them.
    """
    columns = list(np.asarray(states, dtype=float).T)
    flow = Flow(u=columns[3], v=columns[4], r=columns[5], psi=columns[2])
    p, nothing = ship.namespace, Memory()
    for name in ship.effects:
        if effect(name).enters != "measurement":
            continue
        e = ship.parameters_of(name)
        if name == "gnss_delay":
            columns = _late(t, columns, e.tau)
        elif name == "velocity_lag":
            columns = [*columns[:3], *_late(t, columns, e.tau)[3:5], columns[5]]
        elif name == "gyro":
            columns = [*columns[:5], _behind(t, columns[5], e.T) * (1 + e.share)]
        else:
            columns = effect(name).columns(columns, flow, nothing, e, p)
    return np.column_stack(columns)


def _late(t: np.ndarray, columns: list[np.ndarray], delay: float) -> list[np.ndarray]:
    """Position and earth-fixed velocity of ``delay`` [s] ago; before the first sample the ship ran straight on."""
    if delay == 0:
        return columns
    x, y, psi, u, v, r = columns
    velocity = body_to_earth(u, v, psi)
    past = t - delay
    before = np.minimum(past - t[0], 0.0)
    moved = [np.interp(past, t, place) + before * speed[0] for place, speed in zip((x, y), velocity, strict=True)]
    late = earth_to_body(np.interp(past, t, velocity[0]), np.interp(past, t, velocity[1]), psi)
    return [*moved, psi, *late, r]


def _behind(t: np.ndarray, x: np.ndarray, T: float) -> np.ndarray:
    """x after a first-order lag of T [s], exact for x linear between samples; settled at the start."""
    if T == 0:
        return x
    out = x.astype(float).copy()
    for k, h in enumerate(np.diff(t)):
        left, slope = math.exp(-h / T), (x[k + 1] - x[k]) / h
        out[k + 1] = x[k + 1] - slope * T + (out[k] - x[k] + slope * T) * left
    return out


def wrap(psi: np.ndarray) -> np.ndarray:
    """Angles [rad] in (-pi, pi]; those already there are left to the last digit."""
    inside = (psi > -math.pi) & (psi <= math.pi)
    return np.where(inside, psi, math.pi - np.mod(math.pi - psi, 2 * math.pi))


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise: m, rad, m/s, rad/s; the defaults are those of a 3 m model."""

    x: float = 0.01
    y: float = 0.01
    psi: float = 0.0015
    u: float = 0.004
    v: float = 0.004
    r: float = 0.0006

    @classmethod
    def for_length(cls, length: float) -> SensorNoise:
        """Noise for a length [m]: positions scale with L, velocities with sqrt(L), rates with 1 / sqrt(L)."""
        n, scale = cls(), length / MODEL_LENGTH
        root = math.sqrt(scale)
        return cls(n.x * scale, n.y * scale, n.psi, n.u * root, n.v * root, n.r / root)


def add_noise(trial: Trial, noise: SensorNoise, seed: int = 0) -> Trial:
    """A copy with white noise on the states it has, by ``seed``. Inputs and wind stay as they are."""
    draws = np.random.default_rng([2, seed]).standard_normal((len(STATES), len(trial)))
    noisy = {
        name: trial[name] + sd * draw
        for name, sd, draw in zip(STATES, astuple(noise), draws, strict=True)
        if name in trial
    }
    noisy["psi"] = wrap(noisy["psi"])
    return replace(trial, columns={**trial.columns, **noisy})
