"""The raw table of a trial file: header cells and columns of numbers, CSV or Parquet."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mmg.errors import UserError

Numbers = Callable[[int], np.ndarray]
"""Column index -> its values as float (N,), NaN where the cell is empty; raises UserError on text."""


def read_table(path: Path, content: bytes) -> tuple[list[str], Numbers]:
    """Header cells of the file ``path`` with this ``content``, and a function that gives a column as numbers.

    Raises UserError when the file is empty, holds no rows, is not a table, or names a column twice.
    """
    if not content.strip():
        raise UserError(f"{path}: the file is empty")
    header, frame = (_parquet if path.suffix.lower() == ".parquet" else _csv)(path, content)
    if any(cell and not _is_text(cell) for cell in header):
        raise UserError(f"{path}: the first line holds numbers, not headers such as 't [s],psi [rad],...'")
    if not any(header):
        raise UserError(f"{path}: the first line is blank; it must hold the headers")
    doubled = sorted({cell for cell in header if cell and header.count(cell) > 1})
    if doubled:
        raise UserError(f"{path}: the header names '{doubled[0]}' twice; rename or remove one of them")
    if len(frame) == 0:
        raise UserError(f"{path}: a header but no rows")
    return header, lambda index: _numbers(path, header[index], frame.iloc[:, index])


def _is_text(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return cell.lower() in ("nan", "inf", "infinity")


def _csv(path: Path, content: bytes) -> tuple[list[str], Any]:
    import pandas as pd

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    first = text.split("\n", 1)[0]
    header = [cell.strip() for cell in next(csv.reader([first.rstrip("\r")]))]
    if len(header) == 1 and (";" in first or "\t" in first):
        raise UserError(f"{path}: cells are not separated by commas; save the file as comma-separated CSV")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            frame = pd.read_csv(
                io.StringIO(text), header=None, skiprows=1, index_col=False, names=range(len(header)),
                engine="c", skip_blank_lines=False,
            )  # fmt: skip
    except pd.errors.EmptyDataError:
        return header, pd.DataFrame()
    except (pd.errors.ParserError, pd.errors.ParserWarning, ValueError) as error:
        why = " ".join(str(error).split())
        raise UserError(f"{path}: not a table ({why}); check the commas of that row") from None
    return header, frame


def _parquet(path: Path, content: bytes) -> tuple[list[str], Any]:
    import pandas as pd

    try:
        frame = pd.read_parquet(io.BytesIO(content))
    except Exception as error:
        why = " ".join(str(error).split())[:120]
        raise UserError(f"{path}: not a readable Parquet file ({why})") from None
    return [str(name).strip() for name in frame.columns], frame


def _numbers(path: Path, cell: str, series: Any) -> np.ndarray:
    """A column as floats; text is an error that names row (1 = first below the header) and column."""
    import pandas as pd

    kind = getattr(series.dtype, "kind", "O")
    if kind in "iuf":
        return series.to_numpy(dtype=float, na_value=np.nan)
    values = pd.to_numeric(series, errors="coerce") if kind not in "mMb" else series.astype(float) * np.nan
    bad = np.flatnonzero((values.isna() & series.notna()).to_numpy())
    if kind == "O" or len(bad):
        blank = [i for i in bad if str(series.iloc[i]).strip() == ""]
        bad = np.setdiff1d(bad, blank)
    if len(bad):
        row = int(bad[0])
        raise UserError(
            f"{path}: row {row + 1}, column '{cell}': '{series.iloc[row]}' is not a number "
            f"({len(bad)} such cells in the column); correct it or leave the cell empty"
        )
    return values.to_numpy(dtype=float, na_value=np.nan)
