"""NMEA 0183 logs (also with a logger's own time before each sentence), by pynmea2, as a table with a row per time."""

from __future__ import annotations

import datetime
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cases.importing.nmea_times import Sentence, logged_time, moments
from cases.importing.raw_table import Clock, RawTable, raw_table
from cases.io.files import read_bytes
from mmg.errors import NotInstalled
from mmg.messages import Message

SENTENCE = re.compile(r"[$!][A-Z]{2}[A-Z]{3},[^*\r\n]*(?:\*[0-9A-Fa-f]{2})?")
UNITS = {
    "time": "s", "latitude": "deg", "longitude": "deg", "sog": "kn", "cog": "deg", "heading": "deg", "rot": "deg/min",
    "rudder": "deg", "rudder_starboard": "deg", "rudder_port": "deg", "rpm": "rpm", "rpm_starboard": "rpm",
    "rpm_port": "rpm", "apparent_wind_speed": "m/s", "apparent_wind_direction": "deg", "true_wind_speed": "m/s",
    "twa": "deg", "HDG-magnetic": "deg", "RPM-E": "rpm", "RPM-E_starboard": "rpm", "RPM-E_port": "rpm",
}  # fmt: skip
"""Columns of the table and their units; all that other sentences say is left out."""
INSTEAD = (
    ("rudder", ("rudder_starboard", "rudder_port"), ()),
    ("rpm", ("rpm_starboard", "rpm_port"), ("RPM-E", "RPM-E_starboard", "RPM-E_port")),
    ("heading", ("HDG-true",), ("HDG-magnetic",)),
)
"""A column, those of which one alone is it, and those that are left out where it is known."""
WIND = {"K": 1 / 3.6, "M": 1.0, "N": 1852.0 / 3600.0, "S": 1609.344 / 3600.0}
"""Factor to m/s of the units of MWV."""
KINDS = ("RMC", "GGA", "GLL", "ZDA", "VTG", "HDT", "THS", "HDG", "HDM", "ROT", "RSA", "RPM", "MWV")
"""Sentences that are read."""
RECEIVER = ("latitude", "longitude", "sog", "cog")
"""Columns that a receiver says in sentences of several types."""
NO_FIX = ("0", "None", "")
"""Qualities of GGA."""


def is_nmea(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` hold a sentence."""
    lines = [line for line in content[:8192].decode("latin-1").splitlines() if line.strip()]
    return len(lines) > 2 and sum(bool(SENTENCE.search(line)) for line in lines) > 0.5 * len(lines)


def read_nmea(path: Path) -> RawTable:
    """The table of the log ``path``: a row for each moment between its first and last time at which something was said.

    Sentences whose checksum is wrong are left out and counted, and so are those that say of themselves that they are
    not valid. Raises UserError where pynmea2 is missing, where no sentence holds a date and a time, and where the times
    run backwards.
    """
    import numpy as np
    import pandas as pd

    said, notices = _said(path)
    t = np.round(moments(said, str(path)), 3)
    timed = t[[sentence.valid and sentence.time is not None for sentence in said]]
    first, last = float(timed.min()), float(timed.max())
    chosen, doubled = _one_source(said)
    rows: dict[float, dict[str, float]] = {}
    for when, sentence in zip(t.tolist(), said, strict=True):
        values = {
            name: v for name, v in sentence.values.items() if chosen.get(name, sentence.source) == sentence.source
        }
        if values and first <= when <= last:
            rows.setdefault(when, {"time": when}).update(values)
    frame = pd.DataFrame([rows[when] for when in sorted(rows)])
    for name, sensors, unsure in INSTEAD:
        only = [sensor for sensor in sensors if sensor in frame]
        if name not in frame and len(only) == 1:
            frame = frame.rename(columns={only[0]: name})
        if len(only) > 1 or name in frame:
            frame = frame.drop(columns=[c for c in frame if c in unsure])
    names = [name for name in UNITS if name in frame]
    units = [UNITS[name] for name in names]
    table = raw_table(path, str(path), names, units, frame[names].astype(object), [*notices, *doubled])
    return replace(table, clock=Clock(np.array(sorted(rows)), True, "time", "UTC of the receiver"))


def _one_source(said: Sequence[Sentence]) -> tuple[dict[str, str], list[Message]]:
    """The source that says a column most often, of those that several say but no receiver, and what is not used."""
    counts: dict[str, Counter[str]] = {}
    for sentence in said:
        for name in sentence.values:
            if name not in RECEIVER:
                counts.setdefault(name, Counter())[sentence.source] += 1
    chosen = {name: own.most_common(1)[0][0] for name, own in counts.items()}
    others = [(name, source) for name, own in counts.items() for source in own if source != chosen[name]]
    words = (
        f"{name} is taken from {chosen[name]}, not from {source}, which says it less often" for name, source in others
    )
    return chosen, [Message(word, "doubled") for word in words]


def _said(path: Path) -> tuple[list[Sentence], list[Message]]:
    """What the sentences of the log ``path`` say, in its order, and how many of them."""
    try:
        import pynmea2
    except ImportError:
        raise NotInstalled(f"{path}: NMEA logs need pynmea2; pip install 'mmg-ident[import]'") from None

    class THS(pynmea2.TalkerSentence):  # type: ignore[misc]  # pynmea2 has none, and finds this one by its name
        fields = (("True heading", "heading"), ("Mode", "mode"))

    said: list[Sentence] = []
    kinds, silent, damaged = Counter[str](), Counter[str](), 0
    for line in read_bytes(path).decode("latin-1").splitlines():
        match = SENTENCE.search(line)
        if match is None:
            damaged += bool(line.strip())
            continue
        try:
            sentence = pynmea2.parse(match[0], check=False) if "*" not in match[0] else pynmea2.parse(match[0])
            kind = str(getattr(sentence, "sentence_type", ""))
            found = _of(sentence, kind)
        except (pynmea2.ParseError, ValueError, TypeError, AttributeError):
            damaged += 1
            continue
        if found is not None:
            said.append(replace(found, logged=logged_time(line[: match.start()])))
            (kinds if found.values or kind == "ZDA" else silent)[kind] += 1
    notices = [Message(f"NMEA 0183: {', '.join(f'{c} {k}' for k, c in kinds.items())}", "nmea")]
    if silent:
        words = ", ".join(f"{count} {kind}" for kind, count in silent.items())
        notices.append(
            Message(f"sentences that are empty or not valid by their status, left out: {words}", "nmea_void")
        )
    if damaged:
        notices.append(Message(f"lines that are damaged or no sentences, left out: {damaged}", "nmea_damaged"))
    return said, notices


def _of(sentence: Any, kind: str) -> Sentence | None:
    """What a sentence of a ``kind`` says, nothing where it is not valid; None of a kind that says nothing of use."""
    if kind not in KINDS:
        return None
    source = f"{sentence.talker}{kind}"
    if kind == "RPM":
        source += f"{sentence.source}{sentence.engine_no}"
    elif kind == "MWV":
        source += str(sentence.reference)
    time, stamp = None, getattr(sentence, "timestamp", None)
    if stamp is not None:
        time = 3600.0 * stamp.hour + 60.0 * stamp.minute + stamp.second + 1e-6 * stamp.microsecond
    if not _valid(sentence, kind):
        return Sentence(source, time=time, valid=False)
    values = _values(sentence, kind).items()
    said = {name: float(value) for name, value in values if value is not None and str(value) != ""}
    date = getattr(sentence, "datestamp", None)
    if kind == "ZDA" and sentence.year:
        date = datetime.date(int(sentence.year), int(sentence.month), int(sentence.day))
    return Sentence(source, said, time, date and date.toordinal() - datetime.date(1970, 1, 1).toordinal())


def _valid(sentence: Any, kind: str) -> bool:
    """Whether a sentence is valid by what it says of itself: a fix, a status A, no mode N (no fix) or V."""
    if kind == "GGA":
        return str(sentence.gps_qual) not in NO_FIX
    modes = {str(getattr(sentence, name, None)) for name in ("faa_mode", "mode_indicator", "mode")}
    return str(getattr(sentence, "status", None)) in ("A", "None") and not modes & {"N", "V"}


def _values(sentence: Any, kind: str) -> dict[str, Any]:
    """What a valid sentence of a ``kind`` says, by column; None or "" where a field is empty."""
    out: dict[str, Any] = {}
    if kind in ("RMC", "GGA", "GLL") and sentence.lat:
        out = {"latitude": sentence.latitude, "longitude": sentence.longitude}
    if kind == "RMC":
        out |= {"sog": sentence.spd_over_grnd, "cog": sentence.true_course}
    elif kind == "VTG":
        out = {"sog": sentence.spd_over_grnd_kts, "cog": sentence.true_track}
    elif kind in ("HDT", "THS"):
        out = {"heading": sentence.heading}
    elif kind in ("HDG", "HDM"):
        out = _compass(sentence)
    elif kind == "ROT":
        out = {"rot": sentence.rate_of_turn}
    elif kind == "RSA":
        status = str(sentence.rsa_starboard_status or ""), str(sentence.rsa_port_status or "")
        if status[0] == "A" or not any(status):
            out = {"rudder_starboard": sentence.rsa_starboard}
        if status[1] == "A":
            out["rudder_port"] = sentence.rsa_port
    elif kind == "RPM":
        side = ("_port", "_starboard")[int(sentence.engine_no) % 2] if int(sentence.engine_no or 0) else ""
        out = {f"{'rpm' if sentence.source == 'S' else 'RPM-E'}{side}": sentence.speed}  # odd numbers are starboard
    elif kind == "MWV" and sentence.wind_speed_units in WIND:
        speed = float(sentence.wind_speed) * WIND[sentence.wind_speed_units]
        frame = ("apparent_wind_speed", "apparent_wind_direction")
        frame = frame if sentence.reference == "R" else ("true_wind_speed", "twa")  # both from the bow
        out = dict(zip(frame, (speed, sentence.wind_angle), strict=True))
    return out


def _compass(sentence: Any) -> dict[str, Any]:
    """The heading of HDG, true where it has a variation: that and the deviation are added, easterly ones positive."""
    if sentence.heading is None or getattr(sentence, "variation", None) is None:
        return {"HDG-magnetic": sentence.heading}
    parts = ((sentence.deviation or 0, sentence.dev_dir), (sentence.variation, sentence.var_dir))
    return {"HDG-true": (sentence.heading + sum(-part if way == "W" else part for part, way in parts)) % 360}
