"""Logs of JSON: Signal K deltas, a line each, and time series packages of ISO 19848."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable
from cases.importing.series import ENGINE, OVER_WATER, Heard, mostly, number, seconds_of_stamp, table_of_series
from cases.importing.vocabulary import Meaning
from cases.io.files import read_bytes
from mmg.errors import BadValue, Conflict
from mmg.messages import Message

PATHS = {
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
"""Paths of Signal K (specification 1.7) and what they mean; angles are positive to starboard."""
REVOLUTIONS = re.compile(r"propulsion\.(.+)\.revolutions")
DELTA = re.compile(r'^\s*\{.*"updates"')
GEAR = re.compile(r"propulsion\.(.+)\.transmission\.gear")


VIS = {
    "absolute.latitude": "latitude", "latitude": "latitude", "absolute.longitude": "longitude",
    "longitude": "longitude", "heading.true": "psi", "course.over.ground": "cog", "speed.over.ground": "sog",
    "rate.of.turn": "r", "longitudinal.speed.over.ground": "u", "transverse.speed.over.ground": "v",
    "wind.speed.vs.earth": "wind_speed", "wind.direction.vs.earth": "wind_direction",
    "wind.speed.vs.vessel": "apparent_wind_speed", "wind.direction.vs.vessel": "apparent_wind_direction",
}  # fmt: skip
"""Quantities of local ids (vessel information structure 3-11a, code book "quantities") and what they mean."""
SET = r"set\.point|reference|request|control|nominal|input"
"""Types and commands of ids of what is not measured."""
SHAFTS, ENGINES, RUDDERS = r"41[23]\b", r"411\b", r"42[12]\b|HS5"
"""Nodes of propeller shafts, of what drives them, and of rudders and steering gears."""


def vis_meaning(channel: str) -> Meaning:
    """What the local id ``channel`` of ISO 19848, such as /dnv-v2/vis-3-11a/421.2/HS5-P/meta/qty-angle, means.

    Of angles only those of rudders, of frequencies only those of shafts are known; ids of orders mean nothing.
    """
    if "/vis-" not in channel:
        return Meaning("")
    node, _, tags = channel.partition("/meta/")
    said = dict(tag.split("-", 1) for tag in tags.split("/") if "-" in tag)
    if re.search(SET, f"{said.get('type', '')} {said.get('cmd', '')}"):
        return Meaning("")
    side = re.search(r"-\d*([PS])(?![A-Za-z])", node)
    port, quantity = bool(side) and side[1] == "P", said.get("qty", "")  # type: ignore[index]
    if quantity == "angle" and re.search(RUDDERS, node):
        return Meaning("delta" if not side else "delta_port" if port else "delta_starboard")
    if quantity in ("rotational.frequency", "angular.velocity"):
        shaft, engine = re.search(SHAFTS, node), re.search(ENGINES, node)
        return Meaning("n_2" if port else "n") if shaft else Meaning("", may_be=ENGINE if engine else "")
    known = VIS.get(quantity, "")
    return Meaning(known, "deg" if known in ("latitude", "longitude") else "")


def is_signal_k(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` are deltas."""
    return mostly(content, DELTA)


def is_iso19848(content: bytes) -> bool:
    """Whether ``content`` begins as a time series package."""
    return content.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"{") and b'"Package"' in content[:4096]


def read_signal_k(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the deltas in ``path``, of the own ship; each source of each path has times of its own.

    chosen: the map. Raises UserError where several ships could be the own one, two sources say the same, and headings
    are magnetic without a variation.
    """
    values, own, damaged = [], "", 0
    for line in read_bytes(path).decode("utf-8", "replace").splitlines():
        try:
            document = json.loads(line) if line.strip() else {}
            own = str(document.get("self", own))
            values += list(_values_of(document))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            damaged += 1
    ships = Counter(context for context, *_ in values)
    own = own if own in ships else _own_ship(path, values, ships)
    kept = [value[1:] for value in values if value[0] == own]
    heard, gears, others = Heard(), dict[str, str](), Counter[str]()
    for t, name, source, value in kept:
        header = f"{name} ({source})"
        if gear := GEAR.fullmatch(name):
            gears[gear[1]] = str(value).lower()
        elif engine := REVOLUTIONS.fullmatch(name):
            ahead = -1.0 if gears.get(engine[1]) == "reverse" else 1.0
            heard.say(header, t, header, ahead * number(value), Meaning("", "Hz", ENGINE))
        elif name in PATHS:
            at = f"navigation.position ({source})" if ".position." in name else header  # both of one source
            heard.say(at, t, header, value, PATHS[name], rank=int("Magnetic" in name))
        else:
            others[name] += 1
    accounts = [Account(name, count, (), NOT_READ) for name, count in others.items()]
    accounts += [Account(ship, count, (), "another ship") for ship, count in ships.items() if ship != own]
    said = [Message(f"Signal K: {len(kept)} values of {own or 'the own ship'}", "signal_k")]
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
    own = sorted({context for context, _, name, *_ in values if name.startswith(inner)} or ships)
    if len(own) != 1:
        known = ", ".join(own[:4])
        raise Conflict(f"{path}: values of several ships ({known}) and none is named as self; keep the lines of one")
    return own[0]


def read_iso19848(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the time series package in ``path``, of its tabular and event data.

    chosen: the map. Raises UserError where it is damaged or no package.
    """
    heard, codes = Heard(), Counter[str]()
    try:
        package = json.loads(read_bytes(path).decode("utf-8-sig", "replace"))["Package"]
        ship = str(package.get("Header", {}).get("ShipID", ""))
        said = [value for data in _listed(package["TimeSeriesData"]) for value in _data_of(data)]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        why = " ".join(f"{type(error).__name__} {error}".split())[:100]
        raise BadValue(f"{path}: is cut off, damaged or no time series package of ISO 19848 ({why})") from None
    codes.update(code for *_, code in said)
    good = codes.most_common(1)[0][0] if codes else ""
    for name, channel, t, value, code in said:
        if code == good:
            means = vis_meaning(channel)
            heard.say(name or channel, t, channel, value, means if means.quantity or means.may_be else None)
    accounts = [
        Account(f"quality {c or 'none'}", n, (), f"most have {good or 'none'}") for c, n in codes.items() if c != good
    ]
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
    found = {header: means for header in table.headers if (means := vis_meaning(header)) != Meaning("")}
    return replace(table, means=table.means | found) if found else table
