"""What a ship's instruments log of its motion: measurement effects, white noise."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from cases.trial import Trial
from mmg.effects import effect
from mmg.motion.flow import Flow
from mmg.motion.froude import state_scale
from mmg.ship import Ship
from mmg.states import STATES


def logged(ship: Ship, t: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Columns x, y, psi, u, v, r (N, 6) as the ship's measurement effects make them of the true ones (N, 6) at t.

    Delays and lags are exact here, on the samples, where the model of a fit approximates them.
    states (N, 6), t (N,) [s].
    """
    columns = list(np.asarray(states, dtype=float).T)
    flow = Flow(u=columns[3], v=columns[4], r=columns[5], psi=columns[2])
    for name in ship.effects:
        e = effect(name)
        if e.measures:
            columns = e.samples(t, columns, flow, ship.parameters_of(name), ship.namespace)
    return np.column_stack(columns)


def wrap(psi: np.ndarray) -> np.ndarray:
    """Angles [rad] in (-pi, pi]; those already there are left to the last digit. psi (N,) [rad]."""
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
        return cls(*(np.array(astuple(cls())) * state_scale(length)).tolist())


def add_noise(trial: Trial, noise: SensorNoise, seed: int = 0) -> Trial:
    """A copy of ``trial`` with white noise on the states it has, by ``seed``. Inputs and wind stay as they are."""
    draws = np.random.default_rng([2, seed]).standard_normal((len(STATES), len(trial)))
    noisy = {
        name: trial[name] + sd * draw
        for name, sd, draw in zip(STATES, astuple(noise), draws, strict=True)
        if name in trial
    }
    noisy["psi"] = wrap(noisy["psi"])
    return replace(trial, columns={**trial.columns, **noisy})
