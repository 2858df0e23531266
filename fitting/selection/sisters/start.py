"""A sister calibrated with the prior that her group says: mean and width in her ship file, the mean's error beside it.

The prior N(mean, width^2) at the mean of all sisters, herself among them, has its optimum where that of the whole
hierarchy is. Its covariance takes the mean as known; what that is uncertain by is added (Kass & Steffey 1989).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.calibration import Calibration
from fitting.selection.sisters.widths import SisterWidths
from mmg.ship import Ship


@dataclass(frozen=True)
class UncertainMean:
    """Covariance (P, P) of the mean of a prior, in the units of the coefficients ``symbols`` (P,)."""

    symbols: tuple[str, ...]
    covariance: np.ndarray


def sister_start(start: Ship, widths: SisterWidths, names: Sequence[str]) -> Ship:
    """The ship ``start`` with the prior of her sisters, whose ``names`` are said as its source.

    widths: of the group.
    """
    mean = widths.centre + widths.unit * widths.mean
    std = widths.unit * widths.used_width
    words = f"mean of the sisters {', '.join(names)}; std: how much they differ"
    rows = dict(start.coefficients)
    for symbol, value, width in zip(widths.symbols, mean.tolist(), std.tolist(), strict=True):
        c = rows[symbol]
        rows[symbol] = c.with_(value=float(np.clip(value, c.lower, c.upper)), std=width, source=words)
    return replace(start, coefficients=rows)


def with_whole_prior(ship: Ship, mean: UncertainMean) -> Ship:
    """A calibrated ``ship`` whose priors are as wide as sisters differ and their ``mean`` is uncertain: what a refit
    may use that does not know of the other sisters."""
    rows = dict(ship.coefficients)
    for symbol, variance in zip(mean.symbols, np.diag(mean.covariance).tolist(), strict=True):
        c = rows[symbol]
        if c.prior_std is not None:
            rows[symbol] = c.with_(prior_std=float(np.hypot(c.prior_std, np.sqrt(variance))))
    return replace(ship, coefficients=rows)


def mean_of(widths: SisterWidths) -> UncertainMean:
    """How uncertain the mean of the ``widths`` is."""
    return UncertainMean(widths.symbols, widths.unit[:, None] * widths.mean_covariance * widths.unit)


def estimates_of(widths: SisterWidths, number: int) -> Mapping[str, float]:
    """Symbol -> most likely value of the sister of this ``number`` in the ``widths``, from which her fit begins."""
    values = widths.centre + widths.unit * widths.estimate[number]
    return dict(zip(widths.symbols, values.tolist(), strict=True))


def with_uncertain_mean(found: Calibration, mean: UncertainMean | None) -> Calibration:
    """The calibration ``found`` with a covariance that holds the error of its prior's ``mean`` too, as it is for None.

    An error e of the mean moves the estimate by V P e, V the covariance by information and prior P alone.
    """
    if mean is None or not np.isfinite(found.covariance).all():
        return found
    at = [found.prior.symbols.index(s) for s in mean.symbols]
    unit, shared = found.prior.std[at], slice(len(found.p))
    pull = found.spread.model[shared, shared][:, at]
    return found.with_estimate(found.p, pull @ (mean.covariance / np.outer(unit, unit)) @ pull.T)
