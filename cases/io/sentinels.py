"""Numbers that stand for no value, such as -999: found in the columns of a trial file as they are written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from cases.quantities import quantity
from mmg.messages import Message

CODE = "sentinel"
"""Of the notice on such numbers."""

_NINES = (99.0, 99.9, 99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 999999.0)
WELL_KNOWN = (
    *(sign * nines for nines in _NINES for sign in (-1, 1)),
    *(32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0, 1e30, -1e30, 181.0, 91.0, 511.0, 102.3, 360.1),
)
"""Numbers that loggers write where they have none; those of AIS are among them."""

JUMP = 20.0
"""Such a number stands for none where the column jumps there by so many times its larger changes from row to row."""

STEP_OF_INPUT = 1.0
"""The same of a zero of an actuator in a row in which a state jumped to zero."""

LARGER = 0.95
"""The larger changes from row to row: this quantile of them."""


def without_sentinels(
    columns: Mapping[str, np.ndarray],
    wanted: Mapping[str, tuple[int, float]],
    further: Sequence[float],
    notices: list[Message],
) -> dict[str, np.ndarray]:
    """As ``masked`` of ``columns`` (N,), ``wanted`` and ``further``; each number adds one of the ``notices``."""
    out, counts = masked(columns, wanted, further)
    notices += remarks(counts)
    return out


def masked(
    columns: Mapping[str, np.ndarray], wanted: Mapping[str, tuple[int, float]], further: Sequence[float]
) -> tuple[dict[str, np.ndarray], Counter[tuple[str, float]]]:
    """``columns``, name -> (N,), in which what stands for no value is missing, and how often which number did.

    wanted: name -> (number of the column, factor by which its values were multiplied); further: as in ``sentinels_in``.
    """
    out, counts = dict(columns), Counter[tuple[str, float]]()
    for name, values in columns.items():
        factor = wanted[name][1]
        if name == "t" or not np.isfinite(values).any():
            continue
        for number, rows in sentinels_in(values if factor == 1 else np.round(values / factor, 6), further).items():
            out[name] = np.where(rows, np.nan, out[name])
            counts[name, number] += int(rows.sum())
    return out, counts


def remarks(counts: Mapping[tuple[str, float], int]) -> list[Message]:
    """A notice on each column and number of the ``counts`` that ``masked`` gives."""
    what = "which stands for no value; taken as missing"
    return [Message(f"{name}: {n} samples hold {number:g}, {what}", CODE) for (name, number), n in counts.items()]


def sentinels_in(values: np.ndarray, further: Sequence[float] = ()) -> dict[float, np.ndarray]:
    """Number that stands for no value -> rows (N,) of ``values`` (N,) that hold it.

    further: numbers that are known to stand for none. One that is only well known counts where the column jumps to it
    and back, and never where most rows hold it.
    """
    out = {float(number): values == number for number in further if (values == number).any()}
    present = values[np.isfinite(values)]
    for number in np.setdiff1d(values[np.isin(values, WELL_KNOWN)], further).tolist():
        here = present == number
        rest = present[~here]
        if len(rest) < max(10, 0.5 * len(present)):
            continue
        usual = max(float(np.quantile(np.abs(np.diff(rest)), LARGER)), 1e-9 * abs(number))
        edges = np.flatnonzero(np.diff(here.astype(int)))
        off = np.abs(np.where(here[edges], present[edges + 1], present[edges]) - number)
        if len(off) and float(np.median(off)) > JUMP * usual:
            out[float(number)] = values == number
    return out


def without_dropouts(
    channels: Mapping[str, np.ndarray], states: Sequence[str]
) -> tuple[dict[str, np.ndarray], Counter[tuple[str, float]]]:
    """The ``channels``, quantity -> (N,), with NaN for zeros of a logger that had no value, and how many of each.

    states: quantities that cannot jump to zero and back, as a heading or a speed; a rudder and revolutions can, and
    their zeros count only in rows in which those of a state do.
    """
    zeros = {
        name: _dropouts(name, values, JUMP if name in states else STEP_OF_INPUT) for name, values in channels.items()
    }
    none = np.zeros(len(next(iter(channels.values()), ())), dtype=bool)
    rows = np.any([none, *(zeros[name] for name in states if name in zeros)], axis=0)
    counts = Counter({(name, 0.0): int((own & rows).sum()) for name, own in zeros.items() if (own & rows).any()})
    return {name: np.where(zeros[name] & rows, np.nan, values) for name, values in channels.items()}, counts


def _dropouts(name: str, values: np.ndarray, jump: float) -> np.ndarray:
    """Rows (N,) where ``values`` (N,) jump to zero and back by ``jump`` of their larger changes from row to row."""
    out = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    zero = values[known] == 0
    rest = values[known][~zero]
    if not zero.any() or len(rest) < max(10, 0.5 * len(known)):
        return out
    turn = quantity(name).period and (360.0 if np.abs(rest).max() > 7 else quantity(name).period)
    changes = np.abs(np.remainder(np.diff(rest) + turn / 2, turn) - turn / 2) if turn else np.abs(np.diff(rest))
    size = np.minimum(np.abs(rest) % turn, -np.abs(rest) % turn) if turn else np.abs(rest)
    at = np.cumsum(~zero)[zero]  # number of values before each zero
    sides = np.append(0.0, size)[at], np.append(size, 0.0)[at]  # a ship may begin and end at rest
    out[known[zero]] = np.minimum(*sides) > jump * max(float(np.quantile(changes, LARGER)), 1e-9)
    return out
