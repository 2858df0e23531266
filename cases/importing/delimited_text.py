"""Tables of text: any separator, decimal commas, lines before the header, a line of units, any encoding."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cases.importing.raw_table import MOST_CELLS, RawTable, raw_table
from cases.io.files import read_bytes
from cases.io.units import FACTORS, SPELLINGS
from mmg.errors import BadValue, OutOfRange, TooFewData, Unreadable
from mmg.messages import Message

SEPARATORS = (";", "\t", "|", ",", " ")
"""Tried in this order; " " stands for any blanks."""
COMMENT = ("#", "%", "//", "!")
CUT_OFF = "the last line is cut off and left out"
LOOKED_AT, PREAMBLE = 400, 60
"""Lines by which separator and header are found, and most lines before the header."""
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
WITH_COMMA = r"([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)"
MORE_UNITS = {
    "s",
    "ms",
    "min",
    "h",
    "kmh",
    "km/h",
    "deg/min",
    "°/min",
    "rad",
    "deg",
    "m",
    "-",
    "%",
    "utc",
    "iso",
    "n",
    "e",
}
KNOWN_UNITS = {u.lower() for known in FACTORS.values() for u in known} | set(SPELLINGS) | MORE_UNITS
SHIP = r"\W*(?:vessel|ship|mmsi|imo)(?:[ _]?(?:name|number|no\.?))?\W*[:=;,|\t]\s*(\S.{0,60})"
"""A line that names a ship."""
EMPTY = ("", "nan", "null", "none", "na", "n/a", "-", "--", "---", "inf", "#n/a", "nat")
"""Cells that hold nothing, in lower case."""


@dataclass(frozen=True)
class Layout:
    """How a text file holds its table.

    separator: of its cells; header, units: (C,) cells, units "" where there are none; first: index, among the lines
    that are neither blank nor comments, of the first row of data; notices: what was found; ship: that a line above the
    table names.
    """

    separator: str
    header: list[str]
    units: list[str]
    first: int
    notices: list[Message]
    ship: str = ""


def read_text_table(path: Path) -> RawTable:
    """The table in the text file ``path``.

    Raises UserError where the file is empty or no text, where no line holds a header above rows of equally many cells,
    where rows have other numbers of cells (the first is named), and where commas could be both separators and decimals.
    """
    text = _text(path, read_bytes(path))
    lines = [(i + 1, line) for i, line in enumerate(text.splitlines()) if line.strip()]
    if not lines:
        raise TooFewData(f"{path}: the file is empty")
    commented = [line for _, line in lines if is_comment(line)]
    kept = [pair for pair in lines if not is_comment(pair[1])]
    if not kept:
        raise TooFewData(f"{path}: holds nothing but comments; is it a table?")
    number, body = zip(*kept, strict=True)
    found, rows = layout(path, body, commented)
    notices = list(found.notices)
    if commented:
        notices.append(Message(f"lines of comment, left out: {len(commented)}", "comment_lines"))
    data, width = rows[found.first :], len(found.header)
    check_widths(path, data, width, number[found.first :], last=True)
    if len(data[-1]) < width:
        data = data[:-1]
        notices.append(Message(CUT_OFF, "last_line_cut"))
    if len(data) * width > MOST_CELLS:
        raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
    return table_of(path, found, data, notices)


def is_comment(line: str) -> bool:
    """Whether a ``line`` is a comment."""
    return line.lstrip().startswith(COMMENT)


def layout(path: Path, body: Sequence[str], commented: Sequence[str]) -> tuple[Layout, list[list[str]]]:
    """How the lines ``body`` of the file ``path`` hold a table, and their cells; ``commented``: its comments.

    Raises UserError where they hold none.
    """
    separator = _separator(path, body)
    rows = cells_of(body, separator)
    first = _first_data_row(path, rows, separator)
    header, units, first = _header(path, rows, first, commented, separator)
    notices = []
    skipped = first - 1 - bool(any(units))
    if skipped > 0:
        notices.append(Message(f"lines before the header, left out: {skipped}", "lines_before_header"))
    ship = ship_named([*commented, *body[: max(skipped, 0)]])
    return Layout(separator, header, units, first, notices, ship), rows


def ship_named(lines: Iterable[str]) -> str:
    """The ship, or its number, that one of the ``lines`` above a table names, as "Vessel: AURORA" does; else ""."""
    for line in lines:
        match = re.fullmatch(SHIP, line, re.IGNORECASE)
        if match:
            return match[1].strip(" ;,|\t\"'")
    return ""


def table_of(path: Path, found: Layout, data: list[list[str]], notices: list[Message]) -> RawTable:
    """The table of the file ``path`` with this layout ``found`` and rows of cells ``data``; ``notices`` are added to.

    Raises UserError as ``raw_table`` does.
    """
    import pandas as pd

    width, separator = len(found.header), found.separator
    data = [(row + [""] * width)[:width] for row in data]
    frame = pd.DataFrame(data, columns=range(width), dtype=object)
    frame, commas = plain_cells(frame, separator)
    if commas:
        notices.append(Message(f"decimal commas in {commas} columns", "decimal_commas"))
    words = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks", ",": "commas"}[separator]
    if separator != ",":
        notices.append(Message(f"cells are separated by {words}", "separator"))
    table = raw_table(path, str(path), found.header, found.units, frame, notices)
    return replace(table, ship=found.ship)


def plain_cells(frame: Any, separator: str) -> tuple[Any, int]:
    """The pandas ``frame`` (N, C) of texts without blanks around them, None for those that hold nothing, with decimal
    points; and in how many columns there were decimal commas. separator: of its cells."""
    frame = frame.apply(lambda column: column.str.strip())
    frame = frame.mask(frame.apply(lambda column: column.str.lower().isin(EMPTY)))
    commas = [] if separator == "," else [i for i in frame.columns if _decimal_commas(frame[i])]
    for i in commas:
        frame[i] = frame[i].str.replace(f"^{WITH_COMMA}$", r"\1.\2", regex=True)
    return frame, len(commas)


def _text(path: Path, content: bytes) -> str:
    """The content as text: UTF-8 or UTF-16 with a mark, UTF-8, else Windows-1252. Raises UserError for no text."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError:
            raise Unreadable(f"{path}: damaged text in UTF-16; save it in UTF-8") from None
    if b"\0" in content[:4096]:
        raise BadValue(f"{path}: is no text; expected a table, an Excel file (.xlsx), Parquet, or an NMEA log")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def cells_of(lines: Sequence[str], separator: str) -> list[list[str]]:
    """The cells of ``lines``, between separators; ``separator`` " " stands for any blanks."""
    if separator == " ":
        return [line.split() for line in lines]
    try:
        return list(csv.reader(io.StringIO("\n".join(lines)), delimiter=separator))
    except csv.Error:
        return [line.split(separator) for line in lines]


def _separator(path: Path, lines: Sequence[str]) -> str:
    """The separator that gives most lines the same number of cells, two or more, of which most are numbers."""
    sample, best, score = lines[-min(len(lines), LOOKED_AT) :], "", 0.0
    for separator in SEPARATORS:
        rows = cells_of(sample, separator)
        if not rows:
            continue
        width, count = Counter(map(len, rows)).most_common(1)[0]
        if width < 2 or count < 0.5 * len(rows):
            continue
        filled = [cell.strip() for row in rows if len(row) == width for cell in row]
        numbers = sum(bool(NUMBER.fullmatch(cell)) or not cell for cell in filled) / len(filled)
        value = count / len(rows) * (0.2 + numbers) * (0.999 if separator == " " else 1.0)
        if value > score + 0.05:
            best, score = separator, value
    if not best:
        raise BadValue(
            f"{path}: no separator (semicolon, tab, bar, comma, blank) gives its lines equally many cells; is it a "
            "table?"
        )
    return best


def _is_data(row: list[str]) -> bool:
    """Whether a row holds data: a number or a time in most of its cells that are not empty."""
    filled = [cell.strip() for cell in row if cell.strip()]
    numbers = [cell for cell in filled if NUMBER.fullmatch(cell) or re.match(r"\d{1,4}[-/.:]\d{1,2}", cell)]
    return bool(numbers) and len(numbers) >= 0.5 * len(filled)


def _first_data_row(path: Path, rows: list[list[str]], separator: str) -> int:
    width = Counter(len(row) for row in rows[-LOOKED_AT:]).most_common(1)[0][0]
    for i, row in enumerate(rows[: PREAMBLE + 2]):
        if len(row) == width and _is_data(row):
            return i
    raise BadValue(f"{path}: no row of {width} cells with numbers below a header (cells separated by {separator!r})")


def _header(
    path: Path, rows: list[list[str]], first: int, commented: Sequence[str], separator: str
) -> tuple[list[str], list[str], int]:
    """Header cells, units (or "" each) and the first row of data."""
    width = len(rows[first])
    above = [[cell.strip() for cell in row] for row in rows[max(0, first - 2) : first] if len(row) == width]
    if not above and first > 0:
        line = separator.join(rows[first - 1])
        other = next((s for s in SEPARATORS[:4] if s != separator and len(cells_of([line], s)[0]) == width), "")
        if other:
            words = f"the header's cells are separated by {other!r}, those of the rows by {separator!r}"
            raise BadValue(f"{path}: {words}; write one of them throughout")
    if not above:  # the header may be a comment, as of numpy.savetxt and of Fortran programs
        for line in reversed(commented):
            cells = [c.strip() for c in cells_of([line.lstrip(" #%!/")], separator)[0]]
            if len(cells) == width and not _is_data(cells):
                return cells, [""] * width, first
        raise BadValue(f"{path}: the first line holds numbers, not headers; give them by a line above, or by --map")
    if len(above) == 2 and _are_units(above[1]):
        return above[0], [cell.strip("[]() ") for cell in above[1]], first
    return above[-1], [""] * width, first


def _are_units(cells: list[str]) -> bool:
    """Whether a line holds units: most cells are known ones or in brackets."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    known = [c for c in filled if c.strip("[]() ").lower() in KNOWN_UNITS or re.fullmatch(r"[\[(].*[\])]", c)]
    return bool(filled) and len(known) >= 0.7 * len(filled)


def check_widths(path: Path, data: list[list[str]], width: int, numbers: Sequence[int], last: bool) -> None:
    """Raises UserError for rows of ``data`` whose number of cells is not ``width``.

    path, numbers: of the file and its lines, for the message; last: the last row is that of the file, which may be cut
    off.
    """
    other = [i for i, row in enumerate(data) if len(row) != width and not (len(row) > width and not any(row[width:]))]
    if other and not (last and other == [len(data) - 1]):
        row = data[other[0]]
        mixed = next((s for s in SEPARATORS[:4] if len(row) < width and s.join(row).count(s) >= width - 1), "")
        why = f"cells look separated by {mixed!r} there" if mixed else "correct the line"
        raise BadValue(
            f"{path}: line {numbers[other[0]]} has {len(row)} cells, the header {width} "
            f"({len(other)} such lines); {why}"
        )


def _decimal_commas(column: object) -> bool:
    """Whether most cells with commas (a pandas series) are numbers with decimal commas."""
    given = column.dropna()  # type: ignore[attr-defined]
    commas = given[given.str.contains(",", regex=False)]
    return len(commas) > 0 and bool(commas.str.fullmatch(WITH_COMMA).mean() > 0.5)
