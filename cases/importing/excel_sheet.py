"""Tables of Excel workbooks (.xlsx), by openpyxl."""

from __future__ import annotations

import io
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from cases.importing.delimited_text import EMPTY, KNOWN_UNITS, PREAMBLE, ship_named
from cases.importing.raw_table import MOST_CELLS, RawTable, raw_table
from cases.io.files import LARGEST, read_bytes
from mmg.errors import BadValue, NotInstalled, OutOfRange, Unreadable, UserError
from mmg.messages import Message


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

    first = next((i for i, row in enumerate(rows[: PREAMBLE + 2]) if _is_data(row)), None)
    if first is None or first == 0:
        return None
    units = [""] * len(rows[first])
    header = first - 1
    if header > 0 and _are_units(rows[header]):
        units = ["" if c is None else str(c).strip("[]() ") for c in rows[header]]
        header -= 1
    cells = ["" if c is None else str(c) for c in rows[header]]
    notices = [Message(f"lines before the header, left out: {header}", "lines_before_header")] if header else []
    frame = pd.DataFrame(rows[first:], dtype=object)
    table = raw_table(path, f"{path}, sheet '{title}'" if several else str(path), cells, units, frame, notices)
    return replace(table, ship=ship_named("; ".join(str(c) for c in row if c is not None) for row in rows[:header]))


def _is_data(row: list[Any]) -> bool:
    """Whether most cells that are not empty hold something else than text."""
    filled = [c for c in row if c is not None]
    return sum(not isinstance(c, str) or _is_number(c) for c in filled) > 0.5 * len(filled)


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _are_units(row: list[Any]) -> bool:
    filled = [str(c).strip() for c in row if c is not None]
    return bool(filled) and sum(c.strip("[]() ").lower() in KNOWN_UNITS for c in filled) >= 0.7 * len(filled)
