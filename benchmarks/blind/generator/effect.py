"""What a hidden effect is to the generator: a draw of its numbers, and hooks through which it enters the plant.

In every hook ``e`` holds the effect's inside numbers by attribute, one entry per run; at the values of ``neutral`` a
hook returns what it was given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.blind.generator.forces import Force, Moment

Array = np.ndarray
Parts = dict[str, Force]
LEVELS = ("weak", "medium", "strong")


@dataclass
class Drawn:
    """One draw of an effect.

    key: parameters for the key, in the library's names and units as near as they map; inside: the effect's own numbers
    by name, a float or one per run; site: tables of a site file, with roughly known values; bank: (bearing [rad],
    distance [m]) when the runs must be laid out beside a bank.
    """

    key: dict[str, float]
    inside: dict[str, Any]
    site: dict[str, dict[str, Any]] = field(default_factory=dict)
    bank: tuple[float, float] | None = None


@dataclass
class History:
    """Runs as they were, time first (K, B): states x, y, psi, u, v, r over ground (K, 6, B), and the step [s]."""

    states: Array
    dt: float


class Effect:
    """An effect that enters nowhere: base of all others."""

    name = ""
    levels: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Nominal size at weak, medium and strong, in the effect's unit."""
    neutral: dict[str, float] = {}  # noqa: RUF012
    states = 0
    """Number of states that the effect adds to the plant; they start at zero."""

    def size(self, strength: str, rng: np.random.Generator) -> float:
        """The nominal size of the strength, within 25 %."""
        return self.levels[LEVELS.index(strength)] * float(1 + rng.uniform(-0.25, 0.25))

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        """Numbers of one case with this many runs."""
        raise NotImplementedError

    def particulars(self, p: dict[str, Any], e: SimpleNamespace) -> None:
        """Changes the particulars in place."""

    def water(self, m: Moment, e: SimpleNamespace) -> tuple[Any, Any, Any, Any] | None:
        """Velocity of the water over ground, north and east [m/s], and its rate of change at the ship [m/s^2]."""
        return None

    def air(self, north: Array, east: Array, t: Array, e: SimpleNamespace) -> tuple[Any, Any]:
        """Velocity of the air over ground [m/s] from the logged one."""
        return north, east

    def actuators(
        self, n: Array, delta: Array, k: int, dt: float, e: SimpleNamespace, memory: dict[str, Array]
    ) -> tuple[Array, Array]:
        """Real n and delta at row k (B,) from those given (K, B), of which rows up to k are known.

        Called for k = 0, 1, 2, ... of a run with steps of dt [s]; ``memory`` is kept from call to call.
        """
        return n[k], delta[k]

    def inflow(self, m: Moment, e: SimpleNamespace) -> None:
        """Changes the moment in place before the forces are evaluated."""

    def forces(self, parts: Parts, m: Moment, e: SimpleNamespace, z: Array, p: dict[str, Any]) -> Any:
        """Changes or adds parts in place; returns the rates of the effect's own states z, if it has any."""
        return None

    def inertia(self, mass: dict[str, Any], m: Moment, e: SimpleNamespace, p: dict[str, Any]) -> None:
        """Changes m, m_x, m_y, I_z (about midship, with added inertia) in place."""

    def columns(self, y: Array, history: History, rows: Array, e: SimpleNamespace) -> Array:
        """Logged columns (R, 6, B) from those of an earlier effect, at these rows of the history (R,)."""
        return y


class OneNumber(Effect):
    """An effect with one number, and a few of its shape that are drawn uniformly and that no key holds."""

    number = "size"
    two_sided = False
    shape: dict[str, tuple[float, float]] = {}  # noqa: RUF012
    per_run: dict[str, tuple[float, float]] = {}  # noqa: RUF012
    """Numbers of the shape that differ from run to run."""

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        size = (sign(rng) if self.two_sided else 1.0) * self.size(strength, rng)
        inside = {self.number: size, **{k: float(rng.uniform(*limits)) for k, limits in self.shape.items()}}
        return Drawn({self.number: size}, inside)


def effect(
    hook: str, levels: tuple[float, ...], base: type[OneNumber] = OneNumber, **fields: Any
) -> Callable[[Callable[..., Any]], OneNumber]:
    """Makes of a function the effect of its name whose ``hook`` it is; fields: those of the ``base`` and of Effect,
    others being limits of the shape."""

    def made(function: Callable[..., Any]) -> OneNumber:
        own = {name: fields.pop(name) for name in ("number", "two_sided", "states", "per_run") if name in fields}
        own |= {"name": function.__name__, "levels": levels, "shape": fields, hook: staticmethod(function)}
        kind = type(function.__name__, (base,), own | {"__doc__": function.__doc__})
        middles = {k: 0.5 * (a + b) for k, (a, b) in (kind.shape | kind.per_run).items()}
        kind.neutral = {kind.number: 0.0, **middles}
        return kind()

    return made


def scaled(force: Force, X: Any, Y: Any, N: Any) -> Force:
    """A force with factors on its components."""
    return force[0] * X, force[1] * Y, force[2] * N


def sign(rng: np.random.Generator) -> float:
    """+1 or -1."""
    return float(rng.choice((-1.0, 1.0)))


def vector(size: float, rng: np.random.Generator) -> tuple[float, float]:
    """A vector of this size in a random direction."""
    angle = rng.uniform(-np.pi, np.pi)
    return size * float(np.cos(angle)), size * float(np.sin(angle))
