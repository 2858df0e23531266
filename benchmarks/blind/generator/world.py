"""Worlds: the ship, the noise and the numerics of a benchmark. None of what follows was used to choose a limit.

A world is integrated for a ship of 3 m; ``length`` is that of the ship in the files, by Froude's law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from benchmarks.blind.generator import forces, forces_standard, forces_vectwin
from benchmarks.blind.generator.library import DRAUGHT
from benchmarks.toml import tables

Array = np.ndarray
MODEL = 3.0
"""Length of the ship that is integrated [m]."""

MODELS: dict[str, ModuleType] = {"forces_standard": forces_standard, "forces_vectwin": forces_vectwin}


@dataclass(frozen=True)
class World:
    """What is the same in all cases of a benchmark, for a ship of 3 m.

    ship: ship file; length: of the ship in the files [m]; forces: its force model; drawn: coefficients whose truth
    differs from the ship file, with a standard deviation of ``spread`` of each; force: standard deviations of the
    random force X, Y [N], N [N m] before a factor of 0.7 to 1.4; memory: range of its correlation time [s]; noise:
    standard deviations of the errors of x, y [m], psi [rad], u, v [m/s], r [rad/s]; colour: range of the memory of the
    errors of u, v and r [s], (0, 0): white; low_pass: range of the time constant of a first-order filter of the logged
    u and v [s], (0, 0): none; gyro: largest scale error of r; gust: wind that the log does not show, as share of the
    mean; sample: of the records [s]; without: effects that the ship cannot have; runs: manoeuvre set;
    resistance: X_0' that fouling adds a share of; draught: by which the depth in a site file is told [m]; soft:
    angle over which the flow at two rudders changes sides [rad]; sizes: factors on the sizes of causes without a name,
    which cost more or less here than in the pond; runge_kutta: fourth order with inputs in between, else Heun; step:
    of the integration and of all signals [s], a whole part of the sample; duration: of a run [s]; wide: every case
    draws its own noise, memory, sample, runs and spread (``own_world``).
    """

    name: str
    ship: str = "esso_osaka_3m"
    length: float = MODEL
    forces: ModuleType = forces
    drawn: tuple[str, ...] = ()
    spread: float = 0.05
    force: tuple[float, float, float] = (0.05, 0.15, 0.10)
    memory: tuple[float, float] = (3.0, 8.0)
    noise: tuple[float, ...] = (0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006)
    colour: tuple[float, float] = (0.0, 0.0)
    low_pass: tuple[float, float] = (0.0, 0.0)
    gyro: float = 0.0
    gust: float = 0.0
    sample: float = 0.5
    without: tuple[str, ...] = ()
    runge_kutta: bool = False
    runs: str = "mixed"
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


NARROW = {name: world for name, world in _narrow().items() if not world.low_pass[1]}
"""pond, basin, kvlcc2, vectwin, sea."""
WORLDS = {**NARROW, **{wide.name: wide for wide in map(World.widened, NARROW.values())}} | _narrow()
"""The same and, as NAME_wide, each with conditions that every case draws anew; then those with filtered velocities."""

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
        slow = wander(rows, world.sample, rng.uniform(*world.colour, 3)[:, None], (3, runs), rng)
        out[:, 3:] = (out[:, 3:] + slow) / np.sqrt(2.0)
    return np.asarray(world.noise)[:, None] * out


# The ship file's numbers and the true coefficients of a case

SHIPS = Path(__file__).parents[3] / "cases" / "ships"
LENGTHS = {"L": 1, "B": 1, "d": 1, "x_G": 1, "D_P": 1, "x_R": 1, "A_R": 2, "m": 3}
"""Particulars that the plant uses, and the power of the scale that each goes with."""


def scaled_ship(world: World) -> tuple[dict[str, float], dict[str, float]]:
    """Particulars of the ``world``'s ship at the length that is integrated (SI), and its nominal coefficients."""
    particulars, coefficients = ship_numbers(world.ship)
    ratio = MODEL / particulars["L"]
    if ratio != 1:
        particulars = {k: v * ratio ** LENGTHS.get(k, 0) for k, v in particulars.items()}
    return particulars, coefficients


def ship_numbers(name: str = "esso_osaka_3m") -> tuple[dict[str, float], dict[str, float]]:
    """Particulars (SI) and nominal coefficients of a ship file."""
    data = tables(SHIPS / f"{name}.toml")
    particulars = {key: float(value) for key, value in data["ship"].items() if not isinstance(value, str)}
    return particulars, {name: float(entry["value"]) for name, entry in data["coefficients"].items()}


def true_coefficients(
    nominal: dict[str, float], rng: np.random.Generator, drawn: Sequence[str], spread: float = 0.05
) -> dict[str, float]:
    """Nominal values, those ``drawn`` times N(1, spread) each (cut at three standard deviations)."""
    factors = np.clip(1 + spread * rng.standard_normal(len(drawn)), 1 - 3 * spread, 1 + 3 * spread)
    return {**nominal, **{name: nominal[name] * float(f) for name, f in zip(drawn, factors, strict=True)}}


# Wide worlds: every case draws its own noise, memory, sampling, number of runs and spread of the truth, for the claim
# that false alarms stay rare not only in the conditions by which a limit was chosen

RANGES = {
    "force": (0.1, 10.0),
    "sensors": (0.1, 10.0),
    "memory": (1.0, 20.0),
    "sample": (0.05, 1.0),
    "runs": (2.0, 40.0),
    "spread": (0.02, 0.15),
}
"""What a case draws, each log-uniform: factors of the random force and of the sensors' noise, memory of the random
force and time between rows [s, of the ship in the files], runs (training and held out), spread of the truth."""
APART = 2.0
"""Each sensor's own factor lies within this of the case's, and within the range."""
TOTAL, LONGEST = 2000.0, 150.0
"""Most seconds of all runs together, and of one run; of the ship in the files and of the one that is integrated."""
STEP = 0.05
"""Longest step of the integration [s]; a whole number of them lies between two rows."""
TRAINING = 7 / 12
"""Share of the runs that are for training; one run at least is, and one is held out."""
SENSORS = ((0, 1), (2,), (3, 4), (5,))
"""Columns of x, y; psi; u, v; r: each sensor has its own factor."""


def own_world(world: World, rng: np.random.Generator) -> tuple[World, dict[str, float]]:
    """The world of one case of a wide ``world``, and what was drawn for it (names of ``RANGES``)."""
    drawn = {name: float(np.exp(rng.uniform(*np.log(limits)))) for name, limits in RANGES.items()}
    drawn["runs"] = float(round(drawn["runs"]))
    apart = np.exp(rng.uniform(-np.log(APART), np.log(APART), len(SENSORS)))
    factors = np.clip(drawn["sensors"] * apart, *RANGES["sensors"])
    noise = np.array(world.noise)
    for columns, factor in zip(SENSORS, factors, strict=True):
        noise[list(columns)] *= factor
    clock = np.sqrt(world.scale)
    sample, memory = drawn["sample"] / clock, drawn["memory"] / clock
    step = sample / np.ceil(sample / STEP)
    duration = sample * np.floor(min(LONGEST, TOTAL / clock / drawn["runs"]) / sample)
    times = {"sample": float(sample), "step": float(step), "duration": float(duration), "memory": (memory, memory)}
    force = tuple(drawn["force"] * np.array(world.force))
    return replace(world, spread=drawn["spread"], force=force, noise=tuple(noise), **times), drawn


def own_runs(
    kinds: tuple[Sequence[str], Sequence[str]], drawn: Mapping[str, float], rng: np.random.Generator
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Kinds of the runs for training and held out: as many as were drawn, of the given ones in random order."""
    count = int(drawn["runs"])
    training = min(max(round(TRAINING * count), 1), count - 1)
    dealt = []
    for pool, wanted in zip(kinds, (training, count - training), strict=True):
        order = [k for _ in range(-(-wanted // len(pool))) for k in rng.permutation(pool)]
        dealt.append(tuple(str(k) for k in order[:wanted]))
    return dealt[0], dealt[1]


# Gusty wind and the slow random force that no model explains


def wander(count: int, dt: float, tau: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Ornstein-Uhlenbeck processes of unit variance, (count, *shape); tau [s] broadcasts to ``shape``."""
    left = np.broadcast_to(np.exp(-dt / tau), shape)
    push = np.sqrt(1 - left**2)
    noise = rng.standard_normal((count, *shape))
    out = np.empty_like(noise)
    out[0] = noise[0]
    for k in range(1, count):
        out[k] = left * out[k - 1] + push * noise[k]
    return out


def gusty_wind(world: World, runs: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """True wind speed [m/s] and direction it comes from [rad], (rows, runs): one day, each run with its own mean.

    Mean 0.8 to 2.2 m/s; gusts of 10 to 22 % with 12 s; direction within some 30 degrees of the day's, wandering by 8.
    """
    mean = rng.uniform(0.8, 2.2, runs)
    gusts = rng.uniform(0.10, 0.22, runs) * wander(world.rows, world.step, np.array(12.0), (runs,), rng)
    speed = mean * np.maximum(1 + gusts, 0.1)
    base = rng.uniform(-np.pi, np.pi) + np.radians(30) * rng.standard_normal(runs)
    return speed, base + np.radians(8) * wander(world.rows, world.step, np.array(25.0), (runs,), rng)


def unlogged_gusts(world: World, runs: int, rng: np.random.Generator) -> Array:
    """Factors (rows, runs) of the logged wind speed by gusts of 0.5 to 2 s that the log does not show."""
    if not world.gust:
        return np.ones((world.rows, runs))
    gusts = wander(world.rows, world.step, rng.uniform(0.5, 2.0, runs), (runs,), rng)
    return np.maximum(1 + world.gust * gusts, 0.1)


def random_force(world: World, runs: int, rng: np.random.Generator) -> Array:
    """Unmodelled force (rows, 3, runs) [N, N, N m]."""
    sizes, tau = np.array(world.force) * rng.uniform(0.7, 1.4, 3), float(rng.uniform(*world.memory))
    return sizes[:, None] * wander(world.rows, world.step, np.array(tau), (3, runs), rng)
