"""What the columns of a file may be instead of what their headers say: readings that compete, and their remedies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cases.evidence.signals import Signals

DEG = math.pi / 180.0
KNOT = 1852.0 / 3600.0

Keys = dict[str, Any]
"""Keys of the sidecar and their values. A unit is given as the factor from what was read to what is true."""


class Frame(NamedTuple):
    """A reading of axes and signs.

    code: of the finding; meaning: in words; guess: velocity north + i east of the track (M,), or of what a mirrored or
    swapped track becomes; psi, r: what their signs become; keys: of the sidecar.
    """

    code: str
    meaning: str
    guess: Callable[[Signals], np.ndarray]
    psi: int
    r: int
    keys: Keys


def _turned(s: Signals) -> np.ndarray:
    return s.w * np.exp(1j * s.psi)


def _backwards(s: Signals) -> np.ndarray:
    return s.w * np.exp(-1j * s.psi)


FRAMES: Mapping[str, Frame] = {
    "body": Frame("", "u, v are body-axes velocities", _turned, 1, 1, {}),
    "earth": Frame(
        "velocity_frame", "u, v are earth-fixed velocities (north, east)", lambda s: s.w, 1, 1,
        {"velocity_frame": "earth"},
    ),
    "earth_swapped": Frame(
        "velocity_frame", "u, v are earth-fixed velocities (east, north)", lambda s: s.w.imag + 1j * s.w.real, 1, 1,
        {"velocity_frame": "earth", "columns": {"u": "v", "v": "u"}},
    ),
    "turned_twice": Frame(
        "velocity_frame", "u, v were body-axes velocities before they were turned by psi",
        lambda s: s.w * np.exp(2j * s.psi), 1, 1, {"velocity_frame": "body"},
    ),
    "v_to_port": Frame(
        "sway_sign", "v is positive to port", lambda s: np.conj(s.w) * np.exp(1j * s.psi), 1, 1, {"sign": {"v": -1}}
    ),
    "y_to_west": Frame(
        "mirrored_frame", "y is positive to port (west)", lambda s: np.conj(_turned(s)), 1, 1, {"sign": {"y": -1}}
    ),
    "mirrored": Frame(
        "mirrored_frame", "psi, v and r are positive to port", lambda s: np.conj(_turned(s)), -1, -1,
        {"sign": {"psi": -1, "v": -1, "r": -1}},
    ),
    "psi_counter_clockwise": Frame(
        "heading_sign", "psi is positive counter-clockwise", _backwards, -1, 1, {"sign": {"psi": -1}}
    ),
    "psi_r_counter_clockwise": Frame(
        "heading_sign", "psi and r are positive counter-clockwise", _backwards, -1, -1, {"sign": {"psi": -1, "r": -1}}
    ),
    "u_astern": Frame(
        "u_sign", "u is positive astern", lambda s: -np.conj(s.w) * np.exp(1j * s.psi), 1, 1, {"sign": {"u": -1}}
    ),
    "positions_swapped": Frame(
        "swapped_positions", "x is east and y is north", lambda s: 1j * np.conj(_turned(s)), 1, 1,
        {"columns": {"x": "y", "y": "x"}},
    ),
    "psi_from_east": Frame(
        "heading_from_east", "psi is counted from east, counter-clockwise", lambda s: 1j * _backwards(s), -1, 1,
        {"heading_from": "east", "sign": {"psi": -1}},
    ),
    "psi_r_from_east": Frame(
        "heading_from_east", "psi is counted from east, counter-clockwise, and r with it", lambda s: 1j * _backwards(s),
        -1, -1, {"heading_from": "east", "sign": {"psi": -1, "r": -1}},
    ),
    "psi_from_east_clockwise": Frame(
        "heading_from_east", "psi is counted from east, clockwise", lambda s: 1j * _turned(s), 1, 1,
        {"heading_from": "east"},
    ),
}  # fmt: skip
"""Name -> reading of axes and signs; the first is that of the headers."""

HEADINGS: Mapping[float, str] = {
    1.0: "",
    DEG: "psi holds degrees but is labelled rad",
    1 / DEG: "psi holds radians but is labelled deg",
}
"""Factor that makes psi true -> what was mistaken."""

SPEEDS: Mapping[float, str] = {
    1.0: "",
    KNOT: "u and v hold knots but are labelled m/s",
    1 / KNOT: "u and v hold m/s but are labelled kn",
    1 / 3.6: "u and v hold km/h but are labelled m/s",
    3.6: "u and v hold m/s but are labelled km/h",
}
"""Factor that makes u and v true -> what was mistaken."""

CLOCKS: Mapping[float, str] = {
    1.0: "",
    1e-3: "t holds milliseconds but is labelled s",
    60.0: "t holds minutes but is labelled s",
}
"""Factor that makes t true -> what was mistaken."""

RATES: Mapping[float, str] = {
    1.0: "",
    -1.0: "r has the opposite sign of the derivative of the heading",
    DEG: "r holds deg/s but is labelled rad/s",
    1 / DEG: "r holds rad/s but is labelled deg/s",
    1 / 60: "r holds deg/min but is labelled deg/s",
    DEG / 60: "r holds deg/min but is labelled rad/s",
    60.0: "r holds deg/s but is labelled deg/min",
}
"""Factor that makes r true -> what was mistaken."""

RUDDERS: Mapping[int, str] = {1: "", -1: "the rudder is positive to port"}
"""Factor that makes the rudder angle true -> what was mistaken."""


@dataclass(frozen=True)
class ColumnReading:
    """One choice for each question: name of the frame, factors of psi, of (u, v), of t, of r and of delta."""

    frame: str = "body"
    heading: float = 1.0
    speed: float = 1.0
    clock: float = 1.0
    rate: float = 1.0
    rudder: int = 1

    @property
    def choices(self) -> tuple[Any, ...]:
        """The choices in a fixed order."""
        return (self.frame, self.heading, self.speed, self.clock, self.rate, self.rudder)

    @property
    def faults(self) -> int:
        """How many choices differ from what the headers say."""
        return self.differs(ColumnReading())

    def differs(self, other: ColumnReading) -> int:
        """In how many choices it differs from another."""
        return sum(a != b for a, b in zip(self.choices, other.choices, strict=True))

    @property
    def turning(self) -> int:
        """Sign that makes r over delta true."""
        return FRAMES[self.frame].r * (-1 if self.rate < 0 else 1) * self.rudder

    @property
    def units(self) -> list[tuple[str, float]]:
        """(column, factor) of the units that differ from what the headers say."""
        factors = {"psi": self.heading, "u": self.speed, "t": self.clock, "r": abs(self.rate)}
        return [pair for pair in factors.items() if pair[1] != 1.0]

    def statements(self) -> list[tuple[str, str]]:
        """(code, what is mistaken) for each choice that differs from what the headers say."""
        frame = FRAMES[self.frame]
        out = [(frame.code, frame.meaning)] if frame.code else []
        words = (HEADINGS[self.heading], SPEEDS[self.speed], CLOCKS[self.clock])
        out += [("unit", text) for text in words if text]
        if RATES[self.rate]:
            out.append(("r_sign" if self.rate == -1 else "unit", RATES[self.rate]))
        return out + ([("rudder_sign", RUDDERS[self.rudder])] if self.rudder == -1 else [])

    def keys(self) -> Keys:
        """Keys of the sidecar that make the columns true."""
        frame = FRAMES[self.frame].keys
        out: Keys = {**frame}
        if self.rate == -1:
            out["sign"] = {**frame.get("sign", {}), "r": -1}
        units = dict(self.units)
        if units:
            out["units"] = {**units, **({"v": units["u"]} if "u" in units else {})}
        if self.rudder == -1:
            out["rudder_positive"] = "port"
        return out


def readings() -> list[ColumnReading]:
    """All readings that compete: frame, unit of the heading, of the speeds and of the clock, two of them at most, each
    with every reading of r and of the rudder."""
    bases = [
        ColumnReading(frame, heading, speed, clock)
        for frame in FRAMES
        for heading in HEADINGS
        for speed in SPEEDS
        for clock in CLOCKS
    ]
    return [
        ColumnReading(b.frame, b.heading, b.speed, b.clock, rate, rudder)
        for b in bases
        if b.faults <= 2
        for rate in RATES
        for rudder in RUDDERS
        if FRAMES[b.frame].r == 1 or rate != -1
    ]
