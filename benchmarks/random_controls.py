"""Random control manoeuvres of Wakita et al. (2025, section 5.1): every actuator is ordered anew at regular intervals.

Rudder orders are normal, thrusters' as well, clipped to their range; the propeller turns at a constant rate. The wind
is gusty, from any direction. The numbers of the paper's text were not legible; those below are for a 3 m model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cases.simulation.gusts import Wind
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate_controls
from cases.trial import Trial
from mmg.ship import Ship

LIMITS = {"delta": (-35.0, 35.0), "delta_port": (-105.0, 35.0), "delta_starboard": (-35.0, 105.0)}
"""Range of each rudder [deg]; VecTwin rudders turn further outwards (Wakita et al. 2025, Table 1)."""


@dataclass(frozen=True)
class RandomControls:
    """How the orders are drawn.

    rudder: standard deviation [deg]; outward: mean of VecTwin rudders [deg]; n: of the propeller [1/s]; bow, bow_limit:
    standard deviation and range of thrusters [1/s]; interval between orders [s]; wind: range of its mean speed [m/s];
    speed: range of the speed at the start [m/s]; seconds, dt: of each run.
    """

    rudder: float = 30.0
    outward: float = 20.0
    n: float = 10.0
    bow: float = 10.0
    bow_limit: float = 20.0
    interval: float = 10.0
    wind: tuple[float, float] = (0.0, 1.5)
    speed: tuple[float, float] = (0.0, 0.5)
    seconds: float = 200.0
    dt: float = 0.5


def random_control_trials(
    ship: Ship, count: int, seed: int, how: RandomControls | None = None, noise: SensorNoise | None = None
) -> list[Trial]:
    """Runs of a ship under random orders in random gusts, with sensor noise; the same for the same seed."""
    how = how or RandomControls()
    trials = []
    for number in range(count):
        rng = np.random.default_rng([13, seed, number])
        t = np.round(how.dt * np.arange(round(how.seconds / how.dt) + 1), 9)
        block = (t / how.interval + 1e-9).astype(int)
        columns = {"t": t, "n": np.full(len(t), how.n)}
        for name in ship.actuators:
            if name.startswith("delta"):
                low, high = LIMITS[name]
                mean = {"delta": 0.0, "delta_port": -how.outward, "delta_starboard": how.outward}[name]
                orders = np.radians(np.clip(rng.normal(mean, how.rudder, block[-1] + 1), low, high))
                columns[name] = orders[block]
            elif name in ("n_bow", "n_stern"):
                columns[name] = np.clip(rng.normal(0, how.bow, block[-1] + 1), -how.bow_limit, how.bow_limit)[block]
        if "delta" not in columns:
            columns["delta"] = 0.5 * (columns["delta_port"] + columns["delta_starboard"])
        begin = {"x": 0.0, "y": 0.0, "psi": rng.uniform(-math.pi, math.pi), "u": rng.uniform(*how.speed)}
        columns |= {name: np.full(len(t), begin.get(name, 0.0)) for name in ("x", "y", "psi", "u", "v", "r")}
        wind = Wind(rng.uniform(*how.wind), rng.uniform(0, 2 * math.pi), gusty=True)
        gusts, own = (int(value) for value in rng.integers(0, 2**31, 2))
        run = simulate_controls(ship, Trial(f"random_{seed}_{number}", columns, kind="random"), wind, gusts)
        trials.append(add_noise(run, noise or SensorNoise.for_length(ship.particulars["L"]), own))
    return trials
