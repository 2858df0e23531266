"""A current that differs from run to run, as a tide turns within hours, found in the trials and taken out of them.

It moves the ship and not her dynamics: seen from the water of her run she is in still water (Galileo), so that what is
asked of her afterwards is asked of trials through the water. Coefficients, and effects such as an antenna or a hull
with a memory, would else make up for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.trial import Trial
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate, estimate, initial_point
from diagnosis.estimation.parameters import priors_of_effects
from diagnosis.hypotheses.forward_selection import ODDS, RefittedEffect, refit_task
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.hypotheses.unnamed import unnamed_forms

# What turns within hours, so that runs of one day may differ; and from how many runs this is asked. Set by hand.
TURNS, RUNS, BY_RUN = "current", 3, "by run"
FITS = 6  # Linearisations for the current of a run that took no part, all else being known. Set by hand.


def by_run(candidate: Candidate, runs: Iterable[int]) -> Candidate:
    """The ``candidate`` with parameters of its own in each of these ``runs``."""
    return replace(candidate.in_each(runs), form=BY_RUN)


def by_run_among(candidates: Sequence[Candidate], data: GriddedTrials) -> list[Candidate]:
    """What turns, of the ``candidates``, with parameters of its own in each run of ``data``; none of few runs."""
    runs = np.unique(data.run).tolist()
    return [by_run(c, runs) for c in candidates if c.effect == TURNS and not c.form and len(runs) >= RUNS]


@dataclass(frozen=True)
class OwnCurrents:
    """Currents [m/s to north and east] of training and test trials, by number of the trial; found: the refit that has
    them."""

    training: dict[int, tuple[float, float]]
    tests: dict[int, tuple[float, float]]
    found: RefittedEffect

    @property
    def speeds(self) -> tuple[float, float]:
        """The least and the largest of all [m/s]."""
        sizes = [float(np.hypot(*c)) for c in (*self.training.values(), *self.tests.values())]
        return min(sizes), max(sizes)


def taken_out(trials: Sequence[Trial], currents: dict[int, tuple[float, float]]) -> list[Trial]:
    """The ``trials`` through the water, by the ``currents`` of their numbers; one without such a current stays."""
    return [t.through_water(*currents[k]) if k in currents else t for k, t in enumerate(trials)]


def own_currents(problem: SearchProblem, null: Estimate) -> OwnCurrents | None:
    """Currents by run, where they are likelier by ODDS than none and, to first order, than one current, and have more
    evidence than a free force beside them; None else, and where the ship cannot be followed along the test trials.

    problem: whose candidates include the current; null: its fit without effects.
    """
    p = problem
    each = by_run_among(p.candidates, p.data)
    same = [c for c in p.candidates if c.effect == TURNS and not c.form]
    if not each:
        return None
    tests = score_tests(slopes(p.steps, p.data, null, [*same, *each]), [*same, *each])
    evidence = {t.candidate: 0.5 * (t.T - t.degrees * p.cost) for t in tests}  # to first order
    if evidence[each[0]] <= ODDS + max(0.0, *(evidence[c] for c in same)):
        return None
    score = next(t for t in tests if t.candidate == each[0])
    found = refit_task((replace(p, tests=None), null, (), score, len(tests)))
    left = unnamed_forms(p.steps, p.data, found.fit).evidence - p.expected_unnamed
    if found.evidence <= ODDS or left > found.evidence:
        return None
    training = _values(each[0], found.fit)
    if p.tests is None:
        return OwnCurrents(training, {}, found)
    # the ship as she was found, and each test trial's own current
    others = by_run(same[0], np.unique(p.tests.run).tolist())
    theta = found.fit.theta[:, 0].copy()
    theta[[p.steps.ship.symbols.index(s) for s in same[0].symbols]] = same[0].neutral
    start = initial_point(p.steps, p.tests, theta, priors_of_effects([others]), found.fit.noise)
    try:
        fit = estimate(p.steps, p.tests, start, FITS, fixed_noise=True)
    except BrokenModelError:  # she cannot be followed along them: the diagnosis goes on over ground
        return None
    return OwnCurrents(training, _values(others, fit), found)


def _values(candidate: Candidate, fit: Estimate) -> dict[int, tuple[float, float]]:
    """Parameters of a ``candidate`` that differs by run in a ``fit``, by run."""
    pairs = zip(candidate.columns[::2], candidate.columns[1::2], strict=True)
    return {int(a.run or 0): (fit.value(*a), fit.value(*b)) for a, b in pairs}
