"""Columns of a fit: coefficients and parameters of effects that are free, their priors, where they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.candidates import AT, neutral, stem
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearised_model import TransitionModel
from mmg.ship import Ship


@dataclass(frozen=True)
class Priors:
    """Gaussian priors and bounds of some columns: symbols and (P,) each of mean, std, lower, upper."""

    symbols: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __add__(self, other: Priors) -> Priors:
        join = {k: np.concatenate([getattr(self, k), getattr(other, k)]) for k in ("mean", "std", "lower", "upper")}
        return Priors(self.symbols + other.symbols, **join)

    def only(self, kept: Sequence[bool]) -> Priors:
        """Those columns that are marked."""
        symbols = tuple(s for s, k in zip(self.symbols, kept, strict=True) if k)
        at = np.array(kept, dtype=bool)
        return Priors(symbols, self.mean[at], self.std[at], self.lower[at], self.upper[at])


def active_states(steps: TransitionModel, free: Sequence[str], theta: np.ndarray) -> np.ndarray:
    """Positions of the states on which the motion or the columns depend: not the memory of effects at neutral values.

    free: symbols that are being fitted; an effect whose parameters are neither free nor off neutral is asleep.
    """
    ship, awake = steps.ship, {s.split(".")[0] for s in free if "." in s}
    for symbol, value in zip(ship.symbols, theta, strict=True):
        name, _, parameter = symbol.partition(".")
        if parameter and np.any(value != neutral(ship, name, parameter)):
            awake.add(name)
    keep = [i for i, s in enumerate(steps.model.states) if "." not in s or s.split(".")[0] in awake]
    return np.array(keep)


def active_in_window(symbols: Sequence[str], data: GriddedTrials) -> np.ndarray:
    """Which columns act in which windows, (R, P): a parameter of one run in that run alone."""
    own = [s.partition(AT)[2] for s in symbols]
    return np.array([[not o or int(o) == r for o in own] for r in data.run], dtype=float).reshape(len(data.run), -1)


def set_values(
    ship: Ship, data: GriddedTrials, theta: np.ndarray, symbols: Sequence[str], values: np.ndarray
) -> np.ndarray:
    """Coefficients (all,) with some values replaced; (all, R) by window if one of the symbols is of one run."""
    every = theta.copy()
    if every.ndim == 1 and any(AT in s for s in symbols):
        every = np.repeat(every[:, None], len(data.run), axis=1)
    for j, (s, value) in enumerate(zip(symbols, values, strict=True)):
        at = ship.symbols.index(stem(s))
        if AT in s:
            every[at, data.run == int(s.partition(AT)[2])] = values[j]
        else:
            every[at] = value
    return every


def get_values(ship: Ship, data: GriddedTrials, theta: np.ndarray, symbols: Sequence[str]) -> np.ndarray:
    """Values of these symbols among coefficients (all,) or (all, R); a mean over windows where they differ."""
    rows = []
    for s in symbols:
        row = np.atleast_1d(theta[ship.symbols.index(stem(s))])
        own = data.run == int(s.partition(AT)[2]) if AT in s and len(row) > 1 else np.ones(len(row), dtype=bool)
        rows.append(float(row[own].mean()))
    return np.array(rows)


NO_PRIORS = Priors((), *(np.zeros(0) for _ in range(4)))
"""No columns."""


def priors_of(ship: Ship, symbols: Sequence[str]) -> Priors:
    """As the ship's file states them."""
    rows = [ship.coefficients[s] for s in symbols]
    mean, std, lower, upper = (np.array([getattr(c, k) for c in rows]) for k in ("value", "std", "lower", "upper"))
    return Priors(tuple(symbols), mean, std, lower, upper)
