"""Logs of messages: NMEA 2000, by nmea2000 (candump, Yacht Devices, Actisense N2K ASCII, canboat's plain lines and its
JSON), Signal K deltas, time series packages of ISO 19848; and which of these, or NMEA 0183, a file holds."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.clocks import DAY
from cases.importing.import_map import ImportMap
from cases.importing.nmea_log import is_nmea, read_nmea
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable
from cases.importing.series import ENGINE, OVER_WATER, Heard, mostly, seconds_of_stamp, table_of_series
from cases.importing.vocabulary import Meaning
from cases.io.files import read_bytes
from cases.io.text_table import number_of
from mmg.errors import BadValue, Conflict, needed
from mmg.messages import Message

PATHS = {  # Paths of Signal K (specification 1.7) and what they mean; angles are positive to starboard.
    "navigation.position.latitude": Meaning("latitude", "deg"),
    "navigation.position.longitude": Meaning("longitude", "deg"),
    "navigation.courseOverGroundTrue": Meaning("cog", "rad"),
    "navigation.speedOverGround": Meaning("sog", "m/s"),
    "navigation.headingTrue": Meaning("psi", "rad"),
    "navigation.headingMagnetic": Meaning("heading_magnetic", "rad"),
    "navigation.magneticVariation": Meaning("variation", "rad"),
    "navigation.rateOfTurn": Meaning("r", "rad/s"),
    "steering.rudderAngle": Meaning("delta", "rad"),
    "environment.wind.speedApparent": Meaning("apparent_wind_speed", "m/s"),
    "environment.wind.angleApparent": Meaning("apparent_wind_direction", "rad"),
    "environment.wind.speedOverGround": Meaning("wind_speed", "m/s"),
    "environment.wind.directionTrue": Meaning("wind_direction", "rad"),
    "environment.wind.angleTrueGround": Meaning("true_wind_angle", "rad"),
    "environment.wind.speedTrue": Meaning("", "m/s", f"wind_speed {OVER_WATER}"),
    "environment.wind.angleTrueWater": Meaning("", "rad", f"true_wind_angle {OVER_WATER}"),
}
REVOLUTIONS = re.compile(r"propulsion\.(.+)\.revolutions")
DELTA = re.compile(r'^\s*\{.*"updates"')
GEAR = re.compile(r"propulsion\.(.+)\.transmission\.gear")
VIS = {  # Quantities of local ids (vessel information structure 3-11a, code book "quantities") and what they mean.
    "absolute.latitude": "latitude", "latitude": "latitude", "absolute.longitude": "longitude",
    "longitude": "longitude", "heading.true": "psi", "course.over.ground": "cog", "speed.over.ground": "sog",
    "rate.of.turn": "r", "longitudinal.speed.over.ground": "u", "transverse.speed.over.ground": "v",
    "wind.speed.vs.earth": "wind_speed", "wind.direction.vs.earth": "wind_direction",
    "wind.speed.vs.vessel": "apparent_wind_speed", "wind.direction.vs.vessel": "apparent_wind_direction",
}  # fmt: skip
SET = r"set\.point|reference|request|control|nominal|input"  # Types and commands of ids of what is not measured
# Nodes (vessel information structure 3-11a) of propeller shafts, of what drives them, of rudders and steering gears.
SHAFTS, ENGINES, RUDDERS = r"41[23]\b", r"411\b", r"42[12]\b|HS5"


def vis_meaning(channel: str) -> Meaning:
    """What the local id ``channel`` of ISO 19848, such as /dnv-v2/vis-3-11a/421.2/HS5-P/meta/qty-angle, means. Of
    angles only those of rudders, of frequencies only those of shafts are known; ids of orders mean nothing."""
    node, _, tags = channel.partition("/meta/")
    said = dict(tag.split("-", 1) for tag in tags.split("/") if "-" in tag)
    if "/vis-" not in channel or re.search(SET, f"{said.get('type', '')} {said.get('cmd', '')}"):
        return Meaning("")
    side = re.search(r"-\d*([PS])(?![A-Za-z])", node)  # location of a node: a number, then port or starboard
    port, quantity = bool(side) and side[1] == "P", said.get("qty", "")  # type: ignore[index]
    if quantity == "angle" and re.search(RUDDERS, node):
        return Meaning("delta" if not side else "delta_port" if port else "delta_starboard")
    if quantity in ("rotational.frequency", "angular.velocity"):
        shaft, engine = re.search(SHAFTS, node), re.search(ENGINES, node)
        return Meaning("n_2" if port else "n") if shaft else Meaning("", may_be=ENGINE if engine else "")
    known = VIS.get(quantity, "")
    return Meaning(known, "deg" if known in ("latitude", "longitude") else "")


def reader_of(begin: bytes, is_json: bool = False) -> Callable[[Path, ImportMap], RawTable] | None:
    """What reads the messages in a file of this ``begin``, None of other files; is_json: its name says that it is JSON,
    which is Signal K where nothing else is shown."""
    if mostly(begin, *LINES, UNTIMED, JSON):
        return read_nmea2000
    if is_nmea(begin):
        return read_nmea
    if begin.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"{") and b'"Package"' in begin[:4096]:
        return read_iso19848
    return read_signal_k if is_json or mostly(begin, DELTA) else None


def read_signal_k(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the deltas in ``path``, of the own ship; each source of each path has times of its own. chosen: the
    map. Raises UserError where several ships could be the own one, two sources say the same, and headings are magnetic
    without a variation."""
    values, own_ship, damaged = [], "", 0
    for line in read_bytes(path).decode("utf-8", "replace").splitlines():
        try:
            document = json.loads(line) if line.strip() else {}
            own_ship = str(document.get("self", own_ship))
            values += list(_values_of(document))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            damaged += 1
    ships = Counter(context for context, *_ in values)  # AIS receivers put those around into the same log
    own_ship = own_ship if own_ship in ships else _own_ship(path, values, ships)
    kept = [value[1:] for value in values if value[0] == own_ship]
    heard, gears, others = Heard(), dict[str, str](), Counter[str]()
    for t, name, source, value in kept:
        header = f"{name} ({source})"
        if gear := GEAR.fullmatch(name):
            gears[gear[1]] = str(value).lower()
        elif engine := REVOLUTIONS.fullmatch(name):  # never negative: the gear that was said last gives the sign
            sign = -1.0 if gears.get(engine[1]) == "reverse" else 1.0
            heard.say(header, t, header, sign * number_of(value), Meaning("", "Hz", ENGINE))
        elif name in PATHS:
            at = f"navigation.position ({source})" if ".position." in name else header  # both of one source
            heard.say(at, t, header, value, PATHS[name], rank=int("Magnetic" in name))
        else:
            others[name] += 1
    accounts = [Account(name, count, (), NOT_READ) for name, count in others.items()]
    accounts += [Account(ship, count, (), "another ship") for ship, count in ships.items() if ship != own_ship]
    said = [Message(f"Signal K: {len(kept)} values of {own_ship or 'the own ship'}", "signal_k")]
    if damaged:
        said.append(Message(f"lines that are damaged or no deltas, left out: {damaged}", "damaged"))
    clock = Clock(np.zeros(0), True, "time", "stamps of the updates")
    return table_of_series(path, heard.series(), chosen, clock, said, accounts)


def _values_of(document: Any) -> Iterator[tuple[str, float, str, str, Any]]:
    """Ship, time [s], path, source and value of all values of a delta."""
    document = document.get("delta", document)
    context = str(document.get("context", ""))
    for update in document.get("updates", ()):
        source = update.get("source", {})
        t = seconds_of_stamp(update.get("timestamp") or source.get("timestamp"))
        source = str(update.get("$source") or source.get("$source") or source.get("label") or "no source")
        for entry in update.get("values", ()):
            name, value = str(entry["path"]), entry["value"]
            parts = value if isinstance(value, dict) else {"": value}
            for part, one in parts.items():
                yield context, t, f"{name}.{part}" if part else name, source, one


def _own_ship(path: Path, values: list[Any], ships: Counter[str]) -> str:
    """The ship whose heading, rudder or revolutions were logged: those that AIS tells of say neither of the last."""
    inner = ("steering.", "propulsion.", "navigation.headingMagnetic")
    candidates = sorted({context for context, _, name, *_ in values if name.startswith(inner)} or ships)
    if len(candidates) != 1:
        words = f"values of several ships ({', '.join(candidates[:4])}) and none is named as self"
        raise Conflict(f"{path}: {words}; keep the lines of one")
    return candidates[0]


def read_iso19848(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the time series package in ``path``, of its tabular and event data. chosen: the map. Raises
    UserError where it is damaged or no package."""
    heard, codes = Heard(), Counter[str]()
    try:
        package = json.loads(read_bytes(path).decode("utf-8-sig", "replace"))["Package"]
        ship = str(package.get("Header", {}).get("ShipID", ""))
        said = [value for data in _listed(package["TimeSeriesData"]) for value in _data_of(data)]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        why = " ".join(f"{type(error).__name__} {error}".split())[:100]
        raise BadValue(f"{path}: is cut off, damaged or no time series package of ISO 19848 ({why})") from None
    codes.update(code for *_, code in said)
    good = codes.most_common(1)[0][0] if codes else ""  # no code means good everywhere: most values are
    for name, channel, t, value, code in said:
        if code == good:
            means = vis_meaning(channel)
            heard.say(name or channel, t, channel, value, means if means.quantity or means.may_be else None)
    others, why = [(c, n) for c, n in codes.items() if c != good], f"most have {good or 'none'}"
    accounts = [Account(f"quality {code or 'none'}", count, (), why) for code, count in others]
    notices = [Message(f"ISO 19848: {len(said)} values" + (f" of {ship}" if ship else ""), "iso19848")]
    clock = Clock(np.zeros(0), True, "time", "stamps of the package")
    return table_of_series(path, heard.series(), chosen, clock, notices, accounts)


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def _data_of(data: Any) -> Iterator[tuple[str, str, float, Any, str]]:
    """Table, channel, time [s], value and quality of all values of one element TimeSeriesData."""
    for i, table in enumerate(_listed(data.get("TabularData")), 1):
        channels = [str(channel) for channel in table["DataChannelID"]]
        for row in table["DataSet"]:
            t, quality = seconds_of_stamp(row["TimeStamp"]), row.get("Quality") or [""] * len(channels)
            for channel, value, code in zip(channels, row["Value"], quality, strict=True):
                yield f"table {i} of {channels[0]}", channel, t, value, str(code)
    for row in (data.get("EventData") or {}).get("DataSet") or ():
        channel = str(row["DataChannelID"])
        yield channel, channel, seconds_of_stamp(row["TimeStamp"]), row["Value"], str(row.get("Quality") or "")


def with_local_ids(table: RawTable) -> RawTable:
    """The ``table`` with what local ids among its headers mean."""
    ids = {header: means for header in table.headers if (means := vis_meaning(header)) != Meaning("")}
    return replace(table, means=table.means | ids) if ids else table


LINES = tuple(  # What is logged of frames, by identifier, and of whole messages, the first of which are Actisense's.
    re.compile(rf"^\s*{line}\s*$", re.IGNORECASE)
    for line in (
        r"\((?P<stamp>[-\d.:T Z]+)\)\s+\S+\s+(?P<frame>[0-9A-F]{8})(?:#|\s+\[\d\]\s+)(?P<data>[0-9A-F ]+)",  # candump
        r"(?P<stamp>[\d:]+\.\d+)\s+[RT]\s+(?P<frame>[0-9A-F]{8})\s+(?P<data>[0-9A-F ]+)",  # Yacht Devices
        r"A(?P<stamp>\d{6}\.\d+)\s+(?P<source>[0-9A-F]{2})[0-9A-F]{3}\s+(?P<pgn>[0-9A-F]{5})\s+(?P<data>[0-9A-F]+)",
        r"(?P<stamp>\d{4}[-\d:.T ]+Z?),\d+,(?P<pgn>\d+),(?P<source>\d+),\d+,\d+,(?P<data>[0-9A-F,]+)",  # canboat
    )
)
# A line of candump without its option -L or -t.
UNTIMED = re.compile(r"^\s*(?:<0x[0-9A-F]+>|[a-z]\w*\s+[0-9A-F]{8})\s+\[\d\][0-9A-F ]+$", re.IGNORECASE)
JSON = re.compile(r'^\s*\{.*"pgn"')
PLACE = (("latitude", "latitude", "deg"), ("longitude", "longitude", "deg"))
# Groups of parameters that are read: fields, what they are ("" where another field says it), and their units.
FIELDS = {
    127245: (("position", "delta", "angle"),),
    127250: (("heading", "psi", "angle"), ("variation", "variation", "angle")),
    127251: (("rate", "r", "rate"),), 127258: (("variation", "variation", "angle"),),
    127488: (("speed", "", "shaft"),), 127493: (), 129025: PLACE, 129029: PLACE,
    129026: (("sog", "sog", "m/s"), ("cog", "cog", "angle")),
    130306: (("windSpeed", "", "m/s"), ("windAngle", "", "angle")),
}  # fmt: skip
WIND = {  # Reference of 130306 -> what speed and angle are.
    "True (ground referenced to North)": ("wind_speed", "wind_direction"),
    "Apparent": ("apparent_wind_speed", "apparent_wind_direction"),
    "True (boat referenced)": ("wind_speed", "true_wind_angle"),
}
# Units of the decoder, and of canboat's JSON, whose first line may say which they are.
SI = {"angle": "rad", "rate": "rad/s", "shaft": "Hz"}
STD = {"angle": "deg", "rate": "deg/s", "shaft": "rpm"}
UNKNOWN = dict.fromkeys(SI, "")


def read_nmea2000(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the log ``path``; each source of each group of parameters has times of its own. chosen: the map; its
    ``variation`` is that of magnetic headings where the log has none. Raises UserError where nmea2000 is missing, lines
    have no times, two sources say the same, and headings are magnetic without a variation."""
    messages, damaged, units, others = [], 0, UNKNOWN, Counter[str]()
    decoders = _decoders(path)
    lines = [line for line in read_bytes(path).decode("latin-1").splitlines() if line.strip() and line[0] != "#"]
    if sum(bool(UNTIMED.fullmatch(line)) for line in lines[:50]) > 25:  # half of the first; others may be damaged
        raise BadValue(f"{path}: its lines have no times; log with candump -L, or -t a")
    absolute = True
    for line in lines:
        if line.lstrip().startswith("{"):
            found, named_units = _of_json(line)
            units = named_units or units
        else:
            found, units = _of_line(line, *decoders), SI
        if found is None:
            damaged += '"version"' not in line
        elif found[3] is not None:
            absolute &= found[0] > DAY  # else a time of the day, or since the logger began
            messages.append(found)
        elif found[1] not in FIELDS:
            others[str(found[1])] += 1
    t = np.array([message[0] for message in messages])
    if not absolute:  # over midnight
        t = t + DAY * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * DAY)
    elif chosen.zone_hours and not lines[0].lstrip().startswith("("):  # candump writes seconds since 1970
        t = t - 3600.0 * chosen.zone_hours
    heard = _heard(t, messages, units)
    accounts = [Account(pgn, count, (), NOT_READ) for pgn, count in others.items()]
    said = [Message(f"NMEA 2000: {len(messages)} messages that are read", "nmea2000")]
    if damaged:
        said.append(Message(f"lines that are damaged or no messages, left out: {damaged}", "damaged"))
    return table_of_series(path, heard.series(), chosen, Clock(t, absolute, "time", "of the logger"), said, accounts)


# Time [s], group of parameters, source, and fields: None of a group that is not read, or of a part of a message.
Found = tuple[float, int, int, Any]


def _decoders(path: Path) -> tuple[Any, Any]:
    """What decodes frames, as candump writes them, and whole messages, as canboat does."""
    decoder, formats = (needed(f"nmea2000.{part}", f"{path}: a log of NMEA 2000, with Python 3.11 or later,")
                        for part in ("decoder", "input_formats"))  # fmt: skip
    kinds = formats.N2KFormat.CANDUMP3, formats.N2KFormat.BASIC_STRING
    frames, messages = (decoder.NMEA2000Decoder(kind, units="si") for kind in kinds)
    return frames, messages


def _of_line(line: str, frames: Any, whole: Any) -> Found | None:
    """What a line that is no JSON says, None where it is damaged. frames, whole: decoders."""
    match = next(filter(None, (kind.fullmatch(line) for kind in LINES)), None)
    if match is None:
        return None
    said = match.groupdict()
    stamp, data = said["stamp"], re.sub("[ ,]", "", said["data"])
    try:
        if frame := said.get("frame"):
            when = float(stamp) if ":" not in stamp else seconds_of_stamp(stamp)
            pgn, source, *_ = frames.extract_header(int(frame, 16))
            decoder, text = frames, f"(0.0) can0 {frame}#{data}"  # as candump -L: one decoder for all of frames
        else:
            when = seconds_of_stamp(re.sub(r"^(\d\d)(\d\d)(?=\d\d\.)", r"\1:\2:", stamp))
            pgn, source = (int(said[name], 10 if "," in line else 16) for name in ("pgn", "source"))
            content = [data[i : i + 2] for i in range(0, len(data), 2)]
            decoder, text = whole, f"2000-01-01T00:00:00.0Z,6,{pgn},{source},255,{len(content)},{','.join(content)}"
        message = decoder.decode(text) if pgn in FIELDS else None
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
            first, *rest = re.findall(r"\w+", name)  # "Wind Speed" is the decoder's windSpeed
            value = value.get("name", value.get("value")) if isinstance(value, dict) else value
            fields[first.lower() + "".join(word.capitalize() for word in rest)] = value
        return (seconds_of_stamp(stamp), pgn, source, fields if pgn in FIELDS else None), None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        return None, None


def _heard(t: np.ndarray, messages: list[Found], units: dict[str, str]) -> Heard:
    """What the ``messages`` (N) say at the times t (N,) [s], in these ``units``."""
    heard, gears = Heard(), dict[str, Any]()
    for when, (_, pgn, source, said) in zip(t.tolist(), messages, strict=True):
        if pgn == 127493:  # the gear, which signs the revolutions of 127488
            gears[str(said.get("instance"))] = said.get("transmissionGear")
        if pgn in (129025, 129029) and said.get("method") in ("no GNSS", 0):
            continue
        reference = str(said.get("reference", said.get("cogReference", "")))
        part = reference if pgn == 130306 else said.get("instance") if pgn in (127245, 127488) else None
        name = f"{pgn} (source {source})" + ("" if part is None else f" {part}")
        for field, quantity, kind in FIELDS[pgn]:
            value, may_be, rank = number_of(said.get(field)), "", int(pgn in (127258, 129029))
            if field == "heading" and reference == "Magnetic":
                quantity, rank = "heading_magnetic", 1
                value += np.nan_to_num(number_of(said.get("deviation")))  # positive to the east; often not said
            elif field in ("heading", "cog") and reference != "True":
                continue
            elif pgn == 127488:
                may_be = ENGINE
                value = -value if gears.get(str(part)) == "Reverse" else value
            elif pgn == 130306 and reference in WIND:
                quantity = WIND[reference][field == "windAngle"]
            elif pgn == 130306 and "water" in reference:
                may_be = f"{'true_wind_angle' if field == 'windAngle' else 'wind_speed'} {OVER_WATER}"
            elif pgn == 130306:
                continue
            header = f"{name} {'magnetic ' if rank and field == 'heading' else ''}{field}"
            heard.say(name, when, header, value, Meaning(quantity, units.get(kind, kind), may_be), rank)
    return heard
