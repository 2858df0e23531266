"""Cells of a table as numbers: text that is a number is one, blank text is a gap, other text is told with its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.units import as_number
from mmg.errors import BadValue, UserError


@dataclass(frozen=True)
class Text:
    """Text in a column of numbers: the first ``row`` with any (0 = first below the header), what it holds, and the
    ``count`` of such cells."""

    row: int
    text: str
    count: int

    def error(self, path: Path, name: str) -> UserError:
        """What is wrong with the column ``name`` of the file ``path``."""
        shown = f"{self.text[:60]}{'...' * (len(self.text) > 60)}"
        advice = f"({self.count} such cells in the column); correct it or leave the cell empty"
        return BadValue(f"{path}: row {self.row + 1}, column '{name}': '{shown}' is not a number {advice}")


def floats_of_cells(series: Any) -> tuple[np.ndarray, Text | None]:
    """The pandas ``series`` (N,) of cells of any kind as floats, NaN for gaps and for text; and the text in it."""
    import pandas as pd

    kind = getattr(series.dtype, "kind", "O")
    if kind in "iuf":
        return series.to_numpy(dtype=float, na_value=np.nan), None
    cells = series.astype(object)
    given, values = cells.notna().to_numpy(), np.full(len(cells), np.nan)
    if kind != "b":
        try:
            values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        except (OverflowError, TypeError, ValueError):  # integers of hundreds of digits, and objects of other kinds
            values = np.array([as_number(str(value)) for value in cells])
    unread = cells[np.isnan(values) & given].astype(str)
    bad = unread[~unread.str.strip().str.lower().isin(("", "nan"))]
    if not len(bad):
        return values, None
    row = int(np.flatnonzero(series.index == bad.index[0])[0])
    return values, Text(row, bad.iloc[0], len(bad))
