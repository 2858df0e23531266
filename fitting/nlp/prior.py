"""What is known of the free coefficients before a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmg.ship import Ship


@dataclass(frozen=True)
class Prior:
    """Gaussian prior and bounds of the free coefficients, each of shape (P,).

    constants: coefficients of which each of ``runs`` runs has its own (fitting/nlp/run_constants.py); they come
    last, run by run. campaign: (trials,) of which of ``runs`` campaigns each trial is, where the runs of a campaign
    share its constants; empty: each run has its own.
    """

    symbols: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    constants: tuple[str, ...] = ()
    runs: int = 0
    campaign: tuple[int, ...] = ()

    @property
    def shared(self) -> int:
        """Number of the coefficients that all runs share."""
        return len(self.symbols) - self.runs * len(self.constants)

    @property
    def local(self) -> tuple[str, ...]:
        """Symbols, in the ship, of the coefficients that one run depends on: shared ones, then its constants."""
        return (*self.symbols[: self.shared], *self.constants)

    def positions(self, ship: Ship) -> np.ndarray:
        """Of the coefficients that one run depends on, among all of the ship."""
        return np.array([ship.symbols.index(s) for s in self.local])

    @property
    def scaled_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the scaled coefficients, (P,) each."""
        return (self.lower - self.mean) / self.std, (self.upper - self.mean) / self.std

    @property
    def common(self) -> Prior:
        """The prior of the shared coefficients alone."""
        own = slice(self.shared)
        return Prior(self.symbols[own], self.mean[own], self.std[own], self.lower[own], self.upper[own])

    def joined(self, ship: Ship, symbols: Sequence[str]) -> Prior:
        """The prior with further coefficients of ``ship`` that all runs share, about their values, the last ones."""
        mean, std, lower, upper = _stated(ship, symbols)
        return Prior(
            (*self.symbols, *symbols),
            np.concatenate([self.mean, mean]),
            np.concatenate([self.std, std]),
            np.concatenate([self.lower, lower]),
            np.concatenate([self.upper, upper]),
        )

    @classmethod
    def of(
        cls,
        ship: Ship,
        constants: Sequence[str] = (),
        runs: Sequence[str] = (),
        campaign: Sequence[int] = (),
    ) -> Prior:
        """The prior that a ship file states of what is free: value +- std within its bounds.

        constants: further coefficients, of which each of ``runs`` has its own, named "current.x@RUN"; campaign: which
        of ``runs``, then names of campaigns, each trial is of.
        """
        own = [(f"{symbol}@{run}", symbol) for run in runs for symbol in constants]
        symbols = (*ship.free, *(name for name, _ in own))
        mean, std, lower, upper = _stated(ship, (*ship.free, *(symbol for _, symbol in own)))
        return cls(symbols, mean, std, lower, upper, tuple(constants), len(runs) if constants else 0, tuple(campaign))


def _stated(ship: Ship, symbols: Sequence[str]) -> list[np.ndarray]:
    """Value, standard deviation, lower and upper bound of the coefficients ``symbols`` of ``ship``, (P,) each."""
    chosen = [ship.coefficients[s] for s in symbols]
    return [np.array([getattr(c, key) for c in chosen]) for key in ("value", "std", "lower", "upper")]
