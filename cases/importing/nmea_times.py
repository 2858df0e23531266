"""When each sentence of an NMEA log was said: those of a receiver tell it, the others lie between them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cases.importing.clocks import check_clock
from cases.importing.raw_table import Clock
from mmg.errors import Missing

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
