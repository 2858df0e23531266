"""What is known of the free coefficients before a calibration.

The scaled coefficients of a fit are p = (shared, constants of run 0, constants of run 1, ...), each constant with the
same prior N(centre, typical size^2) in every run. The model of one run depends on the shared ones and on its own: L of
the P. All sums over samples are therefore made by run in L columns, and put together in P at the end. The same holds
for campaigns, whose runs share the constants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.nlp.windows import Segments
from mmg.ship import Ship


def group_sums(group: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, ...) of the rows of ``values`` (m, ...) of each ``group`` (m,), a number below ``count``."""
    sums = np.zeros((count, *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums


def product_sums(A: np.ndarray, B: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, a, b) of A^T B over the matrices (m, S, a) and (m, S, b) of each ``group`` (m,), a number below
    ``count``: one product of tall matrices each."""
    total = np.empty((count, A.shape[2], B.shape[2]))
    for g in range(count):
        rows = np.flatnonzero(group == g)
        together = len(rows) and rows[-1] - rows[0] == len(rows) - 1  # no copy then
        some = slice(rows[0], rows[-1] + 1) if together else rows
        total[g] = A[some].reshape(-1, A.shape[2]).T @ B[some].reshape(-1, B.shape[2])
    return total


@dataclass(frozen=True)
class Prior:
    """Gaussian prior and bounds of the free coefficients, each of shape (P,).

    constants: coefficients of which each of ``runs`` runs has its own; they come last, run by run. campaign: (trials,)
    of which of ``runs`` campaigns each trial is, where the runs of a campaign share its constants; else empty.
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
        rows = zip((self.mean, self.std, self.lower, self.upper), _stated(ship, symbols), strict=True)
        mean, std, lower, upper = map(np.concatenate, rows)
        return Prior((*self.symbols, *symbols), mean, std, lower, upper)

    @classmethod
    def of(
        cls, ship: Ship, constants: Sequence[str] = (), runs: Sequence[str] = (), campaign: Sequence[int] = ()
    ) -> Prior:
        """The prior that a ship file states of what is free: value +- std within its bounds.

        constants: further coefficients, of which each of ``runs`` has its own, named "current.x@RUN"; campaign: which
        of ``runs``, then names of campaigns, each trial is of.
        """
        # run by run, as scaled coefficients are ordered
        own = [(f"{symbol}@{run}", symbol) for run in runs for symbol in constants]
        symbols = (*ship.free, *(name for name, _ in own))
        mean, std, lower, upper = _stated(ship, (*ship.free, *(symbol for _, symbol in own)))
        return cls(symbols, mean, std, lower, upper, tuple(constants), len(runs) if constants else 0, tuple(campaign))


def _stated(ship: Ship, symbols: Sequence[str]) -> list[np.ndarray]:
    """Value, standard deviation, lower and upper bound of the coefficients ``symbols`` of ``ship``, (P,) each."""
    chosen = [ship.coefficients[s] for s in symbols]
    return [np.array([getattr(c, key) for c in chosen]) for key in ("value", "std", "lower", "upper")]


@dataclass(frozen=True)
class Columns:
    """The coefficients of a fit by group of intervals: a run, a campaign, or all runs if none has constants of its own.

    at: (G, L) where those of each group lie in p (P,), the ``shared`` first ones in all groups; window (W,),
    interval (M,), node (B,): group of each; campaigns: whether groups are campaigns.
    """

    at: np.ndarray
    shared: int
    window: np.ndarray
    interval: np.ndarray
    node: np.ndarray
    campaigns: bool = False

    @classmethod
    def of(cls, prior: Prior, segments: Segments) -> Columns:
        """Those of a prior, for the intervals of ``segments``."""
        group = segments.run if prior.constants else np.zeros_like(segments.run)
        campaigns = bool(prior.constants and prior.campaign)
        # from number of the run to that of its campaign
        group = np.asarray(prior.campaign)[group] if campaigns else group
        shared, own = prior.shared, len(prior.constants)
        runs = np.arange(prior.runs if own else 1)
        # shared coefficients are first in each group, then come the constants of group 0, of group 1, ...
        at = np.hstack([np.tile(np.arange(shared), (len(runs), 1)), shared + own * runs[:, None] + np.arange(own)])
        return cls(at, shared, group, group[segments.window], group[segments.node_window], campaigns)

    @property
    def groups(self) -> int:
        return len(self.at)

    @property
    def owner(self) -> np.ndarray | None:
        """Run of each coefficient (P,), -1 for shared ones, -2 - c for those of campaign c; None if all are shared."""
        if self.at.shape[1] == self.shared:
            return None
        owner = np.full(int(self.at.max()) + 1, -1)
        numbers = np.arange(self.groups)[:, None]
        owner[self.at[:, self.shared :]] = -2 - numbers if self.campaigns else numbers  # -1 is taken by shared ones
        return owner

    def each(self, values: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Values (G, ...) for points of these groups (m,): (m, ...), or (1, ...) for all of them."""
        return values if self.groups == 1 else values[group]  # one row broadcasts, no copy

    def points(self, theta: np.ndarray, group: np.ndarray) -> np.ndarray:
        """All coefficients of points: (all, m) from (G, all), or as they are if they are the same for all (all,)."""
        return theta if theta.ndim == 1 else np.ascontiguousarray(theta[group].T)

    def total(self, values: np.ndarray, group: np.ndarray) -> np.ndarray:
        """Sums by group (G, ...) of values of points (m, ...); one row stands for each point."""
        if self.groups == 1:
            return values.sum(axis=0)[None]
        return group_sums(group, values, self.groups)

    def unit(self, scale: np.ndarray, std: np.ndarray, group: np.ndarray) -> np.ndarray:
        """What one of the scaled (state, coefficients) is in SI, for points of these groups (m,): (m or 1, 1, S + L).

        scale: (S,) of the states; std: (G, L) of the coefficients; group: (m,)."""
        own = self.each(std, group)
        return np.hstack([np.tile(scale, (len(own), 1)), own])[:, None, :]

    def vector(self, parts: np.ndarray, size: int) -> np.ndarray:
        """Sum (P,) of parts (G, L) of the groups."""
        whole = np.zeros(size)
        np.add.at(whole, self.at, parts)  # .at: shared coefficients are in every group
        return whole

    def matrix(self, parts: np.ndarray, size: int) -> np.ndarray:
        """Sum (P, P) of parts (G, L, L) of the groups."""
        whole = np.zeros((size, size))
        for at, part in zip(self.at, parts, strict=True):
            whole[np.ix_(at, at)] += part
        return whole


@dataclass(frozen=True)
class ByCampaign:
    """Constants that each campaign has for itself: symbols; names: of the campaigns; number: (trials,) of which
    campaign each trial is; told: by symbol, value and standard error of each campaign from another source."""

    symbols: tuple[str, ...]
    names: tuple[str, ...]
    number: tuple[int, ...]
    told: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)


Own = Sequence[str] | ByCampaign
"""Constants that each run has for itself, by symbol, or each campaign."""


def prior_with(ship: Ship, own: Own, trials: Sequence[str]) -> Prior:
    """The prior of what is free in ``ship`` and of ``own``: constants of ``trials`` (names), or told of campaigns."""
    if not isinstance(own, ByCampaign):
        return Prior.of(ship, own, trials)
    prior = Prior.of(ship, own.symbols, own.names, own.number)
    mean, std = prior.mean.copy(), prior.std.copy()
    for symbol, rows in own.told.items():  # the product of two normal distributions: precisions add up
        at = prior.shared + len(own.symbols) * np.arange(len(own.names)) + own.symbols.index(symbol)
        value, error = np.array(rows).T  # an infinite error adds nothing
        precision = std[at] ** -2 + error**-2
        mean[at] = (mean[at] * std[at] ** -2 + value * error**-2) / precision
        std[at] = precision**-0.5
    return replace(prior, mean=np.clip(mean, prior.lower, prior.upper), std=std)


def ship_of_all(ship: Ship, own: Own, constants: RunConstants | None) -> Ship:
    """What all runs share of ``ship`` with the constants ``own``: without the effects of runs; with those of campaigns
    at their mean, the estimates of each campaign beside it."""
    if not isinstance(own, ByCampaign):
        for name in _effects(own):
            ship = ship.without_effect(name)
        return ship
    if constants is None:
        return ship
    values = constants.value.tolist()
    rows = {name: dict(zip(own.symbols, row, strict=True)) for name, row in zip(own.names, values, strict=True)}
    return replace(ship, campaigns=rows)


def _effects(symbols: Sequence[str]) -> dict[str, None]:
    """Names of the effects that the constants ``symbols`` belong to, each once, in their order."""
    return dict.fromkeys(s.split(".")[0] for s in symbols)


def neutral_values(ship: Ship, symbols: Sequence[str]) -> np.ndarray:
    """All coefficients of ``ship`` (all,), effects of the constants ``symbols`` neutral, as in captive tests."""
    off = ship
    for name in _effects(symbols):
        off = off.without_effect(name).with_effect(name)  # put in anew, an effect has its neutral values
    return np.array([off.coefficients[s].value for s in ship.symbols])


@dataclass(frozen=True)
class RunConstants:
    """Estimated constants of the runs.

    symbols: of the Q constants; runs: names; units: (Q,); value, std: (R, Q) in those units; prior_value, prior_std:
    (Q,); p: (R Q,) scaled, run by run.
    """

    symbols: tuple[str, ...]
    runs: tuple[str, ...]
    units: tuple[str, ...]
    value: np.ndarray
    std: np.ndarray
    prior_value: np.ndarray
    prior_std: np.ndarray
    p: np.ndarray

    @classmethod
    def of(
        cls, ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, runs: Sequence[str]
    ) -> RunConstants | None:
        """From the scaled estimate (P,) and its covariance (P, P) in prior standard deviations; None without any."""
        if not prior.constants:
            return None
        shape, own = (prior.runs, len(prior.constants)), slice(prior.shared, None)
        mean, unit = prior.mean[own].reshape(shape), prior.std[own].reshape(shape)
        return cls(
            symbols=prior.constants,
            # the second of equal names with "(2)" behind it
            runs=tuple(f"{n} ({k})" if (k := runs[: i + 1].count(n)) > 1 else n for i, n in enumerate(runs)),
            units=tuple(ship.coefficients[s].unit for s in prior.constants),
            value=mean + unit * p[own].reshape(shape),
            std=unit * np.sqrt(np.diag(covariance)[own]).reshape(shape),
            prior_value=np.array([ship.coefficients[s].value for s in prior.constants]),
            prior_std=np.array([ship.coefficients[s].std for s in prior.constants]),
            p=p[own].copy(),
        )

    def rows(self) -> dict[str, dict[str, dict]]:
        """Plain values for ``result.json``: {run: {symbol: {"value", "std", "unit", "prior_value", "prior_std"}}}."""
        keys = ("value", "std", "unit", "prior_value", "prior_std")
        same = (self.units, self.prior_value.tolist(), self.prior_std.tolist())
        return {
            run: {
                symbol: dict(zip(keys, cells, strict=True))
                for symbol, *cells in zip(self.symbols, value, std, *same, strict=True)
            }
            for run, value, std in zip(self.runs, self.value.tolist(), self.std.tolist(), strict=True)
        }
