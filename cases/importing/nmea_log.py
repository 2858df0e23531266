"""NMEA 0183 logs (also with a logger's own time before each sentence), by pynmea2, as a table with a row per time."""

from __future__ import annotations

import datetime
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.clocks import check_clock
from cases.importing.raw_table import Clock, RawTable, raw_table
from cases.io.files import read_bytes
from mmg.errors import Missing, NotInstalled
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


DAY = 86400.0
"""Seconds."""
OF_DAY = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})[.,](\d+)")
SINCE_1970 = re.compile(r"(?<!\d)(\d{10})(?:[.,](\d+)|(\d{3}))(?!\d)")
"""Times that a logger writes before a sentence, with parts of a second: whole ones tell less than the order does."""


@dataclass(frozen=True)
class Sentence:
    """What a sentence says: ``values`` by column, none where it is not valid; source: its talker, type and instrument;
    time: of the day [s], and day: since 1970, where it has them; valid: by its own status; logged: by the logger's own
    clock, of the day [s]."""

    source: str
    values: dict[str, float] = field(default_factory=dict)
    time: float | None = None
    day: int | None = None
    valid: bool = True
    logged: float | None = None


def logged_time(text: str) -> float | None:
    """The time of the day [s] in the ``text`` before a sentence, or None."""
    if match := OF_DAY.search(text):
        return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(f"{match[3]}.{match[4]}")
    if match := SINCE_1970.search(text):
        return int(match[1]) % DAY + float(f"0.{match[2] or match[3]}")
    return None


def moments(said: Sequence[Sentence], where: str) -> np.ndarray:
    """Seconds since 1970 in UTC (N,) at which the N sentences of a log were ``said``, in its order.

    A sentence with a time has its own; one that is not valid only where that lies between those of valid ones. Others
    lie by the logger's clock, or, without one, at even steps from each time to the next, each source by itself: the
    first of them at the time before it, or, where the log begins with this source and does not end with it, the last of
    them at the time behind it. where: for messages. Raises UserError where no sentence has a date, for a source whose
    times run backwards, and where all stand still.
    """
    sources = np.array([sentence.source for sentence in said])
    timed = np.array([i for i, sentence in enumerate(said) if sentence.time is not None], dtype=int)
    stamps = _stamps([said[i] for i in timed], where)
    good = np.array([said[i].valid for i in timed], dtype=bool)
    for source in np.unique(sources[timed]):
        if (np.diff(own := stamps[good & (sources[timed] == source)]) < 0).any():
            check_clock(Clock(own, True, "time", ""), where)
    before = np.maximum.accumulate(np.where(good, stamps, -np.inf))
    behind = np.minimum.accumulate(np.where(good, stamps, np.inf)[::-1])[::-1]
    good |= (before <= stamps) & (stamps <= behind) & np.isfinite(before) & np.isfinite(behind)
    timed, stamps = timed[good], stamps[good]
    latest = np.maximum.accumulate(stamps)  # sources may be late against each other
    check_clock(Clock(latest, True, "time", ""), where)
    new = np.diff(latest, prepend=-np.inf) > 0
    step = float(np.median(np.diff(stamps[new])))
    edges = np.concatenate([[stamps[0] - step], stamps[new], [latest[-1] + step]])
    out = np.empty(len(said))
    for source in np.unique(sources):
        rows = np.flatnonzero(sources == source)
        out[rows] = _between(edges, np.searchsorted(timed[new], rows, "right"))
    logged = np.array([np.nan if sentence.logged is None else sentence.logged for sentence in said])
    out = _by_logger(out, logged, timed, stamps, 0.5 * step)
    out[timed] = stamps
    return out


def _stamps(timed: Sequence[Sentence], where: str) -> np.ndarray:
    """Seconds since 1970 of sentences with a time (F,): one without a date is of the day that brings it nearest to the
    one before."""
    last = next((DAY * s.day + s.time for s in timed if s.day is not None and s.time is not None), None)
    if last is None:
        raise Missing(f"{where}: no NMEA sentence holds a date and a time (RMC or ZDA), so its rows have no clock")
    out = np.empty(len(timed))
    for i, sentence in enumerate(timed):
        time = sentence.time or 0.0
        day = sentence.day if sentence.day is not None else round((last - time) / DAY)
        out[i] = DAY * day + time
        last = float(out[i]) if sentence.valid else last
    return out


def _between(edges: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Times (N,) of the sentences of one source, each behind that of the ``edges`` (E,) [s] at its ``after`` (N,).

    Where a span between edges holds fewer of them than others, for its length, the log has a gap behind them.
    """
    spans = np.diff(edges)
    counts = np.bincount(after, minlength=len(spans))
    steps = spans / np.maximum(counts, 1)
    inner = np.flatnonzero(counts[1:-1]) + 1
    usual = float(np.median(steps[inner])) if len(inner) else float(spans[0])
    nth = np.arange(len(after)) - (np.cumsum(counts) - counts)[after]
    leads = bool(counts[0] and not counts[-1])
    out = edges[after] + (nth + leads) * np.minimum(steps, usual)[after]
    return np.where(leads & (nth == counts[after] - 1), edges[after + 1], out)


def _by_logger(out: np.ndarray, logged: np.ndarray, timed: np.ndarray, stamps: np.ndarray, most: float) -> np.ndarray:
    """Times (N,) by the logger's clock ``logged`` (N,) [s of the day], of days as ``out`` (N,) has them.

    Against the ``stamps`` (F,) of the sentences ``timed`` (F,) it may be late, but must not change by over ``most`` [s]
    from one to the next: then it is no clock, and ``out`` stays.
    """
    known = np.isfinite(logged[timed])
    late = np.unwrap((logged[timed] - stamps)[known], period=DAY)
    if len(late) < 2 or np.median(np.abs(np.diff(late))) > most:
        return out
    t = logged - np.interp(np.arange(len(logged)), timed[known], late)
    t += DAY * np.round((out - t) / DAY)
    return np.where(np.isfinite(t), t, out)
