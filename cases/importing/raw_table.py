"""A raw table: headers, units and cells of a log as they are, before anything is known of their meaning."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.vocabulary import SIDES, meaning, of_side
from cases.io.text_table import TextTable, floats_of_cells
from cases.io.trial_table import MOST_COLUMNS
from mmg.errors import Conflict, OutOfRange, TooFewData
from mmg.messages import Message

NUMBERED = "column"  # Word before the number of a column without a header, from 1
WIDE = str.maketrans("（）［］／", "()[]/")  # As of Japanese keyboards
NOT_READ = "says nothing that is used"  # Of a column or sentence of which nothing is known or wanted


@dataclass(frozen=True)
class Clock:
    """Times of the rows of a table.

    t: (N,) seconds; absolute: since 1970 in UTC, else since the log's own zero; header: of the column; words: how it
    was read; zoned: whether its stamps name a time zone; period: after which it begins anew [s], 0 of one that goes on.
    """

    t: np.ndarray
    absolute: bool
    header: str
    words: str
    zoned: bool = False
    period: float = 0.0


@dataclass(frozen=True)
class Account:
    """What became of one column or sentence of a log.

    what: its header or sentence ("GPVTG"); rows: that it has; used_as: quantities that came of it, () where it is left
    out; why: it is left out, or how it was used, or "".
    """

    what: str
    rows: int
    used_as: tuple[str, ...] = ()
    why: str = ""

    def __str__(self) -> str:
        used = f" used as {', '.join(self.used_as)}" if self.used_as else " not used"
        return f"{self.what} {self.rows}{used}{': ' + self.why if self.why else ''}"


@dataclass(frozen=True)
class RawTable:
    """One table of a log.

    path: of the file; name: of the table in messages; headers: (C,) unique cells without their units; units: (C,) as
    written, or ""; frame: pandas DataFrame (N, C) of cells, text as it is (decimal points, not commas) or numbers and
    times, labelled by the numbers of the columns in the file; notices: what was found on reading; clock: where it is
    known already; before: rows of the log before those of the table; ship: that lines above it name; rows: of the log;
    source: of the rows of a table that holds only a sample of them; accounts: of all its columns or sentences, where
    the reader of the format gives one; means: header -> what the format itself says of it (``vocabulary.Meaning``);
    since_1904: whether its numbers of days are counted from 1904.
    """

    path: Path
    name: str
    headers: tuple[str, ...]
    units: tuple[str, ...]
    frame: Any
    notices: tuple[Message, ...] = ()
    clock: Clock | None = None
    before: int = 0
    ship: str = ""
    rows: int = 0
    source: TextTable | None = None
    accounts: tuple[Account, ...] = ()
    means: dict[str, Any] = field(default_factory=dict)
    since_1904: bool = False

    def __len__(self) -> int:
        return len(self.frame)

    def pieces(self, headers: Collection[str]) -> Iterator[RawTable]:
        """All rows of the log in tables that hold the columns below ``headers`` at least."""
        import pandas as pd

        if self.source is None:
            yield self  # with all columns, also those that nobody wants
            return
        at = [self.headers.index(header) for header in dict.fromkeys(headers)]
        names, units = zip(*((self.headers[i], self.units[i]) for i in at), strict=True)
        for columns in self.source.pieces([int(self.frame.columns[i]) for i in at]):
            said, frame = tuple(self.source.notices()), pd.DataFrame(columns)
            yield RawTable(self.path, self.name, names, units, frame, said, before=self.source.rows, rows=self.rows)

    def cells(self, header: str) -> Any:
        """The pandas series (N,) of cells below ``header``."""
        return self.frame.iloc[:, self.headers.index(header)]

    def numbers(self, header: str) -> np.ndarray:
        """The column below ``header`` as floats (N,), NaN where cells are empty. Raises UserError on text."""
        values, text = floats_of_cells(self.cells(header))
        if text is not None:
            raise text.error(Path(self.name), header, self.before)
        return values

    def numeric(self, header: str) -> bool:
        """Whether all cells below ``header`` are numbers or empty, and at least one is a number."""
        values, text = floats_of_cells(self.cells(header))
        return text is None and bool(np.isfinite(values).any())


def split_unit(cell: str) -> tuple[str, str]:
    """("SOG", "kn") of "SOG [kn]", "SOG (kn)", "SOG / kn" or "SOG, kn"; the unit is "" when the cell has none, or
    one that is the side of a rudder or shaft."""
    cell = " ".join(cell.translate(WIDE).split())
    match = re.fullmatch(r"(.*?)\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*", cell)
    match = match or re.fullmatch(r"(.*?)\s*(?:,|\s/)\s+([^\s,]+(?:\s?/\s?\w+)?)", cell)
    if match is None or not match[1].strip():
        return cell, ""
    title, unit = match[1].strip(), match[2].strip()
    of_one = meaning(title).quantity if unit.lower() in SIDES else ""
    return (title, unit) if of_side(of_one, "port") == of_one else (cell, "")


def _with_index(cells: list[str], frame: Any) -> list[str]:
    """The header ``cells`` (C,), with one for the index of pandas in the ``frame`` (N, C), which it writes without any:
    where no other column is a clock, one of dates is it."""
    nameless = [i for i, cell in enumerate(cells) if cell.strip() in ("", "__index_level_0__")]  # in text, in Parquet
    clocks = [cell for cell in cells if nameless and meaning(split_unit(cell)[0]).quantity == "t"]
    out = ["" if i in nameless else cell for i, cell in enumerate(cells)]
    for i in nameless if not clocks else ():
        first = next((value for value in frame.iloc[:, i] if value is not None and value == value), "")  # NaN is not
        if re.match(r"\d{4}-\d\d-\d\d[ T]\d\d:", str(first)):
            out[i] = "timestamp"
            break
    return out


def raw_table(
    path: Path, name: str, cells: list[str], units: list[str], frame: Any, notices: list[Message]
) -> RawTable:
    """A table with header ``cells`` (C,), whose units are taken out of them where ``units`` (C,) has none. path, name,
    frame, notices: as of ``RawTable``. Columns without cells are left out, and those without a header but for an index
    of times. Raises UserError for two columns of the same name, for no column, and for more than MOST_COLUMNS."""
    if len(cells) > MOST_COLUMNS:
        raise OutOfRange(f"{name}: has {len(cells)} columns, more than {MOST_COLUMNS}; leave out what is not needed")
    parts = [split_unit(cell) for cell in _with_index(cells, frame)]
    kept = [i for i, (header, _) in enumerate(parts) if header and not frame.iloc[:, i].isna().all()]
    headers = [parts[i][0] for i in kept]
    units = [units[i] or parts[i][1] for i in kept]
    for h in {h for h in headers if headers.count(h) > 1}:  # "Lat (deg)" beside "Lat (min)": other units, other columns
        same = [k for k, header in enumerate(headers) if header == h]
        if len({units[k] for k in same}) == len(same):
            for k in same:
                headers[k] = f"{h} {units[k]}".strip()
    doubled = sorted({h for h in headers if headers.count(h) > 1})
    if doubled:
        raise Conflict(f"{name}: two columns are called '{doubled[0]}'; rename or remove one of them")
    if not kept or not len(frame):
        raise TooFewData(f"{name}: holds no rows of data below a header")
    return RawTable(path, name, tuple(headers), tuple(units), frame.iloc[:, kept], tuple(notices))
