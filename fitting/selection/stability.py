"""Whether a model stays that of a ship under random harbour use of all its actuators (Miyauchi et al. 2023, req. 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cases.simulation.harbour_inputs import harbour_inputs
from mmg.components.expansion.series import speed_scale
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

SEQUENCES, SECONDS = 1000, 400.0
"""Number of sequences and their length [s of a 3 m model]."""
MOST = 4.0
"""Largest speed, and yaw rate times L/2, by 0.1 sqrt(g L), that is still a ship in a harbour (Froude number 0.4)."""


@dataclass(frozen=True)
class Stability:
    """Of ``sequences`` simulated from rest, how many ``diverged``; the largest speed [m/s] and yaw rate [rad/s] of the
    others."""

    sequences: int
    diverged: int
    speed: float
    yaw_rate: float


@np.errstate(all="ignore")
def stability(ship: Ship, sequences: int = SEQUENCES, seed: int = 0, compiled: bool = True) -> Stability:
    """The stability of ``ship`` in so many ``sequences`` of random inputs in calm air; seed: of the first of them.

    compiled: use a C compiler if there is one.
    """
    L = ship.particulars["L"]
    simulator, dt = Simulator(ship, compiled), 1.0 * time_scale(L)
    names = simulator.model.controls
    runs = [harbour_inputs(ship, SECONDS * time_scale(L), seed + k, dt) for k in range(sequences)]
    t = runs[0]["t"]
    zero = np.zeros(len(t))
    columns = [[t if name == "time" else run.columns.get(name, zero) for name in names] for run in runs]
    controls = np.repeat(np.array(columns).transpose(2, 1, 0)[:-1], 2, axis=0)
    states = simulator.run(np.zeros((6, sequences)), controls, 0.5 * dt, ship.values)
    speed = np.hypot(states[:, 3], states[:, 4]).max(axis=0)
    spin = np.abs(states[:, 5]).max(axis=0)
    good = np.isfinite(states).all(axis=(0, 1)) & (np.maximum(speed, 0.5 * L * spin) < MOST * speed_scale(L))
    largest = [float(x[good].max()) if good.any() else float("nan") for x in (speed, spin)]
    return Stability(sequences, int((~good).sum()), *largest)
