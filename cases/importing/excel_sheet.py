"""Tables of Excel workbooks (.xlsx), by openpyxl."""

from __future__ import annotations

import io
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from cases.importing.raw_table import MOST_CELLS, NUMBERED, RawTable, raw_table
from cases.importing.text_log import LOOKED_AT, PREAMBLE, layout
from cases.io.files import LARGEST, read_bytes
from cases.io.text_table import EMPTY
from mmg.errors import BadValue, NotInstalled, OutOfRange, Unreadable, UserError


def read_excel_tables(path: Path) -> list[RawTable]:
    """The tables of the workbook ``path``, one of each sheet that holds numbers below a header.

    Raises UserError where openpyxl is missing, the file is no workbook, or no sheet holds a table.
    """
    try:
        import openpyxl
    except ImportError:
        raise NotInstalled(
            f"{path}: Excel files need openpyxl; pip install 'mmg-ident[import]', or save it as CSV"
        ) from None
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(info.file_size for info in archive.infolist())
        if unpacked > 4 * LARGEST:
            raise OutOfRange(f"{path}: {unpacked / 2**20:.0f} MB unpacked are too many; divide it")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        sheets = [(str(sheet.title), _rows(path, sheet)) for sheet in book.worksheets]
    except UserError:
        raise
    except zipfile.BadZipFile:
        raise Unreadable(f"{path}: is cut off, damaged or no Excel workbook (.xlsx)") from None
    except Exception as error:  # openpyxl raises many kinds for damaged files
        raise Unreadable(f"{path}: not a readable Excel workbook ({' '.join(str(error).split())[:120]})") from None
    tables = [table for title, rows in sheets if (table := _table(path, title, len(sheets) > 1, rows)) is not None]
    if not tables:
        raise BadValue(f"{path}: no sheet holds numbers below a line of headers")
    return tables


def _rows(path: Path, sheet: Any) -> list[list[Any]]:
    rows, cells = [], 0
    for row in sheet.iter_rows(values_only=True):
        cells += len(row)
        if cells > MOST_CELLS:
            raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
        rows.append([None if isinstance(c, str) and c.strip().lower() in EMPTY else c for c in row])
    return [row for row in rows if any(c is not None for c in row)]


def _table(path: Path, title: str, several: bool, rows: list[list[Any]]) -> RawTable | None:
    """The table of a sheet, or None where it holds none."""
    import pandas as pd

    words = [["" if c is None else str(c) for c in row] for row in rows[: PREAMBLE + LOOKED_AT]]
    if not words:
        return None
    try:
        found = layout(path, words, [], "; ")
    except BadValue:
        return None
    if found.header[0] == f"{NUMBERED} 1":
        return None
    frame, name = pd.DataFrame(rows[found.first :], dtype=object), f"{path}, sheet '{title}'" if several else str(path)
    return replace(raw_table(path, name, found.header, found.units, frame, found.notices), ship=found.ship)
