"""The columns of a CSV file, read in pieces: what the file needs of memory is bounded before it is parsed."""

from __future__ import annotations

import codecs
import csv
import io
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.cells import Text, floats_of_cells
from mmg.errors import UserError

LONGEST_LINE, MOST_CELLS = 2**20, 30_000_000
"""Most bytes of a line, and most cells of a table."""
_BYTES, AT_ONCE = 2**24, 500_000
"""Of a piece that is looked at, and that is parsed, at a time."""


def csv_header(path: Path, content: bytes) -> list[str]:
    """The cells of the first line of the CSV file ``path`` with this ``content``. Raises UserError where there is no
    such line."""
    first = content[:LONGEST_LINE].splitlines()[0]
    if len(first) == LONGEST_LINE:
        raise UserError(f"{path}: the first line is longer than {LONGEST_LINE} bytes; it must hold the headers")
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
    return header


def count_rows(path: Path, content: bytes) -> int:
    """Lines below the first of the ``content`` of ``path``, whatever system ended them, before it is parsed. Raises
    UserError where one of them is longer than LONGEST_LINE."""
    ends, last, before = 0, -1, 0
    for start in range(0, len(content), _BYTES):
        piece = np.frombuffer(content, np.uint8, min(_BYTES, len(content) - start), start)
        new, old = piece == ord("\n"), piece == ord("\r")
        new[1:] &= ~old[:-1]  # "\r\n" counts once
        new[:1] &= before != ord("\r")
        at = np.flatnonzero(new | old) + start
        longest = int(np.diff(at, prepend=last, append=start + len(piece)).max())
        if longest > LONGEST_LINE:
            raise UserError(f"{path}: a line is longer than {LONGEST_LINE} bytes; it is no table of trials")
        ends, last, before = ends + len(at), int(at[-1]) if len(at) else last, int(piece[-1])
    return ends - (before in (ord("\n"), ord("\r")))


def csv_columns(path: Path, content: bytes, columns: int, rows: int) -> Callable[[], CsvColumns]:
    """What is below the header of the CSV file ``path``, parsed when the result is first called.

    content: its bytes; columns, rows: cells of the header, and lines below it. The result raises UserError where the
    text is no table. Raises UserError for more cells than MOST_CELLS.
    """
    if columns * rows > MOST_CELLS:
        words = f"{columns} columns of {rows} rows are more than {MOST_CELLS} cells"
        raise UserError(f"{path}: {words}; leave out columns that are not needed, or divide it")
    return cache(lambda: CsvColumns(path, content, columns))


class CsvColumns:
    """The numbers of a CSV file: of each column its pieces, or the first text in it and how often there is any.

    path: for errors; content: its bytes; columns: cells of the header. Raises UserError where it is no table.
    """

    def __init__(self, path: Path, content: bytes, columns: int) -> None:
        self.path, self.rows = path, 0
        self._pieces: list[list[np.ndarray]] = [[] for _ in range(columns)]
        self._texts: dict[int, Text] = {}
        for frame in _frames(path, content, columns):
            for index in range(columns):
                self._add(index, frame.iloc[:, index])
            self.rows += len(frame)

    def _add(self, index: int, series: Any) -> None:
        values, bad = floats_of_cells(series)
        if bad is not None:
            first = self._texts.get(index, Text(self.rows + bad.row, bad.text, 0))
            self._texts[index] = Text(first.row, first.text, first.count + bad.count)
            self._pieces[index].clear()
        if index not in self._texts:
            self._pieces[index].append(values)

    def numbers(self, index: int, name: str) -> np.ndarray:
        """The column (N,) number ``index``, called ``name``, NaN where a cell is empty. Raises UserError on text."""
        if index in self._texts:
            raise self._texts[index].error(self.path, name)
        return np.concatenate(self._pieces[index])


def _frames(path: Path, content: bytes, columns: int) -> Iterator[Any]:
    """The rows below the header, piece by piece; line ends may be those of any system."""
    import pandas as pd

    done = 0
    text = io.TextIOWrapper(io.BytesIO(content), _encoding(content), newline=None)
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
        raise UserError(f"{path}: not a table ({why}); check the commas of that row") from None


def _encoding(content: bytes) -> str:
    """UTF-8 with or without a mark, else Latin-1, which every byte is."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for start in range(0, len(content), _BYTES):
            decoder.decode(content[start : start + _BYTES], start + _BYTES >= len(content))
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"
