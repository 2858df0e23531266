"""Logs of NMEA 2000, by nmea2000: candump, Yacht Devices, Actisense N2K ASCII, canboat's plain lines and its JSON."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable
from cases.importing.series import ENGINE, Heard, seconds_of_stamp, table_of_series
from cases.importing.vocabulary import Meaning
from cases.io.files import read_bytes
from mmg.errors import BadValue, NotInstalled
from mmg.messages import Message

STAMP = r"(\d{4}-\d{2}-\d{2}[-T ]\d{2}:\d{2}:\d{2}(?:\.\d+)?)Z?"
FRAMES = re.compile(
    rf"\s*(?:\((?:(\d+\.\d+)|{STAMP})\)\s+\S+\s+([0-9A-F]{{8}})(?:#|\s+\[\d\]\s+)([0-9A-F ]+)"  # candump
    r"|(\d{2}:\d{2}:\d{2}\.\d+)\s+[RT]\s+([0-9A-F]{8})\s+([0-9A-F ]+))\s*",  # Yacht Devices
    re.IGNORECASE,
)
ASCII = re.compile(
    r"\s*A(\d{6}\.\d+)\s+([0-9A-F]{2})[0-9A-F]{2}[0-9A-F]\s+([0-9A-F]{5})\s+([0-9A-F]+)\s*", re.IGNORECASE
)
PLAIN = re.compile(rf"\s*{STAMP},\d+,(\d+),(\d+),\d+,\d+,([0-9A-F,]+)\s*", re.IGNORECASE)
UNTIMED = re.compile(r"\s*(?:<0x[0-9A-F]+>|[a-z]\w*\s+[0-9A-F]{8})\s+\[\d\][0-9A-F ]+", re.IGNORECASE)
"""A line of candump without its option -L or -t."""
DAY = 86400.0
"""Seconds."""
PLACE = (("latitude", "latitude", "deg"), ("longitude", "longitude", "deg"))
FIELDS = {
    127245: (("position", "delta", "angle"),),
    127250: (("heading", "psi", "angle"), ("variation", "variation", "angle")),
    127251: (("rate", "r", "rate"),), 127258: (("variation", "variation", "angle"),),
    127488: (("speed", "", "shaft"),), 127493: (), 129025: PLACE, 129029: PLACE,
    129026: (("sog", "sog", "m/s"), ("cog", "cog", "angle")),
    130306: (("windSpeed", "", "m/s"), ("windAngle", "", "angle")),
}  # fmt: skip
"""Groups of parameters that are read: fields, what they are ("" where another field says it), and their units."""
WIND = {
    "True (ground referenced to North)": ("wind_speed", "wind_direction"),
    "Apparent": ("apparent_wind_speed", "apparent_wind_direction"),
    "True (boat referenced)": ("wind_speed", "true_wind_angle"),
}
"""Reference of 130306 -> what speed and angle are."""
OVER_WATER = {
    "windSpeed": "wind_speed (over the water, where there is no current) or nothing",
    "windAngle": "true_wind_angle (over the water, where there is no current) or nothing",
}
"""What they may be where the reference is the water."""
SI = {"angle": "rad", "rate": "rad/s", "shaft": "Hz"}
STD = {"angle": "deg", "rate": "deg/s", "shaft": "rpm"}
UNKNOWN = dict.fromkeys(SI, "")
"""Units of the decoder, and of canboat's JSON, whose first line may say which they are."""


def is_nmea2000(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` are messages of NMEA 2000."""
    lines = [line for line in content[:8192].decode("latin-1").splitlines()[:-1] if line.strip() and line[0] != "#"]
    known = [any(kind.fullmatch(line) for kind in (FRAMES, ASCII, PLAIN, UNTIMED)) for line in lines]
    known = [a or ('"pgn"' in line and line.lstrip().startswith("{")) for a, line in zip(known, lines, strict=True)]
    return len(lines) > 2 and sum(known) > 0.5 * len(lines)


def read_nmea2000(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the log ``path``; each source of each group of parameters has times of its own.

    chosen: the map; its ``variation`` is that of magnetic headings where the log has none. Raises UserError where
    nmea2000 is missing, lines have no times, two sources say the same, and headings are magnetic without a variation.
    """
    messages, damaged, units, others = [], 0, UNKNOWN, Counter[str]()
    decode = _decoder(path)
    lines = [line for line in read_bytes(path).decode("latin-1").splitlines() if line.strip() and line[0] != "#"]
    if sum(bool(UNTIMED.fullmatch(line)) for line in lines[:50]) > 25:
        raise BadValue(f"{path}: its lines have no times; log with candump -L, or -t a")
    absolute = True
    for line in lines:
        if line.lstrip().startswith("{"):
            found, own = _of_json(line)
            units = own or units
        else:
            found, units = _of_line(line, decode), SI
        if found is None:
            damaged += '"version"' not in line
        elif found[3] is not None:
            absolute &= found[0] > DAY
            messages.append(found)
        elif found[1] not in FIELDS:
            others[str(found[1])] += 1
    t = np.array([message[0] for message in messages])
    if not absolute:
        t = t + DAY * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * DAY)
    elif chosen.zone_hours and not lines[0].lstrip().startswith("("):  # candump writes seconds since 1970
        t = t - 3600.0 * chosen.zone_hours
    heard = _heard(t, messages, units)
    accounts = [Account(pgn, count, (), NOT_READ) for pgn, count in others.items()]
    said = [Message(f"NMEA 2000: {len(messages)} messages that are read", "nmea2000")]
    if damaged:
        said.append(Message(f"lines that are damaged or no messages, left out: {damaged}", "damaged"))
    return table_of_series(path, heard.series(), chosen, Clock(t, absolute, "time", "of the logger"), said, accounts)


Found = tuple[float, int, int, Any]
"""Time [s], group of parameters, source, and fields: None of a group that is not read, or of a part of a message."""


def _decoder(path: Path) -> Callable[[str, str], Any]:
    """What turns a frame (identifier, hexadecimal bytes), or a whole message ("", a plain line), into a message."""
    try:
        from nmea2000.decoder import NMEA2000Decoder
        from nmea2000.input_formats import N2KFormat
    except ImportError:
        words = "NMEA 2000 needs nmea2000 (Python 3.11 or later); pip install 'mmg-ident[import]'"
        raise NotInstalled(f"{path}: {words}") from None
    frames = NMEA2000Decoder(bound_format=N2KFormat.CANDUMP3, units="si")
    whole = NMEA2000Decoder(bound_format=N2KFormat.BASIC_STRING, units="si")

    def decode(identifier: str, data: str) -> Any:
        if identifier:
            return frames.decode(f"(0.0) can0 {identifier}#{data}")
        return whole.decode(f"2000-01-01T00:00:00.000Z,{data}")

    return decode


def _of_line(line: str, decode: Callable[[str, str], Any]) -> Found | None:
    """What a line that is no JSON says, None where it is damaged."""
    try:
        if match := FRAMES.fullmatch(line):
            epoch, stamp, candump, data, time, yacht, more = match.groups()
            identifier, data = candump or yacht, (data or more).replace(" ", "")
            number = int(identifier, 16) & 0x1FFFFFFF
            pgn, source = number >> 8 & 0x3FFFF, number & 0xFF
            pgn -= pgn & 0xFF if pgn >> 8 & 0xFF < 240 else 0  # those hold their destination
            when = float(epoch) if epoch else seconds_of_stamp(stamp or time)
        elif match := ASCII.fullmatch(line):
            time, from_, hexadecimal, data = match.groups()
            when, pgn, source = (
                seconds_of_stamp(f"{time[:2]}:{time[2:4]}:{time[4:]}"),
                int(hexadecimal, 16),
                int(from_, 16),
            )
            listed = ",".join(data[i : i + 2] for i in range(0, len(data), 2))
            identifier, data = "", f"6,{pgn},{source},255,{len(data) // 2},{listed}"
        elif match := PLAIN.fullmatch(line):
            stamp, group, from_, data = match.groups()
            when, pgn, source = seconds_of_stamp(stamp), int(group), int(from_)
            identifier, data = "", f"6,{pgn},{source},255,{data.count(',') + 1},{data}"
        else:
            return None
        message = decode(identifier, data) if pgn in FIELDS else None
    except (ValueError, OverflowError, LookupError, ArithmeticError):
        return None
    return when, pgn, source, None if message is None else {f.id: f.value for f in message.fields}


def _of_json(line: str) -> tuple[Found | None, dict[str, str] | None]:
    """What a line of canboat's JSON says, None where it is damaged; and the units that it names for all lines."""
    try:
        document = json.loads(line)
        if "version" in document:
            return None, SI if document.get("units") == "si" else STD
        pgn, source, stamp = int(document["pgn"]), int(document["src"]), str(document["timestamp"])
        fields = {}
        for name, value in document["fields"].items():
            first, *rest = re.findall(r"\w+", name)
            value = value.get("name", value.get("value")) if isinstance(value, dict) else value
            fields[first.lower() + "".join(word.capitalize() for word in rest)] = value
        return (seconds_of_stamp(stamp), pgn, source, fields if pgn in FIELDS else None), None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None, None


def _heard(t: np.ndarray, messages: list[Found], units: dict[str, str]) -> Heard:
    """What the ``messages`` (N) say at the times t (N,) [s], in these ``units``."""
    heard, gears = Heard(), dict[Any, Any]()
    for when, (_, pgn, source, said) in zip(t.tolist(), messages, strict=True):
        if pgn == 127493:
            gears[said.get("instance")] = said.get("transmissionGear")
        if pgn in (129025, 129029) and said.get("method") in ("no GNSS", 0):
            continue
        reference = str(said.get("reference", said.get("cogReference", "")))
        part = reference if pgn == 130306 else said.get("instance") if pgn in (127245, 127488) else None
        name = f"{pgn} (source {source})" + ("" if part is None else f" {part}")
        for field, quantity, kind in FIELDS[pgn]:
            value, may_be, rank = said.get(field), "", int(pgn in (127258, 129029))
            if field == "heading" and reference == "Magnetic":
                quantity, rank = "heading_magnetic", 1
                value = value + (said.get("deviation") or 0.0) if value is not None else None
            elif field in ("heading", "cog") and reference != "True":
                continue
            elif pgn == 127488:
                value = -value if value is not None and gears.get(part) == "Reverse" else value
                may_be = ENGINE
            elif pgn == 130306 and reference in WIND:
                quantity = WIND[reference][field == "windAngle"]
            elif pgn == 130306 and "water" in reference:
                may_be = OVER_WATER[field]
            elif pgn == 130306:
                continue
            header = f"{name} {'magnetic ' if rank and field == 'heading' else ''}{field}"
            heard.say(name, when, header, value, Meaning(quantity, units.get(kind, kind), may_be), rank)
    return heard
