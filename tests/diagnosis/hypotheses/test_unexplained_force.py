"""The unexplained force: it is the one that acted, in its channel, with its size and what it follows."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.next_test import telling_test
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.unexplained_force import ForceEstimate, estimated_force, unexplained_force
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.report.words import unexplained_hint
from tests.support.diagnosis_cases import SHIP, pushed_by, pushed_problem

SIZE = 0.6
"""Of a sway force SIZE cos(psi) [N] that no model has."""


@pytest.fixture(scope="module")
def runs() -> SearchProblem:
    return pushed_problem(1)[0]


@pytest.fixture(scope="module")
def pushed(runs: SearchProblem) -> tuple:
    steps, seen, null = pushed_by(runs, 1, 1, "cos", SIZE)
    unnamed = unnamed_forms(steps, seen, null)
    return seen, null, unnamed, estimated_force(unnamed)


def test_the_force_is_that_which_acted(pushed: tuple) -> None:
    data, null, unnamed, found = pushed
    row = unexplained_force(data, null, unnamed.evidence, found, SHIP)
    true = SIZE * np.cos(null.path.z[:-1, :, 2])[data.inside]
    mine = row.force[data.inside][:, 1]
    assert unnamed.evidence > ODDS
    assert np.corrcoef(mine, true)[0, 1] > 0.85
    assert row.channels["sway"].share > 0.9
    low, high = row.channels["sway"].interval_90
    assert low < np.sqrt((true**2).mean()) < 1.3 * high
    inside = np.abs(mine - true) < 1.64 * row.std[data.inside][:, 1]
    assert inside.mean() > 0.5  # the coefficients took a part of it
    # along the track of each channel's own trial
    assert {t.trial for t in row.times} <= set(data.trials) and row.times[0].channel == "sway"


def test_nothing_is_estimated_where_nothing_acts(runs: SearchProblem) -> None:
    steps, seen, null = pushed_by(runs, 4, 1, "cos", 0.0)
    found = estimated_force(unnamed_forms(steps, seen, null))
    row = unexplained_force(seen, null, 1.0, found, SHIP)
    assert max(channel.force_rms for channel in row.channels.values()) < 0.1
    nothing = ForceEstimate(0 * found.mean, 0 * found.covariance, found.dictionary, 0 * found.sizes, found.taken)
    none = unexplained_force(seen, null, 1.0, nothing, SHIP)
    assert none.times == () and none.follows == () and none.channels["sway"].interval_90 == (0.0, 0.0)
    assert unexplained_hint(none) == ""


@pytest.mark.slow
def test_a_manoeuvre_is_named_in_which_it_shows(pushed: tuple, runs: SearchProblem) -> None:
    _, null, _, found = pushed
    assert "--maneuver" in telling_test(runs, null, found, SHIP)
    nothing = ForceEstimate(0 * found.mean, found.covariance, found.dictionary, 0 * found.sizes, found.taken)
    assert "--maneuver" not in telling_test(runs, null, nothing, SHIP)
