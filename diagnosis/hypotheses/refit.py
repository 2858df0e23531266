"""Candidates refitted: coefficients, effect, latent force and noise together, compared by the same measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.candidates import Candidate, Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.parameters import Priors, active_states, get_values, priors_of_effects, set_values
from diagnosis.estimation.transition_model import TransitionModel
from mmg.errors import UserError


@dataclass(frozen=True)
class SearchProblem:
    """What all hypotheses share: the transition model of the full ship, data, priors of its coefficients, candidates.

    expected_unnamed: log Bayes factor of unnamed forms that the trials of the calibration show, for as many samples;
    expected_unnamed_null: that without effects that are strong there; tests: trials that no fit sees, or None.
    """

    steps: TransitionModel
    data: GriddedTrials
    base: Priors
    candidates: tuple[Candidate, ...]
    expected_unnamed: float = 0.0
    expected_unnamed_null: float = 0.0
    tests: GriddedTrials | None = None

    @property
    def cost(self) -> float:
        """ln N of the BIC."""
        return float(np.log(self.data.samples))


# Shares of the first values of new effects that a fit is begun from, one after the other while the ship explodes.
SHARES = (1.0, 0.3, 0.0)  # set by hand


def gained(fewer: Estimate, kept: int, more: Estimate, every: int) -> float:
    """Log likelihood that the fit ``more`` gains over ``fewer``, without the priors of their last ``kept`` and
    ``every`` columns, which are of effects."""
    of_effects = [found.p[len(found.p) - own :] for found, own in ((fewer, kept), (more, every))]  # effects come last
    return fewer.nll - more.nll - 0.5 * float(of_effects[0] @ of_effects[0] - of_effects[1] @ of_effects[1])


def refit(
    problem: SearchProblem,
    before: Estimate,
    effects: Sequence[Candidate],
    start: Mapping[Column, float],
    iterations: int = 8,
    is_rough: bool = False,
) -> Estimate:
    """Fit the ``problem`` with these ``effects``, from the fit ``before`` with fewer.

    start: first values of the effects' parameters, and of those coefficients that do not begin where they are;
    iterations: linearisations at most; is_rough: as of ``estimate``. Returns the fit.

    A prior of an effect among those of the problem, as known from other trials, is set aside. Where the ship explodes
    at the first values of new effects, these are moved towards neutral.
    """
    p, more = problem, priors_of_effects(effects)
    free = p.base.only([s not in more.symbols for s in p.base.symbols]) + more
    first = np.array([start.get(c, m) for c, m in zip(more.columns, more.mean, strict=True)])
    new = np.array([c not in before.free.columns for c in more.columns])  # known effects begin where they are
    moved = [c for c in free.columns if c in start and c not in more.columns]
    here, there = get_values(p.steps.ship, p.data, before.theta, moved), np.array([start[c] for c in moved])
    for share in SHARES:
        begin = np.where(new, more.mean + share * (first - more.mean), first)
        begin = np.concatenate([begin, here + share * (there - here)])
        try:
            point = _start(p, free, before, [*more.columns, *moved], begin)
            return estimate(p.steps, p.data, point, iterations, is_rough=is_rough)
        except UserError:
            if share == SHARES[-1]:
                raise
    raise AssertionError("the last share returns or raises")


def _start(
    problem: SearchProblem, free: Priors, before: Estimate, columns: Sequence[Column], first: np.ndarray
) -> Point:
    """Where the fit of ``free`` starts: from the fit ``before``, with first values of these columns."""
    steps, data = problem.steps, problem.data
    theta = set_values(steps.ship, data, before.theta, columns, first)
    p = (get_values(steps.ship, data, theta, free.columns) - free.mean) / free.std
    active = active_states(steps, free.symbols, theta)
    asleep = np.setdiff1d(active, active_states(steps, before.free.symbols, before.theta))
    path = before.path
    if len(asleep):  # states that were not followed before begin along the path
        controls = acting(steps, data, theta).controls
        path = replace(path, z=steps.with_passive_states(path.z, controls, theta, path.push, asleep))
    return Point(theta, free, p, path, before.noise)
