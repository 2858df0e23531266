"""Raw logs of text that are too large to be held: read in pieces, only columns that are needed, rows averaged."""

from __future__ import annotations

import io
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.bad_values import LARGEST, SENTINELS, nothing_in
from cases.importing.clocks import backwards, clock_of, mixed_zones
from cases.importing.delimited_text import (
    CUT_OFF,
    EMPTY,
    cells_of,
    check_widths,
    is_comment,
    layout,
    plain_cells,
    table_of,
)
from cases.importing.import_map import ImportMap
from cases.importing.log_columns import TEXT, assigned, numbers_of, unit_in, with_sign
from cases.importing.raw_table import Clock, RawTable
from cases.importing.vocabulary import turn_in, turn_of
from cases.io.block_means import BlockMeans, rows_together
from cases.io.csv_table import PIECE, LineCount, text_encoding
from cases.io.files import opened
from mmg.errors import BadValue, TooFewData, UserError
from mmg.messages import Message

LARGEST_LOG, SMALL = 8 * 2**30, 8 * 2**20
"""Most bytes of a log of text; up to SMALL it is read at once."""
PLACES, SAMPLE = 40, 2**15
"""Places at which a log is looked at before it is read, and bytes at each."""
AT_ONCE = 100_000
"""Cells of a piece."""


def read_long_text(path: Path, chosen: ImportMap) -> RawTable:
    """The table in the large text file ``path``: the columns that the map ``chosen`` or their headers make quantities.

    Of more than MOST_KEPT rows, neighbouring ones are averaged. Raises UserError as ``read_text_table`` and ``log_of``
    do; a number that stands for nothing is one that lies far beyond what a sample of the file holds.
    """
    return _LongText(path, chosen).table()


@dataclass(frozen=True)
class _Nothing:
    """Numbers that stand for nothing in a column: those ``named`` by a person, and those ``beyond`` the values around
    ``middle``."""

    named: tuple[float, ...]
    beyond: tuple[float, ...]
    middle: float = 0.0

    def found(self, values: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        """Each of the numbers that occur in ``values`` (N,), and where."""
        yield from ((n, w) for n in self.named if (w := np.isclose(values, n)).any())
        low = max((n for n in self.beyond if n < self.middle), default=-LARGEST)
        high = min((n for n in self.beyond if n > self.middle), default=LARGEST)
        if not ((values <= low) | (values >= high)).any():
            return
        yield from ((n, w) for n in self.beyond if (w := values == n).any())
        if (where := np.abs(values) > LARGEST).any():
            yield LARGEST, where


class _LongText:
    """One large file. Its layout, quantities and sentinels come from a sample of lines at PLACES places."""

    def __init__(self, path: Path, chosen: ImportMap) -> None:
        self.path, self.chosen, self.lines = path, chosen, LineCount(path)
        self.encoding = text_encoding(self._bytes())
        if self.encoding != "utf-8-sig":
            self.encoding, self.lines = "cp1252", LineCount(path)
            for _ in self._bytes():
                pass
        sample = self._sample()
        comments = [line for line in sample if is_comment(line)]
        self.layout, rows = layout(path, [line for line in sample if not is_comment(line)] or [""], comments)
        width = len(self.layout.header)
        data = [row for row in rows[self.layout.first :] if len(row) == width]
        self.sample = table_of(path, self.layout, data, [])
        self.mapped, *others = assigned(self.sample, chosen)
        self.others = tuple(itertools.chain.from_iterable(others))
        self.nothing = {q: self._nothing(q) for q in self.mapped if q not in ("t", *TEXT)}
        self.periods, self.at = self._periods(), dict(zip(self.sample.headers, self.sample.frame.columns, strict=True))
        self.sample = self.sample.without_cells()
        self.masked: Counter[tuple[str, float]] = Counter()
        self.words: dict[str, set[str]] = {q: set() for q in self.mapped if q in ("ship", "zone")}
        self.end, self.days, self.rows, self.comments, self.cut = -math.inf, 0.0, 0, 0, False
        self.clock: Clock | None = None

    def table(self) -> RawTable:
        """The table, averaged where it is long."""
        count = rows_together(self.lines.rows)
        means = BlockMeans(count, self.periods)
        for piece in self._pieces():
            means.add(self._columns(piece))
        columns = means.columns()
        if not columns or len(columns["t"]) < 2 or self.clock is None:
            raise TooFewData(f"{self.path}: fewer than two rows hold a time")
        return self._as_table(columns, count)

    def _bytes(self) -> Iterator[bytes]:
        with opened(self.path) as stream:
            while piece := stream.read(PIECE):
                if not self.lines.seen and (piece.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in piece[:4096]):
                    raise BadValue(f"{self.path}: is no text in UTF-8 or Windows-1252; save it in UTF-8, or divide it")
                self.lines.add(piece)
                yield piece

    def _sample(self) -> list[str]:
        """Whole lines from the begin, from between and from the end."""
        size, lines = self.path.stat().st_size, []
        few = size <= 2 * PLACES * SAMPLE
        length = size if few else SAMPLE
        with opened(self.path) as stream:
            for at in [0] if few else np.linspace(0, size - length, PLACES).astype(int).tolist():
                stream.seek(at)
                piece = stream.read(length).decode(self.encoding, errors="replace").splitlines()
                lines += piece[1 if at else 0 : None if at + length >= size else -1]
        return [line for line in lines if line.strip()]

    def _sampled(self, quantity: str) -> np.ndarray:
        """The numbers of a ``quantity`` in the sample, none where it holds text: that is told of its row, later."""
        try:
            return numbers_of(self.sample, quantity, self.mapped[quantity])
        except UserError:
            return np.zeros(0)

    def _nothing(self, quantity: str) -> _Nothing:
        values, named = self._sampled(quantity), self.chosen.sentinels
        values = values[np.abs(values) <= LARGEST]
        if not len(values):
            return _Nothing(tuple(named), ())
        return _Nothing(tuple(named), tuple(nothing_in(values, SENTINELS)), float(np.median(values)))

    def _periods(self) -> dict[str, float]:
        """The turn of each direction, in the unit of the file."""
        return {
            quantity: turn_in(
                quantity,
                unit_in(self.sample, quantity, column),
                float(np.nanmax(np.abs(self._sampled(quantity)), initial=0.0)),
            )
            for quantity, column in self.mapped.items()
            if turn_of(quantity)
        }

    def _pieces(self) -> Iterator[RawTable]:
        """The rows below the header as tables of the columns that are needed."""
        with opened(self.path) as stream:
            text = io.TextIOWrapper(stream, self.encoding, errors="replace", newline=None)
            lines = ((i + 1, line) for i, line in enumerate(text) if line.strip())
            at_once = max(AT_ONCE // len(self.layout.header), 100)
            left_out, piece = self.layout.first, list(itertools.islice(lines, at_once))
            while piece:
                following = list(itertools.islice(lines, at_once))
                body = [pair for pair in piece if not is_comment(pair[1])]
                self.comments += len(piece) - len(body)
                here, left_out = body[left_out:], max(0, left_out - len(body))
                if here:
                    yield self._piece([n for n, _ in here], [line for _, line in here], not following)
                piece = following

    def _piece(self, numbers: list[int], lines: list[str], last: bool) -> RawTable:
        import pandas as pd

        frame = self._parsed(lines)
        if frame is None:
            width, rows = (
                len(self.layout.header),
                cells_of([line.rstrip("\n") for line in lines], self.layout.separator),
            )
            check_widths(self.path, rows, width, numbers, last)
            if last and len(rows[-1]) < width:
                rows, self.cut = rows[:-1], True
            frame = pd.DataFrame([(row + [""] * width)[:width] for row in rows], dtype=object)
        table = self.sample
        kept = {c.header: frame[self.at[c.header]] for c in self.mapped.values()}
        texts = {h: cells.map(_text) for h, cells in kept.items() if not pd.api.types.is_numeric_dtype(cells)}
        if texts:
            plain, _ = plain_cells(pd.DataFrame(texts), self.layout.separator)
            kept |= {h: plain[h] for h in texts}
        units = [table.units[table.headers.index(h)] for h in kept]
        return RawTable(self.path, table.name, tuple(kept), tuple(units), pd.DataFrame(kept), before=self.rows)

    def _parsed(self, lines: list[str]) -> Any:
        """The cells of ``lines`` by the fast parser, or None where it may not see what is wrong with them."""
        import pandas as pd

        separator, width = self.layout.separator, len(self.layout.header)
        text = "".join(lines)
        if '"' in text or (separator != " " and text.count(separator) != len(lines) * (width - 1)):
            return None
        try:
            frame = pd.read_csv(
                io.StringIO(text), sep=r"\s+" if separator == " " else separator, header=None, names=range(width + 1),
                index_col=False, engine="c", na_values=list(EMPTY), skipinitialspace=True, low_memory=False, quoting=3,
                decimal="," if self._commas() else ".",
            )  # fmt: skip
        except (ValueError, OverflowError):
            return None
        whole = frame[width].isna().all() and (separator != " " or not frame[width - 1].isna().any())
        return frame if whole and len(frame) == len(lines) else None

    def _commas(self) -> bool:
        return any(getattr(m, "code", "") == "decimal_commas" for m in self.sample.notices)

    def _columns(self, piece: RawTable) -> dict[str, np.ndarray]:
        """The quantities of a ``piece``: rows with a time, numbers that stand for nothing as NaN."""
        date = self.mapped["date"].header if "date" in self.mapped else None
        own = self.mapped["t"]
        if not piece.cells(own.header).notna().any():
            self.rows += len(piece)
            return {"t": np.zeros(0), **{quantity: np.zeros(0) for quantity in self.nothing}}
        clock = clock_of(piece, own.header, own.unit, date, self.chosen.zone_hours)
        known = np.isfinite(clock.t)
        out = {"t": self._forward(clock, known)}
        for quantity, column in self.mapped.items():
            if quantity in self.words:
                self.words[quantity] |= {str(cell).strip() for cell in piece.cells(column.header).dropna().unique()}
            if quantity not in self.nothing:
                continue
            values = numbers_of(piece, quantity, column)
            values = np.where(np.isfinite(values), values, np.nan)
            for number, where in self.nothing[quantity].found(values):
                values[where] = np.nan
                self.masked[column.header, number] += int(where.sum())
            values = with_sign(values, quantity, piece, self.mapped, self.chosen)
            out[quantity] = values[known]
        if {"latitude", "longitude"} <= set(out):
            lost = (out["latitude"] == 0) & (out["longitude"] == 0)
            out["latitude"][lost] = np.nan
            out["longitude"][lost] = np.nan
        self.rows += len(known)
        return out

    def _forward(self, clock: Clock, known: np.ndarray) -> np.ndarray:
        """The times that are ``known`` of a piece. Raises UserError where they run backwards."""
        t = clock.t[known] + self.days
        if clock.words == "times of a day" and len(t) and t[0] < self.end - 43200.0:
            self.days += 86400.0
            t = t + 86400.0
        if self.clock is not None and clock.absolute != self.clock.absolute:
            raise BadValue(f"{self.path}: column '{clock.header}' changes its kind of time after row {self.rows}")
        if self.clock is not None and clock.zoned != self.clock.zoned and self.chosen.zone_hours is None:
            raise mixed_zones(f"{self.path}: column '{clock.header}'", self.rows + 1)
        self.clock = self.clock or clock
        times = np.concatenate([[self.end], t])
        back = np.flatnonzero(np.diff(times) < 0)
        if len(back):
            i = int(back[0])
            row = self.rows + (int(np.flatnonzero(known)[i - 1]) + 1 if i else 0)
            raise backwards(str(self.path), clock.header, row, float(times[i] - times[i + 1]))
        self.end = float(times[-1])
        return t

    def _as_table(self, columns: Mapping[str, np.ndarray], count: int) -> RawTable:
        import pandas as pd

        clock, t = self.clock, columns["t"]
        assert clock is not None
        series: dict[str, Any] = {}
        empty = pd.Series(None, index=range(len(t)), dtype=object)
        for quantity, column in self.mapped.items():
            cells = sorted(self.words.get(quantity, ()))
            if cells:
                empty = empty.copy()
                empty[: len(cells)] = cells
            series[column.header] = empty if quantity in TEXT else pd.Series(columns[quantity])
        units = [self.sample.units[self.sample.headers.index(h)] for h in series]
        notices = [*self.layout.notices, *self.sample.notices]
        if self.comments:
            notices.append(Message(f"lines of comment, left out: {self.comments}", "comment_lines"))
        if self.cut:
            notices.append(Message(CUT_OFF, "last_line_cut"))
        for (header, number), count_of in self.masked.items():
            words = (
                f"{header}: {count_of} cells hold {'over ' * (number == LARGEST)}{number:g}, which stands for nothing"
            )
            notices.append(Message(words, "sentinel"))
        if count > 1:
            words = f"{self.rows} rows averaged by {count}: {len(t)} of {np.median(np.diff(t)):.4g} s are kept"
            notices.append(Message(words, "rows_averaged"))
        clock = Clock(t, clock.absolute, clock.header, clock.words)
        frame = pd.DataFrame(series)
        frame.columns = pd.RangeIndex(len(series))
        name, headers, said = str(self.path), tuple(series), tuple(notices)
        return RawTable(self.path, name, headers, tuple(units), frame, said, clock, self.others, ship=self.layout.ship)


def _text(cell: Any) -> Any:
    """A cell of a column that holds texts as text."""
    return cell if cell is None or cell != cell or isinstance(cell, str) else repr(cell)
