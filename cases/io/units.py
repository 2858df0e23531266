"""Units that trial files may use (docs/reference/trials.md), and their conversion to SI and radians.

A few spellings ("degrees", "knots", "1/s") are read as the unit they plainly mean.
"""

from __future__ import annotations

import math
import re

from cases.trial import UNITS
from mmg.errors import UnknownName

KNOT = 1852.0 / 3600.0
"""Metres per second in one knot (exact, BIPM)."""

FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "m": {"m": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180.0},
    "m/s": {"m/s": 1.0, "kn": KNOT, "km/h": 1.0 / 3.6},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180.0, "deg/min": math.pi / 10800.0},
    "rps": {"rps": 1.0, "rpm": 1.0 / 60.0},
}
"""Unit in a Trial -> accepted unit -> factor: value in the file times factor = value in the Trial."""

SPELLINGS = {
    "sec": "s", "seconds": "s", "msec": "ms", "milliseconds": "ms", "minutes": "min",
    "metre": "m", "meter": "m", "metres": "m", "meters": "m",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg",
    "mps": "m/s", "ms-1": "m/s", "m s-1": "m/s", "m s^-1": "m/s",
    "kt": "kn", "kts": "kn", "knot": "kn", "knots": "kn",
    "degree/s": "deg/s", "degrees/s": "deg/s", "°/s": "deg/s", "dps": "deg/s",
    "°/min": "deg/min", "kmh": "km/h", "km/hr": "km/h",
    "1/s": "rps", "rev/s": "rps", "hz": "rps", "rev/min": "rpm", "1/min": "rpm",
}  # fmt: skip
"""Other spellings, in lower case -> the unit as it is named here."""


def si_unit(column: str) -> str:
    """The unit that a canonical ``column`` has in a Trial ("rad" for "psi"; "rps" for "n_3").

    Raises KeyError when it is not canonical.
    """
    return "rps" if re.fullmatch(r"n_[2-9]", column) else UNITS[column]


def is_canonical(column: str) -> bool:
    """Whether ``column`` is a canonical name, "n_2" to "n_9" included."""
    return column in UNITS or re.fullmatch(r"n_[2-9]", column) is not None


def accepted(column: str) -> tuple[str, ...]:
    """The units a trial file may use for a canonical ``column``, that of a Trial first."""
    return tuple(FACTORS[si_unit(column)])


def to_si(column: str, unit: str, where: str) -> float:
    """Factor that turns values of a canonical ``column`` from ``unit`` into that of a Trial.

    ``where`` is how the error names the place, such as ``run.csv: column 'psi [grad]'``.
    Raises UserError, naming place, unit and the accepted ones, when the unit does not belong there.
    """
    key = unit.strip()
    key = SPELLINGS.get(key.lower(), key)
    factors = FACTORS[si_unit(column)]
    match = {name.lower(): name for name in factors}.get(key.lower())
    if match is None:
        raise UnknownName(
            f"{where}: unknown unit '{' '.join(unit.split())}' for {column}; accepted: {', '.join(factors)}"
        )
    return factors[match]


def as_number(text: str) -> float:
    """The number that ``text`` is, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def unit_by_factor(column: str, factor: float) -> str:
    """The unit that values of a canonical ``column`` have when they become those of a Trial by this ``factor``; "" when
    no accepted unit does."""
    return next((u for u, f in FACTORS[si_unit(column)].items() if math.isclose(f, factor, rel_tol=0.01)), "")
