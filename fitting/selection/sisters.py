"""Sister ships: coefficients that are drawn from one distribution, whose mean and width the fits of all of them say.

The coefficients c_i of ship i are drawn from N(m, T), T = diag(width^2), the mean m from the prior of the start, which
is N(0, I) in its scale. Near an estimate the cost of a ship's data is a quadratic in c_i. Integrated over c_i and m,
the likelihood of the widths is Gaussian: restricted maximum likelihood, as the mean is integrated out (Patterson &
Thompson 1971; for meta-analysis DerSimonian & Laird 1986). It uses the whole information of each ship, not her
estimates one by one, so that a direction which her trials do not show counts for nothing.

Three sisters say little of sixty widths. First one width for all is found, in units of the prior. The width of each
coefficient then has a half-Cauchy prior at that scale (Gelman 2006): those that do not differ go to zero, and one that
differs much is hardly held back.

A sister is then calibrated with the prior N(mean, width^2), the mean being that of all sisters, herself among them: its
optimum is where that of the whole hierarchy is. Its covariance takes the mean as known; what that is uncertain by is
added (Kass & Steffey 1989).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.tails import chi2_tail
from fitting.calibration import Calibration
from mmg.ship import Ship

# Widths that are tried as one for all coefficients, in the scale of the prior; zero is tried too. A grid set by hand.
COMMON = np.geomspace(0.005, 5.0, 61)
# Least width with which sisters are fitted, and least scale of the half-Cauchy prior. Set by hand: they divide.
LEAST = 0.02


@dataclass(frozen=True)
class SisterEvidence:
    """What the trials of one ship say of the coefficients that she shares with her sisters: the cost 1/2 c'A c - b'c in
    scaled coefficients c = (coefficient - centre) / unit.

    A (P, P), b (P,): of the data alone; centre, unit: (P,) that the prior of her start has; symbols: of the
    coefficients. Constants of runs and campaigns, and parameters of instruments, are eliminated under their own priors,
    as these are no property of the hull. The information counts by the dispersion of the robust standard errors
    (``fitting.uncertainty.sandwich``).
    """

    symbols: tuple[str, ...]
    centre: np.ndarray
    unit: np.ndarray
    A: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, calibration: Calibration) -> SisterEvidence:
        """The evidence of the ``calibration``."""
        info = calibration.information.shared()
        F, slope = info.fisher.sum(axis=0), info.score.sum(axis=0)
        F, b = 0.5 * (F + F.T), F @ info.p - slope  # the slope of the quadratic at 0 instead of at the estimate
        own = np.array(["." in symbol for symbol in calibration.prior.symbols])  # "gyro.T" is of an effect
        kept, rest = np.flatnonzero(~own), np.flatnonzero(own)
        across = F[np.ix_(kept, rest)]
        # Schur complement, prior included
        gain = np.linalg.solve(F[np.ix_(rest, rest)] + np.eye(len(rest)), across.T).T
        A = F[np.ix_(kept, kept)] - gain @ across.T
        b = b[kept] - gain @ b[rest]
        dispersion = max(calibration.spread.dispersion, 1.0)
        symbols = tuple(calibration.prior.symbols[k] for k in kept)
        A = 0.5 * (A + A.T) / dispersion
        return cls(symbols, calibration.prior.mean[kept], calibration.prior.std[kept], A, b / dispersion)

    def in_units(self, centre: np.ndarray, unit: np.ndarray) -> SisterEvidence:
        """The same in other scaled coefficients. centre, unit: (P,) of these."""
        at, factor = (centre - self.centre) / self.unit, unit / self.unit
        A = factor[:, None] * self.A * factor
        return SisterEvidence(self.symbols, centre, unit, A, factor * (self.b - self.A @ at))


@dataclass(frozen=True)
class Marginal:
    """Widths ``width`` (P,) at which the ships' coefficients are integrated out. W (N, P, P) and w (N, P): information
    and slope of the mean by ship; S (P, P): of the mean, its prior included; mean (P,); log_likelihood."""

    width: np.ndarray
    W: np.ndarray
    w: np.ndarray
    S: np.ndarray
    mean: np.ndarray
    log_likelihood: float

    @classmethod
    def of(cls, A: np.ndarray, b: np.ndarray, width: np.ndarray) -> Marginal:
        """From information ``A`` (N, P, P) and ``b`` (N, P) of the ships, at these widths (P,)."""
        P = len(width)
        inner = np.eye(P) + width[:, None] * A * width  # I + T^1/2 A T^1/2: no width is divided by
        right = np.concatenate([width[:, None] * A, (width * b)[:, :, None]], axis=2)
        solved = np.linalg.solve(inner, right)
        pulled = np.swapaxes(right[:, :, :P], 1, 2)
        W, w = A - pulled @ solved[:, :, :P], b - (pulled @ solved[:, :, P:])[:, :, 0]
        W = 0.5 * (W + np.swapaxes(W, 1, 2))
        S, total = np.eye(P) + W.sum(axis=0), w.sum(axis=0)
        mean = np.linalg.solve(S, total)
        value = 0.5 * float(((width * b) * solved[:, :, P]).sum() + total @ mean)
        # restricted: with the mean integrated out
        value -= 0.5 * float(np.linalg.slogdet(inner)[1].sum() + np.linalg.slogdet(S)[1])
        return cls(width, W, w, S, mean, value)

    def slope(self) -> np.ndarray:
        """Derivative (P,) of the log likelihood with respect to the squares of the widths."""
        score = self.w - self.W @ self.mean
        by_mean = np.linalg.solve(self.S, np.swapaxes(self.W, 0, 1).reshape(len(self.S), -1))  # S^-1 W of all ships
        by_mean = np.swapaxes(by_mean.reshape(len(self.S), len(self.W), -1), 0, 1)
        spent = np.einsum("njj->j", self.W) - np.einsum("njk,nkj->j", self.W, by_mean)
        return 0.5 * ((score**2).sum(axis=0) - spent)


@dataclass(frozen=True)
class SisterWidths:
    """Of N sisters and P coefficients, in the scale of the prior: symbols, centre and unit (P,) of it; width (P,);
    common: the one width for all, with common_90, its interval; mean (P,) and mean_covariance (P, P) of their
    distribution; estimate (N, P) and std (N, P) of each sister; from_others (N, P): how far the trials of each put
    her from the mean of her sisters without her, in standard errors; p_alike (N,): probability of so large a
    distance, over all coefficients, of a ship that is drawn from the same distribution."""

    symbols: tuple[str, ...]
    centre: np.ndarray
    unit: np.ndarray
    width: np.ndarray
    common: float
    common_90: tuple[float, float]
    mean: np.ndarray
    mean_covariance: np.ndarray
    estimate: np.ndarray
    std: np.ndarray
    from_others: np.ndarray
    p_alike: np.ndarray

    @property
    def used_width(self) -> np.ndarray:
        """Widths (P,) with which the sisters are fitted: LEAST at least."""
        return np.maximum(self.width, LEAST)


def sister_widths(ships: Sequence[SisterEvidence]) -> SisterWidths:
    """Mean and width of the coefficients of ``ships``, two at least with the same symbols.

    The scale is that of the start of the first of them.
    """
    first = ships[0]
    own = [ship.in_units(first.centre, first.unit) for ship in ships]
    A, b = np.array([s.A for s in own]), np.array([s.b for s in own])
    common, interval = _common(A, b)
    width = _by_coefficient(A, b, common)
    at = Marginal.of(A, b, width)
    # of the mean by all, and by all but each ship (N, P, P)
    covariance, without = np.linalg.inv(at.S), np.linalg.inv(at.S - at.W)
    others = (without @ (at.w.sum(axis=0) - at.w)[:, :, None])[:, :, 0]
    prior = np.linalg.inv(np.diag(np.maximum(width, 1e-4) ** 2) + without)  # 1e-4: a width of 0 has no inverse
    posterior = np.linalg.inv(A + prior)
    estimate = (posterior @ (b[:, :, None] + prior @ others[:, :, None]))[:, :, 0]
    std = np.sqrt(np.diagonal(posterior, axis1=1, axis2=2))
    away, chance = zip(*map(_apart, at.W, at.w, others, without), strict=True)
    return SisterWidths(
        first.symbols, first.centre, first.unit, width, common, interval, at.mean, covariance, estimate, std,
        np.array(away), np.array(chance),
    )  # fmt: skip


def _common(A: np.ndarray, b: np.ndarray) -> tuple[float, tuple[float, float]]:
    """The most likely width that all coefficients share, and its 90 % interval by the likelihood ratio."""
    tried = np.concatenate([[0.0], COMMON])
    logs = np.array([Marginal.of(A, b, np.full(A.shape[1], width)).log_likelihood for width in tried])
    inside = tried[logs > logs.max() - 0.5 * 2.7055]  # 90 % quantile of chi-squared, one degree (Wilks 1938)
    return float(tried[int(np.argmax(logs))]), (float(inside.min()), float(inside.max()))


def _by_coefficient(A: np.ndarray, b: np.ndarray, common: float) -> np.ndarray:
    """The most likely width (P,) of each coefficient under a half-Cauchy prior at the ``common`` one."""
    from scipy.optimize import minimize  # late: slow to import

    scale = max(common, LEAST) ** 2

    def cost(square: np.ndarray) -> tuple[float, np.ndarray]:
        at = Marginal.of(A, b, np.sqrt(square))
        penalty, slope = np.log1p(square / scale).sum(), 1.0 / (scale + square)
        return float(penalty - at.log_likelihood), slope - at.slope()

    start = np.full(A.shape[1], scale)
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 5.0**2)] * len(start),
                     options={"maxiter": 300, "ftol": 1e-10})  # fmt: skip
    return np.sqrt(np.maximum(found.x, 0.0))


def _apart(W: np.ndarray, w: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, float]:
    """How far a ship is from the ``mean`` (P,) of the others, which has this ``covariance`` (P, P): by coefficient in
    standard errors (P,), and the probability of so much over all. W, w: information and slope of her own on it."""
    score, spread = w - W @ mean, W + W @ covariance @ W  # the score, and its covariance if she is one of them
    values, vectors = np.linalg.eigh(0.5 * (spread + spread.T))
    # directions on which her trials tell something; set by hand
    seen = values > max(1e-3, 1e-9 * values.max(initial=0.0))
    along = vectors[:, seen].T @ score
    chance = chi2_tail(float((along**2 / values[seen]).sum()), int(seen.sum())) if seen.any() else 1.0
    size = np.sqrt(np.maximum(np.diag(spread), 0.0))
    each = np.divide(score, size, out=np.zeros_like(score), where=size > 1e-9)  # 1e-9: she says nothing of it
    return each, chance


@dataclass(frozen=True)
class UncertainMean:
    """Covariance (P, P) of the mean of a prior, in the units of the coefficients ``symbols`` (P,)."""

    symbols: tuple[str, ...]
    covariance: np.ndarray


@dataclass(frozen=True)
class SisterStart:
    """What her sisters say of a ship. ship: to start from; values: most likely ones by symbol, from which the solver
    begins; mean: how uncertain that of her prior is."""

    ship: Ship
    values: Mapping[str, float]
    mean: UncertainMean


def sister_start(start: Ship, widths: SisterWidths, names: Sequence[str], number: int) -> SisterStart:
    """The start of the sister of this ``number`` among ``names``: the ship ``start`` with the prior of all of them.

    widths: of the group.
    """
    unit, rows = widths.unit, dict(start.coefficients)
    mean, likely = (widths.centre + unit * scaled for scaled in (widths.mean, widths.estimate[number]))
    words = f"mean of the sisters {', '.join(names)}; std: how much they differ"
    for symbol, value, width in zip(widths.symbols, mean.tolist(), (unit * widths.used_width).tolist(), strict=True):
        c = rows[symbol]
        rows[symbol] = c.with_(value=float(np.clip(value, c.lower, c.upper)), std=width, source=words)
    uncertain = UncertainMean(widths.symbols, unit[:, None] * widths.mean_covariance * unit)
    values = dict(zip(widths.symbols, likely.tolist(), strict=True))
    return SisterStart(replace(start, coefficients=rows), values, uncertain)


def with_whole_prior(ship: Ship, mean: UncertainMean) -> Ship:
    """A calibrated ``ship`` whose priors are as wide as sisters differ and their ``mean`` is uncertain: what a refit
    may use that does not know of the other sisters."""
    rows = dict(ship.coefficients)
    for symbol, variance in zip(mean.symbols, np.diag(mean.covariance).tolist(), strict=True):
        c = rows[symbol]
        if c.prior_std is not None:
            rows[symbol] = c.with_(prior_std=float(np.hypot(c.prior_std, np.sqrt(variance))))
    return replace(ship, coefficients=rows)


def with_uncertain_mean(calibration: Calibration, mean: UncertainMean) -> Calibration:
    """The ``calibration`` with a covariance that holds the error of its prior's ``mean`` too.

    An error e of the mean moves the estimate by V P e, V the covariance by information and prior P alone.
    """
    if not np.isfinite(calibration.covariance).all():
        return calibration
    at = [calibration.prior.symbols.index(s) for s in mean.symbols]
    unit, shared = calibration.prior.std[at], slice(len(calibration.p))
    pull = calibration.spread.model[shared, shared][:, at]  # V P, P being the identity in scaled coefficients
    return calibration.with_estimate(calibration.p, pull @ (mean.covariance / np.outer(unit, unit)) @ pull.T)
