"""The raw table of a trial file: header cells and columns of numbers, CSV or Parquet."""

from __future__ import annotations

import codecs
import csv
import io
import math
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.files import LARGEST as LARGEST_FILE
from cases.io.units import as_number
from mmg.errors import UserError
from mmg.messages import printable

Numbers = Callable[..., np.ndarray]
"""Column index -> its values as float (N,), NaN where the cell is empty; a second argument that is true allows a column
of time stamps or durations, which becomes seconds. Raises UserError on text and on numbers that no trial holds."""

LONGEST_HEADER, MOST_COLUMNS, MOST_ROWS = 2**20, 5000, 2_500_000
"""Most bytes of the first line, columns, and rows of a table."""
MOST_UNPACKED = 2 * LARGEST_FILE
"""Most bytes of a Parquet file as it would be without compression."""
LONGEST_CELL = 400
"""Most characters of a text in Parquet; a file of a few kB can name a long one millions of times."""
_PIECE = 2**20
LARGEST = 1e13
"""No number of a trial is larger, in any unit."""


def read_table(path: Path, content: bytes) -> tuple[list[str], Numbers]:
    """Header cells of the file ``path`` with this ``content``, and a function that gives a column as numbers.

    Raises UserError when the file is empty, holds no rows, is not a table, names a column twice, or is too large.
    """
    if not content[:1000].strip() and not content.strip():
        raise UserError(f"{path}: the file is empty")
    parquet = path.suffix.lower() == ".parquet"
    header, rows, column = (_parquet if parquet else _csv)(path, content)
    if len(header) > MOST_COLUMNS:
        raise UserError(f"{path}: has {len(header)} columns, more than {MOST_COLUMNS}; leave out what is not needed")
    header = [printable(cell).strip() for cell in header]
    if any(cell and not _is_text(cell) for cell in header):
        raise UserError(f"{path}: the first line holds numbers, not headers such as 't [s],psi [rad],...'")
    if not any(header):
        raise UserError(f"{path}: the first line is blank; it must hold the headers")
    doubled = sorted({cell for cell in header if cell and header.count(cell) > 1})
    if doubled:
        raise UserError(f"{path}: the header names '{doubled[0]}' twice; rename or remove one of them")
    count = rows() if parquet else content.count(b"\n") - 1  # before the text is parsed
    if count > MOST_ROWS:
        raise UserError(f"{path}: has {count} rows, more than {MOST_ROWS}; divide it")
    if rows() == 0:
        raise UserError(f"{path}: a header but no rows")
    return header, lambda index, clock=False: _numbers(path, header[index], column(index), clock)


def _is_text(cell: str) -> bool:
    return math.isnan(as_number(cell)) or cell.lower() in ("inf", "infinity")


_Parts = tuple[list[str], Callable[[], int], Callable[[int], Any]]
"""Header cells, one that counts rows, and one that gives a column as a series: called once the header is good."""


def _csv(path: Path, content: bytes) -> _Parts:
    first = content[:LONGEST_HEADER].splitlines()[0]
    if len(first) == LONGEST_HEADER:
        raise UserError(f"{path}: the first line is longer than {LONGEST_HEADER} bytes; it must hold the headers")
    if first.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise UserError(f"{path}: is encoded in UTF-16; save it in UTF-8")
    if b"\0" in first:
        raise UserError(f"{path}: is no text; trial files are comma-separated text, or Parquet")
    line = first.decode(_encoding(first))
    try:
        header = next(csv.reader([line]))
    except csv.Error as error:
        raise UserError(f"{path}: the first line is not a header ({error})") from None
    if len(header) == 1 and (";" in line or "\t" in line):
        raise UserError(f"{path}: cells are not separated by commas; save the file as comma-separated CSV")
    frame = cache(partial(_csv_frame, path, content, len(header)))
    return header, lambda: len(frame()), lambda index: frame().iloc[:, index]


def _encoding(content: bytes) -> str:
    """UTF-8 with or without a mark, else Latin-1, which every byte is."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for start in range(0, len(content), _PIECE):
            decoder.decode(content[start : start + _PIECE], start + _PIECE >= len(content))
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _csv_frame(path: Path, content: bytes, columns: int) -> Any:
    """The rows below the header; line ends may be those of any system."""
    import pandas as pd

    text = io.TextIOWrapper(io.BytesIO(content), _encoding(content), newline=None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            return pd.read_csv(
                text, header=None, skiprows=1, index_col=False, names=range(columns), engine="c",
                skip_blank_lines=False,
            )  # fmt: skip
    except pd.errors.EmptyDataError:
        return pd.DataFrame()
    except (pd.errors.ParserError, pd.errors.ParserWarning, ValueError, OverflowError) as error:
        why = " ".join(str(error).split())
        raise UserError(f"{path}: not a table ({why}); check the commas of that row") from None


def _parquet(path: Path, content: bytes) -> _Parts:
    import pyarrow as pa
    import pyarrow.parquet as pq

    def refused(error: Exception) -> UserError:
        return UserError(f"{path}: not a readable Parquet file ({' '.join(str(error).split())[:120]})")

    try:
        file = pq.ParquetFile(io.BytesIO(content))
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
            raise UserError(words)
        try:
            text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
            source = pq.ParquetFile(io.BytesIO(content), read_dictionary=[name]) if text else file
            found = source.read(columns=[name]).column(0)
            if len(found) != rows:
                raise ValueError(f"column '{name}' has {len(found)} values in {rows} rows")
            if pa.types.is_dictionary(found.type):  # each text once, however often the rows name it
                _check_texts(name, found)
                found = found.cast(kind)
            if pa.types.is_decimal(kind):
                found = found.cast(pa.float64())
            return found.to_pandas()
        except Exception as error:
            raise refused(error) from None

    return header, lambda: rows, column


def _check_texts(name: str, found: Any) -> None:
    """Raises ValueError where a text of the column ``name`` is longer than any number."""
    longest = max((len(str(text)) for chunk in found.chunks for text in chunk.dictionary), default=0)
    if longest > LONGEST_CELL:
        raise ValueError(f"column '{name}' holds a text of {longest} characters")


def _numbers(path: Path, cell: str, series: Any, clock: bool) -> np.ndarray:
    """A column as floats; text is an error that names row (1 = first below the header) and column."""
    kind = getattr(series.dtype, "kind", "O")
    if kind in "iuf":
        values = series.to_numpy(dtype=float, na_value=np.nan)
    elif kind in "mM" and clock:
        since = series - series.min() if kind == "M" else series
        values = since.dt.total_seconds().to_numpy(dtype=float)
    elif kind in "mMb":
        raise UserError(f"{path}: column '{cell}' holds {series.dtype}, which is no number")
    else:
        values = _numbers_of_text(path, cell, series.astype(object))
    beyond = np.flatnonzero(np.isfinite(values) & (np.abs(values) > LARGEST))
    if len(beyond):
        row = int(beyond[0])
        raise UserError(f"{path}: row {row + 1}, column '{cell}': {values[row]:g} is larger than anything in a trial")
    return values


def _numbers_of_text(path: Path, cell: str, series: Any) -> np.ndarray:
    """A column of cells of which some are no numbers yet: text that is a number is one, blank text is a gap."""
    import pandas as pd

    given = series.notna().to_numpy()
    try:
        values = pd.to_numeric(series, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    except (OverflowError, TypeError, ValueError):  # integers of hundreds of digits, and objects of other kinds
        values = np.array([as_number(str(value)) for value in series])
    bad = [i for i in np.flatnonzero(np.isnan(values) & given) if not _is_gap(str(series.iloc[i]))]
    if bad:
        row = bad[0]
        shown = str(series.iloc[row])
        raise UserError(
            f"{path}: row {row + 1}, column '{cell}': '{shown[:60]}{'...' * (len(shown) > 60)}' is not a number "
            f"({len(bad)} such cells in the column); correct it or leave the cell empty"
        )
    return values


def _is_gap(text: str) -> bool:
    return text.strip().lower() in ("", "nan")
