"""What is known of the free coefficients before a calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmg.ship import Ship


@dataclass(frozen=True)
class Prior:
    """Gaussian prior and bounds of the free coefficients, each of shape (P,)."""

    symbols: tuple[str, ...]
    mean: np.ndarray
    std: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, ship: Ship) -> Prior:
        """The prior that a ship file states: value +- std within its bounds."""
        chosen = [ship.coefficients[s] for s in ship.free]
        return cls(
            ship.free,
            *(np.array([getattr(c, key) for c in chosen]) for key in ("value", "std", "lower", "upper")),
        )
