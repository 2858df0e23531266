"""Tables in files: text with any separator, encoding, size and lines above the data, Excel workbooks, Parquet."""

from __future__ import annotations

import io
import itertools
import re
import warnings
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cases.importing.import_map import OpenQuestion
from cases.importing.raw_table import NUMBERED, RawTable, raw_table, split_unit
from cases.importing.vocabulary import GIVEN_UNITS, factor, is_order, meaning
from cases.io.files import LARGEST, lines_and_hash, opened, read_bytes
from cases.io.text_table import (
    BLANKS,
    EMPTY,
    GROUPED,
    SEPARATORS,
    WITH_COMMA,
    TextTable,
    as_utf8,
    blocks,
    cells_of,
    is_comment,
    rows_together,
)
from cases.io.trial_table import MOST_CELLS, no_parquet
from cases.quantities import QUANTITIES, as_number
from mmg.errors import BadValue, OutOfRange, TooFewData, Unreadable, UserError, needed, reason
from mmg.messages import Message

LARGEST_LOG, SMALL = 8 * 2**30, 2**25  # Most bytes of a log of text, and of one of which all columns are held
LOOKED_AT, PREAMBLE = 400, 200  # Lines by which separator and header are found, and most before it. Set by hand.
PLACES, SAMPLE = 40, 2**15  # Places at which a log whose rows are averaged is looked at before, and bytes at each
NUMBER = re.compile(rf"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|{GROUPED.format(mark=',.' + BLANKS, decimal='.,')}")
# A cell such as "hh:mm:ss" or "ddmm.mmmm", in lower case.
DATE_FORMAT = r"[dhmsyt:./°'\" _\-]*(?:[dhmsy]{2}|[hmsd]:)[dhmsyt:./°'\" _\-]*"
# Cells of a line of some loggers below the units: how values came to be, or how they are held.
PROCESSING = {"smp", "avg", "min", "max", "std", "tot", "inst", "ts", "rn", "f8", "f4", "ascii"}
# A line that names a ship.
SHIP = r"\W*(?:vessel|ship|mmsi|imo)(?:[ _]?(?:name|number|no\.?))?\W*[:=;,|\t]\s*(\S.{0,60})"


class Layout(NamedTuple):
    """Where rows of cells hold a table.

    header, units: (C,) cells, units "" where there are none; first: number of the first row of data; notices: what was
    found; ship: that a line above the table names.
    """

    header: list[str]
    units: list[str]
    first: int
    notices: list[Message]
    ship: str


def read_text_log(path: Path, decimal: str = "") -> RawTable:
    """The table in the text file ``path``; a large one, or one whose rows are averaged, is only looked at, and read in
    ``RawTable.pieces``.

    decimal: the character before the parts of a whole, where the map says it. Raises UserError where the file is empty
    or no text, where no line holds a header above rows of equally many cells, where rows have other numbers of cells
    (the first is named), and where it stays open whether a comma is before parts of a whole or between thousands.
    """
    import pandas as pd

    count, (begin, _) = lines_and_hash(path)[0] - 1, next(blocks(path))
    long = rows_together(count) > 1 or path.stat().st_size > SMALL
    sample = begin if not long else as_utf8(b"\n".join([begin[:SAMPLE].rpartition(b"\n")[0], *_from_places(path)]))
    lines = [line for line in sample.decode("utf-8", "replace").split("\n") if line.strip()]
    body = [line for line in lines if not is_comment(line)]
    if not body:
        raise TooFewData(f"{path}: {'holds nothing but comments; is it a table?' if lines else 'the file is empty'}")
    separator = _separator(path, body[: LOOKED_AT + PREAMBLE])
    rows = cells_of("\n".join(body[: LOOKED_AT + PREAMBLE]), separator)
    most = Counter(map(len, rows)).most_common(1)[0][0]
    if not any(row[-1].strip() for row in rows if len(row) == most):  # a separator behind each row, but not the header
        rows = [row + [""] * (len(row) == most - 1) for row in rows]
    head = layout(path, rows, [line for line in lines if is_comment(line)], separator)
    width, notices = len(head.header), list(head.notices)
    # All rows are looked at only where some number may have thousands apart: such a cell may be rare.
    if re.search(rf"(?<!\d)[1-9]\d{{0,2}}[,.{BLANKS}]\d{{3}}(?!\d)", sample.decode("utf-8", "replace")):
        rows = cells_of("\n".join(body), separator)
    table = [[row[i].strip() for row in rows[head.first :] if i < len(row)] for i in range(width)]
    commas, grouped = _marks(path, head, table, decimal)
    if commas:
        notices.append(Message(f"decimal commas in {len(commas)} columns", "decimal_commas"))
    if grouped:
        names = ", ".join(f"'{head.header[i]}'" for i in grouped)
        notices.append(Message(f"marks between thousands in {names}", "thousands"))
    text = TextTable(path, width, head.first, True, separator, "," if commas else ".", grouped)
    if not long and count * width > MOST_CELLS:
        raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
    looked_at = replace(text, source=lambda: iter([(sample + b"\n", False)])) if long else text
    pieces = list(looked_at.pieces(range(width)))
    columns = {i: np.concatenate([piece[i] for piece in pieces]) for i in range(width) if pieces}
    if not columns:
        raise TooFewData(f"{path}: holds no rows of data below a header")
    said = [*notices, *(() if long else text.notices())]
    read = raw_table(path, str(path), head.header, head.units, pd.DataFrame(columns), said)
    return replace(read, ship=head.ship, rows=count, source=text if long else None)


def _from_places(path: Path) -> Iterator[bytes]:
    """Whole lines from places between the begin of the file ``path`` and its end."""
    size = path.stat().st_size
    with opened(path) as stream:
        for at in np.linspace(SAMPLE, max(size - SAMPLE, SAMPLE), PLACES).astype(int).tolist():
            stream.seek(at)  # in the middle of a line: the first and the last are cut
            yield stream.read(SAMPLE).replace(b"\r", b"\n").partition(b"\n")[2].rpartition(b"\n")[0]


def _marks(
    path: Path, found: Layout, columns: Sequence[Sequence[str]], decimal: str
) -> tuple[list[int], dict[int, str]]:
    """Columns with decimal commas, and those with characters between thousands: number -> the characters. columns:
    cells of each; decimal: what the map says. "1,234" is 1234 or 1.234: the reading is taken that lies within the
    limits of the quantity, or that other columns of the file show. Raises OpenQuestion where neither tells."""
    cells = [[cell for cell in column if cell] for column in columns]
    shown = decimal or _decimal_of(cells)
    grouped: dict[int, str] = {}
    decided: dict[int, bool | None] = {}
    for i, column in enumerate(cells):
        blank = any(re.search(rf"\d[{BLANKS}]\d", cell) for cell in column)
        if blank and _all(rf"[+-]?\d*([.,]\d+)?|{GROUPED.format(mark=BLANKS, decimal='.,')}", column):
            grouped[i] = BLANKS
        for mark, other in ((",", "."), *([(".", ",")] if shown == "," else [])):  # a point alone is a decimal one
            marked = [cell for cell in column if mark in cell]
            if not marked or not _all(GROUPED.format(mark=mark, decimal=other), marked):
                continue
            if any(cell.count(mark) > 1 or other in cell for cell in marked):  # "1,234,567" and "1,234.5" are clear
                grouped[i] = mark
                continue
            refuted = _no_thousands(found.header[i], found.units[i], column, mark)
            decided[i] = False if refuted else (shown != mark if shown else None)
            grouped |= {i: mark} if decided[i] else {}
    others = set(decided.values()) - {None} | ({True} if "," in grouped.values() else set())
    for i in [i for i, thousands in decided.items() if thousands is None]:  # as the other columns of the file
        if len(others) != 1:
            cell = next(cell for cell in cells[i] if "," in cell)
            readings = f"{cell.replace(',', '')} or {cell.replace(',', '.')}"
            words = f"column '{split_unit(found.header[i])[0]}': '{cell}' is {readings}"
            raise OpenQuestion(path, words, {"thousands": {"decimal": "."}, "decimal": {"decimal": ","}})
        grouped |= {i: ","} if True in others else {}
    commas = []
    for i, column in enumerate(cells):
        marked = [cell for cell in column if "," in cell]
        numbers = sum(bool(re.match(WITH_COMMA, cell)) for cell in marked)
        if marked and "," not in grouped.get(i, "") and (i in grouped or 2 * numbers > len(marked)):
            commas.append(i)
    return commas, grouped


def _all(pattern: str, cells: Sequence[str]) -> bool:
    return all(re.fullmatch(pattern, cell) for cell in cells)


def _decimal_of(columns: Sequence[Sequence[str]]) -> str:
    """The character before parts of a whole that numbers show which can have no other meaning; "" where none does, or
    as many columns show one as the other."""
    count = Counter[str]()
    for column in columns:
        for mark, other in ((".", ","), (",", ".")):
            marked = [cell for cell in column if mark in cell and other not in cell]
            plain = _all(rf"[+-]?\d*[{mark}]\d+([eE][+-]?\d+)?", marked)
            if marked and plain and not _all(GROUPED.format(mark=mark, decimal=other), marked):
                count[mark] += 1
    point, comma = count["."], count[","]
    return "" if point == comma else "." if point > comma else ","


def _no_thousands(header: str, unit: str, column: Sequence[str], mark: str) -> bool:
    """Whether a ``column`` of cells that may be read both ways lies within the limits of its quantity only where
    ``mark`` is not between thousands."""
    read = [[as_number(cell.replace(mark, other)) for cell in column] for other in ("", ".")]
    thousands, decimals = (float(np.nanmax(np.abs(values))) for values in read)
    title, inside = split_unit(header)
    known = QUANTITIES.get(meaning(title).quantity)
    if known is None:
        return False
    scale = factor(known.name, unit or inside or meaning(title).unit or known.unit) or 1.0
    most = 2 * known.period if known.period else known.limits[1]  # directions may go on beyond a turn
    return thousands * scale > most >= decimals * scale


def layout(path: Path, rows: list[list[str]], commented: Sequence[str], separator: str) -> Layout:
    """How the ``rows`` of the file ``path`` hold a table; ``commented``: its comments; separator: of its cells. Raises
    UserError where they hold none."""
    first = _first_data_row(path, rows, separator)
    width = len(rows[first])
    lines: list[list[str]] = []
    for row in reversed(rows[max(0, first - 4) : first]):  # groups, names, units and how values came to be
        if len(row) != width or (lines and sum(bool(cell.strip()) for cell in row) < min(2, width)):
            break
        lines.insert(0, [" ".join(cell.split()) for cell in row])
    above = [separator.join(row) for row in rows[:first]]
    named = filter(None, (re.fullmatch(SHIP, line, re.IGNORECASE) for line in [*commented, *above]))
    ship = next((match[1].strip(" ;,|\t\"'") for match in named), "")
    if not lines:
        return Layout(_commented_header(path, rows, first, commented, separator), [""] * width, first, [], ship)
    units = [""] * width
    if len(lines) > 1 and all(cell.lower() in {"", *PROCESSING} for cell in lines[-1]):
        lines.pop()
    for at in (-1, -2):  # some write units above the names
        if len(lines) > 1 and _are_units(lines[at]) and not _are_units(lines[-1 if at == -2 else -2]):
            units = [cell.strip("[]() ") for cell in lines.pop(at)]
            break
    header = lines[-1]
    upper: list[str] = lines[-2] if lines[1:] else []
    groups: Iterator[str] = itertools.accumulate(upper, lambda last, cell: cell or last)  # written where they begin
    joined = [_joined(group, cell) for group, cell in zip(groups, header, strict=False)]
    alone, together = ([meaning(split_unit(cell)[0]) for cell in names] for names in (header, joined))
    gained = sum(a != b for a, b in zip(alone, together, strict=False))
    notices: list[Message] = []
    # A single gain counts only where names repeat, or where the upper line says what was ordered.
    if gained > 1 or (gained and (len({*header} - {""}) < len(header) or any(map(is_order, joined)))):
        header = joined
        notices.append(Message("two lines of headers are read together", "two_header_lines"))
    return Layout(header, units, first, notices, ship)


def _joined(group: str, cell: str) -> str:
    """The header of a column that is ``cell`` in a ``group``: both, unless the cell alone says what it is."""
    both = f"{group} {cell}".strip()
    title = split_unit(both)[0]
    said = meaning(title).quantity or meaning(title).may_be or is_order(title)
    return cell if cell and not said and meaning(split_unit(cell)[0]).quantity else both


def _commented_header(
    path: Path, rows: list[list[str]], first: int, commented: Sequence[str], separator: str
) -> list[str]:
    """The header in a comment, as of numpy.savetxt and of Fortran programs; without one columns have numbers."""
    width = len(rows[first])
    if first > 0:
        line = separator.join(rows[first - 1])
        other = next((s for s in SEPARATORS[:4] if s != separator and len(cells_of(line, s)[0]) == width), "")
        if other:
            words = f"the header's cells are separated by {other!r}, those of the rows by {separator!r}"
            raise BadValue(f"{path}: {words}; write one of them throughout")
    for comment in reversed(commented):
        cells = [c.strip() for row in cells_of(comment.lstrip(" #%!/"), separator)[:1] for c in row]
        if len(cells) == width and not _is_data(cells):
            return cells
    return [f"{NUMBERED} {i + 1}" for i in range(width)]


def _separator(path: Path, lines: Sequence[str]) -> str:
    """The separator that gives most lines the same number of cells, two or more, of which most are numbers."""
    sample, best, score = lines[-min(len(lines), LOOKED_AT) :], "", 0.0
    for separator in SEPARATORS:
        rows = cells_of("\n".join(sample), separator)
        if not rows:
            continue
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2 or count < 0.5 * len(rows):
            continue
        filled = [cell.strip() for row in rows if len(row) == width for cell in row]
        numbers = sum(bool(NUMBER.fullmatch(cell)) or not cell for cell in filled) / len(filled)
        # 0.2: tables of words have a separator as well; 0.05: the order of SEPARATORS decides near ties. Set by hand.
        value = count / len(rows) * (0.2 + numbers) * (0.999 if separator == " " else 1.0)
        if value > score + 0.05:
            best, score = separator, value
    if not best:
        tried = "semicolon, tab, bar, comma, blank"
        raise BadValue(f"{path}: no separator ({tried}) gives its lines equally many cells; is it a table?")
    return best


def _is_data(row: list[str]) -> bool:
    """Whether a row holds data: numbers or times in two of its cells, or in half of those that are not empty."""
    filled = [cell.strip() for cell in row if cell.strip()]
    numbers = [cell for cell in filled if NUMBER.fullmatch(cell) or re.match(r"\d{1,4}[-/.:]\d{1,2}", cell)]
    return bool(numbers) and len(numbers) >= min(2, 0.5 * len(filled))


def _first_data_row(path: Path, rows: list[list[str]], separator: str) -> int:
    width = Counter(len(row) for row in rows[-LOOKED_AT:]).most_common(1)[0][0]
    for i, row in enumerate(rows[: PREAMBLE + 4]):
        if len(row) == width and _is_data(row):
            return i
    raise BadValue(f"{path}: no row of {width} cells with numbers below a header (cells separated by {separator!r})")


def _are_units(cells: list[str]) -> bool:
    """Whether a line holds units: most cells are known ones, in brackets, or formats of times and positions."""
    filled = [cell.lower() for cell in cells if cell]
    known = [c.strip("[]() ") in GIVEN_UNITS or re.fullmatch(rf"[\[(].*[\])]|{DATE_FORMAT}", c) for c in filled]
    return bool(filled) and sum(map(bool, known)) >= 0.7 * len(filled)  # 0.7: set by hand


def read_excel_tables(path: Path) -> list[RawTable]:
    """The tables of the workbook ``path``, one of each visible sheet that holds numbers below a header. Raises
    UserError where openpyxl is missing, the file is no workbook, no sheet holds a table, or a cell holds a formula that
    no program has calculated."""
    openpyxl = needed("openpyxl", f"{path}: an Excel file, which may be saved as CSV instead,")
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if (unpacked := sum(info.file_size for info in archive.infolist())) > 2 * LARGEST:
                raise OutOfRange(f"{path}: {unpacked / 2**20:.0f} MB unpacked are too many; save it as CSV")
            sheets = [name for name in archive.namelist() if name.startswith("xl/worksheets/")]
            calculates = any(re.search(rb"<f[ >/]", archive.read(name)) for name in sheets)
            book = openpyxl.load_workbook(io.BytesIO(content), data_only=True)
            # Read again only where there are formulas: openpyxl gives either these or their values.
            formulas = openpyxl.load_workbook(io.BytesIO(content)) if calculates else None
        hidden = [str(sheet.title) for sheet in book.worksheets if sheet.sheet_state != "visible"]
        tables = []
        for sheet in [sheet for sheet in book.worksheets if sheet.title not in hidden]:
            name = f"{path}, sheet '{sheet.title}'" if len(book.worksheets) > 1 + len(hidden) else str(path)
            if formulas is not None:
                _check_calculated(name, sheet, formulas[sheet.title])
            tables += _of_sheet(path, name, sheet, hidden, book.epoch.year == 1904)
    except UserError:
        raise
    except zipfile.BadZipFile:
        raise Unreadable(f"{path}: is cut off, damaged or no Excel workbook (.xlsx)") from None
    except Exception as error:  # openpyxl raises many kinds for damaged files
        raise Unreadable(f"{path}: not a readable Excel workbook ({reason(error)})") from None
    if not tables:
        others = f" (hidden ones, not read: {', '.join(hidden)})" if hidden else ""
        raise BadValue(f"{path}: no sheet holds numbers below a line of headers{others}")
    return tables


def _check_calculated(name: str, sheet: Any, formulas: Any) -> None:
    """Raises UserError for a formula of the sheet called ``name`` whose value is not in the file."""
    for values, written in zip(sheet.iter_rows(), formulas.iter_rows(), strict=True):
        for value, cell in zip(values, written, strict=True):
            if cell.data_type == "f" and value.value is None:
                words = f"cell {cell.coordinate} holds a formula that was never calculated; open the workbook in a"
                raise BadValue(f"{name}: {words} spreadsheet program, save it there, and import it again")


def _of_sheet(path: Path, name: str, sheet: Any, hidden: Sequence[str], since_1904: bool) -> list[RawTable]:
    """The table of a sheet, or none. hidden: sheets that were left out; since_1904: what days are counted from."""
    import pandas as pd

    if (sheet.max_row or 0) * (sheet.max_column or 0) > MOST_CELLS:
        raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
    rows = [[None if isinstance(cell, str) and cell.strip().lower() in EMPTY else cell for cell in row]
            for row in sheet.iter_rows(values_only=True)]  # fmt: skip
    rows = [row for row in rows if any(cell is not None for cell in row)]
    words = [["" if c is None else str(c) for c in row] for row in rows[: PREAMBLE + LOOKED_AT]]
    try:
        head = layout(path, words, [], "; ") if words else None
    except BadValue:
        return []
    if head is None or head.header[0] == f"{NUMBERED} 1":
        return []
    notices = list(head.notices)
    if hidden:
        notices.append(Message(f"hidden sheets, not read: {', '.join(hidden)}", "hidden_sheets"))
    frame = pd.DataFrame(rows[head.first :], dtype=object)
    table = raw_table(path, name, head.header, head.units, frame, notices)
    return [replace(table, ship=head.ship, since_1904=since_1904)]


def read_parquet(path: Path) -> RawTable:
    """The table in the Parquet file ``path``, an index of pandas as a column. Raises UserError where it cannot be
    read."""
    import pandas as pd
    import pyarrow.parquet as pq

    try:
        frame = pq.read_table(path).to_pandas(ignore_metadata=True)
    except Exception as error:  # pyarrow raises many kinds for damaged files
        raise no_parquet(path, error) from None
    cells = [str(c) for c in frame.columns]
    frame.columns = pd.RangeIndex(len(cells))
    return raw_table(path, str(path), cells, [""] * len(cells), frame, [])
