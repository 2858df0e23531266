"""Naming: other forms of faults of instruments, where one column alone is wrong, and what looks alike."""

from __future__ import annotations

from functools import cache

import pytest

from diagnosis import summary
from diagnosis.estimation.candidates import Candidate
from diagnosis.hypotheses.forward_selection import ODDS, Selection, select_effects
from diagnosis.hypotheses.next_test import next_test
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unnamed import unnamed_forms
from tests.support.diagnosis_cases import FEW, candidate, full_model, pushed_problem
from tests.support.quick import first_quick

FORMS = {
    "heading_bias alone": {"alone": 0.05},
    "antenna_offset alone": {"alone_x": 0.4, "alone_y": -0.3},
    "gnss_delay alone": {"alone": 1.0},
    "gnss_delay finished": {"finished": 1.2},
}


def candidate_of(form: str) -> Candidate:
    """The candidate of a label."""
    return next(c for c in full_model().candidates if c.label == form)


def spec(form: str) -> str:
    return f"{candidate_of(form).effect}:" + ",".join(f"{k}={v}" for k, v in FORMS[form].items())


@cache
def searched(form: str) -> tuple[SearchProblem, Selection]:
    """Trials with a fault of this form as a problem, and what is found."""
    problem, null = pushed_problem(4, spec(form))
    return problem, select_effects(problem, null)


@pytest.mark.slow
@pytest.mark.parametrize("form", first_quick(FORMS))
def test_it_is_named_with_its_own_parameters(form: str) -> None:
    (problem, found), c = searched(form), candidate_of(form)
    assert found.effects == (c,)
    row = summary.named_effect(full_model(), found, c)
    assert row.name == c.effect and set(row.parameters) == set(FORMS[form])
    for k, size in FORMS[form].items():
        got = row.parameters[k]
        assert abs(got.value - size) < 3.5 * got.std + 0.06 * abs(size)
    assert unnamed_forms(problem.steps, problem.data, found.final).mixture < 3.0
    after = summary.fitted_ship(problem.steps.ship, full_model(), found.final, found.effects)
    assert after.coefficients[f"{c.effect}.{next(iter(FORMS[form]))}"].value != 0.0


@pytest.mark.slow
def test_the_ranking_has_each_effect_once() -> None:
    ranked = summary.ranking(full_model(), searched("heading_bias alone")[1].searches[0])
    assert set(ranked[0].visible_from) == {"psi", "alone"} and ranked[0].visible_from["alone"] < 0.05
    rows = [row.name for row in ranked]
    assert len(rows) == len(set(rows)) and rows[0] == "heading_bias"
    assert set(rows) == {c.effect for c in full_model().candidates}


@pytest.mark.slow
def test_what_to_test_next_is_asked_of_the_form_and_told_of_the_effect() -> None:
    problem, found = searched("heading_bias alone")
    form = found.effects[0]
    ship = summary.fitted_ship(FEW, full_model(), found.final, found.effects)
    words = next_test(problem, summary.fit_with(found, form), [form], ship)
    assert "heading_bias" in words
    percent = float(words.split("measure it to ")[1].split(" %")[0])
    assert 0 < percent < 5  # 0.05 rad of a compass that is good to 0.0015


@pytest.mark.slow
@pytest.mark.parametrize("truth", first_quick(["rudder_lag:T=0.4", "control_delay:tau=0.4"]))
def test_what_looks_alike_is_in_one_class(truth: str) -> None:
    """A rudder behind its record and a delay of both actuators, here hardly to be told apart."""
    problem, null = pushed_problem(2, truth, runs=(("zigzag:20/20", 60.0), ("turning:-20", 60.0)))
    s = select_effects(problem, null).searches[0]
    assert s.best and s.best.evidence > ODDS
    assert {"rudder_lag", "control_delay"} <= {c.label for c in s.indistinguishable}
    assert s.indistinguishable[0] == s.refitted[0].candidate and candidate("current") not in s.indistinguishable
