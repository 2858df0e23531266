"""Logs of NMEA 2000, by nmea2000: candump, Yacht Devices, Actisense N2K ASCII, canboat's plain lines and its JSON."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable
from cases.importing.series import ENGINE, Compass, Heard, seconds_of_stamp, table_of_series
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
READ = (127245, 127250, 127251, 127258, 127488, 127493, 129025, 129026, 129029, 130306)
"""Groups of parameters that are read."""
OVER_WATER = "over the water, where there is no current"
WIND = {
    "True (ground referenced to North)": {"windSpeed": Meaning("wind_speed"), "windAngle": Meaning("wind_direction")},
    "Apparent": {
        "windSpeed": Meaning("apparent_wind_speed"), "windAngle": Meaning("apparent_wind_direction"),
    },
    "True (boat referenced)": {"windSpeed": Meaning("wind_speed"), "windAngle": Meaning("true_wind_angle")},
    "True (water referenced)": {
        "windSpeed": Meaning("", may_be=f"wind_speed ({OVER_WATER}) or nothing"),
        "windAngle": Meaning("", may_be=f"true_wind_angle ({OVER_WATER}) or nothing"),
    },
}  # fmt: skip
"""Reference of 130306 -> what speed and angle are, or may be."""
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
        elif found[1] not in READ:
            others[str(found[1])] += 1
    t = np.array([message[0] for message in messages])
    if not absolute:
        t = t + DAY * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * DAY)
    elif chosen.zone_hours and not lines[0].lstrip().startswith("("):  # candump writes seconds since 1970
        t = t - 3600.0 * chosen.zone_hours
    heard = _heard(path, t, messages, units, chosen)
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
        message = decode(identifier, data) if pgn in READ else None
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
        return (seconds_of_stamp(stamp), pgn, source, fields if pgn in READ else None), None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None, None


def _heard(path: Path, t: np.ndarray, messages: list[Found], units: dict[str, str], chosen: ImportMap) -> Heard:
    """What the ``messages`` (N) say at the times t (N,) [s], in these ``units``."""
    heard, gears = Heard(), dict[Any, Any]()
    timed = [(when, *message[1:]) for when, message in zip(t.tolist(), messages, strict=True)]
    variations = [(when, fields.get("variation")) for when, pgn, _, fields in timed if pgn == 127258]
    compass = Compass(variations, units["angle"], chosen)
    for when, pgn, source, fields in timed:
        name, instance = f"{pgn} (source {source})", fields.get("instance")
        if pgn in (129025, 129029) and fields.get("method") not in ("no GNSS", 0):
            for field in ("latitude", "longitude"):
                means = Meaning(field, "deg")
                heard.say(name, when, f"{name} {field}", fields.get(field), means, rank=int(pgn == 129029))
        elif pgn in (127250, 129026):
            field, quantity, of = ("heading", "psi", "reference") if pgn == 127250 else ("cog", "cog", "cogReference")
            if fields.get(of) == "True":
                means = Meaning(quantity, units["angle"])
                heard.say(name, when, f"{name} {field}", fields.get(field), means)
            elif fields.get(of) == "Magnetic":
                compass.say(
                    heard, name, when, quantity, fields.get(field), fields.get("deviation"), fields.get("variation")
                )
            if pgn == 129026:
                heard.say(name, when, f"{name} sog", fields.get("sog"), Meaning("sog", "m/s"))
        elif pgn == 127251:
            heard.say(name, when, f"{name} rate", fields.get("rate"), Meaning("r", units["rate"]))
        elif pgn == 127245:
            name = f"{name} {instance}"
            heard.say(name, when, f"{name} position", fields.get("position"), Meaning("delta", units["angle"]))
        elif pgn == 127493:
            gears[instance] = fields.get("transmissionGear")
        elif pgn == 127488:
            speed, name = fields.get("speed"), f"{name} {instance}"
            astern = gears.get(instance) == "Reverse" and speed is not None
            means = Meaning("", units["shaft"], ENGINE)
            heard.say(name, when, f"{name} speed", -speed if astern else speed, means)
        elif pgn == 130306:
            reference = str(fields.get("reference"))
            for field, means in WIND.get(reference, {}).items():
                unit = "m/s" if field == "windSpeed" else units["angle"]
                heard.say(
                    f"{name} {reference}",
                    when,
                    f"{name} {reference} {field}",
                    fields.get(field),
                    replace(means, unit=unit),
                )
    compass.check(path, heard)
    return heard
