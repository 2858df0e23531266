"""Logs of text: any separator, decimal commas, lines before the header, a line of units, any encoding, any size."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cases.importing.raw_table import MOST_CELLS, NUMBERED, RawTable, raw_table
from cases.io.block_means import rows_together
from cases.io.files import lines_and_hash, opened
from cases.io.text_table import SEPARATORS, WITH_COMMA, TextTable, as_utf8, blocks, cells_of, is_comment
from cases.io.units import FACTORS, SPELLINGS
from mmg.errors import BadValue, OutOfRange, TooFewData
from mmg.messages import Message

LARGEST_LOG, SMALL = 8 * 2**30, 2**25
"""Most bytes of a log of text, and of one of which all columns are held."""
LOOKED_AT, PREAMBLE = 400, 60
"""Lines by which separator and header are found, and most lines before the header."""
PLACES, SAMPLE = 40, 2**15
"""Places at which a log whose rows are averaged is looked at before, and bytes at each."""
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
MORE_UNITS = {"h", "-", "%", "utc", "iso", "n", "e"}
KNOWN_UNITS = {u.lower() for known in FACTORS.values() for u in known} | set(SPELLINGS) | MORE_UNITS
SHIP = r"\W*(?:vessel|ship|mmsi|imo)(?:[ _]?(?:name|number|no\.?))?\W*[:=;,|\t]\s*(\S.{0,60})"
"""A line that names a ship."""
WORDS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks", ",": "commas"}


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


def read_text_log(path: Path) -> RawTable:
    """The table in the text file ``path``; a large one, or one whose rows are averaged, is only looked at, and read in
    ``RawTable.pieces``.

    Raises UserError where the file is empty or no text, where no line holds a header above rows of equally many cells,
    where rows have other numbers of cells (the first is named), and where commas could be both separators and decimals.
    """
    import pandas as pd

    count, (begin, _) = lines_and_hash(path)[0] - 1, next(blocks(path))
    long = rows_together(count) > 1 or path.stat().st_size > SMALL
    sample = begin if not long else as_utf8(b"\n".join([begin[:SAMPLE].rpartition(b"\n")[0], *_from_places(path)]))
    lines = [line for line in sample.decode("utf-8", "replace").split("\n") if line.strip()]
    body = [line for line in lines[: LOOKED_AT + PREAMBLE] if not is_comment(line)]
    if not body:
        raise TooFewData(f"{path}: {'holds nothing but comments; is it a table?' if lines else 'the file is empty'}")
    separator = _separator(path, body)
    rows = cells_of("\n".join(body), separator)
    found = layout(path, rows, [line for line in lines if is_comment(line)], separator)
    width, notices = len(found.header), list(found.notices)
    commas = [i for i in range(width) if separator != "," and _decimal_commas(row[i] for row in rows if i < len(row))]
    if commas:
        notices.append(Message(f"decimal commas in {len(commas)} columns", "decimal_commas"))
    if separator != ",":
        notices.append(Message(f"cells are separated by {WORDS[separator]}", "separator"))
    text = TextTable(path, width, found.first, True, separator, "," if commas else ".")
    if not long and count * width > MOST_CELLS:
        raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
    looked_at = replace(text, source=lambda: iter([(sample + b"\n", False)])) if long else text
    pieces = list(looked_at.pieces(range(width)))
    columns = {i: np.concatenate([piece[i] for piece in pieces]) for i in range(width) if pieces}
    if not columns:
        raise TooFewData(f"{path}: holds no rows of data below a header")
    said = [*notices, *(() if long else text.notices())]
    table = raw_table(path, str(path), found.header, found.units, pd.DataFrame(columns), said)
    return replace(table, ship=found.ship, rows=count, source=text if long else None)


def _from_places(path: Path) -> Iterator[bytes]:
    """Whole lines from places between the begin of the file ``path`` and its end."""
    size = path.stat().st_size
    with opened(path) as stream:
        for at in np.linspace(SAMPLE, max(size - SAMPLE, SAMPLE), PLACES).astype(int).tolist():
            stream.seek(at)
            yield stream.read(SAMPLE).replace(b"\r", b"\n").partition(b"\n")[2].rpartition(b"\n")[0]


def layout(path: Path, rows: list[list[str]], commented: Sequence[str], separator: str) -> Layout:
    """How the ``rows`` of the file ``path`` hold a table; ``commented``: its comments; separator: of its cells.

    Raises UserError where they hold none.
    """
    first = _first_data_row(path, rows, separator)
    header, units, first = _header(path, rows, first, commented, separator)
    skipped = first - 1 - bool(any(units))
    words = Message(f"lines before the header, left out: {skipped}", "lines_before_header")
    above = [separator.join(row) for row in rows[: max(skipped, 0)]]
    return Layout(header, units, first, [words] if skipped > 0 else [], ship_named([*commented, *above]))


def ship_named(lines: Iterable[str]) -> str:
    """The ship, or its number, that one of the ``lines`` above a table names, as "Vessel: AURORA" does; else ""."""
    for line in lines:
        match = re.fullmatch(SHIP, line, re.IGNORECASE)
        if match:
            return match[1].strip(" ;,|\t\"'")
    return ""


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
    """Whether a row holds data: numbers or times in two of its cells, or in half of those that are not empty."""
    filled = [cell.strip() for cell in row if cell.strip()]
    numbers = [cell for cell in filled if NUMBER.fullmatch(cell) or re.match(r"\d{1,4}[-/.:]\d{1,2}", cell)]
    return bool(numbers) and len(numbers) >= min(2, 0.5 * len(filled))


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
        other = next((s for s in SEPARATORS[:4] if s != separator and len(cells_of(line, s)[0]) == width), "")
        if other:
            words = f"the header's cells are separated by {other!r}, those of the rows by {separator!r}"
            raise BadValue(f"{path}: {words}; write one of them throughout")
    if not above:  # the header may be a comment, as of numpy.savetxt and of Fortran programs
        for line in reversed(commented):
            cells = [c.strip() for row in cells_of(line.lstrip(" #%!/"), separator)[:1] for c in row]
            if len(cells) == width and not _is_data(cells):
                return cells, [""] * width, first
        return [f"{NUMBERED} {i + 1}" for i in range(width)], [""] * width, first
    if len(above) == 2 and _are_units(above[1]):
        return above[0], [cell.strip("[]() ") for cell in above[1]], first
    return above[-1], [""] * width, first


def _are_units(cells: list[str]) -> bool:
    """Whether a line holds units: most cells are known ones or in brackets."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    known = [c for c in filled if c.strip("[]() ").lower() in KNOWN_UNITS or re.fullmatch(r"[\[(].*[\])]", c)]
    return bool(filled) and len(known) >= 0.7 * len(filled)


def _decimal_commas(cells: Iterable[str]) -> bool:
    """Whether most ``cells`` with commas are numbers with decimal commas."""
    commas = [bool(re.match(WITH_COMMA, cell.strip())) for cell in cells if "," in cell]
    return bool(commas) and sum(commas) > 0.5 * len(commas)
