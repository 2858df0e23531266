"""Units of FMI variables: their exponents in SI, and the units in which they are shown to people."""

from __future__ import annotations

import math
import re

BASES = {"kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "rad": {"rad": 1}, "N": {"kg": 1, "m": 1, "s": -2}}
"""Exponents of the units that a ship file may name, alone or as products."""
SHOWN = {
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("deg/s", 180 / math.pi),
    "m/s": ("kn", 3600 / 1852),
    "1/s": ("rpm", 60.0),
}
"""Unit -> unit for people, and its value for one of the unit."""
_PLAIN = str.maketrans({"²": "2", "³": "3", "^": "", "·": "."})


def plain_unit(unit: str) -> str:
    """Name of the ``unit`` of a ship file in FMI: "rps" becomes "1/s", "m²" "m2"; "" stays."""
    return "1/s" if unit == "rps" else unit.translate(_PLAIN)


def exponents(unit: str) -> dict[str, int] | None:
    """Exponents of a plain ``unit`` in kg, m, s and rad, zeros left out; None for one that is not made of BASES."""
    powers: dict[str, int] = {}
    for place, part in enumerate(unit.split("/")):
        for word in re.split(r"[. ]+", part):
            match = re.fullmatch(r"([A-Za-z]+)(-?\d*)", word)
            if word == "1":
                continue
            if match is None or match[1] not in BASES:
                return None
            power = int(match[2] or 1) * (1 if place == 0 else -1)
            for base, n in BASES[match[1]].items():
                powers[base] = powers.get(base, 0) + n * power
    return {base: n for base, n in powers.items() if n}
