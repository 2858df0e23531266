"""Headers of ship logs and the quantities they mean, and the units that raw logs use."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from cases.io.headers import FRT_NAMES
from cases.io.units import FACTORS, SPELLINGS, factor_of, is_canonical, si_unit
from cases.trial import wraps
from mmg.motion.flow import INPUTS

RAW = {
    "latitude": "deg", "longitude": "deg", "sog": "m/s", "cog": "rad", "true_wind_angle": "rad", "date": "", "ship": "",
    "zone": "",
}  # fmt: skip
SIGNS = tuple(f"{q}_sign" for q in ("latitude", "longitude", *(q for q in INPUTS if q.startswith(("n", "delta")))))
"""Words that give numbers of another column their sign."""
RAW |= dict.fromkeys(SIGNS, "")
"""Quantities of raw logs that no trial file holds, and the unit they are turned into. The angle of the true wind is
counted from the bow."""

_ENDINGS = "deg degrees rad kn kt kts knots mps m_s ms kmh deg_s degs dps deg_min rad_s rads rpm rps m s sec us ns"
ENDINGS = {word: SPELLINGS.get(word, word.replace("_", "/")) for word in _ENDINGS.split()} | {"ms": "m/s"}
"""Last words of a header that are a unit."""

BEYOND_A_TURN = 6.6
"""No direction in radians is larger."""

SIDES = dict.fromkeys(("port", "ps"), "port") | dict.fromkeys(("stbd", "starboard", "sb", "stb"), "starboard")
_WORDS: tuple[tuple[str, str], ...] = (
    (r"(gps|gnss)?_?(lat|latitude)(_decimal)?", "latitude"),
    (r"(gps|gnss)?_?(lon|long|lng|longitude)(_decimal)?", "longitude"),
    (r"(utm_)?(northing|north|n)_?(position|utm)?|x_north|pos_north|x0", "x"),
    (r"(utm_)?(easting|east|e)_?(position|utm)?|y_east|pos_east|y0", "y"),
    (r"(utm_)?zone", "zone"),
    (r"(true_|gyro_|ship_)?(heading|hdg|hdt|yaw)(_true|_angle|_gyro)?|gyro|psi", "psi"),
    (r"(gps_|gnss_)?(cog|course|course_over_ground|course_made_good|cmg|track)(_true)?", "cog"),
    (r"(gps_|gnss_)?(sog|speed_over_ground|ground_speed|gps_speed|speed_made_good)", "sog"),
    (r"rot|rate_of_turn|turn_rate|yaw_rate|yawrate|gyro_rate|yaw_velocity|angular_velocity_z", "r"),
    (r"surge(_velocity|_speed)?|u_velocity|longitudinal_(speed|velocity)|speed_longitudinal", "u"),
    (r"sway(_velocity|_speed)?|v_velocity|(transverse|lateral)_(speed|velocity)|speed_transverse", "v"),
    (r"(propeller|prop|shaft|main_engine|engine|me)?_?(rpm|rps|revs|revolutions|n_prop|shaft_speed)", "n"),
    (r"(propeller|prop|shaft)_(speed|rate)", "n"),
    (r"rudder(_angle|_feedback|_actual|_position|_response)?|rsa|delta|actual_rudder", "delta"),
    (r"(true_wind_speed|wind_speed_true|tws)", "wind_speed"),
    (r"(true_wind_(direction|dir)|wind_(direction|dir)_true|twd)", "wind_direction"),
    (r"(true_wind_angle|wind_angle_true|twa)", "true_wind_angle"),
    (r"((apparent|relative|rel|app)_wind_speed|wind_speed_(apparent|relative|rel|app)|aws|rws)", "apparent_wind_speed"),
    (
        r"((apparent|relative|rel|app)_wind_(direction|dir|angle)|wind_(direction|dir|angle)_(apparent|relative|rel|app)"
        r"|awa|awd|rwd)",
        "apparent_wind_direction",
    ),
    (r"(n_azimuth|n_pod)|(azimuth|pod)(_thruster)?_(rpm|rps|revs|revolutions|speed)", "n_azimuth"),
    (r"(azimuth|pod)(_thruster)?(_angle|_direction)?", "azimuth"),
    (r"bow_thruster(_rpm|_speed)?", "n_bow"),
    (r"stern_thruster(_rpm|_speed)?", "n_stern"),
    (r"(pitch_)?(propeller_pitch|cpp_pitch|pitch_feedback)", "pitch"),
    (r"time|time_?stamp|date_?time|utc|utc_time|time_utc|gps_time|clock|epoch|unix_?time|elapsed(_time)?|zeit", "t"),
    (r"date|day|datum|utc_date", "date"),
    (r"mmsi|imo(_number)?|vessel(_name)?|ship(_name)?|call_?sign", "ship"),
)  # fmt: skip
UNSURE = {
    r"wind_?(speed|velocity)|ws": "wind_speed or apparent_wind_speed",
    r"wind_?(direction|dir|angle)|wd": "wind_direction or apparent_wind_direction",
    r"speed|velocity|v_ship|ship_speed": "sog (over ground) or nothing (through the water)",
    r"rpm_e": "n or n_2 (of an engine without a gear) or nothing (ahead of a gear)",
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
    if is_canonical(header) or header in RAW:
        return Meaning(header)
    words, unit = _without_unit(plain_words(header))
    side = ""
    for word in words.split("_"):
        if word in SIDES and words != word:
            side = SIDES[word]
            words = "_".join(w for w in words.split("_") if w != word)
    if re.fullmatch(NOT_USED, words):
        return Meaning("", unit)
    for pattern, quantity in _WORDS:
        if re.fullmatch(pattern, words):
            if words.endswith(("rpm", "rps")):
                unit = unit or words[-3:]
            unit = "" if quantity == "t" else unit  # the clock knows more of them
            return Meaning(_of_side(quantity, side), unit)
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


def unit_of(quantity: str) -> str:
    """The unit that a ``quantity`` is turned into, "" where it has none."""
    return RAW[quantity] if quantity in RAW else si_unit(quantity)


def turn_of(quantity: str) -> float:
    """A turn in ``unit_of`` the ``quantity``, after which its values begin anew; 0 of one that is no direction."""
    return 360.0 if quantity == "longitude" else 2 * math.pi if wraps(quantity) else 0.0


def turn_in(quantity: str, unit: str, largest: float) -> float:
    """``turn_of`` the ``quantity`` in the ``unit`` of a file; without one ("") the ``largest`` number tells degrees."""
    scale = factor(quantity, unit or ("deg" if largest > BEYOND_A_TURN else "rad"))
    return turn_of(quantity) / (scale or 1.0)


def known_units(quantity: str) -> dict[str, float]:
    """Unit that a raw log may use for a ``quantity`` -> factor to ``unit_of`` it."""
    return FACTORS.get(unit_of(quantity), {})


def factor(quantity: str, unit: str) -> float | None:
    """Factor from ``unit`` as written to ``unit_of`` the ``quantity``, or None for one that does not belong to it."""
    return factor_of(unit_of(quantity), unit)
