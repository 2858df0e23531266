"""What one sentence of NMEA 0183 says: values by column, or why it says nothing (status, mode, empty fields).

Names and conversions of the fields are those of pynmeagps, without its objects, which cost most of the time of reading;
which fields hold is by NMEA 0183 4.10 (status A or V, modes, qualities of GGA).
"""

from __future__ import annotations

import datetime
import functools
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

from cases.importing.raw_table import NOT_READ
from cases.io.units import KNOT
from mmg.errors import NotInstalled

EMPTY = "empty"
"""Why a sentence is left out that holds nothing."""
MODES = {"A": 1, "D": 2, "P": 3, "F": 4, "R": 5}
"""Modes of a fix that was measured -> rank, the better the higher: autonomous, differential, precise, real time
kinematic with floats and without. Dead reckoning (E), manual (M), simulator (S), no fix (N) and not valid (V) are none.
"""
QUALITIES = {"1": "A", "2": "D", "3": "P", "5": "F", "4": "R"}
"""The modes by their numbers in GGA."""
WIND = {"K": 1 / 3.6, "M": 1.0, "N": KNOT, "S": 1609.344 / 3600.0}
"""Factor to m/s of the units of MWV."""
MWV = {"R": ("apparent_wind_speed", "apparent_wind_direction"), "T": ("true_wind_speed", "twa")}
"""What speed and angle of MWV are by its reference: both angles are counted from the bow."""
DAY_ZERO = datetime.date(1970, 1, 1).toordinal()
WATER = (("through the water", "speed through the water"),)

Fields = Mapping[str, str]


class Decoded(NamedTuple):
    """values: by column, none where the sentence is not valid, and ``why`` it is not; instrument: one of several behind
    a talker; aside: (part, why) of parts of it that are left out; time: of the day [s], NaN where it has none."""

    values: dict[str, float]
    why: str = ""
    instrument: str = ""
    aside: tuple[tuple[str, str], ...] = ()
    time: float = math.nan


def decoded(kind: str, content: str) -> Decoded:
    """What a sentence of a ``kind`` in DECODERS with this ``content`` (fields between commas) says; "day" (since 1970)
    and "decimals" of minutes are columns as well. Raises ValueError or
    OverflowError for fields that are none of the kind."""
    fields = _fields(kind, content.split(","))
    found = DECODERS[kind](fields)
    if clock := fields.get("time", ""):
        found = found._replace(time=_time(clock))
    return found if found.values or found.why else found._replace(why=EMPTY)


@functools.cache
def field_names() -> dict[str, tuple[str, ...]]:
    """Names of the fields of each kind. Raises UserError where pynmeagps is missing."""
    try:
        from pynmeagps import NMEA_PAYLOADS_GET
    except ImportError:
        raise NotInstalled("NMEA logs need pynmeagps; pip install 'mmg-ident[import]'") from None
    return {kind: tuple(NMEA_PAYLOADS_GET[kind]) for kind in DECODERS}


def checksum(content: str) -> int:
    """Of the ``content`` between $ and * (NMEA 0183): exclusive or of its characters."""
    return functools.reduce(operator.xor, content.encode("latin-1"), 0)


def _fields(kind: str, parts: list[str]) -> dict[str, str]:
    if kind == "XDR":
        return {str(i): part for i, part in enumerate(parts)}
    names = field_names()[kind]
    return dict(zip(names, (*parts, *("",) * (len(names) - len(parts))), strict=False))


def _time(text: str) -> float:
    """Seconds of the day of hhmmss.ss."""
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0 <= seconds < 61):
        raise ValueError("no time")
    return 3600.0 * hours + 60.0 * minutes + seconds


def _numbers(fields: Fields, **columns: str) -> dict[str, float]:
    """Column -> number of the field of that name, of those that are not empty."""
    values = {column: float(fields[field]) for column, field in columns.items() if fields.get(field)}
    if not all(map(math.isfinite, values.values())):
        raise ValueError("a number that is none")
    return values


def _not_valid(status: str = "", mode: str = "") -> str:
    """Why a sentence with these is not valid, or ""; fields that old instruments do not have are empty."""
    if status not in ("", "A"):
        return f"status {status}"
    return f"mode {mode}" if mode and not set(mode) & set(MODES) else ""


def _fix(fields: Fields) -> Decoded:
    """Position of RMC, GGA, GLL and GNS, with what RMC says beside it."""
    from pynmeagps import dmm2ddd

    mode, number = fields.get("posMode", ""), fields.get("quality", "A")
    why = _not_valid(fields.get("status", ""), mode)
    if "quality" in fields:
        mode = QUALITIES.get(number.lstrip("0"), "")
        why = "" if mode or not number else f"quality {number.lstrip('0') or 0}"
    if why or not number or not fields["lat"] or not fields["lon"]:
        return Decoded({}, why or EMPTY)
    latitude, longitude = dmm2ddd(fields["lat"]), dmm2ddd(fields["lon"])
    if fields["NS"] not in ("N", "S") or fields["EW"] not in ("E", "W"):
        return Decoded({}, "no hemisphere")
    if not isinstance(latitude, float) or not isinstance(longitude, float) or latitude > 90 or longitude > 180:
        raise ValueError("no place on the globe")
    values = {
        "latitude": -latitude if fields["NS"] == "S" else latitude,
        "longitude": -longitude if fields["EW"] == "W" else longitude,
        "decimals": float(len(fields["lat"].partition(".")[2])),
        "quality": float(max((MODES.get(char, 1) for char in mode), default=1)),
    }
    values |= _numbers(fields, sog="spd", cog="cog")
    values |= _toward(_numbers(fields, variation="mv"), fields.get("mvEW", ""))
    if day := fields.get("date"):
        year = int(day[4:6])
        values["day"] = _day(year + (1900 if year >= 80 else 2000), int(day[2:4]), int(day[:2]))
    return Decoded(values)


def _day(year: int, month: int, day: int) -> float:
    """Since 1970."""
    return float(datetime.date(year, month, day).toordinal() - DAY_ZERO)


def _zda(fields: Fields) -> Decoded:
    parts = [fields[name] for name in ("time", "year", "month", "day")]
    return Decoded({"day": _day(*(int(part) for part in parts[1:]))} if all(parts) else {})


def _hdg(fields: Fields) -> Decoded:
    """Of the compass with its deviation; easterly ones are added."""
    values = _numbers(fields, heading_magnetic="headingM")
    if values:
        deviation = _toward(_numbers(fields, deviation="deviation"), fields["deviationEW"])
        values["heading_magnetic"] += deviation.get("deviation", 0.0)
        values |= _toward(_numbers(fields, variation="variation"), fields["variationEW"])
    return Decoded(values)


def _toward(value: dict[str, float], side: str) -> dict[str, float]:
    """The ``value`` positive to the east; nothing without a ``side``."""
    return {name: -v if side == "W" else v for name, v in value.items()} if side in ("E", "W") else {}


def _plain(columns: dict[str, str], status: str = "", mode: str = "", water: str = "") -> Callable[[Fields], Decoded]:
    """Of sentences with ``columns`` -> fields, that are valid by the fields ``status`` and ``mode``; water: a field
    with a speed through the water."""

    def decode(fields: Fields) -> Decoded:
        why = _not_valid(fields.get(status, ""), fields.get(mode, ""))
        return Decoded({} if why else _numbers(fields, **columns), why, aside=WATER if fields.get(water) else ())

    return decode


def _rsa(fields: Fields) -> Decoded:
    values: dict[str, float] = {}
    aside: list[tuple[str, str]] = []
    for side, part in (("starboard", "stbd"), ("port", "port")):
        value, why = _numbers(fields, **{f"rudder_{side}": f"{part}angle"}), _not_valid(fields[f"{part}status"])
        if value and why:
            aside.append((side, why))
        values |= {} if why else value
    return Decoded(values, "" if values else aside[0][1] if aside else EMPTY, aside=tuple(aside) if values else ())


def _rpm(fields: Fields) -> Decoded:
    source, number = fields["source"], int(fields["engineshaftnum"] or 0)
    side = ("_port", "_starboard")[number % 2] if number else ""  # odd numbers are starboard, 0 the only one
    why = _not_valid(fields["status"]) or ("" if source in ("S", "E") else f"source {source}")
    column = f"{'rpm' if source == 'S' else 'RPM-E'}{side}"
    values = {} if why else _numbers(fields, **{column: "rpm"})
    if values:
        values |= _numbers(fields, **{f"blades {column}": "pitch"})
    return Decoded(values, why, f"{source}{number}")


def _mwv(fields: Fields) -> Decoded:
    unit, reference = fields["speedu"], fields["reference"]
    values, why = _numbers(fields, angle="angle", speed="speed"), _not_valid(fields["status"])
    if not why and len(values) == 2:
        why = f"unit {unit}" if unit not in WIND else "" if reference in MWV else f"reference {reference}"
    if why or len(values) < 2:
        return Decoded({}, why or EMPTY, reference)
    speed, direction = MWV[reference]
    return Decoded({speed: values["speed"] * WIND[unit], direction: values["angle"]}, "", reference)


def _mwd(fields: Fields) -> Decoded:
    knots = {name: speed * WIND["N"] for name, speed in _numbers(fields, true_wind_speed="speedN").items()}
    values = knots | _numbers(fields, twd="dirT", true_wind_speed="speedM")
    why = "" if len(values) == 2 else "only a magnetic direction" if fields["dirM"] else EMPTY
    return Decoded({} if why else values, why)


def _xdr(fields: Fields) -> Decoded:
    """Transducers that are a rudder or a shaft by their names."""
    values: dict[str, float] = {}
    aside: list[tuple[str, str]] = []
    for i in range(0, len(fields) - 3, 4):
        kind, _, unit, name = (fields[str(i + k)] for k in range(4))
        words = name.upper()
        side = "_port" if "PORT" in words else "_starboard" if re.search("STARBOARD|STBD", words) else ""
        column = ""
        if (kind, unit) == ("A", "D") and re.search("RUDDER|RSA", words):
            column = f"rudder{side}"
        elif (kind, unit) == ("T", "R") and re.search("SHAFT|PROP|ENGINE", words):
            column = f"{'RPM-E' if 'ENGINE' in words else 'rpm'}{side}"
        value = _numbers(fields, **{column: str(i + 1)}) if column else {}
        values |= value
        if not value:
            aside.append((name, EMPTY if column else NOT_READ))
    return Decoded(values, "" if values else NOT_READ, aside=tuple(aside) if values else ())


DECODERS: dict[str, Callable[[Fields], Decoded]] = {
    "RMC": _fix, "GGA": _fix, "GNS": _fix, "GLL": _fix, "ZDA": _zda, "HDG": _hdg, "RSA": _rsa, "RPM": _rpm,
    "MWV": _mwv, "MWD": _mwd, "XDR": _xdr,
    "VTG": _plain({"sog": "sogn", "cog": "cogt"}, mode="posMode"),
    "HDT": _plain({"heading": "headingT"}),
    "THS": _plain({"heading": "headt"}, mode="mi"),
    "VHW": _plain({"heading": "hdgT"}, water="spdN"),
    "HDM": _plain({"heading_magnetic": "headingM"}),
    "ROT": _plain({"rot": "rot"}, status="valid"),
    "VBW": _plain({"u": "longgroundspd", "v": "transgroundspd"}, status="groundspdstatus", water="longwaterspd"),
}  # fmt: skip
"""Sentences that are read."""
