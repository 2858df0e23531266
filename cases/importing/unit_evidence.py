"""Units that nobody wrote: taken only where other columns, or the size of the numbers, leave one choice."""

from __future__ import annotations

import numpy as np

from cases.importing.derived_motion import smoothed
from cases.importing.log_columns import Log
from cases.importing.vocabulary import BEYOND_A_TURN, factor, known_units, unit_of
from cases.trial import RUDDERS, wraps

CLOSE, APART = 0.10, 0.25
"""Relative difference of a unit that fits, and least one of all others."""
RARE = ("rad/min", "mrad/s", "ft/s", "cm/s", "mm/s")
"""Units that are read where they are written, but not looked for: other ones lie too near."""


def with_units_of_size(log: Log) -> Log:
    """The ``log`` with units that the size of its numbers shows: angles beyond a turn are degrees."""
    for quantity in log.unitless:
        values = log.columns[quantity]
        largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
        if wraps(quantity) and BEYOND_A_TURN < largest <= 361:
            log = log.with_unit(quantity, "deg", f"up to {largest:g}, more than a turn in radians")
        elif (quantity in RUDDERS or quantity == "pitch") and 1.75 < largest <= 110:
            log = log.with_unit(quantity, "deg", f"up to {largest:g}, more than 100 deg if in radians")
        elif unit_of(quantity) == "m" and largest > 2e4:
            log = log.with_unit(quantity, "m", "of the size of eastings and northings")
        elif unit_of(quantity) == "rps" and 60 < largest < 5000:
            log = log.with_unit(quantity, "rpm", f"up to {largest:g}: no shaft turns as often in a second")
    return log


def by_evidence(quantity: str, values: np.ndarray, t: np.ndarray, columns: dict[str, np.ndarray]) -> tuple[str, str]:
    """(unit, what shows it) of a ``quantity`` whose ``values`` (N,) have no unit; ("", "") where nothing shows it.

    t: (N,) even times [s]; columns: of the same run, with known units. A speed is compared with that of the positions,
    a turn rate with the change of the heading.
    """
    h = float(np.median(np.diff(t)))
    if quantity == "r" and "psi" in columns:
        psi = columns["psi"].copy()
        good = np.isfinite(psi)
        psi[good] = np.unwrap(psi[good])
        return _fitting(quantity, values, smoothed(h, psi).rate, "the change of the heading")
    if quantity in ("sog", "u") and {"x", "y"} <= set(columns):
        speed = np.hypot(*(smoothed(h, columns[name]).rate for name in ("x", "y")))
        return _fitting(quantity, values, speed, "the speed of the positions")
    return "", ""


def _fitting(quantity: str, values: np.ndarray, truth: np.ndarray, what: str) -> tuple[str, str]:
    """The unit in which ``values`` agree with the ``truth`` (N,), if only one does."""
    good = np.isfinite(values) & np.isfinite(truth)
    square = float(values[good] @ values[good])
    if good.sum() < 10 or square == 0:
        return "", ""
    slope = float(values[good] @ truth[good]) / square
    error = truth[good] - slope * values[good]
    if slope <= 0 or error @ error > 0.2 * float(truth[good] @ truth[good]):
        return "", ""
    off = {unit: abs(np.log(slope / scale)) for unit, scale in known_units(quantity).items() if unit not in RARE}
    ranked = sorted(off, key=lambda unit: off[unit])
    if off[ranked[0]] > CLOSE or off[ranked[1]] < APART:
        return "", ""
    assert factor(quantity, ranked[0]) is not None
    return ranked[0], f"{what} is {slope / known_units(quantity)[ranked[0]]:.2f} times that"
