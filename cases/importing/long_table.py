"""Tables with a row a value (time, name, value, unit) turned into those with a column a quantity."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from cases.importing.clocks import clock_of
from cases.importing.import_map import ImportMap
from cases.importing.raw_table import Account, RawTable
from cases.importing.series import SourceSeries, table_of_series
from cases.importing.vocabulary import Meaning, meaning, plain_words
from cases.io.text_table import floats_of_cells
from mmg.errors import Conflict
from mmg.messages import Message

_NAMES = "variable|quantity|signal|channel|parameter|param|name|tag|sensor|measurement|topic|field|data_?channel"
NAME = rf"({_NAMES})(_?name|_?id)?"
VALUE = r"value|val|reading"
UNIT = r"units?|uom"


def pivoted(table: RawTable, chosen: ImportMap) -> RawTable:
    """The ``table`` with a column for each name in it, where it is a long one; else as it is.

    A long table has columns of times, names, which are words, and values; a column of units if any. chosen: the map.
    Raises UserError where rows of one name have several units, and as ``table_of_series``.
    """
    times = [h for h in table.headers if meaning(h).quantity == "t"]
    words = {h: plain_words(h) for h in table.headers}
    values = [h for h in table.headers if re.fullmatch(VALUE, words[h])]
    names = [h for h in table.headers if re.fullmatch(NAME, words[h]) and not table.numeric(h)]
    if len(times) != 1 or len(values) != 1 or not names:
        return table
    unit = [h for h in table.headers if re.fullmatch(UNIT, words[h])][:1]
    t, cells, of, units, clock = [], [], [], [], None
    for piece in table.pieces([*times, *values, *names, *unit]):
        clock = clock_of(piece, times[0], "", None, chosen.zone_hours)
        t.append(clock.t)
        cells.append(floats_of_cells(piece.cells(values[0]))[0])
        of.append(_joined(piece.cells(h) for h in names))
        units.append(_joined(piece.cells(h) for h in unit) if unit else np.full(len(clock.t), ""))
    assert clock is not None
    when, numbers, called, measured = (np.concatenate(parts) for parts in (t, cells, of, units))
    series = []
    for name in dict.fromkeys(called.tolist()):
        rows = (called == name) & np.isfinite(when)
        own = sorted(set(measured[rows].tolist()))
        if len(own) > 1:
            raise Conflict(f"{table.name}: '{name}' has several units ({', '.join(own[:4])}); divide the file")
        means = meaning(name)
        said = Meaning(means.quantity, (own or [""])[0] or means.unit, means.may_be)
        series.append(SourceSeries(name, when[rows], {name: numbers[rows]}, {name: said}))
    used = {*times, *values, *names, *unit}
    left = [Account(h, len(when), (), "beside the values of a long table") for h in table.headers if h not in used]
    text = f"a long table: {len(series)} names in {', '.join(repr(h) for h in names)}, a column each"
    return table_of_series(
        table.path, series, chosen, clock, [*table.notices, Message(text, "pivoted")], left, table.name
    )


def _joined(columns: Iterable[Any]) -> np.ndarray:
    """Words of each row (N,) of one or more ``columns``, between blanks; "" for nothing."""
    parts = [["" if cell is None or cell != cell else str(cell).strip() for cell in column] for column in columns]
    return np.array([" ".join(filter(None, row)) for row in zip(*parts, strict=True)], dtype=object)
