"""The columns of a trial file in SI units: small files read at once, long ones in pieces and averaged."""

from __future__ import annotations

import hashlib
import io
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from cases.io.block_means import MOST_KEPT, BlockMeans, rows_together
from cases.io.csv_table import PIECE, CsvPieces, LineCount, csv_header, text_encoding
from cases.io.files import check_file, opened, read_bytes
from cases.io.sentinels import masked, remarks, without_sentinels
from cases.io.table import checked_header, read_table, within
from cases.trial import wraps
from mmg.errors import BadValue, TooFewData
from mmg.messages import Message
from mmg.states import STATES

LARGEST_CSV = 8 * 2**30
"""Most bytes of a CSV file."""
SMALL = 32 * 2**20
"""Bytes up to which a CSV file is read at once."""

Wanted = Mapping[str, tuple[int, float]]
"""Canonical name -> number of the column and factor to SI."""


@dataclass(frozen=True)
class TrialTable:
    """A trial file whose header is known.

    header: its cells; sha256: of its bytes; columns: the wanted ones in SI, every row or means of rows, without
    sentinels (further numbers that stand for no value; None: none are looked for). It adds to the notices, and raises
    UserError on text and on numbers that no trial holds.
    """

    header: list[str]
    sha256: str
    columns: Callable[[Wanted, Sequence[float] | None, list[Message]], dict[str, np.ndarray]]


def trial_table(path: Path) -> TrialTable:
    """The table in the trial file ``path``, CSV or Parquet. Raises UserError where there is none."""
    if path.suffix.lower() == ".csv":
        check_file(path, LARGEST_CSV)
        if path.stat().st_size > SMALL:
            return _long(path, lambda: opened(path))
    content = read_bytes(path)
    if path.suffix.lower() == ".csv":
        lines = LineCount(path)
        for start in range(0, len(content), PIECE):
            lines.add(content[start : start + PIECE])
        if content and lines.rows > MOST_KEPT:
            return _long(path, lambda: io.BytesIO(content))
    header, numbers = read_table(path, content)

    def columns(wanted: Wanted, sentinels: Sequence[float] | None, notices: list[Message]) -> dict[str, np.ndarray]:
        found = {name: numbers(index, name == "t") * factor for name, (index, factor) in wanted.items()}
        if sentinels is not None:
            found = without_sentinels(found, wanted, sentinels, notices)
        return _averaged(path, iter([found]), len(found["t"]), notices)

    return TrialTable(header, hashlib.sha256(content).hexdigest(), columns)


def _long(path: Path, stream: Callable[[], BinaryIO]) -> TrialTable:
    """A CSV file that is looked through once for its lines, encoding and hash, and then parsed in pieces."""
    digest, lines = hashlib.sha256(), LineCount(path)
    with stream() as file:
        header = checked_header(path, csv_header(path, file.read(PIECE)))

    def through() -> Iterator[bytes]:
        with stream() as file:
            while piece := file.read(PIECE):
                digest.update(piece)
                lines.add(piece)
                yield piece

    encoding = text_encoding(through())
    if encoding != "utf-8-sig":  # it stopped at the first byte that is no UTF-8
        digest, lines = hashlib.sha256(), LineCount(path)
        for _ in through():
            pass

    def columns(wanted: Wanted, sentinels: Sequence[float] | None, notices: list[Message]) -> dict[str, np.ndarray]:
        with stream() as file:
            pieces = CsvPieces(path, file, encoding, len(header))
            scaled = _scaled(path, pieces, header, wanted)
            if rows_together(lines.rows) == 1:
                out = _averaged(path, scaled, lines.rows, notices)
                return out if sentinels is None else without_sentinels(out, wanted, sentinels, notices)
            counts: Counter[tuple[str, float]] = Counter()
            out = _averaged(path, _without(scaled, wanted, sentinels, counts), lines.rows, notices)
            notices += remarks(counts)
            return out

    return TrialTable(header, digest.hexdigest(), columns)


def _scaled(path: Path, pieces: CsvPieces, header: list[str], wanted: Wanted) -> Iterator[dict[str, np.ndarray]]:
    """The ``wanted`` columns of each of the ``pieces`` in SI. Raises UserError at the end where one holds text."""
    before = 0
    for values in pieces.of([index for index, _ in wanted.values()]):
        if len(values) == len({index for index, _ in wanted.values()}):
            yield {
                name: within(path, header[index], values[index], before) * factor
                for name, (index, factor) in wanted.items()
            }
        before = pieces.rows
    for index, _ in wanted.values():
        pieces.check(index, header[index])


def _without(
    pieces: Iterator[dict[str, np.ndarray]],
    wanted: Wanted,
    sentinels: Sequence[float] | None,
    counts: Counter[tuple[str, float]],
) -> Iterator[dict[str, np.ndarray]]:
    """The ``pieces`` without numbers that stand for no value, whose ``counts`` are added to."""
    for columns in pieces:
        if sentinels is None:
            yield columns
        else:
            kept, own = masked(columns, wanted, sentinels)
            counts.update(own)
            yield kept


def _averaged(
    path: Path, pieces: Iterator[dict[str, np.ndarray]], rows: int, notices: list[Message]
) -> dict[str, np.ndarray]:
    """The columns in ``pieces``, of so many ``rows`` that means are taken if they are more than MOST_KEPT.

    Infinite values become gaps. Of means, the rows before the first state and those without a time are left out. Raises
    UserError for no row, and where the clock of rows that are averaged runs backwards.
    """
    count = rows_together(rows)
    means = BlockMeans(count, {})
    infinite: dict[str, int] = {}
    clock = _Clock(path)
    for columns in pieces:
        means.periods = {name: 2 * math.pi for name in columns if wraps(name)}
        for name, values in columns.items():
            wrong = np.isinf(values)
            if wrong.any():
                infinite[name] = infinite.get(name, 0) + int(wrong.sum())
                columns[name] = np.where(wrong, np.nan, values)
        means.add(columns if count == 1 else clock.passed(columns))
    clock.check()
    out = means.columns()
    if not out or not len(out["t"]):
        raise TooFewData(f"{path}: no row holds a time and a state ({rows} rows); nothing to read")
    for name, cells in infinite.items():
        notices.append(Message(f"{name}: {cells} infinite values taken as missing", "infinite_values"))
    if count > 1:
        words = f"{rows} rows averaged by {count}: {len(out['t'])} of {np.median(np.diff(out['t'])):.4g} s are kept"
        notices.append(Message(words, "rows_averaged"))
    return out


class _Clock:
    """Goes through the rows of a log that is averaged, and knows where its time did not increase."""

    def __init__(self, path: Path) -> None:
        self.path, self._rows, self._last, self._alive = path, 0, -math.inf, -1
        self._wrong: tuple[int, float, float] | None = None

    def passed(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The next rows without those before the first state and those without a time."""
        t = columns["t"]
        alive = np.isfinite(t) & np.any([np.isfinite(columns[c]) for c in STATES if c in columns], axis=0)
        keep = np.isfinite(t)
        if self._alive < 0:
            keep[: int(np.argmax(alive)) if alive.any() else len(t)] = False
        at = np.flatnonzero(keep)
        times = np.concatenate([[self._last], t[at]])
        back = np.flatnonzero(np.diff(times) <= 0)
        if len(back) and self._wrong is None:
            self._wrong = self._rows + int(at[back[0]]), float(times[back[0]]), float(times[back[0] + 1])
        if alive.any():
            self._alive = self._rows + int(np.flatnonzero(alive)[-1])
        self._rows, self._last = self._rows + len(t), float(times[-1])
        return {name: values[at] for name, values in columns.items()}

    def check(self) -> None:
        """Raises UserError where the time stood still or ran backwards before the last row with a state."""
        if self._wrong is not None and self._wrong[0] <= self._alive:
            row, before, after = self._wrong
            raise BadValue(
                f"{self.path}: time {'repeats' if after == before else 'runs backwards'} at row {row + 1}: t = "
                f"{before:.10g} s, then {after:.10g} s; sort the rows or remove the doubled ones"
            )
