"""The mean of two estimates of the same coefficients from the same trials.

Multiple shooting predicts windows open loop, so that it is right over a manoeuvre, but takes what pushed the ship for a
part of her; a filter predicts the next sample from the past, with random forces between, so that it is hardly misled
by gusts, but sees the error of a second, not of a minute. Where the model is not quite the ship, both are off in their
own way, and their mean is off less (a composite likelihood, Varin, Reid and Firth 2011, in equal parts). On the 35
records of Train-TZRB+, left out in five folds, it predicts every kind of manoeuvre better than multiple shooting alone
("windows alone" in ``benchmarks/ablation.md``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from fitting.calibration import Calibration
from mmg.effects import EFFECTS
from mmg.messages import Message
from mmg.ship import Ship

Second = Callable[[Ship, Sequence[Trial]], "Mapping[str, float] | str"]
"""Another estimator: of a ship on trials, values of free coefficients by symbol, or why there are none."""
SHARE = 0.5
"""Share [-] of the second estimate: the plain mean of both."""


def answers(second: Second | None, ship: Ship) -> bool:
    """Whether a ``second`` estimator is there and knows ``ship``: nothing is free but coefficients and faults of
    instruments."""
    own = {s.partition(".")[0] for s in ship.free if "." in s}
    return second is not None and all(name in EFFECTS and EFFECTS[name].measures for name in own)


def with_second(found: Calibration, second: Mapping[str, float] | str) -> Calibration:
    """The calibration ``found`` with the means of its estimates and those of a ``second`` estimator. Its covariance has
    the square of half their difference added: so far each may be off by its own way of seeing what the model lacks. As
    it is, with a notice, where ``second`` says why it has none."""
    if isinstance(second, str):
        return _noted(found, f"the estimate is that of multiple shooting alone: {second}")
    if not np.isfinite(found.covariance).all():
        return found
    prior = found.prior
    other = np.array([second.get(s, np.nan) for s in prior.symbols])
    apart = np.nan_to_num((other - prior.mean) / prior.std - found.p)
    p = np.clip(found.p + SHARE * apart, *prior.scaled_bounds)
    ratio = apart / np.sqrt(np.diag(found.covariance))
    farthest = ", ".join(f"{prior.symbols[i]} ({ratio[i]:+.1f})" for i in np.argsort(-np.abs(ratio))[:3])
    words = "coefficients are the mean of two estimates, by multiple shooting and by a Kalman filter, which differ most"
    words += f" in {farthest} standard errors of the former; half of that is part of the errors given"
    return _noted(found.with_estimate(p, SHARE**2 * np.outer(apart, apart)), words)


def _noted(found: Calibration, words: str) -> Calibration:
    """The notice comes first, so that those of a run that goes on have the same order."""
    return replace(found, notices=(Message(words, "two_estimates"), *found.notices))
