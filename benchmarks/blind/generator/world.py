"""Worlds: the ship, the noise and the numerics of a benchmark. None of what follows was used to choose a limit.

A world is integrated for a ship of 3 m; ``length`` is that of the ship in the files, by Froude's law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.blind.generator import forces, forces_standard, forces_vectwin
from benchmarks.blind.generator.surroundings import DRAUGHT
from benchmarks.toml import tables

Array = np.ndarray
MODEL = 3.0
"""Length of the ship that is integrated [m]."""

ESSO = (
    "X_0F", "X_0A", "X_vr", "Y_v", "Y_r", "N_v", "N_r", "C_D", "C_rY", "C_rN",
    "k_0", "t_P", "w_P0", "tau",
    "t_R", "a_H", "ell_R", "k_x", "epsilon", "gamma_P", "gamma_N",
)  # fmt: skip
"""Coefficients whose truth differs from the ship file in the first world."""
MODELS: dict[str, ModuleType] = {"forces_standard": forces_standard, "forces_vectwin": forces_vectwin}


@dataclass(frozen=True)
class World:
    """What is the same in all cases of a benchmark, for a ship of 3 m.

    ship: ship file; length: of the ship in the files [m]; forces: its force model; drawn: coefficients whose truth
    differs from the ship file, with a standard deviation of ``spread`` of each; force: standard deviations of the
    random force X, Y [N], N [N m] before a factor of 0.7 to 1.4; memory: range of its correlation time [s]; noise:
    standard deviations of the errors of x, y [m], psi [rad], u, v [m/s], r [rad/s]; colour: range of the memory of the
    errors of u, v and r [s], (0, 0): white; gyro: largest scale error of r; gust: wind that the log does not show, as
    share of the mean; sample: of the records [s]; without: effects that the ship cannot have; resistance: X_0' that
    fouling adds a share of; draught: by which the depth in a site file is told [m]; soft:
    angle over which the flow at two rudders changes sides [rad]; sizes: factors on the sizes of causes without a name,
    which cost more or less here than in the pond; runge_kutta: fourth order with inputs in between, else Heun; step:
    of the integration and of all signals [s], a whole part of the sample; duration: of a run [s]; wide: every case
    draws its own noise, memory, sample, runs and spread (wide.py).
    """

    name: str
    ship: str = "esso_osaka_3m"
    length: float = MODEL
    forces: ModuleType = forces
    drawn: tuple[str, ...] = ESSO
    spread: float = 0.05
    force: tuple[float, float, float] = (0.05, 0.15, 0.10)
    memory: tuple[float, float] = (3.0, 8.0)
    noise: tuple[float, ...] = (0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006)
    colour: tuple[float, float] = (0.0, 0.0)
    gyro: float = 0.0
    gust: float = 0.0
    sample: float = 0.5
    without: tuple[str, ...] = ()
    runge_kutta: bool = False
    sets: Mapping[str, str] = field(default_factory=dict)
    resistance: float = 0.02139
    draught: float = DRAUGHT
    soft: float = 0.0
    sizes: Mapping[str, float] = field(default_factory=dict)
    step: float = 0.05
    duration: float = 150.0
    wide: bool = False

    @property
    def scale(self) -> float:
        """Length of the ship in the files over that of the ship that is integrated."""
        return self.length / MODEL

    @property
    def rows(self) -> int:
        """Points in time of the integration of a run."""
        return round(self.duration / self.step) + 1

    @property
    def every(self) -> int:
        """Steps of the integration between two rows of the records."""
        return round(self.sample / self.step)

    def widened(self) -> World:
        """The same ship and kinds of errors, where every case draws its own conditions."""
        return replace(self, name=f"{self.name}_wide", wide=True)


def _narrow() -> dict[str, World]:
    """The worlds of worlds.toml, by name."""
    found: dict[str, World] = {}
    for name, row in tables(Path(__file__).with_name("worlds.toml")).items():
        start = found[row.pop("like")] if "like" in row else World("")
        row = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
        if "forces" in row:
            row["forces"] = MODELS[row["forces"]]
        found[name] = replace(start, name=name, **row)
    return found


NARROW = _narrow()
"""pond, basin, kvlcc2, vectwin, sea."""
WORLDS = {**NARROW, **{wide.name: wide for wide in map(World.widened, NARROW.values())}}
"""The same and, as NAME_wide, each with conditions that every case draws anew."""

POWERS = {
    "current.x": 0.5, "current.y": 0.5, "wind_sensor_bias.x": 0.5, "wind_sensor_bias.y": 0.5, "wave_drift.x": 3.0,
    "wave_drift.y": 3.0, "tow.X": 3.0, "tow.Y": 3.0, "tow.N": 4.0, "rudder_lag.T": 0.5, "control_delay.tau": 0.5,
    "gnss_delay.tau": 0.5, "hull_memory.T": 0.5, "antenna_offset.x": 1.0, "antenna_offset.y": 1.0,
    "bank.distance": 1.0, "bank.decay": 1.0,
}  # fmt: skip
"""Powers of the scale by which parameters of the key grow; those that are not here are numbers."""
COLUMNS, AIR = (0.5, 1.0, 1.0, 0.0, 0.5, 0.5, -0.5, -0.5, 0.0), (0.5, 0.0)
"""Powers of the scale of t, x, y, psi, u, v, r, n, delta; of wind speed and direction."""


def sensor_errors(world: World, rows: int, runs: int, rng: np.random.Generator) -> Array:
    """Errors (rows, 6, runs) of the logged columns: white, or those of u, v and r half white and half with memory."""
    out = rng.standard_normal((rows, 6, runs))
    if world.colour[1] > 0:
        left = np.exp(-world.sample / rng.uniform(*world.colour, 3))[:, None]
        slow = rng.standard_normal((rows, 3, runs))
        for k in range(1, rows):
            slow[k] = left * slow[k - 1] + np.sqrt(1 - left**2) * slow[k]
        out[:, 3:] = (out[:, 3:] + slow) / np.sqrt(2.0)
    return np.asarray(world.noise)[:, None] * out
