"""Heading and positions of a record against the integrals of its rates; the resolution of a column."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cases.inputs import integral
from cases.trial import Trial

COLUMNS = {"psi": (("psi",), ("r",)), "position": (("x", "y"), ("u", "v"))}
"""Mismatch -> its own columns, and the rates whose integral they are compared with."""


def mismatches(trial: Trial) -> dict[str, np.ndarray]:
    """Channel of ``trial`` -> its difference from the integral of its rate, (N,).

    "psi" [rad]; "position" [m], north + i east, where there are positions.
    """
    t, psi = trial.t, filled(trial.psi_unwrapped)
    found = {"psi": psi - integral(t, filled(trial["r"]))}
    if trial.has_position:
        w = filled(trial["u"]) + 1j * filled(trial["v"])
        found["position"] = filled(trial["x"]) + 1j * filled(trial["y"]) - integral(t, w * np.exp(1j * psi))
    return found


def filled(values: np.ndarray) -> np.ndarray:
    """``values`` (N,) with missing samples by straight lines: a gap is no break."""
    good = np.isfinite(values)
    if good.all() or not good.any():
        return np.where(good, values, 0.0)
    rows = np.arange(len(values))
    return np.interp(rows, rows[good], values[good])


def grain(values: np.ndarray) -> float:
    """Least difference between neighbours of ``values`` (N,), which a rounded column cannot tell apart; 0 where all of
    them are the same."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.quantile(steps, 0.01)) if len(steps) else 0.0


def resolution(trial: Trial, columns: Sequence[str]) -> float:
    """``grain`` of the ``columns`` of ``trial`` together."""
    return math.hypot(*(grain(trial[name]) for name in columns))
