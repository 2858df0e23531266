"""Tables of text in blocks of whole lines, by pyarrow: one way for small files and for those of gigabytes, of which
means of so many neighbouring rows are kept, none across a gap."""

from __future__ import annotations

import codecs
import contextlib
import csv
import io
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.files import opened
from cases.quantities import as_number
from mmg.errors import BadValue, OutOfRange, UserError, reason
from mmg.messages import Message

MOST_KEPT = 400_000  # Most rows of a trial that are kept; 11 hours at 10 Hz. Set by hand: bounds memory.


def rows_together(rows: int) -> int:
    """How many neighbouring rows become one in a file of so many ``rows``, so that MOST_KEPT are not exceeded."""
    return max(1, math.ceil(rows / MOST_KEPT))


class BlockMeans:
    """Means of ``count`` neighbouring rows of a log that is given in pieces.

    periods: of the columns that are angles, by name. The same rows are averaged in every column, so no column is late
    against another. A block ends before a gap (``count`` usual steps long). A column that lacks some rows of a block is
    taken to the block's mean time along the line to its neighbours.
    """

    def __init__(self, count: int, periods: Mapping[str, float]) -> None:
        self.count, self.periods = count, dict(periods)
        self.rows = 0
        self._rest: dict[str, np.ndarray] = {}
        self._parts: list[dict[str, np.ndarray]] = []
        self._late: list[tuple[int, dict[str, np.ndarray]]] = []

    def add(self, columns: Mapping[str, np.ndarray]) -> None:
        """The next rows: columns (N,) by name, "t" [s] among them, increasing and without NaN."""
        self.rows += len(columns["t"])
        if self.count == 1:
            self._parts.append(dict(columns))
            return
        if self._rest:
            columns = {name: np.concatenate([self._rest[name], values]) for name, values in columns.items()}
        t = columns["t"]
        if not len(t):
            return
        step = np.diff(t)
        gap = np.concatenate([[True], step > self.count * np.median(step)]) if len(step) else np.ones(1, dtype=bool)
        row = np.arange(len(t))
        begins = np.flatnonzero((row - np.maximum.accumulate(np.where(gap, row, 0))) % self.count == 0)
        last = begins[-1]  # rows of this block may follow in the next piece; copied, as a view holds the whole one
        self._rest = {name: values[last:].copy() for name, values in columns.items()}
        if last:
            self._average({name: values[:last] for name, values in columns.items()}, begins[:-1])

    def columns(self) -> dict[str, np.ndarray]:
        """The means of all rows that were added, by name (M,)."""
        if self._rest:
            self._average(self._rest, np.zeros(1, dtype=int))
            self._rest = {}
        names = list(self._parts[0]) if self._parts else []
        out = {name: np.concatenate([part.pop(name) for part in self._parts]) for name in names}
        for name in sorted({name for _, late in self._late for name in late}):
            late = np.concatenate([late.get(name, np.zeros(rows)) for rows, late in self._late])
            out[name] = _moved(out["t"], out[name], late, self.periods.get(name))
        return out

    def _average(self, columns: Mapping[str, np.ndarray], begins: np.ndarray) -> None:
        """Keep the means of ``columns`` (N,) over blocks that begin at the rows ``begins`` (M,)."""
        rows, size = np.arange(len(columns["t"])), np.diff(begins, append=len(columns["t"]))
        means: dict[str, np.ndarray] = {}
        late: dict[str, np.ndarray] = {}
        for name, values in columns.items():
            good = np.isfinite(values)
            first = np.minimum.reduceat(np.where(good, rows, len(rows)), begins)
            base = np.append(values, np.nan)[first]  # the mean is that of differences from it: no digits are lost
            off = np.where(good, values - np.repeat(base, size), 0.0)
            if name in self.periods:
                off = np.remainder(off + self.periods[name] / 2, self.periods[name]) - self.periods[name] / 2
                off[~good] = 0.0
            known = np.add.reduceat(good.astype(int), begins)  # (M,) values in each block
            with np.errstate(invalid="ignore", divide="ignore"):
                means[name] = base + np.add.reduceat(off, begins) / known
                if name != "t" and (known < size).any():
                    since = columns["t"] - np.repeat(columns["t"][begins], size)
                    mean_since = np.add.reduceat(np.where(good, since, 0.0), begins) / known
                    late[name] = np.nan_to_num(mean_since - np.add.reduceat(since, begins) / size)
        self._parts.append(means)
        self._late.append((len(begins), late))


def _moved(t: np.ndarray, values: np.ndarray, late: np.ndarray, period: float | None) -> np.ndarray:
    """``values`` (M,) that are means at ``t + late`` (M,) [s], at ``t``, along the lines between neighbours."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return values
    at, y = (t + late)[known], values[known]
    if period:
        y = np.unwrap(y, period=period)
    out = values.copy()
    out[known] -= np.gradient(y, at) * late[known]
    return out


BLOCK, LONGEST_LINE = 2**21, 2**20  # Bytes that are parsed at a time, and most of a line. Set by hand: bounds memory.
SEPARATORS = (";", "\t", "|", ",", " ")  # Between cells; " " stands for any blanks
COMMENT = ("#", "%", "//", "!")  # How lines of comment begin in raw logs
# Cells that hold nothing, in lower case.
EMPTY = ("", "nan", "null", "none", "na", "n/a", "<na>", "-", "--", "---", "#n/a", "nat")
WITH_COMMA = r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$"  # A number with a decimal comma
# A number whose thousands are apart by one of the characters ``mark``, with a ``decimal`` character.
GROUPED = r"[+-]?[1-9]\d{{0,2}}(?:[{mark}]\d{{3}})+(?:[{decimal}]\d+)?"
# Blanks, narrow ones and apostrophes stand between thousands in some languages, and mean nothing else in a number.
BLANKS = " \u00a0\u202f'\u2019"


@dataclass(frozen=True)
class Text:
    """Text in a column of numbers: the first ``row`` with any, from 0, what it holds, the ``count`` of such cells."""

    row: int
    text: str
    count: int

    def error(self, path: Path, name: str, before: int = 0) -> UserError:
        """What is wrong with the column ``name`` of the file ``path``, with so many rows ``before``."""
        shown = f"{self.text[:60]}{'...' * (len(self.text) > 60)}"
        advice = f"({self.count} such cells in the column); correct it or leave the cell empty"
        return BadValue(f"{path}: row {before + self.row + 1}, column '{name}': '{shown}' is not a number {advice}")


def floats_of_cells(cells: Any) -> tuple[np.ndarray, Text | None]:
    """The ``cells`` (N,) of any kind as floats, NaN for gaps and for text; and the text in them."""
    cells = np.asarray(cells)
    if cells.dtype.kind in "iuf":
        return cells.astype(float), None
    values = np.array([number_of(cell) for cell in cells], dtype=float)
    unread = [i for i in np.flatnonzero(np.isnan(values)).tolist() if str(cells[i]).strip().lower() not in EMPTY]
    return values, Text(unread[0], str(cells[unread[0]]), len(unread)) if unread else None


def number_of(cell: Any) -> float:
    """The number in a ``cell``, or of a value of a message; NaN where it is none."""
    if isinstance(cell, str):
        return np.nan if "_" in cell else as_number(cell)  # Python reads 1_0 as ten
    try:
        return np.nan if cell is None or isinstance(cell, bool | np.bool_) else float(cell)
    except (TypeError, ValueError):
        return np.nan
    except OverflowError:  # an integer of hundreds of digits
        return np.inf


def blocks(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Blocks of the lines of the file ``path``, in UTF-8, each with "\\n" at its end; and whether a block is the last.

    Text in UTF-16 needs its mark; what is no UTF-8 is taken for Windows-1252. Raises UserError for a line longer than
    LONGEST_LINE, and for what is no text.
    """
    buffer, last = b"", False
    with opened(path) as stream:
        wide = stream.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        stream.seek(0)
        source: Any = io.TextIOWrapper(stream, "utf-16", "replace", newline="") if wide else stream
        while not last:
            piece = source.read(BLOCK)
            piece, last = (piece.encode() if wide else piece), not piece
            if b"\0" in piece[:4096]:  # in no text of these encodings
                raise BadValue(f"{path}: is no text; expected a table of text, Parquet, or an Excel file (.xlsx)")
            end = buffer.rfind(b"\n") + 1
            if len(buffer) - end > LONGEST_LINE:
                raise OutOfRange(f"{path}: a line is longer than {LONGEST_LINE} bytes; it is no table")
            if end and not last:
                yield as_utf8(buffer[:end]), False
                buffer = buffer[end:]
            buffer += piece.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    yield as_utf8(buffer.removesuffix(b"\n") + b"\n"), True


def as_utf8(block: bytes) -> bytes:
    """The text of a ``block`` in UTF-8: what is none is taken for Windows-1252, or for Japanese where it holds bytes
    that have no meaning there."""
    block = block.removeprefix(codecs.BOM_UTF8)
    for encoding in ("utf-8", "cp1252", "cp932"):
        with contextlib.suppress(UnicodeDecodeError):
            return block.decode(encoding).encode()
    return block.decode("cp1252", "replace").encode()


def _without_comments(block: bytes) -> bytes:
    """The lines of a ``block`` that are no comments."""
    if not any(mark.encode() in block for mark in COMMENT):
        return block
    return re.sub(rb"(?m)^[ \t]*(?:#|%|//|!).*\n", b"", block)


def cells_of(text: str, separator: str) -> list[list[str]]:
    """The cells of the lines of ``text`` that are not blank, between each ``separator``; " " is any blanks."""
    if separator == " ":
        return [line.split() for line in text.splitlines() if line.strip()]
    try:
        rows = list(csv.reader(io.StringIO(text), delimiter=separator))
    except csv.Error:  # such as a field of more than 131072 characters
        return [line.split(separator) for line in text.splitlines() if line.strip()]
    return [row for row in rows if len(row) > 1 or any(map(str.strip, row))]


@dataclass
class TextTable:
    """The rows of a text file below its header.

    path: of it; width: cells of the header; skipped: lines above the first row that are neither blank nor comments;
    log: a raw one, in which lines may be comments, and a row may lack cells only where the file is cut off; separator,
    decimal: of its cells; grouped: column -> the characters between its thousands; source: blocks of a sample of the
    file, of which odd rows are left out. While it is read, rows and cut say how many rows there were, and whether the
    last line was cut off; texts are the numbers of columns that hold some.
    """

    path: Path
    width: int
    skipped: int = 1
    log: bool = False
    separator: str = ","
    decimal: str = "."
    grouped: Mapping[int, str] = field(default_factory=dict)
    source: Callable[[], Iterator[tuple[bytes, bool]]] | None = None
    rows: int = 0
    cut: bool = False
    texts: set[int] = field(default_factory=set)

    def pieces(self, wanted: Collection[int]) -> Iterator[dict[int, np.ndarray]]:
        """The columns ``wanted``, by number, of one block after another: floats (N,), NaN for gaps, or, where a cell is
        no number, objects: text without blanks around it, with decimal points, or None. Raises UserError for rows with
        other numbers of cells."""
        skip, line = self.skipped, 1
        for block, last in self.source() if self.source else blocks(self.path):
            kept = _without_comments(block) if self.log else block
            while skip and kept.strip():
                kept, skip = kept.lstrip().partition(b"\n")[2], skip - 1
            if kept.strip():
                table, odd = self._parsed(kept, wanted)
                if odd and self.source is None:
                    table = self._by_rows(kept, wanted, block, line, last)
                columns = {i: self._column(table.column(str(i)), i) for i in wanted}
                self.texts |= {i for i, cells in columns.items() if cells.dtype == object}
                yield columns
                self.rows += table.num_rows
            line += block.count(b"\n")

    def notices(self) -> list[Message]:
        """What was left out."""
        return [Message("the last line is cut off and left out", "last_line_cut")] * self.cut

    def _parsed(self, block: bytes, wanted: Collection[int]) -> tuple[Any, int]:
        """The table of the cells of a ``block``, and how many of its rows have another number of cells."""
        import pyarrow as pa
        import pyarrow.csv

        odd: list[Any] = []
        names = [str(i) for i in range(self.width)]
        if self.separator == " ":  # one blank between cells, none around a row: pyarrow knows no runs of separators
            block = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[^\S\n]+", b" ", block))
        nothing = sorted({form for word in (*EMPTY, "NaN", "NaT") for form in (word, word.upper(), word.capitalize())})

        def left_out(row: Any) -> str:
            odd.append(row)
            return "skip"

        def read(numbers: bool) -> Any:
            odd.clear()
            words = {*self.texts, *self.grouped}
            kinds = {str(i): pa.float64() if numbers and i not in words else pa.string() for i in wanted}
            return pa.csv.read_csv(
                pa.BufferReader(block),
                pa.csv.ReadOptions(use_threads=False, block_size=len(block) + 1, column_names=names),
                pa.csv.ParseOptions(delimiter=self.separator, invalid_row_handler=left_out),
                pa.csv.ConvertOptions(
                    column_types=kinds, include_columns=list(kinds), null_values=nothing, strings_can_be_null=True,
                    decimal_point=self.decimal,
                ),
            )  # fmt: skip

        try:
            try:
                return read(numbers=True), len(odd)
            except pa.ArrowInvalid:  # text in some column: read again, which only few blocks need
                return read(numbers=False), len(odd)
        except pa.ArrowInvalid as error:
            raise BadValue(f"{self.path}: not a table ({reason(error)})") from None

    def _by_rows(self, kept: bytes, wanted: Collection[int], block: bytes, line: int, last: bool) -> Any:
        """As ``_parsed``, for rows of which some have other numbers of cells. line: number of the first of a block."""
        import pyarrow as pa

        rows, width = cells_of(kept.decode(), self.separator), self.width
        wrong = [i for i, row in enumerate(rows) if any(map(str.strip, row[width:])) or (self.log and len(row) < width)]
        if self.log and last and wrong == [len(rows) - 1] and len(rows[-1]) < width:
            rows, wrong, self.cut = rows[:-1], [], True
        if wrong:
            row, lines = rows[wrong[0]], block.decode().split("\n")
            # Lines that hold rows; those of the header, which a first block has as well, stand before them.
            full = [n for n, words in enumerate(lines) if words.strip() and not (self.log and is_comment(words))]
            mixed = next((s for s in SEPARATORS[:4] if len(row) < width and s.join(row).count(s) >= width - 1), "")
            why = f"cells look separated by {mixed!r} there" if mixed else "correct the line"
            words = f"has {len(row)} cells, the header {width} ({len(wrong)} such lines); {why}"
            raise BadValue(f"{self.path}: line {line + full[len(full) - len(rows) + wrong[0]]} {words}")
        padded = [(row + [""] * width)[:width] for row in rows]
        return pa.table({str(i): pa.array([row[i] for row in padded], pa.string()) for i in wanted})

    def _column(self, column: Any, i: int) -> np.ndarray:
        import pyarrow as pa
        import pyarrow.compute as pc

        if not pa.types.is_floating(column.type):
            column = pc.utf8_trim_whitespace(column)
            empty = pc.is_in(pc.utf8_lower(column), value_set=pa.array(EMPTY))
            column = pc.if_else(empty, pa.scalar(None, pa.string()), column)
            column = pc.replace_substring(column, "\u2212", "-")  # a minus of typesetters
            if i in self.grouped:
                column = pc.replace_substring_regex(column, rf"(\d)[{self.grouped[i]}]", r"\1")
            if self.separator != "," or self.decimal == ",":  # else only a quoted cell can hold one
                column = pc.replace_substring_regex(column, WITH_COMMA, r"\1.\2")
            try:
                column = pc.cast(column, pa.float64())
            except pa.ArrowInvalid:
                return np.asarray(column.to_numpy(zero_copy_only=False), dtype=object)
        one = column.combine_chunks()  # its own way to numpy imports pandas, which takes longer than small files
        known = np.from_dlpack(pc.cast(pc.is_valid(one), pa.uint8()))
        return np.where(known, np.frombuffer(one.buffers()[1])[one.offset :][: len(one)], np.nan)


def is_comment(line: str) -> bool:
    """Whether a ``line`` of a raw log is a comment."""
    return line.lstrip().startswith(COMMENT)
