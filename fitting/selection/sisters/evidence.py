"""What the trials of one ship say of the coefficients that she shares with her sisters: a quadratic cost.

Near an estimate the cost of the data is 1/2 c'A c - b'c in the coefficients c. Constants of runs and campaigns, and
parameters of instruments, are eliminated under their own priors, as these are no property of the hull. The information
counts by the dispersion of the robust standard errors: residuals that are correlated in time say less than their number
(``fitting.uncertainty.sandwich``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.calibration import Calibration


@dataclass(frozen=True)
class SisterEvidence:
    """Of one ship, in scaled coefficients c = (coefficient - centre) / unit: information A (P, P) and b (P,) of the
    data alone, and the centre and unit (P,) that the prior of her start has; symbols: of the coefficients."""

    symbols: tuple[str, ...]
    centre: np.ndarray
    unit: np.ndarray
    A: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, found: Calibration) -> SisterEvidence:
        """The evidence of the calibration ``found``."""
        info = found.information.shared()
        F, slope = info.fisher.sum(axis=0), info.score.sum(axis=0)
        F, b = 0.5 * (F + F.T), F @ info.p - slope
        own = np.array(["." in symbol for symbol in found.prior.symbols])
        kept, rest = np.flatnonzero(~own), np.flatnonzero(own)
        across = F[np.ix_(kept, rest)]
        gain = np.linalg.solve(F[np.ix_(rest, rest)] + np.eye(len(rest)), across.T).T
        A = F[np.ix_(kept, kept)] - gain @ across.T
        b = b[kept] - gain @ b[rest]
        dispersion = max(found.spread.dispersion, 1.0)
        symbols = tuple(found.prior.symbols[k] for k in kept)
        A = 0.5 * (A + A.T) / dispersion
        return cls(symbols, found.prior.mean[kept], found.prior.std[kept], A, b / dispersion)

    def in_units(self, centre: np.ndarray, unit: np.ndarray) -> SisterEvidence:
        """The same in other scaled coefficients. centre, unit: (P,) of these."""
        at, factor = (centre - self.centre) / self.unit, unit / self.unit
        A = factor[:, None] * self.A * factor
        return SisterEvidence(self.symbols, centre, unit, A, factor * (self.b - self.A @ at))
