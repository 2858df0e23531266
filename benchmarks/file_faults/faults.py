"""Faults of logged files: what makes each, the codes that name it, and which files of a folder have it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Columns, Rng = Mapping[str, np.ndarray], np.random.Generator
Change = Callable[[Columns, float, float, np.random.Generator], dict[str, np.ndarray]]
"""Columns, length [m] and speed [m/s] of the ship, generator -> the columns that change."""

KNOT, DEG = 3600 / 1852, 180 / math.pi


@dataclass(frozen=True)
class Fault:
    """What it does to the columns of a file; codes that name it; whether only one file of the folder has it; units that
    are written into the headers."""

    change: Change
    codes: tuple[str, ...]
    one: bool = False
    labels: Mapping[str, str] = field(default_factory=dict)


def of(change: Callable[..., dict[str, np.ndarray]]) -> Callable[..., Change]:
    """What makes a change of the numbers that ``change`` takes after those of every change."""
    return lambda *given, **more: lambda *columns: change(*columns, *given, **more)


@of
def scaled(c: Columns, length: float, speed: float, rng: Rng, **by: float) -> dict[str, np.ndarray]:
    return {name: c[name] * factor for name, factor in by.items()}


@of
def earth(c: Columns, length: float, speed: float, rng: Rng, swap: bool) -> dict[str, np.ndarray]:
    w = (c["u"] + 1j * c["v"]) * np.exp(1j * c["psi"])
    return {"u": w.imag, "v": w.real} if swap else {"u": w.real, "v": w.imag}


def swapped(c: Columns, *_: object) -> dict[str, np.ndarray]:
    return {"x": c["y"], "y": c["x"]}


@of
def late(c: Columns, length: float, speed: float, rng: Rng, *names: str) -> dict[str, np.ndarray]:
    """The columns ``names`` late by 40 % of the ship's time length over speed, at least 2 s."""
    back = max(2.0, 0.4 * (length / speed)) * rng.uniform(0.8, 1.25)
    return {name: np.interp(c["t"] - back, c["t"], c[name]) for name in names}


@of
def lever(c: Columns, length: float, speed: float, rng: Rng, ahead: float, across: float) -> dict[str, np.ndarray]:
    """An antenna so many lengths forward of midship and to starboard."""
    arm = (ahead * rng.uniform(0.8, 1.2) + 1j * across) * length
    place = c["x"] + 1j * c["y"] + arm * np.exp(1j * c["psi"])
    return {"x": place.real, "y": place.imag}


@of
def lost(c: Columns, length: float, speed: float, rng: Rng, number: float, *names: str) -> dict[str, np.ndarray]:
    """The same ``number`` in the columns ``names`` in bursts, 3 % of the rows."""
    count = len(c["t"])
    rows = np.zeros(count, bool)
    for first in rng.integers(0, count - 8, max(3, count // 150)):
        rows[first : first + rng.integers(1, 8)] = True
    return {name: np.where(rows, number, c[name]) for name in names}


@of
def stuck(c: Columns, length: float, speed: float, rng: Rng, part: float, *names: str) -> dict[str, np.ndarray]:
    """The columns ``names`` keep one value over a ``part`` of the file, from its first third on, or all of it."""
    count = len(c["t"])
    first = 0 if part == 1 else count // 3
    out = {name: c[name].copy() for name in names}
    for values in out.values():
        values[first : first + round(part * count)] = values[first]
    return out


@of
def both(c: Columns, length: float, speed: float, rng: Rng, first: Change, then: Change) -> dict[str, np.ndarray]:
    once = first(c, length, speed, rng)
    return {**once, **then({**c, **once}, length, speed, rng)}


FAULTS: dict[str, Fault] = {
    "velocities earth-fixed": Fault(earth(False), ("velocity_frame",)),
    "velocities earth-fixed, east first": Fault(earth(True), ("velocity_frame",)),
    "v positive to port": Fault(scaled(v=-1), ("sway_sign", "v_sign")),
    "r positive to port": Fault(scaled(r=-1), ("r_sign",)),
    "psi counter-clockwise": Fault(scaled(psi=-1), ("heading_sign",)),
    "psi and r counter-clockwise": Fault(scaled(psi=-1, r=-1), ("heading_sign",)),
    "y positive to west": Fault(scaled(y=-1), ("mirrored_frame",)),
    "psi, v, r mirrored": Fault(scaled(psi=-1, v=-1, r=-1), ("mirrored_frame",)),
    "rudder positive to port": Fault(scaled(delta=-1), ("rudder_sign",)),
    "u positive astern": Fault(scaled(u=-1), ("u_sign",)),
    "x and y swapped": Fault(swapped, ("swapped_positions",)),
    "heading from east, counter-clockwise": Fault(
        lambda c, *_: {"psi": math.pi / 2 - c["psi"], "r": -c["r"]}, ("heading_from_east",)
    ),
    "heading from east, clockwise": Fault(lambda c, *_: {"psi": c["psi"] - math.pi / 2}, ("heading_from_east",)),
    "milliseconds as s": Fault(scaled(t=1000.0), ("unit",)),
    "knots as m/s": Fault(scaled(u=KNOT, v=KNOT), ("unit",)),
    "m/s as knots": Fault(scaled(), ("unit",), labels={"u": "kn", "v": "kn"}),
    "psi in deg as rad": Fault(lambda c, *_: {"psi": np.mod(c["psi"] * DEG, 360.0)}, ("unit",)),
    "r in deg/s as rad/s": Fault(scaled(r=DEG), ("unit",)),
    "r in deg/min as deg/s": Fault(scaled(r=60.0 * DEG), ("unit",), labels={"r": "deg/s"}),
    "delta in deg as rad": Fault(scaled(delta=DEG), ("unit",)),
    "rpm as rps": Fault(scaled(n=60.0), ("unit",)),
    "rps as rpm": Fault(scaled(), ("unit",), labels={"n": "rpm"}),
    "delta in rad as deg": Fault(scaled(), ("unit",), labels={"delta": "deg"}),
    "r frozen": Fault(stuck(1, "r"), ("frozen_channel",)),
    "psi frozen": Fault(stuck(1, "psi"), ("frozen_channel",)),
    "u, v frozen for half the file": Fault(stuck(0.5, "u", "v"), ("frozen_channel", "broken_stretch")),
    "-999 in u, v, r": Fault(lost(-999.0, "u", "v", "r"), ("sentinel",)),
    "9999 in x, y": Fault(lost(9999.0, "x", "y"), ("sentinel",)),
    "u, v late": Fault(late("u", "v"), ("lag",)),
    "r late": Fault(late("r"), ("lag",)),
    "positions late": Fault(late("x", "y"), ("lag",)),
    "antenna 0.35 L forward": Fault(lever(0.35, 0.0), ("lever_arm",)),
    "antenna 0.35 L aft, 0.1 L to port": Fault(lever(-0.35, -0.1), ("lever_arm",)),
    "one file: earth-fixed": Fault(earth(False), ("velocity_frame",), True),
    "one file: rudder to port": Fault(scaled(delta=-1), ("rudder_sign",), True),
    "one file: knots as m/s": Fault(scaled(u=KNOT, v=KNOT), ("unit",), True),
    "earth-fixed and rudder to port": Fault(both(earth(False), scaled(delta=-1)), ("velocity_frame", "rudder_sign")),
    "earth-fixed knots": Fault(both(earth(False), scaled(u=KNOT, v=KNOT)), ("velocity_frame", "unit")),
}  # fmt: skip
"""Name -> fault."""
