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
    last, run by run.
    """

    symbols: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    constants: tuple[str, ...] = ()
    runs: int = 0

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

    @classmethod
    def of(cls, ship: Ship, symbols: Sequence[str] | None = None) -> Prior:
        """The prior that a ship file states: value +- std within its bounds; default of what is free."""
        symbols = ship.free if symbols is None else tuple(symbols)
        chosen = [ship.coefficients[s] for s in symbols]
        mean, std, lower, upper = (
            np.array([getattr(c, k) for c in chosen]) for k in ("value", "std", "lower", "upper")
        )
        return cls(symbols, mean, std, lower, upper)
