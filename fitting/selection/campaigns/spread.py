"""How much the constants of campaigns differ: the width of their distribution by empirical Bayes.

Near an estimate the cost of the data is a quadratic in the constants d (C campaigns, each in its scale), everything
else eliminated: with information A and slope b at zero. The constants of one instrument are drawn from N(m, w^2), their
mean m from N(0, s^2): Omega = w^2 I + s^2 1 1'. Integrated over d, the likelihood of w is Gaussian, so the width that
makes the data most likely (Efron and Morris 1973; Laird and Ware 1982, whose EM climbs the same function) is found by a
search over one number for each instrument. A few campaigns often make a width of zero the most likely one although they
differ: its prior is the gamma density w exp(-w / 3) of Chung et al. (2013), which keeps off zero by about one standard
error and lets go of nothing that the data say. Whether the result is worth having is wanted of runs left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.nlp.fisher_information import Information

WIDTHS = np.geomspace(0.02, 12.0, 33)
"""Widths that are tried, in the scale of a constant."""
SHARED = 3.0
"""Standard deviation of the mean of all campaigns, in the scale of a constant: that of an effect that is freed."""
NARROW = 1e-3
"""Width that stands for none: the campaigns share one value."""
SWEEPS = 3
"""Rounds over the instruments."""


@dataclass(frozen=True)
class Reduced:
    """The cost of the data as a quadratic in the constants: A (K, K), slope b (K,) at zero, all else eliminated."""

    A: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, info: Information, constants: np.ndarray, dispersion: float = 1.0) -> Reduced:
        """From ``info`` of the windows; constants: (K,) columns; dispersion: how much more the scores of windows vary
        than their information says (``Robust``), by which the data count less."""
        rest = np.setdiff1d(np.arange(len(info.p)), constants)
        H, slope = info.fisher.sum(axis=0), info.score.sum(axis=0)
        known = info.prior_information[np.ix_(rest, rest)]
        across = H[np.ix_(constants, rest)]
        gain = np.linalg.solve(H[np.ix_(rest, rest)] + known, across.T).T
        A = H[np.ix_(constants, constants)] - gain @ across.T
        b = slope[constants] - gain @ (slope[rest] + info.prior_score[rest])
        A = 0.5 * (A + A.T)
        return cls(A / dispersion, (b - A @ info.p[constants]) / dispersion)

    def log_likelihood(self, omega: np.ndarray) -> float:
        """Of constants drawn from N(0, ``omega``), (K, K), beside none at all."""
        M = np.eye(len(self.b)) + omega @ self.A
        sign, size = np.linalg.slogdet(M)
        if sign <= 0:
            return -np.inf
        return float(-0.5 * size + 0.5 * self.b @ np.linalg.solve(M, omega @ self.b))

    def mean(self, omega: np.ndarray) -> np.ndarray:
        """Constants (K,) that are to be expected under N(0, ``omega``)."""
        return -np.linalg.solve(np.eye(len(self.b)) + omega @ self.A, omega @ self.b)


@dataclass(frozen=True)
class Widths:
    """Width of the constants of each instrument, 0 for one that is absent; block: (K,) instrument, and symbol: (K,)
    number of the symbol of each constant."""

    width: tuple[float, ...]
    block: np.ndarray
    symbol: np.ndarray

    def covariance(self) -> np.ndarray:
        """Omega (K, K)."""
        size = np.array(self.width)[self.block]
        same = (self.symbol[:, None] == self.symbol) & (size > 0)[:, None] & (size > 0)
        return np.diag(size**2) + SHARED**2 * same

    @property
    def used(self) -> np.ndarray:
        """Constants (K,) that are there."""
        return np.array(self.width)[self.block] > 0

    def with_width(self, block: int, width: float) -> Widths:
        """The same with another ``width`` of the instrument number ``block``."""
        return replace(self, width=tuple(width if i == block else w for i, w in enumerate(self.width)))

    def fitted(self, reduced: Reduced, blocks: Sequence[int]) -> Widths:
        """The same with the most likely widths of these ``blocks``, each found while the others stay, in turn."""
        found = self
        for _ in range(SWEEPS if len(blocks) > 1 else 1):
            for block in blocks:
                tried = [found.with_width(block, float(w)) for w in WIDTHS]
                found = max(tried, key=lambda t: reduced.log_likelihood(t.covariance()) + _log_prior(t.width[block]))
        return found

    def means(self, constants: np.ndarray) -> np.ndarray:
        """Mean of all campaigns, by constant (K,), from estimates (K,) under ``covariance``."""
        omega, used = self.covariance(), self.used
        found = np.zeros(len(constants))
        at = np.flatnonzero(used)
        if len(at):
            pull = np.linalg.solve(omega[np.ix_(at, at)], constants[at])
            same = SHARED**2 * (self.symbol[at][:, None] == self.symbol[at])
            found[at] = same @ pull
        return found


def _log_prior(width: float) -> float:
    """Log density of a width, up to a constant."""
    return float(np.log(width) - width / SHARED)


def with_prior(info: Information, constants: np.ndarray, widths: Widths) -> tuple[Information, np.ndarray]:
    """``info`` of the coefficients that ``widths`` leave in, under the prior of these, and their columns (n,).

    constants: (K,) columns of all constants.
    """
    used = constants[widths.used]
    columns = np.sort(np.concatenate([np.setdiff1d(np.arange(len(info.p)), constants), used]))
    at = np.searchsorted(columns, used)
    omega = widths.covariance()[np.ix_(widths.used, widths.used)]
    known = info.prior_information[np.ix_(columns, columns)].copy()
    slope = info.prior_score[columns].copy()
    if len(at):
        inverse = np.linalg.inv(omega)
        known[np.ix_(at, at)] = inverse
        slope[at] = inverse @ info.p[used]
    return (
        Information(
            info.fisher[:, columns[:, None], columns],
            info.score[:, columns],
            info.p[columns],
            info.run,
            tuple(info.symbols[i] for i in columns),
            known,
            slope,
        ),
        columns,
    )
