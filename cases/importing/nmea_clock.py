"""When each sentence of an NMEA log was said: by its own time, by the logger's stamp, or by its place in the order."""

from __future__ import annotations

import datetime
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import median_filter, percentile_filter

from cases.importing.clocks import DAY, EPOCHS, check_clock, within_stamps
from cases.importing.raw_table import Clock
from cases.importing.series import STAMP, seconds_of
from mmg.errors import Missing
from mmg.messages import Message

ROLLOVER = 1024 * 7 * DAY  # Seconds after which the weeks of GPS begin anew
FIRST_DAY = 14610  # Days since 1970 of 1 January 2010: earlier logs are rather of a receiver whose weeks began anew
UNSET = 30 * DAY  # A clock that jumps so far [s] was not set before, or is not after
COLD = 0.1  # Share of a log in which a receiver may still set its clock. Set by hand.
# Steps by which times of a source go back at most: two receivers behind one talker are late against each other.
BACK = 2.0  # set by hand
LATE = 0.5  # s by which sentences of a receiver come after their fix at most. Set by hand.
QUARTER = 900.0  # s; the zones of clocks differ from UTC by multiples of it (IANA time zone database, 2025)
JITTER = 0.1  # Scatter of delays, in the step of a source, above which they scatter. Set by hand.
UNSTEADY = 0.2  # Share of delays that scatter from which all do. Set by hand.
EARLY = 80  # Percentile of the delays of fixes, from late to early, at which one counts as not late. Set by hand.
# Fixes and stamps over which delays are compared, and fixes over which the step of a source is taken: rather too small
# than too large by the sentences that were lost, since delays grow with each of them then and only grow.
FIXES, STAMPS, LAG = 21, 21, 10  # set by hand
# A number that may count since 1970, in seconds or parts of them.
EPOCH = re.compile(r"(?<![\d.])(\d{10}|\d{13}|\d{16}|\d{19})(?:\.\d+)?(?![\d:])")


@dataclass
class Series:
    """The sentences of one source in their order, also those that are not valid: ``at`` their numbers among all
    sentences of the log, the ``time`` of the day that each holds [s], and the ``values`` that it says, by column."""

    talker: str
    kind: str
    at: list[int] = field(default_factory=list)
    time: list[float] = field(default_factory=list)
    values: list[dict[str, float]] = field(default_factory=list)
    _columns: dict[str, np.ndarray] = field(default_factory=dict)

    def column(self, name: str) -> np.ndarray:
        """The numbers (N,) of a column, NaN where a sentence does not say it; of a series that is complete."""
        if name not in self._columns:
            self._columns[name] = np.array([values.get(name, np.nan) for values in self.values])
        return self._columns[name]


def logger_of(texts: Sequence[str]) -> Clock:
    """The clock of the logger that wrote the ``texts`` (L,) beside the sentences, NaN where one has no stamp: of the
    kind that most of them hold, "epoch" or "date", or "day" of times since the day on which it began; "" of none."""
    read = [_stamp(text) for text in texts]
    kind, count = Counter(kind for kind, _, _ in read).most_common(1)[0] if read else ("", 0)
    if not kind or count <= 0.5 * len(read):
        return Clock(np.full(len(read), np.nan), False, "", "")
    t = np.array([t if each == kind else np.nan for each, t, _ in read])
    if kind == "day":  # over midnight
        known = np.isfinite(t)
        t[known] = np.unwrap(t[known], period=DAY)
    return Clock(t, kind != "day", kind, "of the logger", all(zoned for each, _, zoned in read if each == kind))


def _stamp(text: str) -> tuple[str, float, bool]:
    """Kind, seconds and whether it names its zone, of the stamp in a ``text``."""
    if match := EPOCH.search(text):
        number = float(match[0])
        for _, low, high, factor, zero, _ in EPOCHS:
            if zero == 0.0 and low <= number < high:
                return "epoch", number * factor, True
    try:
        if match := STAMP.search(text):
            return "date" if match[1] else "day", seconds_of(match), bool(match[7])
    except ValueError:  # 31 February
        pass
    return "", np.nan, False


def moments_of(
    by_name: dict[str, Series], logger: Clock, where: str, zone_hours: float = 0.0
) -> tuple[dict[str, np.ndarray], Clock, list[Message]]:
    """When the sentences of each of the series ``by_name`` were said [s], (N,), NaN where it is not known; by which
    clock, without its times; and what was done.

    logger: its stamps of all sentences; where: for messages; zone_hours: of its stamps without a zone. Sentences with a
    time lie there. Others lie at the logger's stamps, less what its clock is ahead, or else by the order: each source
    evenly. Raises UserError where neither a sentence nor the logger tells a time, and where times run backwards.
    """
    notices: list[Message] = []
    # Times of valid sentences, then the right day, then void ones between them: they tell when others were said.
    stamps = {name: _own_times(series) for name, series in by_name.items()}
    stamps, absolute = _set_clocks(by_name, stamps, logger, where, notices)
    stamps = {name: _with_void(series, stamps[name]) for name, series in by_name.items()}
    fix_at, fix_t = _known(by_name, stamps, by_name)
    logged, offset, latency = logger.t, None, 0.0
    if len(fix_at) > 1:
        latest = np.maximum.accumulate(fix_t)  # sources may be late against each other
        check_clock(Clock(latest, True, "time", ""), where)
        new = np.diff(latest, prepend=-np.inf) > 0  # of sentences of one time the first is the nearest to its fix
        fix_at, fix_t, words = fix_at[new], fix_t[new], "UTC of the receiver"
        offset, latency = _clock_offset(logged, fix_at, fix_t)
    elif np.isfinite(logged).sum() > 1:
        logged = logged - 3600.0 * zone_hours * (logger.header == "date" and not logger.zoned)
        fix_at = np.flatnonzero(np.isfinite(logged))
        check_clock(Clock(logged[fix_at], True, "of the logger", ""), where)
        fix_at = fix_at[np.diff(logged[fix_at], prepend=-np.inf) > 0]
        fix_t, words, absolute = logged[fix_at], logger.words, logger.absolute
        offset = np.zeros(len(logged)) if _fine(logged) else None
    else:
        raise Missing(f"{where}: no sentence holds a time (RMC, GGA, GLL, ZDA), and no line a stamp of its logger")
    if offset is not None and latency:
        words_of = f"the logger's clock is right; sentences of the receiver come {latency:.2g} s after their fix"
        notices.append(Message(words_of, "logger_clock"))
    receivers = {s.talker for name, s in by_name.items() if np.isfinite(stamps[name]).any()}
    for name, series in by_name.items():
        if np.isfinite(stamps[name]).any():
            continue
        at = np.array(series.at)
        if offset is not None and np.isfinite(logged[at]).mean() > 0.5:
            t = (logged - offset)[at] - (latency if series.talker in receivers else 0.0)
            known = np.isfinite(t)
            stamps[name] = np.maximum.accumulate(np.interp(at, at[known], t[known]))
        else:  # nothing beyond the fixes tells how the order goes on
            t = _by_order(at, fix_at, fix_t)
            stamps[name] = np.where((t > fix_t[0] - 1e-3) & (t < fix_t[-1] + 1e-3), t, np.nan)
    return stamps, Clock(np.zeros(0), absolute, "time", words), notices


def _known(
    by_name: dict[str, Series], stamps: dict[str, np.ndarray], names: Iterable[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (M,) of the sentences of some series whose ``stamps`` are known, in their order, and these [s]."""
    at = np.concatenate([np.zeros(0, dtype=int), *(by_name[name].at for name in names)])
    t = np.concatenate([np.zeros(0), *(stamps[name] for name in names)])
    order = np.argsort(at)
    order = order[np.isfinite(t[order])]
    return at[order].astype(int), t[order]


def _own_times(series: Series) -> np.ndarray:
    """Seconds since 1970 (N,) of the valid sentences of a ``series`` by their own times, NaN for others; those without
    a date are of the day that brings them nearest to the one before, and of day 0 where none has a date."""
    time, day = np.array(series.time), series.column("day")
    known = np.flatnonzero(np.isfinite(time) & np.array([bool(values) for values in series.values]))
    out = np.full(len(time), np.nan)
    if len(known):
        out[known] = np.unwrap(time[known], period=DAY)
        begin = day[known] - np.round((out[known] - time[known]) / DAY)  # the day on which the series began
        dated = np.flatnonzero(np.isfinite(begin))
        if len(dated):
            begin = median_filter(begin[dated], size=5, mode="nearest")  # a date may change a second late
            out[known] += DAY * begin[np.maximum(np.searchsorted(dated, np.arange(len(known)), "right") - 1, 0)]
        place = [series.column(name)[known] for name in ("latitude", "longitude")]
        if (np.diff(out[known]) == 0).any() and _one_path(place[1] + 1j * place[0]):
            out[known] = within_stamps(out[known], place)[0]
    return out


def _one_path(place: np.ndarray) -> bool:
    """Whether positions (N,) in their order lie along a path, not on two in turn: halfway between their neighbours."""
    place = place[np.isfinite(place)]
    off = np.abs(place[1:-1] - 0.5 * (place[:-2] + place[2:]))
    return len(off) > 0 and bool(np.median(off) < 0.25 * np.median(np.abs(np.diff(place))))  # 0.25: set by hand


def _with_void(series: Series, t: np.ndarray) -> np.ndarray:
    """The times ``t`` (N,) [s] of a ``series`` with those of sentences that are not valid, where they lie between those
    of valid ones: they tell when others were said."""
    known = np.isfinite(t)
    if known.sum() < 2:
        return t
    time, rows = np.array(series.time), np.arange(len(t))
    time = time + DAY * np.round((np.interp(rows, rows[known], t[known]) - time) / DAY)
    low = np.maximum.accumulate(np.where(known, t, -np.inf))  # times of the valid ones before, and behind
    high = np.minimum.accumulate(np.where(known, t, np.inf)[::-1])[::-1]
    between = (low > -np.inf) & (low <= time) & (time <= high) & (high < np.inf)
    return np.where(between & ~known, time, t)


def _set_clocks(
    by_name: dict[str, Series], stamps: dict[str, np.ndarray], logger: Clock, where: str, notices: list[Message]
) -> tuple[dict[str, np.ndarray], bool]:
    """The ``stamps`` on the days that dated series or the logger say, without those of clocks that were not set, and
    whether the day is known."""
    dated = {name for name, s in by_name.items() if np.isfinite(s.column("day")).any()}
    logged = logger.t if logger.absolute else np.full(len(logger.t), np.nan)
    at, t = _known(by_name, stamps, dated)
    if len(t):
        typical = float(np.median(t))
        weeks = np.nanmedian(logged[at] - typical) / ROLLOVER if np.isfinite(logged[at]).any() else 0.0
        early = round(weeks) if abs(weeks - round(weeks)) * ROLLOVER < UNSET else 0  # other differences: other faults
        for name in dated:  # weeks that begin anew within the log
            stamps[name] = stamps[name] + ROLLOVER * (np.round((typical - stamps[name]) / ROLLOVER) + early)
        if early:
            words = f"dates of the receiver are {1024 * early} weeks early by the logger's stamps, and are moved"
            notices.append(Message(words, "week_rollover"))
        elif typical < FIRST_DAY * DAY:
            day = datetime.datetime.fromtimestamp(max(typical, 0.0), datetime.timezone.utc).date()
            words = f"the log is of {day} by its receiver, whose weeks may have begun anew: then it is 1024 weeks later"
            notices.append(Message(words, "date_early"))
    anchor_at, anchor_t = _known(by_name, stamps, dated)
    if not len(anchor_at):
        anchor_at = np.flatnonzero(np.isfinite(logged))
        anchor_t = logged[anchor_at]
    if len(anchor_at):  # the stretch without jumps of UNSET that holds most
        stretch = np.cumsum(np.abs(np.diff(anchor_t, prepend=anchor_t[:1])) > UNSET)
        kept = stretch == np.bincount(stretch).argmax()
        anchor_at, anchor_t = anchor_at[kept], anchor_t[kept]
    unset = 0
    for name, series in by_name.items():
        at, t = np.array(series.at), stamps[name].copy()
        known = np.isfinite(t)
        if len(anchor_at) and known.any():
            last = np.maximum(np.searchsorted(anchor_at, at, "right") - 1, 0)  # the anchor before each sentence
            if name not in dated:  # on the day that brings it nearest to the anchor
                nearest = np.minimum(np.searchsorted(at[known], anchor_at), known.sum() - 1)
                t = t + (DAY * np.round((anchor_t - t[known][nearest]) / DAY))[last]
            far = known & (np.abs(t - anchor_t[last]) > UNSET)
            back = np.flatnonzero(known & ~far)
            turns = np.flatnonzero(np.diff(t[back]) < 0)
            if len(turns) and turns[-1] + 1 <= COLD * len(back):  # times before the receiver set its clock
                far[back[: turns[-1] + 1]] = True
            t[far] = np.nan
            unset += int(far.sum())
            step = np.diff(t[np.isfinite(t)])
            if len(step) and step.min() < -BACK * np.median(np.abs(step)):
                check_clock(Clock(t, True, "time", ""), where)
        stamps[name] = t
    if unset:
        notices.append(Message(f"{unset} sentences of a receiver whose clock was not set are left out", "clock_unset"))
    return stamps, bool(len(anchor_at))


def _fine(t: np.ndarray) -> bool:
    """Whether stamps (L,) [s] tell parts of a second."""
    return len(np.unique(np.round(t[np.isfinite(t)] % 1.0, 3))) > 1


def _clock_offset(logged: np.ndarray, fix_at: np.ndarray, fix_t: np.ndarray) -> tuple[np.ndarray | None, float]:
    """Seconds (L,) by which a logger with stamps ``logged`` (L,) [s] is ahead of UTC at its lines, and by which
    sentences of the receiver come after their fix; None where it is no clock to go by. fix_at, fix_t: lines and times
    (F,) of fixes. A clock that is ahead by whole quarters of an hour and up to LATE is set to its zone, and the rest is
    the delay of the receiver: a clock that is not set would hardly be as near."""
    known = np.isfinite(logged[fix_at])
    if not _fine(logged) or known.sum() < 2:
        return None, 0.0
    lag = (logged[fix_at] - fix_t)[known]
    if abs(np.polyfit(fix_t[known] - fix_t[0], lag, 1)[0]) > 0.1:  # a word that stands before all lines loses 1 s per s
        return None, 0.0
    smooth = median_filter(lag, size=STAMPS, mode="nearest")
    zone = QUARTER * round(float(np.median(lag)) / QUARTER)
    latency = float(np.median(lag)) - zone
    if 0.0 < latency < LATE and np.ptp(smooth) < LATE:
        return np.full(len(logged), zone), latency
    return np.interp(np.arange(len(logged)), fix_at[known], smooth), 0.0  # a clock that drifts, or is set in between


def _by_order(at: np.ndarray, fix_at: np.ndarray, fix_t: np.ndarray) -> np.ndarray:
    """Times (N,) [s] of the sentences ``at`` (N,) of one source between fixes ``fix_at`` (F,) with times (F,). They lie
    evenly, and the first one behind a fix is not earlier than it. Where the log begins with one sentence of the source
    and ends with a fix, they are said before the fix of their time, and the last one is not later."""
    t, steady = _behind_fixes(at, fix_at, fix_t)
    if steady and int((at < fix_at[0]).sum()) == 1 and at[-1] < fix_at[-1]:
        return -_behind_fixes(-at[::-1], -fix_at[::-1], -fix_t[::-1])[0][::-1]  # the same, with time reversed
    return t


def _behind_fixes(at: np.ndarray, fix_at: np.ndarray, fix_t: np.ndarray) -> tuple[np.ndarray, bool]:
    """Times (N,) of sentences that follow the fix of their time, and whether fixes come at a steady delay. Where they
    do not, those of the EARLY percentile are not late, and the next sentence follows within its step."""
    step = float(np.median(np.diff(fix_t)))
    behind = np.searchsorted(fix_at, at, "right") - 1
    before, after = fix_t[np.maximum(behind, 0)], np.append(fix_t, np.inf)[behind + 1]
    first = np.flatnonzero((behind >= 0) & (np.diff(behind, prepend=-1) > 0))  # behind a new fix
    if len(first) < 2:
        return before, True
    steady, lag = True, min(LAG, len(first) - 1)
    # Seconds from sentence to sentence: the lower quartile is rather too small (LAG).
    usual = float(np.percentile((before[first[lag:]] - before[first[:-lag]]) / (first[lag:] - first[:-lag]), 25))
    jumps = np.abs(np.diff(before[first]) - usual * np.diff(first)) > 1.5 * max(usual, step)
    parts = np.flatnonzero(jumps) + 1  # the source or the log was silent
    out = np.empty(len(at))
    for rows, heads in zip(np.split(np.arange(len(at)), first[parts]), np.split(first, parts), strict=True):
        every, delays = usual, before[heads] - usual * heads
        phases = median_filter(delays, FIXES, mode="nearest")  # keeps the steps where sentences are lost
        if len(heads) > 2 and np.mean(np.abs(delays - phases) > JITTER * usual) > UNSTEADY:
            steady, every = False, float(np.polyfit(heads, before[heads], 1)[0])
            phases = percentile_filter(before[heads] - every * heads, EARLY, 3 * FIXES, mode="reflect") + 0.5 * every
        out[rows] = every * rows + phases[np.maximum(np.searchsorted(heads, rows, "right") - 1, 0)]
    low = np.where(behind < 0, -np.inf, before - 0.5 * step)
    return np.maximum.accumulate(np.clip(out, low, after + 0.5 * step)), steady
