"""The trials that may be proposed, and in words what motion and orders a trial has that others have not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cases.maneuvers.definitions import parse_maneuver
from cases.maneuvers.self_propulsion import own_speed
from cases.simulation.gusts import Wind
from fitting.identifiability.verdicts import listed
from fitting.nlp.windows import Segments
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

WIND_SPEED, WIND_FROM = 1.5, 60.0
"""True wind [m/s of a 3 m model, Froude scaled] and the direction it comes from [deg]."""

MANEUVERS = (
    "turning:35", "turning:-35", "turning:15", "zigzag:10/10", "zigzag:20/20", "zigzag:35/20", "spiral:15/5",
    "pull-out:20", "crash-stop", "acceleration", "random:1", "berthing",
)  # fmt: skip
IN_WIND = ("straight", "turning:35", "zigzag:20/20", "random:1", "berthing")


@dataclass(frozen=True)
class Option:
    """One possible trial: its name in words, the manoeuvre as ``mmg simulate`` takes it, its approach and wind.

    speed [m/s], n [1/s]: None for the defaults.
    """

    name: str
    maneuver: str
    speed: float | None = None
    n: float | None = None
    wind: Wind | None = None

    @property
    def arguments(self) -> str:
        """What follows ``mmg simulate SHIP`` to see it."""
        words = [self.maneuver]
        words += [f"--speed {self.speed:.3g}"] if self.speed is not None else []
        words += [f"--n {self.n:.3g}"] if self.n is not None else []
        words += [f"--wind {self.wind.speed:.3g}:{math.degrees(self.wind.direction):.0f}"] if self.wind else []
        return " ".join(words)


def library(ship: Ship, wind: bool = True) -> tuple[Option, ...]:
    """The trials to choose from, simple ones first: manoeuvres at full and half speed, some astern, some in wind.

    wind: whether there may be wind where trials are run: not in a towing tank, whose records have no wind. In wind only
    where the ship has wind forces, astern only where her propeller can be reversed.
    """
    full = own_speed(ship)
    options = [Option(name, name) for name in MANEUVERS]
    options += [Option(f"{name} at half speed", name, speed=full / 2) for name in MANEUVERS if name != "acceleration"]
    if "n" in ship.actuators and "pitch" not in ship.actuators:
        n = parse_maneuver("straight", ship).n
        going_astern = ("straight", "turning:35", "turning:-35")
        options += [Option(f"{name} astern", name, -full / 2, -0.8 * n) for name in going_astern]
    if wind and ship.feels_wind:
        speed = WIND_SPEED * time_scale(ship.particulars["L"])
        air = Wind(speed, math.radians(WIND_FROM))
        options += [Option(f"{name} in wind", name, wind=air) for name in IN_WIND]
    return tuple(options)


FEATURES = {
    "astern revolutions": lambda z, c, L: any((a < -0.05 * np.abs(a).max()).mean() > 0.02 for k, a in c.items()
                                              if k in ("n", "n_2", "pitch")),
    "sternway": lambda z, c, L: bool(np.mean(z[:, 3] < -0.01 * reference_speed(L)) > 0.02),
    "rudder movement": lambda z, c, L: any(np.ptp(a) > math.radians(3) for k, a in c.items() if k.startswith("delta")),
    "turning": lambda z, c, L: bool(np.percentile(np.abs(z[:, 5]), 95) * L > 0.1 * np.hypot(z[:, 3], z[:, 4]).mean()),
    "wind": lambda z, c, L: any(np.abs(c[k]).max() > 0 for k in ("wind_north", "wind_east") if k in c),
    "changes of revolutions": lambda z, c, L: any(np.ptp(a) > 0.1 * np.abs(a).max() for k, a in c.items()
                                                  if k in ("n", "n_2", "pitch")),
}  # fmt: skip
"""What may be missing in trials: name -> test of (node states, inputs by name, length)."""


def features(segments: Segments, ship: Ship) -> frozenset[str]:
    """Names of ``FEATURES`` that trials of a ship, cut into segments, have."""
    controls = dict(zip(ship.inputs, segments.node_controls, strict=False))
    length = ship.particulars["L"]
    return frozenset(name for name, test in FEATURES.items() if test(segments.nodes, controls, length))


def missing(excitation: np.ndarray, own: Sequence[frozenset[str]], had: frozenset[str]) -> str:
    """What the simplest of the trials that excite a coefficient has and others had not, in words.

    excitation: information on the coefficient in each of K trials (K,); own: their features; had: of the others.
    """
    lacks = sorted((s - had for s, e in zip(own, excitation, strict=True) if e > 0.2 * excitation.max()), key=len)
    return listed([name for name in FEATURES if lacks and name in lacks[0]], " or ")
