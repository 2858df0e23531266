"""The columns of a CSV file, read in pieces: what the file needs of memory is bounded before it is parsed."""

from __future__ import annotations

import codecs
import csv
import io
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from cases.io.cells import Text, floats_of_cells
from mmg.errors import BadValue, OutOfRange

LONGEST_LINE, MOST_CELLS = 2**20, 30_000_000
"""Most bytes of a line, and most cells of a table."""
PIECE, AT_ONCE = 2**22, 500_000
"""Of a piece that is looked at, and that is parsed, at a time."""
SMALL, PLAIN, EXACT = 2**22, b"0123456789+-.eE,\n", 2.0**53
"""Bytes of a file that is read without pandas, what is in its lines, and the largest whole number that is exact."""


def csv_header(path: Path, content: bytes) -> list[str]:
    """The cells of the first line of the CSV file ``path`` with this ``content``. Raises UserError where there is no
    such line."""
    first = content[:LONGEST_LINE].splitlines()[0]
    if len(first) == LONGEST_LINE:
        raise OutOfRange(f"{path}: the first line is longer than {LONGEST_LINE} bytes; it must hold the headers")
    if first.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise BadValue(f"{path}: is encoded in UTF-16; save it in UTF-8")
    if b"\0" in first:
        raise BadValue(f"{path}: is no text; trial files are comma-separated text, or Parquet")
    line = first.decode(text_encoding([first]))
    try:
        header = next(csv.reader([line]))
    except csv.Error as error:
        raise BadValue(f"{path}: the first line is not a header ({error})") from None
    if len(header) == 1 and (";" in line or "\t" in line):
        raise BadValue(f"{path}: cells are not separated by commas; save the file as comma-separated CSV")
    return header


class LineCount:
    """Counts the lines of a file that is given in pieces, whatever system ended them. path: for errors."""

    def __init__(self, path: Path) -> None:
        self.path, self.seen = path, 0
        self._ends, self._last, self._before = 0, -1, 0

    def add(self, content: bytes) -> None:
        """The next piece. Raises UserError where a line is longer than LONGEST_LINE."""
        piece = np.frombuffer(content, np.uint8)
        new, old = piece == ord("\n"), piece == ord("\r")
        new[1:] &= ~old[:-1]  # "\r\n" counts once
        new[:1] &= self._before != ord("\r")
        at = np.flatnonzero(new | old) + self.seen
        self.seen += len(piece)
        if int(np.diff(at, prepend=self._last, append=self.seen).max()) > LONGEST_LINE:
            raise OutOfRange(f"{self.path}: a line is longer than {LONGEST_LINE} bytes; it is no table of trials")
        self._ends, self._before = self._ends + len(at), int(piece[-1])
        self._last = int(at[-1]) if len(at) else self._last

    @property
    def rows(self) -> int:
        """Lines below the first."""
        return self._ends - (self._before in (ord("\n"), ord("\r")))


def count_rows(path: Path, content: bytes) -> int:
    """Lines below the first of the ``content`` of ``path``, before it is parsed. Raises UserError where one of them is
    longer than LONGEST_LINE."""
    lines = LineCount(path)
    for start in range(0, len(content), PIECE):
        lines.add(content[start : start + PIECE])
    return lines.rows


def csv_columns(path: Path, content: bytes, columns: int, rows: int) -> Callable[[], CsvColumns]:
    """What is below the header of the CSV file ``path``, parsed when the result is first called.

    content: its bytes; columns, rows: cells of the header, and lines below it. The result raises UserError where the
    text is no table. Raises UserError for more cells than MOST_CELLS.
    """
    if columns * rows > MOST_CELLS:
        words = f"{columns} columns of {rows} rows are more than {MOST_CELLS} cells"
        raise OutOfRange(f"{path}: {words}; leave out columns that are not needed, or divide it")
    return cache(lambda: CsvColumns(path, content, columns))


class CsvColumns:
    """The numbers of a CSV file: of each column its pieces, or the first text in it and how often there is any.

    path: for errors; content: its bytes; columns: cells of the header. Raises UserError where it is no table.
    """

    def __init__(self, path: Path, content: bytes, columns: int) -> None:
        self._plain = plain_numbers(content, columns)
        if self._plain is not None:
            self.rows = len(self._plain)
            return
        self.pieces = CsvPieces(path, io.BytesIO(content), text_encoding([content]), columns)
        self._parts: list[list[np.ndarray]] = [[] for _ in range(columns)]
        for values in self.pieces.of(range(columns)):
            for index, part in values.items():
                self._parts[index].append(part)
        self.rows = self.pieces.rows

    def numbers(self, index: int, name: str) -> np.ndarray:
        """The column (N,) number ``index``, called ``name``, NaN where a cell is empty. Raises UserError on text."""
        if self._plain is not None:
            return self._plain[:, index].copy()
        self.pieces.check(index, name)
        return np.concatenate(self._parts[index])


def plain_numbers(content: bytes, columns: int) -> np.ndarray | None:
    """The numbers (N, columns) below the first line of a small file of nothing but numbers and empty cells, NaN; None
    for any other ``content``, which pandas reads. It alone takes longer to import than such a file to read."""
    if len(content) > SMALL:
        return None
    body = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n").partition(b"\n")[2].removesuffix(b"\n")
    if not body or b'"' in content or body.translate(None, PLAIN):
        return None
    lines = body.split(b"\n")
    if any(not line or line.count(b",") != columns - 1 for line in lines):
        return None
    cells = body.replace(b"\n", b",").split(b",")
    try:
        values = np.array([float(cell or b"nan") for cell in cells])
    except ValueError:
        return None
    return None if np.fmax.reduce(np.abs(values), initial=0.0) > EXACT else values.reshape(-1, columns)


class CsvPieces:
    """The rows of a CSV file below its header, piece by piece.

    path: for errors; stream: its bytes; encoding: of them; columns: cells of the header.
    """

    def __init__(self, path: Path, stream: BinaryIO, encoding: str, columns: int) -> None:
        self.path, self.columns, self.rows = path, columns, 0
        self._text = io.TextIOWrapper(stream, encoding, newline=None)
        self._found: dict[int, Text] = {}

    def of(self, wanted: Iterable[int]) -> Iterator[dict[int, np.ndarray]]:
        """Of each piece the columns ``wanted`` as floats by number, NaN for gaps; columns with text end there.

        Raises UserError where it is no table.
        """
        for frame in _frames(self.path, self._text, self.columns):
            values = {}
            for index in wanted:
                numbers, bad = floats_of_cells(frame.iloc[:, index])
                if bad is not None:
                    first = self._found.get(index, Text(self.rows + bad.row, bad.text, 0))
                    self._found[index] = Text(first.row, first.text, first.count + bad.count)
                if index not in self._found:
                    values[index] = numbers
            self.rows += len(frame)
            yield values

    def check(self, index: int, name: str) -> None:
        """Raises UserError where text was in the column number ``index``, called ``name``."""
        if index in self._found:
            raise self._found[index].error(self.path, name)


def _frames(path: Path, text: io.TextIOWrapper, columns: int) -> Iterator[Any]:
    """The rows below the header, piece by piece; line ends may be those of any system."""
    import pandas as pd

    done = 0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            for frame in pd.read_csv(
                text, header=None, skiprows=1, index_col=False, names=range(columns), engine="c",
                skip_blank_lines=False, chunksize=max(AT_ONCE // columns, 1),
            ):  # fmt: skip
                yield frame
                done += len(frame)
    except pd.errors.EmptyDataError:
        return
    except (pd.errors.ParserError, pd.errors.ParserWarning, ValueError, OverflowError) as error:
        why = " ".join(str(error).split())
        if isinstance(error, pd.errors.ParserWarning):  # a row at the start of a piece
            why = f"from row {done + 1} on there are more cells than the header names"
        raise BadValue(f"{path}: not a table ({why}); check the commas of that row") from None


def text_encoding(pieces: Iterable[bytes]) -> str:
    """UTF-8 with or without a mark, else Latin-1, which every byte is. pieces: of the text, of any length."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for piece in pieces:
            for start in range(0, len(piece), PIECE):
                decoder.decode(piece[start : start + PIECE])
        decoder.decode(b"", True)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"
