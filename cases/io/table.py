"""The raw table of a trial file: header cells and columns of numbers, CSV or Parquet."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.cells import floats_of_cells
from cases.io.csv_table import count_rows, csv_columns, csv_header
from cases.io.files import LARGEST as LARGEST_FILE
from cases.io.units import as_number
from mmg.errors import BadValue, Conflict, OutOfRange, TooFewData, Unreadable, UserError
from mmg.messages import printable

Numbers = Callable[..., np.ndarray]
"""Column index -> its values as float (N,), NaN where the cell is empty; a second argument that is true allows a column
of time stamps or durations, which becomes seconds. Raises UserError on text and on numbers that no trial holds."""

MOST_COLUMNS, MOST_ROWS = 5000, 2_500_000
"""Most columns and rows of a table."""
MOST_UNPACKED = 2 * LARGEST_FILE
"""Most bytes of a Parquet file as it would be without compression."""
LONGEST_CELL = 400
"""Most characters of a text in Parquet; a file of a few kB can name a long one millions of times."""
LARGEST = 1e13
"""No number of a trial is larger, in any unit."""


def read_table(path: Path, content: bytes) -> tuple[list[str], Numbers]:
    """Header cells of the file ``path`` with this ``content``, and a function that gives a column as numbers.

    Raises UserError when the file is empty, holds no rows, is not a table, names a column twice, or is too large.
    """
    if not content[:1000].strip() and not content.strip():
        raise TooFewData(f"{path}: the file is empty")
    header, count, rows, column = (_parquet if path.suffix.lower() == ".parquet" else _csv)(path, content)
    header = checked_header(path, header)
    if count > MOST_ROWS:
        raise OutOfRange(f"{path}: has {count} rows, more than {MOST_ROWS}; divide it")
    if rows() == 0:
        raise TooFewData(f"{path}: a header but no rows")
    return header, lambda index, clock=False: within(path, header[index], column(index, header[index], clock))


def checked_header(path: Path, header: list[str]) -> list[str]:
    """The cells of the ``header`` of the file ``path``, as they are shown. Raises UserError for too many columns, for
    numbers, for nothing, and for a column that is named twice."""
    if len(header) > MOST_COLUMNS:
        raise OutOfRange(f"{path}: has {len(header)} columns, more than {MOST_COLUMNS}; leave out what is not needed")
    header = [printable(cell).strip() for cell in header]
    if any(cell and not _is_text(cell) for cell in header):
        raise BadValue(f"{path}: the first line holds numbers, not headers such as 't [s],psi [rad],...'")
    if not any(header):
        raise BadValue(f"{path}: the first line is blank; it must hold the headers")
    doubled = sorted({cell for cell in header if cell and header.count(cell) > 1})
    if doubled:
        raise Conflict(f"{path}: the header names '{doubled[0]}' twice; rename or remove one of them")
    return header


def _is_text(cell: str) -> bool:
    return math.isnan(as_number(cell)) or cell.lower() in ("inf", "infinity")


_Parts = tuple[list[str], int, Callable[[], int], Callable[[int, str, bool], np.ndarray]]
"""Header cells, lines or rows by what is known before anything is parsed, one that counts rows, and one that gives the
numbers of a column by its number, its name, and whether it may be a clock: called once the header is good."""


def _csv(path: Path, content: bytes) -> _Parts:
    header, lines = csv_header(path, content), count_rows(path, content)
    table = csv_columns(path, content, len(header), lines)
    stripped = content.strip()
    single = b"\n" not in stripped and b"\r" not in stripped  # a header of thousands of cells is not parsed for nothing
    return header, lines, lambda: 0 if single else table().rows, lambda index, name, clock: table().numbers(index, name)


def _parquet(path: Path, content: bytes) -> _Parts:
    import pyarrow as pa
    import pyarrow.parquet as pq

    def refused(error: Exception) -> UserError:
        why = " ".join(str(error).split())
        why = "it is cut off, damaged or none" if "magic bytes" in why else why[:120]
        return Unreadable(f"{path}: not a readable Parquet file ({why})")

    try:
        file = pq.ParquetFile(io.BytesIO(content), page_checksum_verification=True)
        header, rows = list(file.schema_arrow.names), file.metadata.num_rows
        # sizes of single columns are not asked for: on some damaged files that aborts the process
        unpacked = sum(file.metadata.row_group(k).total_byte_size for k in range(file.num_row_groups))
        if unpacked > MOST_UNPACKED:
            raise ValueError(f"it has {unpacked / 2**20:.0f} MB unpacked, more than {MOST_UNPACKED // 2**20}")
    except Exception as error:
        raise refused(error) from None

    def column(index: int) -> Any:
        kind, name = file.schema_arrow.types[index], header[index]
        kind = kind.value_type if pa.types.is_dictionary(kind) else kind
        words = f"{path}: column '{name}' holds {kind}, which is no number"
        if pa.types.is_nested(kind) or pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
            raise BadValue(words)
        try:
            text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
            source = (
                pq.ParquetFile(io.BytesIO(content), read_dictionary=[name], page_checksum_verification=True)
                if text
                else file
            )
            found = source.read(columns=[name]).column(0)
            if len(found) != rows:
                raise ValueError(f"column '{name}' has {len(found)} values in {rows} rows")
            if pa.types.is_dictionary(found.type):  # each text once, however often the rows name it
                _check_texts(name, found)
                found = found.unify_dictionaries()
            if pa.types.is_decimal(kind):
                found = found.cast(pa.float64())
            return found.to_pandas()
        except Exception as error:
            raise refused(error) from None

    return header, rows, lambda: rows, lambda index, name, clock: _numbers(path, name, column(index), clock)


def _check_texts(name: str, found: Any) -> None:
    """Raises ValueError where a text of the column ``name`` is longer than any number."""
    longest = max((len(str(text)) for chunk in found.chunks for text in chunk.dictionary), default=0)
    if longest > LONGEST_CELL:
        raise ValueError(f"column '{name}' holds a text of {longest} characters")


def _numbers(path: Path, cell: str, series: Any, clock: bool) -> np.ndarray:
    """A column as floats; text is an error that names row (1 = first below the header) and column."""
    kind = getattr(series.dtype, "kind", "O")
    if kind in "mM" and clock:
        since = series - series.min() if kind == "M" else series
        return np.asarray(since.dt.total_seconds().to_numpy(dtype=float))
    if kind in "mMb":
        raise BadValue(f"{path}: column '{cell}' holds {series.dtype}, which is no number")
    values, text = floats_of_cells(series)
    if text is not None:
        raise text.error(path, cell)
    return values


def within(path: Path, cell: str, values: np.ndarray, before: int = 0) -> np.ndarray:
    """The ``values`` (N,) of the column ``cell`` of the file ``path``, whose rows follow ``before`` others. Raises
    UserError for a number that no trial holds."""
    beyond = np.flatnonzero(np.isfinite(values) & (np.abs(values) > LARGEST))
    if len(beyond):
        at = int(beyond[0])
        words = f"row {before + at + 1}, column '{cell}': {values[at]:g} is larger than anything in a trial"
        raise OutOfRange(f"{path}: {words}")
    return values
