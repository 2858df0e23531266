"""Logs that hold one series a source, each at times of its own, as one table: a row a time, cells empty between;
long tables (a row a value: time, name, value, unit) among them."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.clocks import DAY, check_forward, clock_of, within_stamps
from cases.importing.import_map import ColumnMap, ImportMap, OpenQuestion
from cases.importing.raw_table import Account, Clock, RawTable
from cases.importing.vocabulary import Meaning, meaning, plain_words, turn_in
from cases.io.text_table import floats_of_cells, number_of
from cases.io.trial_table import MOST_CELLS
from mmg.errors import BadValue, Conflict, OutOfRange, TooFewData
from mmg.messages import Message

ENGINE = "n or n_2 (of an engine without a gear) or nothing (ahead of a gear)"  # What its revolutions may be
OVER_WATER = "(over the water, where there is no current) or nothing"  # Of a true wind by the speed through the water
# A date and time of ISO 8601, with other signs between or none (canboat writes a dash), or a time of the day.
STAMP = re.compile(
    r"(?<!\d)(?:((?:19|20)\d\d)[-/.]?(0\d|1[0-2])[-/.]?([0-3]\d)[-T ,;_]*)?([01]?\d|2[0-3])(?(1):?|:)([0-5]\d)"
    r"(?(1):?|:)([0-6]\d(?:[.,]\d+)?)\s?(Z|[+-]\d\d(?::?\d\d)?)?",
    re.ASCII | re.IGNORECASE,
)
ALIKE = {  # What says the same in another way.
    "x": "latitude", "y": "longitude", "latitude": "x", "longitude": "y", "psi": "heading_magnetic",
    "heading_magnetic": "psi",
}  # fmt: skip
FEW = 20  # Times from which a clock is said to jump. Set by hand.
MOST_OF_LOG = 0.5  # Share of a log over which a series runs whose begin and end are those of the table. Set by hand.


@dataclass(frozen=True)
class SourceSeries:
    """What one source of a log says, such as a topic or a sensor.

    name: of the source in the words of the file; t: (N,) seconds; columns: header -> (N,), NaN where it says nothing;
    means: header -> what the format itself says of it; rank: a source of a lower one is taken where two say the same.
    """

    name: str
    t: np.ndarray
    columns: Mapping[str, np.ndarray]
    means: Mapping[str, Meaning] = field(default_factory=dict)
    rank: int = 0

    def quantities(self) -> dict[str, str]:
        """Header -> quantity that it means, of headers that mean one."""
        all_of = {header: (self.means.get(header) or meaning(header)).quantity for header in self.columns}
        return {header: quantity for header, quantity in all_of.items() if quantity}


class Heard:
    """What the sources of a log say, message by message, in its order."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, int], list[tuple[float, dict[str, float]]]] = {}
        self._means: dict[str, Meaning] = {}

    def say(self, name: str, t: float, header: str, value: Any, means: Meaning | None = None, rank: int = 0) -> None:
        """The source ``name`` says at the time t [s] a ``value`` below a ``header``: as of ``SourceSeries``."""
        rows = self._rows.setdefault((name, rank), [])
        if not rows or rows[-1][0] != t or header in rows[-1][1]:  # a header again: another sample of a coarse stamp
            rows.append((t, {}))
        rows[-1][1][header] = number_of(value)
        if means is not None:
            self._means[header] = means

    def series(self) -> list[SourceSeries]:
        """The series of all sources."""
        out = []
        for (name, rank), rows in self._rows.items():
            headers = dict.fromkeys(header for _, said in rows for header in said)
            columns = {h: np.array([said.get(h, np.nan) for _, said in rows]) for h in headers}
            means = {h: self._means[h] for h in headers if h in self._means}
            out.append(SourceSeries(name, np.array([t for t, _ in rows]), columns, means, rank))
        return out


def mostly(content: bytes, *patterns: re.Pattern[str]) -> bool:
    """Whether at least half of the lines of the begin of ``content`` hold one of the ``patterns``."""
    lines = [line for line in content[:65536].decode("latin-1").splitlines() if line.strip() and line[0] != "#"]
    # More than one line: the last may be cut off.
    return 2 * sum(any(pattern.search(line) for pattern in patterns) for line in lines) >= len(lines) > 1


def seconds_of_stamp(stamp: Any) -> float:
    """Seconds since 1970 of a ``stamp`` with a date (in UTC where it names no zone), or of the day of one without.
    Raises ValueError for one that is none."""
    match = STAMP.fullmatch(str(stamp).strip())
    if match is None:
        raise ValueError(f"'{str(stamp)[:40]}' is no time")
    return seconds_of(match)


def seconds_of(match: re.Match[str]) -> float:
    """As ``seconds_of_stamp``, of a ``match`` of STAMP."""
    *day, hour, minute, second, zone = match.groups()
    t = 3600.0 * int(hour) + 60.0 * int(minute) + float(second.replace(",", "."))
    if match[1]:
        t += DAY * (datetime.date(*map(int, day)).toordinal() - datetime.date(1970, 1, 1).toordinal())
    if zone and zone not in "Zz":
        t -= float(f"{zone[0]}1") * (3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:] if len(zone) > 3 else 0))
    return t


def table_of_series(
    path: Path, series: Iterable[SourceSeries], chosen: ImportMap, clock: Clock, notices: Sequence[Message] = (),
    accounts: Sequence[Account] = (), name: str = "",
) -> RawTable:  # fmt: skip
    """The table of all ``series`` of the log ``path``, for as long as those run that span most of it.

    chosen: the map, whose ``ignore`` may name series; notices: of the reader; clock: says how times were read, and
    whether they are absolute; accounts: of what the reader left out; name: of the table, else the path. Raises
    UserError where two series of one rank differ, where times run backwards or jump, for no rows and for too many.
    """
    name, accounts, ignored = name or str(path), list(accounts), chosen.ignored_in(path)
    kept = []
    for one in series:
        columns = {h: v for h, v in one.columns.items() if np.isfinite(v).any() and not {h, one.name} & ignored}
        if ignored & {one.name, *one.columns}:
            accounts.append(Account(one.name, len(one.t), (), "ignored by the map"))
        if columns and (np.ptp(one.t) > 0 or _says_variation(one)):
            kept.append(_ordered(replace(one, columns=columns), name))
        elif one.name not in ignored:
            accounts.append(Account(one.name, len(one.t), (), "holds fewer than two values or times"))
    kept = _one_source(kept, path, chosen.columns_of(path), accounts)
    sampled = [one for one in kept if not _says_variation(one)]
    if not any("heading_magnetic" in one.quantities().values() for one in sampled):
        kept = sampled
    if not sampled:
        raise TooFewData(f"{name}: holds no series of numbers that says something of a ship")
    spans = np.array([np.ptp(one.t) for one in sampled])
    ends = np.array([(one.t[0], one.t[-1]) for one in sampled])[spans >= MOST_OF_LOG * spans.max()]
    first, last = ends[:, 0].max(), ends[:, 1].min()
    if last <= first:  # one after another: all of them
        first, last = ends.min(), ends.max()
    t = np.unique(np.concatenate([one.t for one in sampled]))
    at = int(np.argmax(np.diff(t, append=t[-1])))
    if len(t) > FEW and (jump := t[at + 1] - t[at]) > 0.5 * (t[-1] - t[0]):
        words = f"the clock jumps by {jump:.6g} s after {t[at] - t[0]:.6g} s, more than the rest of the log lasts"
        raise BadValue(f"{name}: {words}; divide it there")
    t = t[(first <= t) & (t <= last)]
    count = sum(len(one.columns) for one in kept)
    if len(t) * count > MOST_CELLS:
        raise OutOfRange(f"{name}: more than {MOST_CELLS} cells; leave out what is not needed in the map (ignore)")
    if len(t) < 2:
        raise TooFewData(f"{name}: its series hold fewer than two times in common")
    return _table(path, name, kept, replace(clock, t=t), notices, accounts)


def _table(
    path: Path, name: str, kept: Sequence[SourceSeries], clock: Clock, notices: Sequence[Message],
    accounts: list[Account],
) -> RawTable:  # fmt: skip
    """The ``kept`` series at the times of the ``clock``."""
    import pandas as pd

    cells, means = {clock.header: clock.t}, {clock.header: Meaning("t", "s")}
    for one in kept:
        inside = (clock.t[0] <= one.t) & (one.t <= clock.t[-1])
        at = np.searchsorted(clock.t, one.t[inside])
        for header, values in one.columns.items():
            known = np.isfinite(values)
            column = np.full(len(clock.t), np.nan)
            column[at] = values[inside]
            if _says_variation(one):  # it changes slowly, and is said rarely
                column = np.interp(clock.t, one.t[known], values[known])
            meant = one.means.get(header) or meaning(header)
            used = (meant.quantity,) if meant.quantity else ()
            accounts.append(Account(header, int(known.sum()), used, "" if used else meant.may_be))
            cells[header], means[header] = column, meant
    units, frame = tuple(m.unit for m in means.values()), pd.DataFrame(dict(enumerate(cells.values())))
    table = RawTable(path, name, tuple(cells), units, frame, tuple(notices), clock)
    return replace(table, accounts=tuple(accounts), means=means)


def _says_variation(one: SourceSeries) -> bool:
    """Whether a series is that of the variation of the compass alone."""
    return set(one.quantities().values()) == {"variation"}


def _ordered(one: SourceSeries, name: str) -> SourceSeries:
    """A series whose times increase: samples of one coarse stamp lie apart, of repeated ones the last is kept."""
    check_forward(Clock(one.t, False, f"time of {one.name}", ""), name)
    t = np.round(within_stamps(one.t, one.columns.values())[0], 6)  # microseconds: sources agree on a row
    last = np.append(np.diff(t) > 0, True)
    return replace(one, t=t[last], columns={header: values[last] for header, values in one.columns.items()})


def _one_source(
    kept: Sequence[SourceSeries], path: Path, mapped: Mapping[str, ColumnMap], accounts: list[Account]
) -> list[SourceSeries]:
    """The series of the log ``path`` with each quantity in that of the lowest rank only; of several of one rank that
    say the same, in the first. mapped: columns of the map, which need no choice."""
    of: dict[str, tuple[SourceSeries, str]] = {}
    out, said = [], {column.header for column in mapped.values()}
    for one in sorted(kept, key=lambda one: (one.rank, -len(one.t))):
        columns = dict(one.columns)
        for header, quantity in one.quantities().items():
            if quantity in mapped or header in said:
                continue
            other, same = of.get(quantity) or of.get(ALIKE.get(quantity, quantity)) or (one, header)
            if other is one or (quantity not in of and other.rank == one.rank):  # x beside latitude: both are kept
                of.setdefault(quantity, (one, header))
                continue
            same_rank = other.rank == one.rank and quantity != "variation"  # models of the earth's field differ little
            if same_rank and not _agree(one, header, other, same, quantity):
                words = f"{quantity} is said by '{other.name}' and by '{one.name}', and they differ"
                choices = {f"'{a.name}'": {"ignore": [b.name]} for a, b in ((other, one), (one, other))}
                raise OpenQuestion(path, words, choices)
            accounts.append(Account(header, len(one.t), (), f"{quantity} is taken from {other.name}"))
            del columns[header]
        if columns:
            out.append(replace(one, columns=columns))
    return out


def _agree(one: SourceSeries, header: str, other: SourceSeries, same: str, name: str) -> bool:
    """Whether columns of the quantity ``name`` say the same, ``header`` of ``one`` and ``same`` of the ``other``: they
    differ by less than values of each that follow one another."""
    t, values = (part[np.isfinite(one.columns[header])] for part in (one.t, one.columns[header]))
    at, known = (part[np.isfinite(other.columns[same])] for part in (other.t, other.columns[same]))
    if min(len(t), len(at)) < 2:
        return False
    period = turn_in(name, one.means[header].unit if header in one.means else "", float(np.abs(values).max()))
    if period:
        values, known = np.unwrap(values, period=period), np.unwrap(known, period=period)
    off = values - np.interp(t, at, known, left=np.nan, right=np.nan)
    if period:
        off = np.remainder(off + period / 2, period) - period / 2
    off = np.abs(off[np.isfinite(off)])
    step = max(np.abs(np.diff(v)).mean() for v in (values, known))  # of the coarser one
    return bool(len(off)) and float(np.median(off)) <= step


_NAMES = "variable|quantity|signal|channel|parameter|param|name|tag|sensor|measurement|topic|field|data_?channel"
NAME = rf"({_NAMES})(_?name|_?id)?"
VALUE = r"value|val|reading"
UNIT = r"units?|uom"


def pivoted(table: RawTable, chosen: ImportMap) -> RawTable:
    """The ``table`` with a column for each name in it, where it is a long one; else as it is. A long table has columns
    of times, names, which are words, and values; a column of units if any. chosen: the map. Raises UserError where rows
    of one name have several units, and as ``table_of_series``."""
    times = [h for h in table.headers if meaning(h).quantity == "t"]
    words = {h: plain_words(h) for h in table.headers}
    values = [h for h in table.headers if re.fullmatch(VALUE, words[h])]
    names = [h for h in table.headers if re.fullmatch(NAME, words[h]) and not table.numeric(h)]
    if len(times) != 1 or len(values) != 1 or not names:
        return table
    unit = [h for h in table.headers if re.fullmatch(UNIT, words[h])][:1]
    t, cells, of, units, clock = [], [], [], [], None
    for piece in table.pieces([*times, *values, *names, *unit]):
        clock = clock_of(piece, times[0], "", None, chosen.zone_hours)
        t.append(clock.t)
        cells.append(floats_of_cells(piece.cells(values[0]))[0])
        of.append(_joined(piece.cells(h) for h in names))
        units.append(_joined(piece.cells(h) for h in unit) if unit else np.full(len(clock.t), ""))
    assert clock is not None  # a table has rows
    when, numbers, called, measured = (np.concatenate(parts) for parts in (t, cells, of, units))
    series = []
    for name in dict.fromkeys(called.tolist()):
        rows = (called == name) & np.isfinite(when)
        written = sorted(set(measured[rows].tolist()))
        if len(written) > 1:
            raise Conflict(f"{table.name}: '{name}' has several units ({', '.join(written[:4])}); divide the file")
        means = meaning(name)
        means = replace(means, unit=(written or [""])[0] or means.unit)
        series.append(SourceSeries(name, when[rows], {name: numbers[rows]}, {name: means}))
    used, why = {*times, *values, *names, *unit}, "beside the values of a long table"
    unused = [Account(h, len(when), (), why) for h in table.headers if h not in used]
    text = f"a long table: {len(series)} names in {', '.join(repr(h) for h in names)}, a column each"
    notices = [*table.notices, Message(text, "pivoted")]
    return table_of_series(table.path, series, chosen, clock, notices, unused, table.name)


def _joined(columns: Iterable[Any]) -> np.ndarray:
    """Words of each row (N,) of one or more ``columns``, between blanks; "" for nothing."""
    parts = [["" if cell is None or cell != cell else str(cell).strip() for cell in column] for column in columns]
    return np.array([" ".join(filter(None, row)) for row in zip(*parts, strict=True)], dtype=object)
