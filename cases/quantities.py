"""The registry of quantities: what a column of a trial or of a raw log is, in one row each; units that files may use
(docs/reference/trials.md) and their conversion to SI and radians.

Units and signs are those of the product (conventions.md, section 0): north, east, clockwise, starboard are positive.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import partial

from mmg.errors import UnknownName
from mmg.motion.flow import INPUTS, PODS

KNOT = 1852.0 / 3600.0  # Metres per second in one knot (exact, BIPM)
DEG = math.pi / 180.0  # Radians in a degree
# Unit in a Trial, or of a latitude -> accepted unit -> factor: value in the file times factor = value in a Trial.
# "ddmm" is degrees and minutes in one number, which the reader parts before.
FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "m": {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "nm": 1852.0},
    "rad": {"rad": 1.0, "deg": DEG, "mrad": 0.001},
    "m/s": {"m/s": 1.0, "kn": KNOT, "km/h": 1.0 / 3.6, "cm/s": 0.01, "mm/s": 0.001, "ft/s": 0.3048},
    "rad/s": {"rad/s": 1.0, "deg/s": DEG, "deg/min": DEG / 60.0, "rad/min": 1.0 / 60.0, "mrad/s": 0.001},
    "rps": {"rps": 1.0, "rpm": 1.0 / 60.0, "rad/s": 0.5 / math.pi},
    "deg": {"deg": 1.0, "rad": 1.0 / DEG, "1e-7 deg": 1e-7, "ddmm": 1.0},
}
# Other spellings, in lower case -> the unit as it is named here.
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


TURN = 2 * math.pi  # rad


@dataclass(frozen=True)
class Quantity:
    """One row of the registry.

    name: canonical; unit: in a Trial, or of a raw log once it is read; canonical: whether trial files hold it, or only
    raw logs; period: in ``unit``, after which its values begin anew, 0 of what is no direction; compass: whether it is
    counted from north, so that it turns with the whole record; limits: within which it is on any ship or model, in
    ``unit``; headers: regular expression of the words, in lower case with "_" between them, by which logs call it;
    valid: likewise of the column that says whether it holds.

    Between samples all run along lines, directions the short way round; whether actuators are held instead is said by
    ``inputs`` of the sidecar.
    """

    name: str
    unit: str
    canonical: bool = True
    period: float = 0.0
    compass: bool = False
    limits: tuple[float, float] = (-math.inf, math.inf)
    headers: str = ""
    valid: str = ""

    @property
    def wraps(self) -> bool:
        """Whether it is a direction, whose values begin anew after a turn."""
        return self.period > 0


# rad; VecTwin rudders reach 105 deg = 1.83 rad, nothing that steers reaches 115 deg. The limit was set by hand between
# them.
RUDDER_LIMIT = 2.0
# rad/s; a ship or a metre-long model does not turn by 86 deg every second for most of a run. The limit was set by hand.
SPIN_LIMIT = 1.5
# rps; propellers of models of a metre or more, and of ships, turn more slowly. The limit was set by hand.
REVOLUTIONS_LIMIT = 60.0
# m/s; the fastest boats reach 50, a hurricane's mean wind 60 (Beaufort 12 begins at 33). The limit was set by hand
# between them.
SPEED_LIMIT = 60.0
_FIX = r"(gps|gnss|fix|position|nav)?_?(fix|quality|qual|status|mode|valid|validity|ok)(_indicator|_flag|_type)?"
_direction = partial(Quantity, unit="rad", period=TURN)
_speed = partial(Quantity, unit="m/s", limits=(-SPEED_LIMIT, SPEED_LIMIT))
_amount = partial(Quantity, unit="m/s", limits=(0.0, SPEED_LIMIT))
_rudder = partial(Quantity, unit="rad", limits=(-RUDDER_LIMIT, RUDDER_LIMIT))
_shaft = partial(Quantity, unit="rps", limits=(-REVOLUTIONS_LIMIT, REVOLUTIONS_LIMIT))
_REVS = "rpm|rps|revs|revolutions"
_REL = "apparent|relative|rel|app"
_ROWS = (
    Quantity(
        "t", "s",
        headers="time|time_?stamp|date_?time|date_and_time|utc|utc_(date_)?time|time_utc|(gps|gnss)_time|clock|epoch|"
        "unix_?time(stamp)?|elapsed(_time)?|(log|sample|local|system|ship)_time|time_(of_day|since_start|local|gps)|secs?|"
        "seconds|(header_)?stamp(_secs?)?|date_?num|(gps_|gnss_)?(i?tow|sow|time_of_week|seconds?_of_week)(_m?s)?",
    ),
    Quantity("x", "m", headers=r"(utm_)?(northing|north|n)_?(position|utm)?|x_north|pos_north|x0", valid=_FIX),
    Quantity("y", "m", headers=r"(utm_)?(easting|east|e)_?(position|utm)?|y_east|pos_east|y0", valid=_FIX),
    _direction("psi", compass=True, valid=r"(heading|hdg|hdt|gyro|ths)_(status|mode|valid|validity|ok)",
               headers=r"(true_|gyro_|ship_)?(heading|hdg|hdt|yaw)(_true|_t|_angle|_gyro)?|gyro(_heading)?|psi"),
    _speed("u", headers=r"surge(_velocity|_speed)?|u_velocity|longitudinal_(speed|velocity)|speed_longitudinal"),
    _speed("v", headers=r"sway(_velocity|_speed)?|v_velocity|(transverse|lateral)_(speed|velocity)|speed_transverse"),
    Quantity("r", "rad/s", limits=(-SPIN_LIMIT, SPIN_LIMIT), valid="rot_(status|mode|valid|validity|ok)",
             headers="rot|rate_of_turn|turn_rate|yaw_rate|yawrate|gyro_rate|yaw_velocity|angular_velocity_z"),
    _shaft("n", valid="(rpm|shaft|engine)_(status|valid|validity|ok)",
           headers=rf"(propeller|prop|shaft|main_engine|engine|me)?_?({_REVS}|n_prop|shaft_speed)"
           rf"|(propeller|prop|shaft)_(speed|rate)|({_REVS})_(propeller|prop|shaft)"),
    _shaft("n_2"),
    _rudder("delta", valid="(rudder|rsa)_(status|valid|validity|ok)",
            headers=r"(angle_)?rudder(_angle|_feedback|_actual|_position|_response)?|rsa|delta|actual_rudder"),
    _rudder("delta_port"),
    _rudder("delta_starboard"),
    _rudder("delta_order"),
    _shaft("n_order"),
    _shaft("n_bow", headers="bow_thruster(_rpm|_speed)?"),
    _shaft("n_stern", headers="stern_thruster(_rpm|_speed)?"),
    Quantity("pitch", "rad", headers="(pitch_)?(propeller_pitch|cpp_pitch|pitch_feedback)"),
    _shaft("n_azimuth", headers=rf"(n_azimuth|n_pod)|(azimuth|pod)(_thruster)?_({_REVS}|speed)"),
    Quantity("phi", "rad"),
    Quantity("p", "rad/s"),
    _direction("azimuth", headers="(azimuth|pod)(_thruster)?(_angle|_direction)?"),
    _shaft("n_azimuth_2"),
    _direction("azimuth_2"),
    *(_shaft(f"n_azimuth_{pod}") for pod in range(3, PODS + 1)),
    *(_direction(f"azimuth_{pod}") for pod in range(3, PODS + 1)),
    _amount("wind_speed", headers="true_wind_speed|wind_speed_true|tws"),
    _direction("wind_direction", compass=True, headers="true_wind_(direction|dir)|wind_(direction|dir)_true|twd"),
    _amount("apparent_wind_speed", headers=f"({_REL})_wind_speed|wind_speed_({_REL})|aws|rws"),
    _direction("apparent_wind_direction",
               headers=f"({_REL})_wind_(direction|dir|angle)|wind_(direction|dir|angle)_({_REL})|awa|awd|rwd"),
    Quantity("latitude", "deg", False, limits=(-90.0, 90.0), valid=_FIX,
             headers="(gps|gnss)?_?(lat|latitude)(_decimal)?"),
    Quantity("longitude", "deg", False, period=360.0, limits=(-360.0, 360.0), valid=_FIX,
             headers="(gps|gnss)?_?(lon|long|lng|longitude)(_decimal)?"),
    _amount("sog", canonical=False, valid=_FIX,
            headers="(gps_|gnss_)?(sog|speed_(over_)?ground|ground_speed|gps_speed|speed_made_good)"),
    _direction("cog", canonical=False, compass=True, valid=_FIX,
               headers="(gps_|gnss_)?(cog|course|course_(over_)?ground|course_made_good|cmg|track)(_true|_t)?"),
    _direction("true_wind_angle", canonical=False, headers="true_wind_angle|wind_angle_true|twa"),
    _direction("heading_magnetic", canonical=False, compass=True,
               headers="(magnetic|mag|compass)_(heading|hdg)|(heading|hdg)_(magnetic|mag|m|compass)|hdm|compass",
               valid=r"(heading|hdg|hdm|compass)_(status|mode|valid|validity|ok)"),
    Quantity("variation", "rad", False, headers="(magnetic_|mag_)?(variation|declination|decl)|mag_?var|var_mag"),
    Quantity("deviation", "rad", False, headers="(compass_|magnetic_|mag_)?(deviation|dev)"),
    *(
        Quantity(f"{name}_{part}", "", False, headers=rf"({short}|{name})_({words})")
        for name, short in (("latitude", "lat"), ("longitude", "lon|long|lng"))
        for part, words in (("min", "min|mins|minutes?|mm"), ("s", "secs?|seconds?|ss"))
    ),
    Quantity("t_week", "", False, headers="(gps_|gnss_)?(week|wk|wn|week_?number|week_?no)"),
    Quantity("t_part", "", False, headers="((header_)?stamp_)?(n_?secs?|nano_?secs?|nano_?seconds?|micro_?seconds?|"
        "milli_?seconds?|u_?secs?|m_?secs?|millis|micros|nanos)"),
    Quantity("date", "", False, headers="date|day|datum|utc_date"),
    Quantity("ship", "", False, headers=r"mmsi|imo(_number)?|vessel(_name)?|ship(_name)?|call_?sign"),
    Quantity("zone", "", False, headers="(utm_)?zone"),
)  # fmt: skip
QUANTITIES = {row.name: row for row in _ROWS}  # By name; of a ship with more than two propellers see ``quantity``
# What was ordered of rudder and revolutions: no input, but what shows how long these wait.
ORDERS = ("delta_order", "n_order")
# Quantities whose sign another column of a raw log may say, in words.
SIGNED = (
    *("latitude", "longitude", "variation", "deviation", "apparent_wind_direction", "true_wind_angle"),
    *(name for name in INPUTS if name.startswith(("n", "delta"))),
)
QUANTITIES |= {f"t_{part}": Quantity(f"t_{part}", "", False) for part in ("year", "month", "day", "hour", "minute")}
QUANTITIES |= {f"{name}_sign": Quantity(f"{name}_sign", "", canonical=False) for name in SIGNED}
UNITS = {row.name: row.unit for row in _ROWS if row.canonical}  # Canonical columns and the unit they have in a Trial


def quantity(name: str) -> Quantity:
    """The row of ``name``, "n_3" to "n_9" included. Raises KeyError for what is none."""
    if re.fullmatch(r"n_[3-9]", name):
        return replace(QUANTITIES["n_2"], name=name)
    return QUANTITIES[name]


def is_canonical(name: str) -> bool:
    """Whether trial files may hold a column of that ``name``."""
    return name in UNITS or re.fullmatch(r"n_[3-9]", name) is not None


def wraps(name: str) -> bool:
    """Whether the column ``name`` is a direction, whose values begin anew after a turn; False of what is none."""
    return name in QUANTITIES and QUANTITIES[name].wraps
