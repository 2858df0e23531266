"""The table of a trial file, CSV or Parquet: its header, and its columns as numbers; of long files means of rows."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.conventions import masked, remarks
from cases.io.files import LARGEST as LARGEST_FILE
from cases.io.files import check_file, lines_and_hash
from cases.io.text_table import LONGEST_LINE, BlockMeans, TextTable, blocks, floats_of_cells, rows_together
from cases.quantities import as_number, quantity
from cases.trial import MOST_ROWS
from mmg.errors import BadValue, Conflict, OutOfRange, TooFewData, Unreadable, UserError, reason
from mmg.messages import Message, printable

LARGEST_CSV = 8 * 2**30  # Most bytes of a CSV file, which is read in pieces. Set by hand.
# Most columns of a table, and most rows and cells of one whose rows are not averaged.
MOST_COLUMNS, MOST_CELLS = 5000, 30_000_000  # set by hand: it bounds memory, to 240 MB
MOST_UNPACKED = 2 * LARGEST_FILE  # Most bytes of a Parquet file without its compression. Set by hand: bounds memory.
LARGEST = 1e13  # No number of a trial is larger, in any unit. Set by hand: milliseconds since 1970 are below it.
Wanted = Mapping[str, tuple[int, float]]
"""Canonical name -> number of the column and factor to SI."""
Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class TrialTable:
    """A file whose header is known.

    path: of it; header: its cells; sha256: of its bytes; rows: lines or rows below the header; read: the columns of
    these numbers, one piece of the file after another, as cells (N,) of any kind; is_file: else its path is only what
    errors call it.
    """

    path: Path
    header: list[str]
    sha256: str
    rows: int
    read: Callable[[Collection[int]], Iterator[dict[int, Any]]]
    is_file: bool = True

    def numbers(self, wanted: Collection[int], clock: int | None = None) -> dict[int, np.ndarray]:
        """The columns ``wanted``, by number, as floats (N,), NaN where a cell is empty. clock: one that may hold time
        stamps or durations, which become seconds. Raises UserError on text, on numbers that no trial holds, for no row,
        and for more than MOST_ROWS or MOST_CELLS."""
        if self.rows > MOST_ROWS:
            raise OutOfRange(f"{self.path}: has {self.rows} rows, more than {MOST_ROWS}; divide it")
        if self.rows * len(wanted) > MOST_CELLS:
            words = f"{len(wanted)} columns of {self.rows} rows are more than {MOST_CELLS} cells"
            raise OutOfRange(f"{self.path}: {words}; leave out columns that are not needed, or divide it")
        parts = list(self._floats(wanted, clock))
        if not sum(len(part) for part in parts[0].values()) if parts else True:
            raise TooFewData(f"{self.path}: a header but no rows")
        return {i: np.concatenate([part[i] for part in parts]) for i in wanted}

    def columns(self, wanted: Wanted, sentinels: Sequence[float] | None, notices: list[Message]) -> Columns:
        """The ``wanted`` columns in SI, every row or means of rows, infinite values and sentinels missing. sentinels:
        further numbers that stand for no value, None where none are looked for; notices: are added to. Raises UserError
        as ``numbers`` does, for no row, and where the clock of rows that are averaged runs backwards."""
        count = rows_together(self.rows)
        numbers = list(dict.fromkeys(index for index, _ in wanted.values()))
        pieces = self._floats(numbers, wanted["t"][0]) if count > 1 else iter([self.numbers(numbers, wanted["t"][0])])
        means = BlockMeans(count, {name: period for name in wanted if (period := quantity(name).period)})
        nothing, infinite, last, before, out = Counter[tuple[str, float]](), Counter[str](), -math.inf, 0, Columns()
        for piece in pieces:  # one where rows are not averaged
            out = {name: piece[index] * factor for name, (index, factor) in wanted.items()}
            if sentinels is not None:
                out, counts = masked(out, wanted, sentinels)
                nothing.update(counts)
            for name, values in out.items():
                wrong = np.isinf(values)
                infinite[name] += int(wrong.sum())
                out[name] = np.where(wrong, np.nan, values) if wrong.any() else values
            if count > 1:  # rows without a time or any value are in no mean
                known = [np.isfinite(values) for name, values in out.items() if name != "t"]
                rows = np.flatnonzero(np.isfinite(out["t"]) & np.any(known, axis=0))
                check_forward(self.path, np.append(last, out["t"][rows]), before + np.append(-1, rows))
                before, last = before + len(out["t"]), float(out["t"][rows[-1]]) if len(rows) else last
                means.add({name: values[rows] for name, values in out.items()})
        out = means.columns() if count > 1 else out
        if not out or not len(out["t"]):
            raise TooFewData(f"{self.path}: no row holds a time and a state ({self.rows} rows); nothing to read")
        notices += remarks(nothing)
        for name, cells in infinite.items():
            if cells:
                notices.append(Message(f"{name}: {cells} infinite values taken as missing", "infinite_values"))
        if count > 1:
            step = np.median(np.diff(out["t"]))
            words = f"{self.rows} rows averaged by {count}: {len(out['t'])} of {step:.4g} s are kept"
            notices.append(Message(words, "rows_averaged"))
        return out

    def _floats(self, wanted: Collection[int], clock: int | None) -> Iterator[dict[int, np.ndarray]]:
        before = 0
        for piece in self.read(wanted):
            yield {i: self._column(piece[i], i, i == clock, before) for i in wanted}
            before += len(next(iter(piece.values()), ()))

    def _column(self, cells: np.ndarray, index: int, clock: bool, before: int) -> np.ndarray:
        """A column as floats; text, and a number that no trial holds, is an error that names row (1 = first below the
        header) and column. before: rows of the file before its first."""
        name, kind = self.header[index], cells.dtype.kind
        if kind in "mM" and clock:
            since = cells - np.nanmin(cells) if kind == "M" else cells
            return np.where(np.isnat(cells), np.nan, since / np.timedelta64(1, "s"))
        if kind in "mMbc":
            raise BadValue(f"{self.path}: column '{name}' holds {cells.dtype}, which is no number")
        values, text = floats_of_cells(cells)
        if text is not None:
            raise text.error(self.path, name, before)
        beyond = np.flatnonzero(np.isfinite(values) & (np.abs(values) > LARGEST))
        if len(beyond):
            at = int(beyond[0])
            words = f"row {before + at + 1}, column '{name}': {values[at]:g} is larger than anything in a trial"
            raise OutOfRange(f"{self.path}: {words}")
        return values


def trial_table(path: Path) -> TrialTable:
    """The table in the file ``path``, CSV or Parquet. Raises UserError where there is none."""
    if path.suffix.lower() == ".parquet":
        check_file(path)
        return _parquet(path)
    check_file(path, LARGEST_CSV)
    header = checked_header(path, _first_line(path))
    lines, digest = lines_and_hash(path)
    return TrialTable(path, header, digest, lines - 1, TextTable(path, len(header)).pieces)


def _first_line(path: Path) -> list[str]:
    """The cells of the first line of the CSV file ``path``. Raises UserError where there is no such line."""
    for block, _ in islice(blocks(path), 1):
        line = block.partition(b"\n")[0].decode()
        if not block.strip():
            raise TooFewData(f"{path}: the file is empty")
    if len(line) > LONGEST_LINE:
        raise OutOfRange(f"{path}: the first line is longer than {LONGEST_LINE} bytes; it must hold the headers")
    try:
        header = next(csv.reader([line]), [])
    except csv.Error as error:
        raise BadValue(f"{path}: the first line is not a header ({error})") from None
    if len(header) == 1 and (";" in line or "\t" in line):
        raise BadValue(f"{path}: cells are not separated by commas; save the file as comma-separated CSV")
    return header


def checked_header(path: Path, header: list[str]) -> list[str]:
    """The cells of the ``header`` of the file ``path``, as they are shown. Raises UserError for too many columns, for
    numbers, for nothing, and for a column that is named twice."""
    if len(header) > MOST_COLUMNS:
        raise OutOfRange(f"{path}: has {len(header)} columns, more than {MOST_COLUMNS}; leave out what is not needed")
    header = [printable(cell).strip() for cell in header]
    if any(math.isfinite(as_number(cell)) for cell in header):
        raise BadValue(f"{path}: the first line holds numbers, not headers such as 't [s],psi [rad],...'")
    if not any(header):
        raise BadValue(f"{path}: the first line is blank; it must hold the headers")
    doubled = sorted({cell for cell in header if cell and header.count(cell) > 1})
    if doubled:
        raise Conflict(f"{path}: the header names '{doubled[0]}' twice; rename or remove one of them")
    return header


def check_forward(path: Path, t: np.ndarray, rows: np.ndarray) -> None:
    """Raises UserError for times ``t`` (N,) [s] that do not increase, naming the file ``path`` and the row among
    ``rows`` (N,), 0 the first of the file."""
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        i = int(bad[0])
        words = f"{'repeats' if t[i + 1] == t[i] else 'runs backwards'} at row {rows[i + 1] + 1}: "
        words += f"t = {t[i]:.10g} s, then {t[i + 1]:.10g} s ({len(bad)} such rows)"
        raise BadValue(f"{path}: time {words}; sort the rows or remove the doubled ones")


def no_parquet(path: Path, error: Exception) -> UserError:
    """What is said of the file ``path`` that pyarrow cannot read, by its ``error``."""
    why = "it is cut off, damaged or none" if "magic bytes" in str(error) else reason(error)
    return Unreadable(f"{path}: not a readable Parquet file ({why})")


def _parquet(path: Path) -> TrialTable:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        header, rows = list(file.schema_arrow.names), file.metadata.num_rows
        # sizes of single columns are not asked for: on some damaged files that aborts the process
        unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.num_row_groups))
        if unpacked > MOST_UNPACKED:
            raise ValueError(f"it has {unpacked / 2**20:.0f} MB unpacked, more than {MOST_UNPACKED // 2**20}")
    except Exception as error:
        raise no_parquet(path, error) from None

    def column(index: int) -> np.ndarray:
        kind, name = file.schema_arrow.types[index], header[index]
        clear = (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal, pa.types.is_temporal, pa.types.is_null)
        if not any(is_it(kind) for is_it in clear):  # a few kB can hold a long text millions of times
            raise BadValue(f"{path}: column '{name}' holds {kind}, which is no number")
        try:
            cells = file.read(columns=[name]).column(0)
            if len(cells) != rows:
                raise ValueError(f"column '{name}' has {len(cells)} values in {rows} rows")
            return np.asarray((cells.cast(pa.float64()) if pa.types.is_decimal(kind) else cells).to_numpy())
        except Exception as error:
            raise no_parquet(path, error) from None

    def read(wanted: Collection[int]) -> Iterator[dict[int, np.ndarray]]:
        yield {i: column(i) for i in wanted}

    checked = checked_header(path, header)
    if rows > MOST_ROWS:
        raise OutOfRange(f"{path}: has {rows} rows, more than {MOST_ROWS}; divide it")
    return TrialTable(path, checked, lines_and_hash(path)[1], rows, read)
