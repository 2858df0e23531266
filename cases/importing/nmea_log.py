"""NMEA 0183 logs as a table: each talker and sentence is a time series, one of each quantity is used, all are named.

Names and conversions of the fields are those of pynmeagps, without its objects, which cost most of the time of reading;
which fields hold is by NMEA 0183 4.10 (status A or V, modes, qualities of GGA). Which positions come from the same
receiver is told by talker, sentence and place.
"""

from __future__ import annotations

import datetime
import functools
import itertools
import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.nmea_clock import Series, logger_of, moments_of
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable, raw_table
from cases.importing.series import mostly
from cases.io.files import read_bytes
from cases.quantities import KNOT
from mmg.errors import Missing, needed
from mmg.messages import Message

EMPTY = "empty"  # Why a sentence is left out that holds nothing
# Modes of a fix that was measured -> rank, the better the higher: autonomous, differential, precise, real time
# kinematic with floats and without. Dead reckoning (E), manual (M), simulator (S), no fix (N) and not valid (V) count
# as none.
MODES = {"A": 1, "D": 2, "P": 3, "F": 4, "R": 5}
QUALITIES = {"1": "A", "2": "D", "3": "P", "5": "F", "4": "R"}  # The modes by their numbers in GGA
WIND = {"K": 1 / 3.6, "M": 1.0, "N": KNOT, "S": 1609.344 / 3600.0}  # Factor to m/s of the units of MWV
# What speed and angle of MWV are by its reference: both angles are counted from the bow.
MWV = {"R": ("apparent_wind_speed", "apparent_wind_direction"), "T": ("true_wind_speed", "twa")}
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
    and "decimals" of minutes are columns as well. Raises ValueError or OverflowError for fields that are none of it."""
    fields = _fields(kind, content.split(","))
    sentence = DECODERS[kind](fields)
    if clock := fields.get("time", ""):
        sentence = sentence._replace(time=_time(clock))  # also of one that is not valid: it tells when it was said
    return sentence if sentence.values or sentence.why else sentence._replace(why=EMPTY)


@functools.cache
def field_names() -> dict[str, tuple[str, ...]]:
    """Names of the fields of each kind. Raises UserError where pynmeagps is missing."""
    payloads = needed("pynmeagps", "a log of NMEA 0183").NMEA_PAYLOADS_GET
    return {kind: tuple(payloads[kind]) for kind in DECODERS}


def checksum(content: str) -> int:
    """Of the ``content`` between $ and * (NMEA 0183): exclusive or of its characters."""
    return functools.reduce(operator.xor, content.encode("latin-1"), 0)


def _fields(kind: str, parts: list[str]) -> dict[str, str]:
    if kind == "XDR":
        return {str(i): part for i, part in enumerate(parts)}
    names = field_names()[kind]
    return dict(zip(names, (*parts, *("",) * (len(names) - len(parts))), strict=False))  # older ones have fewer fields


def _time(text: str) -> float:
    """Seconds of the day of hhmmss.ss."""
    hours, minutes, seconds = int(text[:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0 <= seconds < 61):  # 60: a leap second
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
        century = 1900 if year >= 80 else 2000  # receivers without a fix begin in 1980, with the time of GPS
        values["day"] = _day(year + century, int(day[2:4]), int(day[:2]))
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
    """Of sentences with columns -> fields, valid by the fields status and mode; water: of a speed through the water."""

    def decode(fields: Fields) -> Decoded:
        why = _not_valid(fields.get(status, ""), fields.get(mode, ""))
        return Decoded({} if why else _numbers(fields, **columns), why, aside=WATER if fields.get(water) else ())

    return decode


def _rudders(column: str, angle: str, status: str) -> Callable[[Fields], Decoded]:
    """Of both rudders: columns "``column``_starboard" and "_port"; angle, status: names of the fields behind the
    side."""

    def decode(fields: Fields) -> Decoded:
        values: dict[str, float] = {}
        aside: list[tuple[str, str]] = []
        for side, part in (("starboard", "stbd"), ("port", "port")):
            value, why = _numbers(fields, **{f"{column}_{side}": part + angle}), _not_valid(fields[part + status])
            if value and why:
                aside.append((side, why))
            values |= {} if why else value
        return Decoded(values, "" if values else aside[0][1] if aside else EMPTY, aside=tuple(aside) if values else ())

    return decode


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
    values = knots | _numbers(fields, twd="dirT", true_wind_speed="speedM")  # m/s before knots: no conversion
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


DECODERS: dict[str, Callable[[Fields], Decoded]] = {  # Sentences that are read.
    "RMC": _fix, "GGA": _fix, "GNS": _fix, "GLL": _fix, "ZDA": _zda, "HDG": _hdg, "RPM": _rpm,
    "MWV": _mwv, "MWD": _mwd, "XDR": _xdr,
    "RSA": _rudders("rudder", "angle", "status"),
    "ROR": _rudders("rudder_order", "rudderorder", "rudderstatus"),
    "VTG": _plain({"sog": "sogn", "cog": "cogt"}, mode="posMode"),
    "HDT": _plain({"heading": "headingT"}),
    "THS": _plain({"heading": "headt"}, mode="mi"),
    "VHW": _plain({"heading": "hdgT"}, water="spdN"),
    "HDM": _plain({"heading_magnetic": "headingM"}),
    "ROT": _plain({"rot": "rot"}, status="valid"),
    "VBW": _plain({"u": "longgroundspd", "v": "transgroundspd"}, status="groundspdstatus", water="longwaterspd"),
}  # fmt: skip


M_PER_DEG = 111.2e3  # Metres of a degree of latitude, within 0.6 %. pi/180 of the mean radius of 6371 km (IUGG 1980).
NEAR = 3.0  # m within which fixes of one receiver by different satellites agree (GPS SPS 2020, horizontal error)
STEADY = 0.1  # Scatter of a distance, in itself, below which it is that of two antennas. Set by hand.
ALIKE = 0.9  # Least share of the fixes of the one most heard with which another is heard equally often. Set by hand.
PAIRED = 0.9  # Least cosine of the turn from one pair of fixes of two antennas to the next. Set by hand.


@dataclass(frozen=True, eq=False)
class Fixes:
    """Valid positions of one sentence: index (N,) of its rows, t (N,) [s], degrees (N,), decimals of the minutes (N,)
    and ranks of the quality (N,)."""

    name: str
    index: np.ndarray
    t: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    decimals: np.ndarray
    quality: np.ndarray

    def __len__(self) -> int:
        return len(self.t)

    @property
    def rounding(self) -> float:
        """Of the positions [m]."""
        return M_PER_DEG / 60.0 * 10.0 ** -float(np.median(self.decimals))

    @property
    def z(self) -> np.ndarray:
        """Metres east + 1j north (N,) of the first fix, continuous over 180 degrees."""
        longitude = np.unwrap(self.longitude, period=360.0)
        east = (longitude - longitude[0]) * np.cos(np.radians(self.latitude[0]))
        return M_PER_DEG * (east + 1j * (self.latitude - self.latitude[0]))  # flat: receivers lie some metres apart

    def rows(self, rows: np.ndarray) -> Fixes:
        """Those at ``rows``."""
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)[1:]})


@dataclass(frozen=True)
class Receiver:
    """The ``fixes`` of one receiver, the best first; distance: to the first receiver [m], None where they are not heard
    at the same time."""

    fixes: tuple[Fixes, ...]
    distance: float | None = None


def receivers_of(sentences: Sequence[Fixes]) -> list[Receiver]:
    """The receivers behind the sentences ``sentences``, that which is used first: the one heard most often, or, equally
    often, the one of better quality, or the first."""
    fixes = [part for one in sentences for part in _divided(one)]
    most = max((len(f) for f in fixes), default=0)
    fixes.sort(key=lambda f: (-len(f) if len(f) < ALIKE * most else -most, -float(np.mean(f.quality))))
    groups: list[list[Fixes]] = []
    for one in fixes:
        for group in groups:
            if _one_receiver(group[0], one):
                group.append(one)
                break
        else:
            groups.append([one])
    receivers: list[Receiver] = []
    for group in groups:
        finest = sorted(group, key=lambda f: (len(f) < ALIKE * len(group[0]), f.rounding))
        distance = _distance(groups[0][0], group[0])[0] if receivers else None
        receivers.append(Receiver(tuple(finest), None if distance is None else float(np.median(distance))))
    return receivers


def _one_receiver(a: Fixes, b: Fixes) -> bool:
    """Whether two series of fixes are of one receiver: they agree within NEAR, and not at a steady distance; what is
    never heard at the same time is, where it goes on where the other one stops."""
    off, tolerance = _distance(a, b)
    if off is None:
        first, last = sorted((a, b), key=lambda f: float(f.t[0]))
        both = first.rows(np.arange(len(first))[-5:])  # the end of one and the first fix of the other
        both = Fixes("", *(np.append(getattr(both, f.name), getattr(last, f.name)[0]) for f in fields(both)[1:]))
        step = np.abs(np.diff(both.z))
        speed = float(np.median(step[:-1] / np.maximum(np.diff(both.t)[:-1], 1e-3))) if len(step) > 1 else 0.0
        return bool(step[-1] <= NEAR + 2.0 * speed * (both.t[-1] - both.t[-2]))  # 2: set by hand
    middle = float(np.median(off))
    low, high = np.percentile(off, [25, 75])
    return middle <= tolerance or (middle <= NEAR and high - low > STEADY * middle)


def _distance(a: Fixes, b: Fixes) -> tuple[np.ndarray | None, float]:
    """Metres (M,) between two series at their common times, else at those of the rarer one between fixes of the other,
    None without any; and how large they are by rounding and interpolation alone."""
    a, b = (b, a) if len(b) > len(a) else (a, b)
    rounding = 1.5 * (a.rounding + b.rounding)
    common, i, j = np.intersect1d(np.round(a.t, 2), np.round(b.t, 2), return_indices=True)
    if len(common) > 0.5 * len(b):
        latitude, longitude, b, slack = a.latitude[i], a.longitude[i], b.rows(j), 0.0
    else:
        inside = np.flatnonzero((b.t >= a.t[0]) & (b.t <= a.t[-1]))
        if not len(inside) or len(a) < 3:
            return None, rounding
        b, slack = b.rows(inside), 0.25 * float(np.percentile(np.abs(np.diff(a.z, 2)), 95))
        latitude = np.interp(b.t, a.t, a.latitude)
        longitude = np.interp(b.t, a.t, np.unwrap(a.longitude, period=360.0))
    east = (np.remainder(longitude - b.longitude + 180.0, 360.0) - 180.0) * np.cos(np.radians(b.latitude))
    return np.asarray(M_PER_DEG * np.hypot(east, latitude - b.latitude)), rounding + slack


def _divided(fixes: Fixes) -> list[Fixes]:
    """The fixes of each of two receivers behind one talker and sentence: where it says two positions at one time."""
    z, step = fixes.z, np.diff(fixes.t)
    twice = np.flatnonzero((step == 0) & (np.abs(np.diff(z)) > 3.0 * fixes.rounding))
    if len(fixes) < 8 or len(twice) <= 3:  # some fixes that are repeated are no second receiver
        return [fixes]
    turn = np.angle(np.diff(z)[twice[1:]] * np.conj(np.diff(z)[twice[:-1]]))
    steady = np.median(np.abs(np.cos(turn))) > PAIRED  # noise has any direction
    return _by_pairs(fixes, z, twice) if steady else [fixes]


def _by_pairs(fixes: Fixes, z: np.ndarray, twice: np.ndarray) -> list[Fixes]:
    """Fixes of two receivers, of which pairs at the rows ``twice`` and behind them have the same time: which is which
    is told by the direction from one to the other, which turns slowly; single ones belong to the nearer track."""
    apart = z[twice + 1] - z[twice]
    # 1e-300: a product of zero, of pairs at right angles, keeps the order.
    flips = np.cumprod(np.append(1.0, np.sign(np.real(apart[1:] * np.conj(apart[:-1])) + 1e-300)))
    second = np.zeros(len(fixes), dtype=bool)
    second[np.where(flips > 0, twice + 1, twice)] = True
    paired = np.zeros(len(fixes), dtype=bool)
    paired[twice] = paired[twice + 1] = True
    off = []
    for rows in (np.flatnonzero(paired & ~second), np.flatnonzero(paired & second)):
        off.append(np.abs(z - np.interp(fixes.t, fixes.t[rows], z[rows])))
    second |= ~paired & (off[1] < off[0])
    return [fixes.rows(np.flatnonzero(~second)), fixes.rows(np.flatnonzero(second))]


def merged(series: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Times and values (N,) of the first of the ``series``, in order, and of others where it is silent for more than
    half its step."""
    t, values = series[0]
    t, first = np.unique(t, return_index=True)
    values = values[first]
    for other, more in series[1:]:
        if len(t) < 2 or not len(other):
            continue
        near = np.minimum(np.searchsorted(t, other), len(t) - 1)
        off = np.minimum(np.abs(t[near] - other), np.abs(t[np.maximum(near - 1, 0)] - other))
        new = off > 0.5 * float(np.median(np.diff(t)))
        t, order = np.unique(np.concatenate([t, other[new]]), return_index=True)
        values = np.concatenate([values, more[new]])[order]
    return t, values


CHECKSUM = "checksum wrong"  # Why a sentence is rejected out
SENTENCE = re.compile(r"[$!](P[A-Z0-9]{2,9}|[A-Z][A-Z0-9][A-Z]{3}),([^*$!]*)(?:\*([0-9A-Fa-f]{2}))?")
TAG = re.compile(r"\\(?:[^\\]*,)?s:([^,*\\]+)[^\\]*\\")  # The source of a tag block of NMEA 4
_COLUMNS = {
    "deg": "latitude longitude cog heading heading_magnetic variation rudder rudder_starboard rudder_port "
    "rudder_order rudder_order_starboard rudder_order_port apparent_wind_direction twa twd",
    "kn": "sog u v", "deg/min": "rot", "m/s": "apparent_wind_speed true_wind_speed",
    "rpm": "rpm rpm_starboard rpm_port RPM-E RPM-E_starboard RPM-E_port",
}  # fmt: skip
# Columns of the table and their units.
UNITS = {column: unit for unit, columns in _COLUMNS.items() for column in columns.split()}
TOGETHER = (  # Columns that are taken from one source: that which says one of them most often.
    "heading", "heading_magnetic", "u v", "apparent_wind_speed apparent_wind_direction", "true_wind_speed twa twd",
    "rot", "rudder", "rudder_starboard", "rudder_port", "rudder_order_starboard rudder_order_port",
    *_COLUMNS["rpm"].split(),
)  # fmt: skip
SHAFTS, RUDDERS = ("rpm", "rpm_starboard", "rpm_port"), ("rudder_starboard", "rudder_port")
ORDERS = ("rudder_order_starboard", "rudder_order_port")
# Column -> those beside which it is not used: a true heading, the shafts of engines.
BETTER = {"heading_magnetic": ("heading",)} | {f"RPM-E{side}": SHAFTS for side in ("", "_starboard", "_port")}
MOVES = 1.0  # Per cent of the largest pitch by which blades move at least: the least step that RPM says. Set by hand.
Samples = tuple[np.ndarray, np.ndarray]  # Times [s] and values (M,)


def is_nmea(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` hold a sentence."""
    return mostly(content, SENTENCE)


def read_nmea(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the log ``path``: a row for each moment at which something that is used was said.

    chosen: the map, of which ``zone_hours`` and ``ignore`` are used. What became of each talker and
    sentence is in the ``accounts`` of the table. Raises UserError where pynmeagps is missing, where neither a sentence
    nor a logger tells a time, where the times run backwards, and where no sentence is used.
    """
    series, prefixes, rejected = _parsed(path, chosen.ignored_in(path))
    try:
        t, clock, notices = moments_of(series, logger_of(prefixes), str(path), chosen.zone_hours or 0.0)
    except Missing as error:
        why = (f"{name} {count}: {why}" for (name, why), count in rejected.most_common(12))
        raise Missing(f"{error}; left out: {', '.join(why) or 'none'}") from None
    log = _Selection(series, t, rejected)
    log.select_positions()
    log.select_others()
    return log.table(path, clock, notices)


def _parsed(path: Path, ignored: set[str]) -> tuple[dict[str, Series], list[str], Counter[tuple[str, str]]]:
    """The series of the log ``path`` by talker, sentence and instrument, what stands before (or behind) each of their
    sentences, and counts of what is rejected, by sentence and why. ignored: sentences that the map does not want."""
    field_names()
    by_name: dict[str, Series] = {}
    rejected: Counter[tuple[str, str]] = Counter()
    prefixes: list[str] = []
    for line in read_bytes(path).decode("latin-1").splitlines():
        end = 0
        for match in SENTENCE.finditer(line):
            prefix, head, kind = line[end : match.start()], match[1], match[1][2:]
            prefix = prefix if prefix.strip() or end else line[match.end() :]  # some loggers write the time behind it
            end = match.end()
            right = match[3] is None or checksum(match[0][1:-3]) == int(match[3], 16)
            known = match[0][0] == "$" and head[0] != "P" and kind in DECODERS
            if not known or head in ignored:
                rejected[head, "ignored by the map" if known else NOT_READ if right else CHECKSUM] += 1
                continue
            tag = TAG.search(prefix)
            source = f"{head} of {tag[1]}" if tag else head
            try:
                sentence = decoded(kind, match[2]) if right else Decoded({}, CHECKSUM)
            except (ValueError, OverflowError):
                sentence = Decoded({}, "damaged")
            name = f"{source} {sentence.instrument}" if sentence.instrument else source
            series = by_name.setdefault(name, Series(head[:2], kind))  # what is not valid keeps its place in the order
            series.at.append(len(prefixes))
            series.time.append(sentence.time)
            series.values.append({} if sentence.why else sentence.values)
            prefixes.append(prefix)
            aside = [(f"{name} {part}", why) for part, why in sentence.aside]
            rejected.update([(name, sentence.why), *aside] if sentence.why else aside)
        if not end and line.strip():
            rejected["lines", "damaged or no sentence"] += 1
    return by_name, prefixes, rejected


class _Selection:
    """The choice of a source for each column of a log. series, t: by name, and their times; rejected: counts by
    (sentence, why); columns: samples of those that are chosen; used: columns by series; why: what else is to be said of
    a series."""

    def __init__(self, series: dict[str, Series], t: dict[str, np.ndarray], rejected: Counter[tuple[str, str]]) -> None:
        self.series, self.t, self.rejected = series, t, rejected
        self.columns: dict[str, Samples] = {}
        self.used: dict[str, list[str]] = {name: [] for name in series}
        self.why: dict[str, str] = {}
        self.warnings: list[Message] = []

    def rows(self, name: str, column: str) -> np.ndarray:
        """Rows (M,) of a series that hold a column, in the order of their times."""
        good = np.flatnonzero(np.isfinite(self.series[name].column(column)) & np.isfinite(self.t[name]))
        return good[np.argsort(self.t[name][good], kind="stable")]  # stable: the order tells two receivers apart

    def samples(self, name: str, column: str, rows: np.ndarray | None = None) -> Samples:
        """Of a column of a series; rows: of it alone."""
        at = self.rows(name, column)
        at = at if rows is None else at[np.isin(at, rows)]
        return self.t[name][at], self.series[name].column(column)[at]

    def sources(self, *columns: str) -> list[str]:
        """The series that hold one of the ``columns``, that with most samples first, a water log (VHW) last."""
        counts = {name: max(len(self.rows(name, column)) for column in columns) for name in self.series}
        return sorted(filter(counts.get, counts), key=lambda name: (self.series[name].kind == "VHW", -counts[name]))

    def select(self, column: str, samples: dict[str, Samples]) -> None:
        """Use ``samples`` of the first series as a column, and of others where it is silent."""
        self.columns[column] = merged(list(samples.values()))
        for name in samples:
            self.used[name].append(column)

    def reject(self, names: Sequence[str], why: str) -> None:
        """Say ``why`` series are not used, of which nothing is said yet."""
        for name in names:
            self.why.setdefault(name, why)

    def select_positions(self) -> None:
        """Latitude and longitude of one receiver, and its speed and course over ground."""
        fixes = []
        for name in self.sources("latitude"):
            rows, series = self.rows(name, "latitude"), self.series[name]
            parts = [series.column(c)[rows] for c in ("latitude", "longitude", "decimals", "quality")]
            fixes.append(Fixes(name, rows, self.t[name][rows], *parts))
        receivers = receivers_of(sorted(fixes, key=lambda f: self.series[f.name].at[0]))
        for used in receivers[:1]:
            self.select("latitude", {f.name: (f.t, f.latitude) for f in used.fixes})
            self.select("longitude", {f.name: (f.t, f.longitude) for f in used.fixes})
        for other in receivers[1:]:
            off = ", not heard at the same time" if other.distance is None else f" {other.distance:.3g} m off"
            for f in other.fixes:
                if self.used[f.name]:  # two receivers behind one talker
                    self.rejected[f.name, f"second receiver{off}"] += len(f)
                else:
                    self.why[f.name] = f"second receiver{off}"
        self._select_speeds(receivers)

    def _select_speeds(self, receivers: Sequence[Receiver]) -> None:
        """Speed and course of the first of the ``receivers``: RMC with its position, or VTG of its talkers."""
        fixes = {f.name: f.index for used in receivers[:1] for f in used.fixes}
        foreign = {self.series[f.name].talker for other in receivers[1:] for f in other.fixes}
        rows: dict[str, np.ndarray] = {}
        for name in self.sources("sog"):
            if name not in fixes and self.series[name].talker in foreign:
                self.reject([name], "of a second receiver, or of one of two")
            elif name in fixes or not fixes or self.series[name].kind == "VTG":
                rows[name] = fixes.get(name, np.arange(len(self.series[name].at)))
        most = max(map(len, rows.values()), default=0)
        # RMC before VTG: its time is its own, not that of its place in the order.
        names = sorted(rows, key=lambda name: (len(rows[name]) < ALIKE * most, self.series[name].kind != "RMC"))
        for column in ("sog", "cog"):
            samples = {name: self.samples(name, column, rows[name]) for name in names}
            if samples := {name: both for name, both in samples.items() if len(both[0])}:
                self.select(column, samples)

    def select_others(self) -> None:
        """Of what several sources hold, that with most samples."""
        self._reject_zeros()
        for group in map(str.split, TOGETHER):
            names = self.sources(*group)
            if better := [column for column in BETTER.get(group[0], ()) if column in self.columns]:
                self.reject(names, f"{better[0]} is used")
                continue
            for name in names[:1]:
                for column in group:
                    if len(self.rows(name, column)):
                        self.select(column, {name: self.samples(name, column)})
                self.reject([n for n in names[1:] if not self.used[n]], f"{group[0]} is taken from {name}")
        self._select_variation()
        for alone, sides in (("rudder", RUDDERS), ("rudder_order", ORDERS), ("rpm", SHAFTS[1:])):
            only = [side for side in sides if side in self.columns]
            if alone not in self.columns and len(only) == 1:  # one of two that say a side is the only one
                self.columns[alone] = self.columns.pop(only[0])
                self.used = {n: [alone if c == only[0] else c for c in used] for n, used in self.used.items()}
        for name, shaft in itertools.product(self.series, SHAFTS):
            pitch = self.samples(name, f"blades {shaft}")[1]
            if len(pitch) and np.ptp(pitch) > MOVES:
                pitch_range = f"from {pitch.min():g} to {pitch.max():g} % of its largest, whose angle is not said"
                words = f"{name}: the blades of the propeller move {pitch_range}"
                self.rejected[f"{name} pitch", pitch_range] += len(pitch)
                self.warnings.append(Message(f"{words}; revolutions alone do not tell its thrust", "pitch_moves"))

    def _select_variation(self) -> None:
        """That of the compass, or of a receiver. Zeros alone are none: receivers without a model say them."""
        compass = [name for name in self.series if "heading_magnetic" in self.used[name]]
        for name in (*compass, *self.sources("variation")) if compass else ():
            t, east = self.samples(name, "variation")
            if east.any() and "variation" not in self.columns:
                at = self.columns["heading_magnetic"][0]
                self.select("variation", {name: (at, np.interp(at, t, east))})

    def _reject_zeros(self) -> None:
        """Leave out a rudder that stays at zero beside another one of its source: no sensor is there."""
        for name in self.sources(*RUDDERS):
            values = {side: self.samples(name, side)[1] for side in RUDDERS}
            still = [side for side in RUDDERS if len(values[side]) and not values[side].any()]
            if len(still) == 1 and all(map(len, values.values())):
                self.rejected[f"{name} {still[0]}", "always zero, where the other one moves"] += len(values[still[0]])
                self.series[name].column(still[0])[:] = np.nan  # in the cache of the series: nobody sees it any more

    def accounts(self) -> tuple[Account, ...]:
        """What became of every talker and sentence."""
        rows = []
        for name, series in self.series.items():
            valid, why = sum(map(bool, series.values)), self.why.get(name, "")
            valid -= sum(count for (one, other), count in self.rejected.items() if one == name and "receiver" in other)
            used = tuple(self.used[name]) or (("time",) if series.kind == "ZDA" else ())
            if valid:
                rows.append(Account(name, valid, used, why or ("" if used else NOT_READ)))
        return (*rows, *(Account(name, count, (), why) for (name, why), count in self.rejected.items()))

    def table(self, path: Path, clock: Clock, notices: Sequence[Message]) -> RawTable:
        """The columns at the times of all of them, with the accounts."""
        import pandas as pd

        accounts = self.accounts()
        names = [name for name in UNITS if name in self.columns]
        if not names:
            raise Missing(f"{path}: no sentence is used: {'; '.join(map(str, accounts[:20]))}")
        t = np.unique(np.concatenate([np.round(self.columns[name][0], 3) for name in names]))  # rows of a millisecond
        columns = {name: np.full(len(t), np.nan) for name in names}
        for name, values in columns.items():
            values[np.searchsorted(t, np.round(self.columns[name][0], 3))] = self.columns[name][1]
        said = [*notices, *self.warnings]
        units, frame = [UNITS[name] for name in names], pd.DataFrame({"time": t} | columns).astype(object)
        table = raw_table(path, str(path), ["time", *names], ["s", *units], frame, said)
        return replace(table, clock=replace(clock, t=t), accounts=accounts)
