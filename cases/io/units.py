"""Units that trial files and raw logs may use (docs/reference/trials.md), and their conversion to SI and radians.

A few spellings ("degrees", "knots", "1/s") are read as the unit they plainly mean.
"""

from __future__ import annotations

import math

from cases.quantities import quantity
from mmg.errors import UnknownName

KNOT = 1852.0 / 3600.0
"""Metres per second in one knot (exact, BIPM)."""

DEG = math.pi / 180.0
"""Radians in a degree."""

FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "nm": 1852.0},
    "rad": {"rad": 1.0, "deg": DEG, "mrad": 0.001},
    "m/s": {"m/s": 1.0, "kn": KNOT, "km/h": 1.0 / 3.6, "cm/s": 0.01, "mm/s": 0.001, "ft/s": 0.3048},
    "rad/s": {"rad/s": 1.0, "deg/s": DEG, "deg/min": DEG / 60.0, "rad/min": 1.0 / 60.0, "mrad/s": 0.001},
    "rps": {"rps": 1.0, "rpm": 1.0 / 60.0, "rad/s": 0.5 / math.pi},
    "deg": {"deg": 1.0, "rad": 1.0 / DEG, "1e-7 deg": 1e-7, "ddmm": 1.0},
}
"""Unit in a Trial, or of a latitude -> accepted unit -> factor: value in the file times factor = value in a Trial.
"ddmm" is degrees and minutes in one number, which the reader parts before."""

SPELLINGS = {
    "sec": "s", "seconds": "s", "msec": "ms", "milliseconds": "ms", "minutes": "min", "µs": "us",
    "metre": "m", "meter": "m", "metres": "m", "meters": "m", "meter/s": "m/s", "m/sec": "m/s",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg", "deg.": "deg", "degt": "deg",
    "°t": "deg", "deg_t": "deg", "mps": "m/s", "ms-1": "m/s", "m s-1": "m/s", "m s^-1": "m/s",
    "kt": "kn", "kts": "kn", "knot": "kn", "knots": "kn",
    "kmh": "km/h", "km/hr": "km/h", "km/t": "km/h", "kmph": "km/h",
    "degree/s": "deg/s", "degrees/s": "deg/s", "°/s": "deg/s", "dps": "deg/s", "degs": "deg/s", "rads": "rad/s",
    "°/min": "deg/min", "degrees/min": "deg/min", "deg/minute": "deg/min", "dpm": "deg/min",
    "1/s": "rps", "rev/s": "rps", "hz": "rps", "s-1": "rps", "r/s": "rps", "rev/min": "rpm", "1/min": "rpm",
    "upm": "rpm", "u/min": "rpm", "r/min": "rpm", "min-1": "rpm", "min^-1": "rpm",
}  # fmt: skip
"""Other spellings, in lower case -> the unit as it is named here."""


def factor_of(own: str, unit: str) -> float | None:
    """Factor from a ``unit`` as somebody writes it to the unit ``own``, None for one that does not belong to it."""
    key = unit.strip().lower()
    return FACTORS.get(own, {}).get(SPELLINGS.get(key, key))


def accepted(column: str) -> tuple[str, ...]:
    """The units a trial file may use for a canonical ``column``, that of a Trial first."""
    return tuple(FACTORS[quantity(column).unit])


def to_si(column: str, unit: str, where: str) -> float:
    """Factor that turns values of a canonical ``column`` from ``unit`` into that of a Trial.

    ``where`` is how the error names the place, such as ``run.csv: column 'psi [grad]'``.
    Raises UserError, naming place, unit and the accepted ones, when the unit does not belong there.
    """
    factor = factor_of(quantity(column).unit, unit)
    if factor is None:
        known = ", ".join(accepted(column))
        raise UnknownName(f"{where}: unknown unit '{' '.join(unit.split())}' for {column}; accepted: {known}")
    return factor


def as_number(text: str) -> float:
    """The number that ``text`` is, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def unit_by_factor(column: str, factor: float) -> str:
    """The unit that values of a canonical ``column`` have when they become those of a Trial by this ``factor``; "" when
    no accepted unit does."""
    return next((u for u, f in FACTORS[quantity(column).unit].items() if math.isclose(f, factor, rel_tol=0.01)), "")
