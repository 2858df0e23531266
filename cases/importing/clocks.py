"""Clocks of raw logs: time stamps of any kind as seconds, absolute (since 1970, UTC) or of the log's own."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cases.importing.raw_table import Clock, RawTable
from cases.io.units import FACTORS, factor_of
from mmg.errors import BadValue, Conflict, Missing, TooFewData, UnknownName, UserError
from mmg.messages import Message

EPOCH = {"s": (1e8, 1e10), "ms": (1e11, 1e13), "us": (1e14, 1e16), "ns": (1e17, 1e19)}
"""What counts since 1970 in this unit holds numbers of this size (1973 to 2286)."""
DAYS_1899 = 25569.0
"""Days from the epoch of spreadsheets to 1970."""
DAYS_0000 = 719529.0
"""Days from the year 0, as MATLAB's datenum counts them, to 1970."""


SAMPLED = 0.1
"""Share of the changes of values that lie within stamps from which rows of a stamp are samples, not copies."""
ZONE = r"[:T]\d{2}\S*\s*(?:Z|[+-]\d{2}(?::?\d{2})?)$"
"""The end of a stamp with a zone."""
LATEST = 1e21
"""No clock of any unit shows a larger number: nanoseconds of 30,000 years."""


def clock_of(
    table: RawTable, header: str, unit: str = "", date: str | None = None, zone_hours: float | None = None
) -> Clock:
    """The clock of ``table`` in the column ``header``.

    unit: of its numbers, if known; date: header of a column with the day, or None; zone_hours: of stamps without a
    zone, ahead of UTC, None where nobody said it: they are UTC. Raises UserError, which names the first row, for text
    that is no time, for numbers of which it is not known what they count, and for stamps of which only some have a zone
    where ``zone_hours`` is None.
    """
    import pandas as pd

    cells, no_times = table.cells(header), np.zeros(0)
    where = f"{table.name}: column '{header}'"
    if getattr(cells.dtype, "kind", "O") in "mM" or _holds(cells, "datetime"):
        return _stamps(cells, where, zone_hours, table.before, Clock(no_times, True, header, "dates and times"))
    if _holds(cells, "time"):
        cells = cells.map(lambda value: None if value is None else str(value))
    if table.numeric(header):
        return _numbers(table.numbers(header), header, unit or _unit_of(table, header), where)
    text = cells.astype(object).where(cells.notna(), None)
    sample = next((str(value).strip() for value in text if value is not None), "")
    if re.fullmatch(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?", sample):
        if date is not None:
            joined = table.cells(date).astype(str).str.strip().str.slice(0, 10) + " " + text.astype(str)
            words = f"times of the days in '{date}'"
            return _stamps(joined, where, zone_hours, table.before, Clock(no_times, True, header, words))
        passed = pd.to_timedelta(text.map(_full_time), errors="coerce")
        _refuse(passed.isna() & text.notna(), text, where, table.before)
        t = passed.dt.total_seconds().to_numpy(dtype=float)
        return Clock(_past_midnight(t), False, header, "times of a day")
    words = "ISO 8601" if sample[:4].isdigit() else "dates and times"
    return _stamps(text, where, zone_hours, table.before, Clock(no_times, True, header, words))


def check_clock(clock: Clock, where: str) -> list[Message]:
    """What is to be said of a clock. where: names the table. Raises UserError where it runs backwards: the first row,
    and how often; and where no two rows have different times."""
    t = clock.t[np.isfinite(clock.t)]
    if len(t) < 2:
        raise TooFewData(f"{where}: column '{clock.header}' holds fewer than two times")
    check_forward(clock, where)
    if t[0] == t[-1]:
        raise BadValue(f"{where}: the clock '{clock.header}' stands still")
    return [Message(f"time from '{clock.header}': {clock.words}", "clock")]


def within_stamps(t: np.ndarray, columns: Iterable[np.ndarray]) -> tuple[np.ndarray, list[Message]]:
    """Times (N,) of rows, and what is said of those whose stamps ``t`` (N,) [s], in order, are alike.

    columns: (N,) each. Where values change within stamps, these are coarser than the rows, as those of a clock that
    shows whole seconds: the rows of a stamp are spread until the next. A stamp beside a gap may lack some of them.
    """
    stamps, first, count = np.unique(t, return_index=True, return_counts=True)
    repeated = len(t) - len(stamps)
    if not repeated:
        return t, []
    within = changes = 0
    for values in columns:
        good = np.isfinite(values)
        changed = np.diff(values[good]) != 0
        changes += int(changed.sum())
        within += int((changed & (np.diff(t[good]) == 0)).sum())
    if within <= SAMPLED * changes:
        return t, [Message(f"{repeated} rows with the time of the row before are averaged with it", "time_repeated")]
    step = np.diff(stamps)
    wide = np.append(step, np.inf)
    tick = float(np.quantile(step, 0.1, method="lower"))  # others are longer where rows are missing
    gap_before, gap_after = np.append(True, step > 1.5 * tick), wide > 1.5 * tick
    places = np.where(gap_before | gap_after, np.maximum(count, int(np.median(count))), count)
    skipped = np.where(gap_before & ~gap_after, places - count, 0)
    place = np.arange(len(t)) - np.repeat(first, count) + np.repeat(skipped, count)
    words = f"{repeated} rows with the time of the row before are spread until the next: stamps of {tick:.3g} s"
    spread = np.repeat(stamps, count) + place * np.repeat(np.minimum(wide, tick) / places, count)
    return spread, [Message(f"{words} hold several rows", "time_spread")]


def check_forward(clock: Clock, where: str, before: int = 0, end: float = -np.inf) -> None:
    """Raises UserError where the ``clock`` runs backwards: the first row, and how often.

    where: the table; before, end: rows of it before those of the clock, and their last time [s].
    """
    rows = np.flatnonzero(np.isfinite(clock.t))
    t = np.append(end, clock.t[rows])
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        i = int(back[0])
        row = before + (int(rows[i - 1]) + 1 if i else 0)
        raise BadValue(
            f"{where}: the clock '{clock.header}' runs backwards by {t[i] - t[i + 1]:.3g} s after row {row} "
            f"({len(back)} such rows); divide the file there, or leave out the rows that were logged twice"
        )


def _numbers(values: np.ndarray, header: str, unit: str, where: str) -> Clock:
    """A clock of numbers: by its unit, or since 1970 where the size of the numbers says so."""
    known = values[np.isfinite(values)]
    if not len(known) or np.abs(known).max() > LATEST:
        raise BadValue(f"{where}: column '{header}' holds no times, or some that no clock shows")
    middle = float(np.median(known))
    for name, (low, high) in EPOCH.items():
        if low <= middle < high and (not unit or unit.lower() == name or (name == "s" and unit.lower() == "sec")):
            return Clock(values * FACTORS["s"][name], True, header, f"{name} since 1970")
    if not unit and 2e4 < middle < 8e4 and np.ptp(values[np.isfinite(values)]) < 1.0:
        return Clock((values - DAYS_1899) * 86400.0, True, header, "days of a spreadsheet")
    if not unit and 6.9e5 < middle < 8e5 and np.ptp(known) < 1.0:
        return Clock((values - DAYS_0000) * 86400.0, True, header, "days of MATLAB (datenum)")
    if not unit:
        raise Missing(f'{where}: numbers without a unit; say it: [columns] t = {{ from = "{header}", unit = "s" }}')
    factor = factor_of("s", unit)
    if factor is None:
        raise UnknownName(f"{where}: unknown unit '{unit}' of time; known: {', '.join(FACTORS['s'])}")
    return Clock(values * factor, False, header, f"in {unit}")


def _unit_of(table: RawTable, header: str) -> str:
    """The unit of a clock that the header gives, or the words of the header themselves (``time_ms``)."""
    unit = table.units[table.headers.index(header)].lower()
    if factor_of("s", unit) is not None:
        return unit
    ending = re.search(r"(?:^|[_\s.])(seconds|sec|ms|us|ns|min|s)$", header.lower())
    return ending[1] if ending else ""


def _holds(cells: Any, kind: str) -> bool:
    """Whether the first cell that is not empty is a datetime or a time of a day."""
    import datetime

    first = next((value for value in cells if value is not None and value == value), None)
    return isinstance(first, datetime.datetime if kind == "datetime" else datetime.time)


def _full_time(text: Any) -> Any:
    """ "12:05" as "12:05:00"."""
    if text is None:
        return None
    text = str(text).strip().replace(",", ".")
    return text if text.count(":") == 2 else f"{text}:00"


def _past_midnight(t: np.ndarray) -> np.ndarray:
    """Times of a day that go on after midnight."""
    steps = np.diff(t, prepend=t[:1])
    return t + 86400.0 * np.cumsum(np.where(np.nan_to_num(steps) < -43200.0, 1.0, 0.0))


def _stamps(cells: Any, where: str, zone_hours: float | None, before: int, clock: Clock) -> Clock:
    """The ``clock`` with dates and times as seconds since 1970, UTC. Raises UserError for the first that is none, where
    day and month could be either, and where only some have a zone and nobody said that of the others."""
    import pandas as pd

    text = cells if getattr(cells.dtype, "kind", "O") == "M" else cells.map(_normal_stamp)
    given = text[text.notna()]
    dotted = given.astype(str).str.extract(r"^(\d{1,2})([./-])(\d{1,2})[./-]\d{4}")
    order: dict[str, Any] = {"format": "ISO8601"}
    if dotted[0].notna().any():
        first, second = dotted[0].dropna().astype(int), dotted[2].dropna().astype(int)
        if (first > 12).any() or (dotted[1].dropna() == ".").all():
            order = {"dayfirst": True}
        elif (second > 12).any():
            order = {"dayfirst": False}
        else:
            raise BadValue(f"{where}: '{given.iloc[0]}': day and month could be either; write dates as 2026-11-22")
        order["format"] = "mixed"
    try:
        parsed = pd.to_datetime(text, utc=True, errors="coerce", **order)
        since = (parsed - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy(dtype=float)
    except (ValueError, OverflowError, TypeError) as error:  # years before our era, among others
        raise BadValue(f"{where}: holds a time that no clock shows ({' '.join(str(error).split())[:80]})") from None
    _refuse(parsed.isna() & text.notna(), text, where, before)
    zoned = text.astype(str).str.contains(ZONE, regex=True).to_numpy()
    naive = (text.notna() & ~zoned).to_numpy()
    if zone_hours is None and zoned.any() and naive.any():
        row = int(np.flatnonzero(naive != naive[0])[0])
        raise mixed_zones(where, before + row + 1)
    return replace(clock, t=since - 3600.0 * (zone_hours or 0.0) * naive, zoned=bool(zoned.any()))


def mixed_zones(where: str, row: int) -> UserError:
    """What is said of stamps with and without a zone. where: names table and column; row: the first other one."""
    return Conflict(
        f"{where}: some stamps have a time zone and others none (from row {row} on); write it to all, or say that of "
        "the others: --zone-hours, or zone_hours in the map"
    )


def _refuse(bad: Any, text: Any, where: str, before: int) -> None:
    """Raises UserError for the first row where ``bad`` (N,) is true, which follows ``before`` others."""
    if bad.any():
        row = int(np.flatnonzero(bad.to_numpy())[0])
        words = f"row {before + row + 1}: '{text.iloc[row]}' is no time ({int(bad.sum())} such cells)"
        raise BadValue(f"{where}: {words}")


def _normal_stamp(value: Any) -> Any:
    """A stamp as pandas reads it: a comma before the part of a second becomes a point."""
    if value is None or value != value:
        return None
    return re.sub(r"(:\d{2}),(\d+)", r"\1.\2", value.strip()) if isinstance(value, str) else value
