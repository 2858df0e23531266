"""Long logs averaged while they are read: means of so many neighbouring rows, none across a gap."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

MOST_KEPT = 400_000
"""Most rows of a trial that are kept; 11 hours at 10 Hz."""


def rows_together(rows: int) -> int:
    """How many neighbouring rows become one in a file of so many ``rows``, so that MOST_KEPT are not exceeded."""
    return max(1, math.ceil(rows / MOST_KEPT))


class BlockMeans:
    """Means of ``count`` neighbouring rows of a log that is given in pieces.

    periods: of the columns that are angles, by name. The same rows are averaged in every column, so no column is late
    against another. A block ends before a gap (``count`` usual steps long). A column that lacks some rows of a block is
    taken to the block's mean time along the line to its neighbours.
    """

    def __init__(self, count: int, periods: Mapping[str, float]) -> None:
        self.count, self.periods = count, dict(periods)
        self.rows = 0
        self._rest: dict[str, np.ndarray] = {}
        self._parts: list[dict[str, np.ndarray]] = []
        self._late: list[tuple[int, dict[str, np.ndarray]]] = []

    def add(self, columns: Mapping[str, np.ndarray]) -> None:
        """The next rows: columns (N,) by name, "t" [s] among them, increasing and without NaN."""
        self.rows += len(columns["t"])
        if self.count == 1:
            self._parts.append(dict(columns))
            return
        if self._rest:
            columns = {name: np.concatenate([self._rest[name], values]) for name, values in columns.items()}
        t = columns["t"]
        if not len(t):
            return
        step = np.diff(t)
        gap = np.concatenate([[True], step > self.count * np.median(step)]) if len(step) else np.ones(1, dtype=bool)
        row = np.arange(len(t))
        begins = np.flatnonzero((row - np.maximum.accumulate(np.where(gap, row, 0))) % self.count == 0)
        last = begins[-1]
        self._rest = {name: values[last:].copy() for name, values in columns.items()}
        if last:
            self._average({name: values[:last] for name, values in columns.items()}, begins[:-1])

    def columns(self) -> dict[str, np.ndarray]:
        """The means of all rows that were added, by name (M,)."""
        if self._rest:
            self._average(self._rest, np.zeros(1, dtype=int))
            self._rest = {}
        names = list(self._parts[0]) if self._parts else []
        out = {name: np.concatenate([part.pop(name) for part in self._parts]) for name in names}
        for name in sorted({name for _, late in self._late for name in late}):
            late = np.concatenate([late.get(name, np.zeros(rows)) for rows, late in self._late])
            out[name] = _moved(out["t"], out[name], late, self.periods.get(name))
        return out

    def _average(self, columns: Mapping[str, np.ndarray], begins: np.ndarray) -> None:
        """Keep the means of ``columns`` (N,) over blocks that begin at the rows ``begins`` (M,)."""
        rows, size = np.arange(len(columns["t"])), np.diff(begins, append=len(columns["t"]))
        means: dict[str, np.ndarray] = {}
        late: dict[str, np.ndarray] = {}
        for name, values in columns.items():
            good = np.isfinite(values)
            first = np.minimum.reduceat(np.where(good, rows, len(rows)), begins)
            base = np.append(values, np.nan)[first]
            off = np.where(good, values - np.repeat(base, size), 0.0)
            if name in self.periods:
                off = np.remainder(off + self.periods[name] / 2, self.periods[name]) - self.periods[name] / 2
                off[~good] = 0.0
            known = np.add.reduceat(good.astype(int), begins)
            with np.errstate(invalid="ignore", divide="ignore"):
                means[name] = base + np.add.reduceat(off, begins) / known
                if name != "t" and (known < size).any():
                    since = columns["t"] - np.repeat(columns["t"][begins], size)
                    own = np.add.reduceat(np.where(good, since, 0.0), begins) / known
                    late[name] = np.nan_to_num(own - np.add.reduceat(since, begins) / size)
        self._parts.append(means)
        self._late.append((len(begins), late))


def _moved(t: np.ndarray, values: np.ndarray, late: np.ndarray, period: float | None) -> np.ndarray:
    """``values`` (M,) that are means at ``t + late`` (M,) [s], at ``t``, along the lines between neighbours."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return values
    at, y = (t + late)[known], values[known]
    if period:
        y = np.unwrap(y, period=period)
    slope = np.gradient(y, at)
    out = values.copy()
    out[known] -= slope * late[known]
    return out
