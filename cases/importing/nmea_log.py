"""NMEA 0183 logs (also with a logger's own time before each sentence), by pynmea2, as a table with a row per time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from cases.importing.raw_table import RawTable, raw_table
from cases.io.files import read_bytes
from mmg.errors import UserError
from mmg.messages import Message

SENTENCE = re.compile(r"[$!][A-Z]{2}[A-Z]{3},[^*\r\n]*(?:\*[0-9A-Fa-f]{2})?")
UNITS = {
    "time": "", "latitude": "deg", "longitude": "deg", "sog": "kn", "cog": "deg", "heading": "deg", "rot": "deg/min",
    "rudder_starboard": "deg", "rudder_port": "deg", "rudder": "deg", "rpm": "rpm", "rpm_port": "rpm",
    "apparent_wind_speed": "m/s", "apparent_wind_direction": "deg", "true_wind_speed": "m/s", "true_wind_angle": "deg",
}  # fmt: skip
"""Columns of the table and their units; all that other sentences say is left out."""
WIND = {"K": 1 / 3.6, "M": 1.0, "N": 1852.0 / 3600.0}
"""Factor to m/s of the units of MWV."""


def is_nmea(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` hold a sentence."""
    lines = [line for line in content[:8192].decode("latin-1").splitlines() if line.strip()]
    return len(lines) > 2 and sum(bool(SENTENCE.search(line)) for line in lines) > 0.5 * len(lines)


def read_nmea(path: Path) -> RawTable:
    """The table of the log ``path``: a row for each time of its receiver, with what was said until the next time.

    Sentences whose checksum is wrong are left out and counted. Raises UserError where pynmea2 is missing, and where no
    sentence holds a date and a time.
    """
    try:
        import pynmea2
    except ImportError:
        raise UserError(f"{path}: NMEA logs need pynmea2; pip install 'mmg-ident[import]'") from None
    import pandas as pd

    rows: list[dict[str, Any]] = []
    damaged, kinds, day, fix = 0, dict[str, int](), None, True
    for line in read_bytes(path).decode("latin-1").splitlines():
        match = SENTENCE.search(line)
        if match is None:
            damaged += bool(line.strip())
            continue
        try:
            sentence = pynmea2.parse(match[0], check=False) if "*" not in match[0] else pynmea2.parse(match[0])
            kind = str(getattr(sentence, "sentence_type", ""))
            day = _day(sentence, kind) or day
            stamp = getattr(sentence, "timestamp", None)
            if kind in ("RMC", "GGA", "ZDA", "GLL") and stamp is not None:
                when = f"{day or '0001-01-01'} {stamp.strftime('%H:%M:%S.%f')}"
                if not rows or rows[-1]["time"] != when:
                    rows.append({"time": when})
            if kind == "GGA":
                fix = str(sentence.gps_qual) not in ("0", "None", "")
            if rows:
                said = _values(sentence, kind, fix)
                rows[-1].update(said)
                kinds[kind] = kinds.get(kind, 0) + bool(said)
        except (pynmea2.ParseError, ValueError, TypeError, AttributeError):
            damaged += 1
    if not rows or day is None:
        raise UserError(f"{path}: no NMEA sentence holds a date and a time (RMC or ZDA), so its rows have no clock")
    for row in rows:
        row["time"] = row["time"].replace("0001-01-01", day)
    names = [name for name in UNITS if any(name in row for row in rows)]
    frame = pd.DataFrame(rows)[names].astype(object)
    notices = [Message(f"NMEA 0183: {', '.join(f'{c} {k}' for k, c in kinds.items() if c)}", "nmea")]
    if damaged:
        notices.append(Message(f"lines that are damaged or no sentences, left out: {damaged}", "nmea_damaged"))
    table = raw_table(path, str(path), names, [UNITS[name] for name in names], frame, notices)
    return table


def _day(sentence: Any, kind: str) -> str | None:
    if kind == "RMC" and getattr(sentence, "datestamp", None):
        return str(sentence.datestamp.isoformat())
    if kind == "ZDA" and sentence.year:
        return f"{int(sentence.year):04d}-{int(sentence.month):02d}-{int(sentence.day):02d}"
    return None


def _values(sentence: Any, kind: str, fix: bool) -> dict[str, Any]:
    """What a sentence says, by column; positions without a fix say nothing."""
    out: dict[str, Any] = {}
    if kind in ("RMC", "GGA", "GLL"):
        valid = fix if kind == "GGA" else str(getattr(sentence, "status", "A")) == "A"
        if valid and sentence.lat:
            out = {"latitude": sentence.latitude, "longitude": sentence.longitude}
        if kind == "RMC" and valid:
            out |= {"sog": sentence.spd_over_grnd, "cog": sentence.true_course}
    elif kind == "VTG":
        out = {"sog": sentence.spd_over_grnd_kts, "cog": sentence.true_track}
    elif kind in ("HDT", "THS"):
        out = {"heading": sentence.heading if kind == "HDT" else sentence.data[0]}
    elif kind == "ROT" and str(sentence.status) == "A":
        out = {"rot": sentence.rate_of_turn}
    elif kind == "RSA":
        side = "rudder_starboard" if str(sentence.rsa_port_status or "") == "A" else "rudder"
        out = {side: sentence.rsa_starboard}
        if side != "rudder":
            out["rudder_port"] = sentence.rsa_port
    elif kind == "RPM" and str(sentence.status) == "A":  # odd numbers are starboard shafts
        number = int(sentence.engine_no or 0)
        out = {"rpm_port" if number and number % 2 == 0 else "rpm": sentence.speed}
    elif kind == "MWV" and str(sentence.status) == "A":
        pair = ("apparent_wind_speed", "apparent_wind_direction")
        pair = pair if sentence.reference == "R" else ("true_wind_speed", "true_wind_angle")
        out = {pair[0]: float(sentence.wind_speed) * WIND[sentence.wind_speed_units], pair[1]: sentence.wind_angle}
    return {name: float(value) for name, value in out.items() if value is not None and str(value) != ""}
