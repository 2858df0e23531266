"""Headers of ship logs and the quantities they mean, and the units that raw logs use."""

from __future__ import annotations

import re
from dataclasses import dataclass

from cases.io.headers import FRT_NAMES
from cases.io.units import FACTORS, SPELLINGS, factor_of
from cases.quantities import QUANTITIES, is_canonical, quantity

_ENDINGS = "deg degrees rad kn kt kts knots mps m_s ms kmh deg_s degs dps deg_min rad_s rads rpm rps m s sec us ns"
ENDINGS = {word: SPELLINGS.get(word, word.replace("_", "/")) for word in _ENDINGS.split()} | {"ms": "m/s"}
"""Last words of a header that are a unit."""

BEYOND_A_TURN = 6.6
"""No direction in radians is larger."""

SIDES = dict.fromkeys(("port", "ps"), "port") | dict.fromkeys(("stbd", "starboard", "sb", "stb"), "starboard")
UNSURE = {
    r"wind_?(speed|velocity)|ws": "wind_speed or apparent_wind_speed",
    r"wind_?(direction|dir|angle)|wd": "wind_direction or apparent_wind_direction",
    r"speed|velocity|v_ship|ship_speed": "sog (over ground) or nothing (through the water)",
    r"rpm_e": "n or n_2 (of an engine without a gear) or nothing (ahead of a gear)",
    r"hdg_magnetic": "psi (magnetic, where the variation is zero) or nothing",
}
"""Headers that may mean one of several quantities."""
NOT_USED = r".*(order|command|cmd|setpoint|demand|ordered|desired).*|stw|.*through_water|log_speed|water_speed"
"""Headers of orders and of speeds through the water: no states and no actual inputs."""


@dataclass(frozen=True)
class Meaning:
    """What a header means: the quantity, or "" with what it ``may_be``, and the unit that its words name, or ""."""

    quantity: str
    unit: str = ""
    may_be: str = ""


def plain_words(header: str) -> str:
    """The words of a ``header`` in lower case with "_" between them."""
    return re.sub(r"[^a-z0-9]+", "_", header.lower()).strip("_")


def meaning(header: str) -> Meaning:
    """What the words of a ``header`` mean."""
    header = FRT_NAMES.get(header, header)
    if is_canonical(header) or header in QUANTITIES:
        return Meaning(header)
    words, unit = _without_unit(plain_words(header))
    side = ""
    for word in words.split("_"):
        if word in SIDES and words != word:
            side = SIDES[word]
            words = "_".join(w for w in words.split("_") if w != word)
    if re.fullmatch(NOT_USED, words):
        return Meaning("", unit)
    for name, known in QUANTITIES.items():
        if known.headers and re.fullmatch(known.headers, words):
            if words.endswith(("rpm", "rps")):
                unit = unit or words[-3:]
            unit = "" if name == "t" else unit  # the clock knows more of them
            return Meaning(_of_side(name, side), unit)
    may_be = next((what for pattern, what in UNSURE.items() if re.fullmatch(pattern, words)), "")
    return Meaning("", unit, may_be)


def _without_unit(words: str) -> tuple[str, str]:
    """Words without a unit at their end, and the unit."""
    for ending in sorted(ENDINGS, key=len, reverse=True):
        if words.endswith(f"_{ending}") and len(words) > len(ending) + 1:
            kept = words[: -len(ending) - 1]
            return (words if ending in ("rpm", "rps") else kept), ENDINGS[ending]
    return words, ""


def _of_side(quantity: str, side: str) -> str:
    """The column of that side: two rudders; the port one of two propellers or pods is the second."""
    if quantity == "delta" and side:
        return f"delta_{side}"
    if quantity in ("n", "n_azimuth", "azimuth") and side == "port":
        return f"{quantity}_2"
    return quantity


def turn_in(name: str, unit: str, largest: float) -> float:
    """The period of the quantity ``name`` in the ``unit`` of a file; without one ("") the ``largest`` number tells
    degrees."""
    scale = factor(name, unit or ("deg" if largest > BEYOND_A_TURN else "rad"))
    return quantity(name).period / (scale or 1.0)


def known_units(name: str) -> dict[str, float]:
    """Unit that a raw log may use for the quantity ``name`` -> factor to its own."""
    return FACTORS.get(quantity(name).unit, {})


def factor(name: str, unit: str) -> float | None:
    """Factor from ``unit`` as written to that of the quantity ``name``, or None for one that does not belong to it."""
    return factor_of(quantity(name).unit, unit)
