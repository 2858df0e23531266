"""Clocks of raw logs: time stamps of any kind as seconds, absolute (since 1970, UTC) or of the log's own."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cases.importing.raw_table import Clock, RawTable
from cases.importing.vocabulary import plain_words
from cases.quantities import FACTORS, SPELLINGS, factor_of
from mmg.errors import BadValue, Conflict, Missing, TooFewData, UnknownName, UserError, reason
from mmg.messages import Message

DAY, WEEK = 86400.0, 604800.0  # s (SI brochure of 2019, table 8)
# Unit, least and largest number, factor to seconds, seconds from 1970 to zero, words. The sizes lie between 1965 and
# 2092; the epochs are those of POSIX, LabVIEW, Windows, .NET, Excel, MATLAB and astronomy. The first that fits counts.
EPOCHS = (
    ("s", 1e8, 2.6e9, 1.0, 0.0, "s since 1970"),
    ("s", 3.0e9, 4.7e9, 1.0, -2082844800.0, "s since 1904"),
    ("ms", 1e11, 2.6e12, 1e-3, 0.0, "ms since 1970"),
    ("us", 1e14, 2.6e15, 1e-6, 0.0, "us since 1970"),
    ("ns", 1.2e17, 1.5e17, 1e-7, -11644473600.0, "0.1 us since 1601"),
    ("ns", 6.2e17, 6.6e17, 1e-7, -62135596800.0, "0.1 us since the year 1"),
    ("ns", 1e17, 2.6e18, 1e-9, 0.0, "ns since 1970"),
    ("", 3.2e4, 5.2e4, DAY, -25569.0 * DAY, "days of a spreadsheet"),
    ("", 5.2e4, 7.0e4, DAY, -40587.0 * DAY, "modified Julian days"),
    ("", 7.2e5, 7.6e5, DAY, -719529.0 * DAY, "days of MATLAB"),
    ("", 2.44e6, 2.48e6, DAY, -2440587.5 * DAY, "Julian days"),
)
SINCE_1904 = 1462.0 * DAY  # What days of a workbook that counts from 1904 are later
# s from 1970 to the first week of GPS (6 January 1980), and by which its time is ahead of UTC since 2017 (IERS).
GPS_ZERO, GPS_AHEAD = 315964800.0, 18.0
# A header of a clock that begins anew every week.
OF_WEEK = r"(gps_|gnss_)?(tow|sow|itow|time_of_week|seconds?_of_week|week_seconds?)(_m?s)?"
JUMPS = {  # Jumps of clocks [s] and what makes them.
    43200.0: "half a day: a clock of twelve hours without AM and PM",
    3600.0: "an hour, as between summer and winter time or two zones",
    DAY: "a day: the date does not follow the time over midnight",
    WEEK: "a week: seconds of the week begin anew",
    1024 * WEEK: "1024 weeks: the receiver's count of weeks rolled over",
}
SAMPLED = 0.1  # Share of changes of values within stamps from which rows of a stamp are no copies. Set by hand.
ZONE = r"[:T]\d{2}\S*\s*(?:Z|[+-]\d{2}(?::?\d{2})?)$"  # The end of a stamp with a zone
LAST_STAMP = 253402300800.0  # s from 1970 to the year 10000
LATEST = 1e21  # No clock of any unit shows a larger number: nanoseconds of 30,000 years. Set by hand.


def clock_of(
    table: RawTable,
    header: str,
    unit: str = "",
    time_columns: Mapping[str, str] | None = None,
    zone_hours: float | None = None,
) -> Clock:
    """The clock of ``table`` in the column ``header``.

    unit: of its numbers, if known; time_columns: headers of columns that complete it: "date", "t_week" (of GPS),
    "t_part" (parts of a second), and "t_year", "t_month", "t_day", "t_hour", "t_minute"; zone_hours: of stamps without
    a zone, ahead of UTC, None where nobody said it: they are UTC. Raises UserError, which names the first row, for text
    that is no time, for numbers of which it is not known what they count, and for stamps of which only some have a
    zone.
    """
    import pandas as pd

    time_columns, where = time_columns or {}, f"{table.name}: column '{header}'"
    if "t_minute" in time_columns:
        return _of_parts(table, header, time_columns, zone_hours)
    clock = Clock(np.zeros(0), True, header, "dates and times")
    cells, date = table.cells(header), time_columns.get("date")
    first = next((value for value in cells if value is not None and value == value), None)  # NaN is not itself
    if isinstance(first, datetime.timedelta):  # pandas makes them of durations as well
        return Clock(pd.to_timedelta(cells).dt.total_seconds().to_numpy(dtype=float), False, header, "durations")
    if getattr(cells.dtype, "kind", "O") == "M" or isinstance(first, datetime.datetime):
        return _stamps(cells, where, zone_hours, table.before, clock)
    if isinstance(first, datetime.time):  # of a workbook
        cells = cells.map(lambda value: None if value is None else str(value))
    elif table.numeric(header):
        unit = unit or _unit_of(table, header)
        digits = _of_digits(table.numbers(header), table.before > 0) if not unit else None
        if digits is None:
            return _numbers(table, header, unit, time_columns)
        cells, first = pd.Series(digits), next(filter(None, digits))
    text = cells.astype(object).where(cells.notna(), None).map(_of_24_hours)
    sample = "" if first is None else str(_of_24_hours(first)).strip()
    of_hour = re.fullmatch(r"\d{1,2}:\d{2}[.,]\d+", sample)
    if not of_hour and not re.fullmatch(r"\d{1,2}:\d{2}(:\d{2}([.,:]\d+)?)?", sample):
        words = "ISO 8601" if sample[:4].isdigit() else clock.words
        return _stamps(text, where, zone_hours, table.before, replace(clock, words=words))
    # "30:07.5" of a spreadsheet is minutes and seconds: with an hour before it, pandas reads it as such.
    text = text.map(_full_time if not of_hour else lambda cell: cell and "00:" + str(cell).strip().replace(",", "."))
    if date is not None and not of_hour:
        joined = table.cells(date).map(_day) + " " + text.astype(str)
        return _stamps(joined, where, zone_hours, table.before, replace(clock, words=f"times of the days in '{date}'"))
    passed = pd.to_timedelta(text, errors="coerce")
    _refuse(passed.isna() & text.notna(), text, where, table.before)
    t = passed.dt.total_seconds().to_numpy(dtype=float)
    words, period = ("minutes and seconds of an hour", 3600.0) if of_hour else ("times of a day", DAY)
    return _going_on(Clock(t, False, header, words, period=period))


def _of_digits(values: np.ndarray, goes_on: bool) -> list[str | None] | None:
    """The ``values`` (N,) as text, such as 93000.5 as "09:30:00.500" and 20260504093000 with its date; None where they
    are no such digits: seconds that are counted on would go beyond 59 in some places. goes_on: whether rows of the log
    before them are."""
    known = values[np.isfinite(values)]
    day, clock = np.divmod(known, 1e6)
    seconds = clock % 100
    if not len(known) or (clock >= 240000).any() or (clock // 100 % 100 >= 60).any() or (seconds >= 60).any():
        return None
    dated = day.min() >= 19000101 and day.max() <= 21001231
    by_chance = not goes_on and (np.ptp(known) < 100 or len(np.unique(seconds // 1)) < 10)  # a count may look so
    if not dated and (day.any() or by_chance):
        return None
    texts = [f"{value:.3f}".zfill(18 if dated else 10) if value == value else None for value in values]
    parts = r"(....)(..)(..)(..)(..)(......)" if dated else r"(..)(..)(......)"
    return [text and re.sub(parts, r"\1-\2-\3T\4:\5:\6" if dated else r"\1:\2:\3", text) for text in texts]


def _day(value: Any) -> Any:
    """The day of a cell of dates, as text: "20260504" and "4.5.2026 00:00" as well."""
    if isinstance(value, datetime.date):
        return value.isoformat()[:10]
    text = str(value).strip().removesuffix(".0").split(" ")[0].split("T")[0]
    return f"{text[:4]}-{text[4:6]}-{text[6:]}" if re.fullmatch(r"(19|20)\d{6}", text) else text


def _of_parts(table: RawTable, header: str, time_columns: Mapping[str, str], zone_hours: float | None) -> Clock:
    """The clock of columns of hours, minutes and seconds, and of days where they are there."""
    import pandas as pd

    second, minute, hour = (table.numbers(h) for h in (header, time_columns["t_minute"], time_columns["t_hour"]))
    t = second + 60.0 * minute + 3600.0 * hour
    names = ["t_year", "t_month", "t_day"]
    words = "columns of hours, minutes and seconds"
    if not set(names) <= set(time_columns):
        return _going_on(Clock(t, False, header, words, period=DAY))
    day = pd.DataFrame({name[2:]: table.numbers(time_columns[name]) for name in names})
    day["year"] += np.where(day["year"] < 100, 2000, 0)  # years of two digits
    since = (pd.to_datetime(day, errors="coerce") - pd.Timestamp(0)).dt.total_seconds().to_numpy(dtype=float)
    return Clock(since + t - 3600.0 * (zone_hours or 0.0), True, header, words)


def without_jumps(clock: Clock, columns: Mapping[str, np.ndarray], end: float = -np.inf) -> tuple[Clock, list[Message]]:
    """The ``clock`` without JUMPS, and what was mended: those that lead back, and those that lead on while all
    ``columns`` (N,) go on as from row to row. end: the last time before [s]."""
    good = np.flatnonzero(np.isfinite(clock.t))
    t = clock.t[good]
    step = np.diff(t, prepend=end if np.isfinite(end) else t[:1])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    out, said = clock.t.copy(), []
    for i in np.flatnonzero((step < 0) | (step > 3600.0 - usual)) if usual else ():  # the shortest jump is an hour
        back = step[i] < 0
        for size, what in JUMPS.items():
            jump = -size if back else size
            # A gap of an hour is no jump: there the ship has moved on, so other columns jump as well.
            if not -1e-6 <= step[i] - jump <= 3 * usual or not (back or _goes_on(columns, good, int(i))):
                continue
            out[good[i:]] -= jump
            words = f"jumps {'back' if back else 'forward'} by {size:.10g} s at row {int(good[i]) + 1}, {what}"
            said.append(Message(f"the clock '{clock.header}' {words}; it is taken to go on", "clock_jump"))
    return replace(clock, t=out), said


def _goes_on(columns: Mapping[str, np.ndarray], rows: np.ndarray, i: int) -> bool:
    """Whether all ``columns`` that move change no more at the i-th of the ``rows`` than elsewhere."""
    smooth = []
    for values in columns.values():
        change = np.abs(np.diff(values[rows]))
        if np.isfinite(change).sum() > 10 and 0 < i <= len(change) and np.nanmedian(change) > 0:
            smooth.append(bool(change[i - 1] <= np.nanmax(np.delete(change, i - 1))))
    return bool(smooth) and all(smooth)  # where nothing moves, nothing is shown


def _going_on(clock: Clock) -> Clock:
    """A clock that begins anew after its period, going on."""
    step = np.diff(clock.t, prepend=clock.t[:1])
    anew = np.cumsum(np.where(np.nan_to_num(step) < -0.5 * clock.period, 1.0, 0.0))  # others begin none
    return replace(clock, t=clock.t + clock.period * anew)


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
    """Times (N,) of rows, and what is said of those whose stamps ``t`` (N,) [s], in order, are alike. columns: (N,)
    each. Where values change within stamps, these are coarser than the rows, as those of a clock that shows whole
    seconds: the rows of a stamp are spread until the next. A stamp beside a gap may lack some of them."""
    stamps, first, count = np.unique(t, return_index=True, return_counts=True)
    repeated = len(t) - len(stamps)
    if not repeated or len(stamps) == 1:  # of a clock that stands still, which is refused later
        return t, []
    within = changes = 0  # of values from row to row: within a stamp, and all
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
    places = np.where(gap_before | gap_after, np.maximum(count, int(np.median(count))), count)  # (stamps,) rows of each
    skipped = np.where(gap_before & ~gap_after, places - count, 0)  # behind a gap the first rows of a stamp are lost
    place = np.arange(len(t)) - np.repeat(first, count) + np.repeat(skipped, count)
    words = f"{repeated} rows with the time of the row before are spread until the next: stamps of {tick:.3g} s"
    spread = np.repeat(stamps, count) + place * np.repeat(np.minimum(wide, tick) / places, count)
    return spread, [Message(f"{words} hold several rows", "time_spread")]


def check_forward(clock: Clock, where: str, before: int = 0, end: float = -np.inf) -> None:
    """Raises UserError where the ``clock`` runs backwards: the first row, and how often. where: the table; before, end:
    rows of it before those of the clock, and their last time [s]."""
    rows = np.flatnonzero(np.isfinite(clock.t))
    t = np.append(end, clock.t[rows])
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        i = int(back[0])
        row = before + (int(rows[i - 1]) + 1 if i else 0)
        words = f"runs backwards by {t[i] - t[i + 1]:.3g} s after row {row} ({len(back)} such rows); divide the file"
        raise BadValue(
            f"{where}: the clock '{clock.header}' {words} there, or leave out the rows that were logged twice"
        )


def _numbers(table: RawTable, header: str, unit: str, time_columns: Mapping[str, str]) -> Clock:
    """A clock of numbers: by its unit, or by EPOCHS where the size of the numbers says what they count."""
    where = f"{table.name}: column '{header}'"
    values = table.numbers(header)
    known = values[np.isfinite(values)]
    if not len(known) or np.abs(known).max() > LATEST:
        raise BadValue(f"{where}: column holds no times, or some that no clock shows")
    part = np.zeros(len(values))
    if "t_part" in time_columns:
        part = table.numbers(time_columns["t_part"]) * _part_unit(table, time_columns["t_part"])
    middle, name = float(np.median(known)), unit.lower()  # the median: ends may be 0 or lost
    name = SPELLINGS.get(name, name.replace("sec", "s"))
    if re.fullmatch(OF_WEEK, plain_words(header)):
        of_week = 1e-3 if name == "ms" or known.max() > WEEK else 1.0
        clock = _going_on(Clock(values * of_week + part, False, header, "seconds of the week", period=WEEK))
        if "t_week" not in time_columns:
            return clock
        weeks = table.numbers(time_columns["t_week"])
        first = float(weeks[np.isfinite(weeks)][0]) if np.isfinite(weeks).any() else 0.0
        zero = GPS_ZERO - GPS_AHEAD + WEEK * (first + (2048.0 if first < 1024 else 0.0))  # third era, since 2019
        return replace(clock, t=clock.t + zero, absolute=True, words="GPS weeks and seconds, as UTC")
    for epoch_unit, low, high, factor, zero, words in EPOCHS:
        steps = np.abs(np.diff(known))
        if low <= middle < high and (epoch_unit == name if epoch_unit and name else not name):
            # counts of samples are no days, and microseconds since a logger began no seconds since 1970
            if not name and (len(steps) < 1 or np.median(steps) * factor > 3600.0):
                continue
            if words.startswith("days of a spread") and table.since_1904:
                zero += SINCE_1904
            since = (values + zero / factor) * factor  # days since the year 0 have few digits left for parts of seconds
            return Clock(since + part, True, header, words)
    if not unit:
        raise Missing(f'{where}: numbers without a unit; say it: [columns] t = {{ from = "{header}", unit = "s" }}')
    scale = factor_of("s", unit)
    if scale is None:
        raise UnknownName(f"{where}: unknown unit '{unit}' of time; known: {', '.join(FACTORS['s'])}")
    return Clock(values * scale + part, False, header, f"in {unit}")


def _part_unit(table: RawTable, header: str) -> float:
    """Seconds in one of the parts below ``header``: by its words, else by the size of the numbers."""
    for letters, scale in (("n", 1e-9), ("u", 1e-6), ("mic", 1e-6), ("m", 1e-3)):
        if re.search(rf"(^|_){letters}[a-z]*s[a-z]*$", plain_words(header)):
            return scale
    most = float(np.nanmax(table.numbers(header), initial=0.0))
    return next(scale for scale in (1e-3, 1e-6, 1e-9) if most * scale < 1.0 or scale == 1e-9)


def _unit_of(table: RawTable, header: str) -> str:
    """The unit of a clock that the header gives, or the words of the header themselves (``time_ms``)."""
    unit = table.units[table.headers.index(header)].lower()
    if factor_of("s", unit) is not None:
        return unit
    ending = re.search(r"(?:^|_)(seconds|sec|ms|us|ns|min|s)$", plain_words(header))
    return ending[1] if ending else ""


def _of_24_hours(text: Any) -> Any:
    """ "01:20:07 PM", a time without a date, as "13:20:07"; all else as it is."""
    half = re.fullmatch(r"\s*(\d{1,2})((?::\d{2}){1,2}(?:[.,]\d+)?)\s*([ap])\.?\s*m\.?\s*", str(text), re.IGNORECASE)
    return f"{int(half[1]) % 12 + 12 * (half[3].lower() == 'p')}{half[2]}" if half and int(half[1]) <= 12 else text


def _full_time(text: Any) -> Any:
    """ "12:05" as "12:05:00"; "12:05:07:250" and "12:05:07,25" with a point."""
    if text is None:
        return None
    text = re.sub(r"^(\d{1,2}:\d{2}:\d{2})[:,](\d+)$", r"\1.\2", str(text).strip())
    return f"{text}:00" if text.count(":") == 1 else text


def _stamps(cells: Any, where: str, zone_hours: float | None, before: int, clock: Clock) -> Clock:
    """The ``clock`` with dates and times as seconds since 1970, UTC. Raises UserError for the first that is none, where
    day and month could be either, and where only some have a zone."""
    import pandas as pd

    text = cells if getattr(cells.dtype, "kind", "O") == "M" else cells.map(_normal_stamp)
    given = text[text.notna()]
    dotted = given.astype(str).str.extract(r"^(\d{1,2})([./-])(\d{1,2})[./-]\d{4}")
    order: dict[str, Any] = {"format": "ISO8601"}
    if len(given) and re.search(r"(?<![a-z])[a-z]{3,9}(?![a-z])", str(given.iloc[0]).lower().replace("am", "")):
        order = {"format": "mixed", "dayfirst": True}  # names of months leave nothing open
    if dotted[0].notna().any():
        first, second = dotted[0].dropna().astype(int), dotted[2].dropna().astype(int)
        day_first = bool((first > 12).any() or (dotted[1].dropna() == ".").all())  # points stand in dates of days first
        if not day_first and not (second > 12).any():
            raise BadValue(f"{where}: '{given.iloc[0]}': day and month could be either; write dates as 2026-11-22")
        order = {"format": "mixed", "dayfirst": day_first}
    try:
        parsed = pd.to_datetime(text, utc=True, errors="coerce", **order)
        since = (parsed - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy(dtype=float)
    except (ValueError, OverflowError, TypeError) as error:  # years before our era, among others
        raise BadValue(f"{where}: holds a time that no clock shows ({reason(error, 80)})") from None
    if np.nanmax(since, initial=0.0) > LAST_STAMP:
        raise BadValue(f"{where}: holds a time after the year 9999, which no clock shows")
    _refuse(parsed.isna() & text.notna(), text, where, before)
    zoned = text.astype(str).str.contains(ZONE, regex=True).to_numpy()
    naive = (text.notna() & ~zoned).to_numpy()
    if zoned.any() and naive.any():
        row = int(np.flatnonzero(naive != naive[0])[0])
        raise mixed_zones(where, before + row + 1)
    return replace(clock, t=since - 3600.0 * (zone_hours or 0.0) * naive, zoned=bool(zoned.any()))


def mixed_zones(where: str, row: int) -> UserError:
    """What is said of stamps with and without a zone. where: names table and column; row: the first other one."""
    words = f"some stamps have a time zone and others none (from row {row} on); write the zone to all of them"
    return Conflict(f"{where}: {words}")


def _refuse(bad: Any, text: Any, where: str, before: int) -> None:
    """Raises UserError for the first row where ``bad`` (N,) is true, which follows ``before`` others."""
    if bad.any():
        row, count = int(np.argmax(bad.to_numpy())), int(bad.sum())
        raise BadValue(f"{where}: row {before + row + 1}: '{text.iloc[row]}' is no time ({count} such cells)")


def _normal_stamp(value: Any) -> Any:
    """A stamp as pandas reads it: with years of four digits, a point before the part of a second, "T" for "_" behind
    a date of digits."""
    if value is None or value != value:
        return None
    if not isinstance(value, str):
        return value
    text = re.sub(r"^(\d{8})_(?=\d{6})", r"\1T", value.strip())
    text = re.sub(r"^(\d{1,2}\.\d{1,2}\.)(?=\d\d\s)", r"\g<1>20", text)  # years of two digits
    return re.sub(r"\s*(UTC|GMT)$", "Z", re.sub(r"(:\d{2}),(\d+)", r"\1.\2", text))
