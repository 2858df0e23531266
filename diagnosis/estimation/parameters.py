"""Free parameters of a fit: coefficients of the ship and parameters of effects, their priors, where they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.candidates import Candidate, Column, neutral
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.transition_model import TransitionModel
from mmg.ship import Ship

PRIOR_WIDTH = 10.0  # Prior standard deviation of an effect's parameter, in typical sizes of it. Set by hand: wide.


@dataclass(frozen=True)
class Priors:
    """Gaussian priors and bounds of P free parameters: columns; mean, std, lower, upper: (P,) each, in their units."""

    columns: tuple[Column, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __add__(self, other: Priors) -> Priors:
        join = {k: np.concatenate([getattr(self, k), getattr(other, k)]) for k in ("mean", "std", "lower", "upper")}
        return Priors(self.columns + other.columns, **join)

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbol of each column (P,) among the ship's coefficients."""
        return tuple(c.symbol for c in self.columns)

    @property
    def scaled_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (P,) less the mean, in std."""
        return (self.lower - self.mean) / self.std, (self.upper - self.mean) / self.std

    def only(self, kept: Sequence[bool]) -> Priors:
        """Those columns that are marked in ``kept`` (P,)."""
        columns = tuple(c for c, k in zip(self.columns, kept, strict=True) if k)
        at = np.array(kept, dtype=bool)
        return Priors(columns, self.mean[at], self.std[at], self.lower[at], self.upper[at])


NO_PRIORS = Priors((), *(np.zeros(0) for _ in range(4)))  # No free parameters


def priors_of_effects(candidates: Sequence[Candidate], width: float = PRIOR_WIDTH) -> Priors:
    """Priors of the parameters of ``candidates`` about their neutral values; width: std [typical sizes]."""
    join = {
        k: np.concatenate([np.zeros(0), *(getattr(c, k) for c in candidates)])
        for k in ("neutral", "typical", "lower", "upper")
    }
    columns = tuple(x for c in candidates for x in c.columns)
    return Priors(columns, join["neutral"], width * join["typical"], join["lower"], join["upper"])


def active_states(steps: TransitionModel, free: Sequence[str], theta: np.ndarray) -> np.ndarray:
    """Positions (A,) of the states that the motion or the free parameters depend on: not those of effects that are off.

    steps: model; free: symbols being fitted; theta: coefficients (all,) or by window (all, R). An effect is off if none
    of its parameters is free and all are neutral.
    """
    ship, on = steps.ship, {s.split(".")[0] for s in free if "." in s}
    for symbol, value in zip(ship.symbols, theta, strict=True):
        name, _, parameter = symbol.partition(".")
        if parameter and np.any(value != neutral(ship, name, parameter)):
            on.add(name)
    keep = [i for i, s in enumerate(steps.model.states) if "." not in s or s.split(".")[0] in on]
    return np.array(keep)


def active_in_window(columns: Sequence[Column], data: GriddedTrials) -> np.ndarray:
    """Which of P ``columns`` act in which of R windows of ``data``, (R, P) of 0 and 1: those of a run in it alone."""
    own = [c.run for c in columns]
    return np.array([[o is None or o == r for o in own] for r in data.run], dtype=float).reshape(len(data.run), -1)


def set_values(
    ship: Ship, data: GriddedTrials, theta: np.ndarray, columns: Sequence[Column], values: np.ndarray
) -> np.ndarray:
    """Coefficients ``theta`` (all,) or (all, R) of a ``ship`` with ``values`` (P,) in these ``columns``.

    data: the R windows. Returns (all, R) if one of the columns belongs to a run.
    """
    every = theta.copy()
    if every.ndim == 1 and any(c.run is not None for c in columns):
        every = np.repeat(every[:, None], len(data.run), axis=1)
    for c, value in zip(columns, values, strict=True):
        at = ship.symbols.index(c.symbol)
        if c.run is None:
            every[at] = value
        else:
            every[at, data.run == c.run] = value
    return every


def get_values(ship: Ship, data: GriddedTrials, theta: np.ndarray, columns: Sequence[Column]) -> np.ndarray:
    """Values (P,) of ``columns`` among coefficients ``theta`` (all,) or (all, R) of a ``ship``: means over the windows
    of ``data`` in which they act."""
    rows = []
    for c in columns:
        row = np.atleast_1d(theta[ship.symbols.index(c.symbol)])
        own = data.run == c.run if c.run is not None and len(row) > 1 else np.ones(len(row), dtype=bool)
        rows.append(float(row[own].mean()))
    return np.array(rows)
