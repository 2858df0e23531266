"""The last word on what a search found: whether it is named, by chance, by what is left, and by test trials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.parameters import Priors
from diagnosis.findings import HeldOut
from diagnosis.hypotheses.forward_selection import AGREE, Search, Selection
from diagnosis.hypotheses.found_again import CERTAIN, NOTHING, FoundAgain
from diagnosis.judgement.judged_search import (
    CONFIRMING_REDUCTION,
    LARGE_GROWTH,
    NOTED_GROWTH,
    SMALL_GROWTH,
    STRICT_RATIO,
    UNEXPLAINED_RATIO,
    decide,
)
from mmg.messages import has_code
from tests.support.diagnosis_answers import LIMIT, a_fit, found_with, held, made_up, tried


def test_nothing_named_is_none_or_unknown_by_the_dictionary() -> None:
    nothing = found_with(0.0)
    assert decide(nothing, -0.01, -1.0, LIMIT, None) == ("none", [])
    assert decide(nothing, 0.01, -1.0, LIMIT, None) == ("unknown", [])
    assert decide(nothing, -0.01, -1.0, LIMIT, held(0.0, (0.0, 0.0))) == ("none", [])


@pytest.mark.parametrize(
    ("p_value", "beyond", "verdict"), [(2, -0.1, "none"), (0.5, -0.1, "unknown"), (2, 0.1, "unknown")]
)
def test_a_name_withdrawn_that_may_be_chance_leaves_nothing(p_value: float, beyond: float, verdict: str) -> None:
    first = Search((), (tried("bank", 3.0, p_value * CERTAIN),), a_fit(100.0))
    found = replace(found_with(12.0, "bank", p=1.1 * AGREE), searches=(first,))
    assert decide(found, beyond, -1.0, LIMIT, None)[0] == verdict


@pytest.mark.parametrize(
    "test",
    [
        None,
        held(0.3, (0.1, 0.4), 20.0, (5.0, 30.0)),
        held(0.0, (-0.1, 0.1), 1.0, (-2.0, 4.0)),
        held(-0.9 * SMALL_GROWTH, (-0.1, 0.05), -1.0, (-4.0, 1.0)),  # a little worse in both, well within chance
        held(
            -0.9 * LARGE_GROWTH, (-0.2, -0.05), 12.0, (3.0, 20.0)
        ),  # longer predictions worse, one-step ones surely better
    ],
)
def test_a_name_stands_where_nothing_speaks_against_it(test: HeldOut | None) -> None:
    assert decide(found_with(12.0, "current"), 9.0, -1.0, LIMIT, test) == ("named", [])


@pytest.mark.parametrize(
    ("test", "verdict"),
    [
        (None, "unknown"),
        (held(2 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0)), "named"),
        (held(0.9 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0)), "unknown"),
        (held(2 * CONFIRMING_REDUCTION, (-0.01, 0.2), 3.0, (1.0, 5.0)), "unknown"),
    ],
)
def test_a_name_that_explains_less_than_is_left_needs_support_by_test_trials(
    test: HeldOut | None, verdict: str
) -> None:
    found, reasons = decide(found_with(6.0, "draft", "tow"), 9.0, 6.1, LIMIT, test)
    assert found == verdict and bool(reasons) == (verdict == "unknown")
    if reasons:
        assert "withdrawn" in reasons[0]
    less = decide(found_with(6.0, "draft", "tow"), 9.0, 5.9, LIMIT, test)[0]
    assert less == ("named" if test is None else verdict)  # test trials that are there must support it
    assert (
        decide(found_with(6.0 / UNEXPLAINED_RATIO, "draft", "tow"), 9.0, 5.9, LIMIT, test)[0] == "named"
    )  # a remainder, no more
    assert decide(found_with(0.5, "draft"), 9.0, LIMIT - 0.01, LIMIT, test)[0] == "named"


@pytest.mark.parametrize(("value", "verdict"), [(4.9, "named"), (5.0, "unknown")])
def test_a_name_that_needs_the_end_of_what_is_possible_is_withdrawn(value: float, verdict: str) -> None:
    free = Priors(
        (Column("X_0F"), Column("fouling.share")), np.zeros(2), np.ones(2), np.array([0.0, -0.6]), np.array([9.0, 5.0])
    )
    final = replace(a_fit(80.0), free=free, p=np.array([0.0, value]))  # a coefficient of the ship's own may be there
    found = Selection((made_up("fouling"),), a_fit(100.0), final, (), {made_up("fouling"): 1e-4})
    got, reasons = decide(found, 9.0, -1.0, LIMIT, None)
    assert got == verdict and bool(reasons) == (verdict == "unknown")
    assert not reasons or (has_code(reasons, "name_withdrawn") and "fouling.share = 5 " in reasons[0])
    assert decide(found, 9.0, -1.0, LIMIT, held(0.3, (0.1, 0.4), 20.0, (5.0, 30.0)))[0] == "named"


def test_where_longer_predictions_become_worse_less_may_be_left_without_a_name() -> None:
    for reduction, share in (
        (-0.9 * SMALL_GROWTH, UNEXPLAINED_RATIO),
        (-1.1 * SMALL_GROWTH, STRICT_RATIO),
    ):
        test = held(reduction, (-0.2, 0.1), 20.0, (5.0, 30.0))
        for left, verdict in ((0.9, "named"), (1.1, "unknown")):
            assert decide(found_with(100.0, "rudder_lag"), 99.0, left * share * 100.0, LIMIT, test)[0] == verdict


def test_where_test_trials_show_no_gain_at_all_nothing_may_be_left_without_a_name() -> None:
    """Real records without their wind: a memory of the hull fitted them, and the test trials were no better with it."""
    for test, verdict in (
        (held(0.06, (-0.06, 0.14), 2.0, (-3.0, 7.0)), "unknown"),
        (held(0.06, (-0.06, 0.14), 9.0, (2.0, 16.0)), "named"),
        (held(0.06, (0.01, 0.14), 2.0, (-3.0, 7.0)), "named"),
        (None, "named"),
    ):
        assert decide(found_with(100.0, "hull_memory"), 99.0, 1.1 * LIMIT, LIMIT, test)[0] == verdict
        assert decide(found_with(100.0, "hull_memory"), 99.0, 0.9 * LIMIT, LIMIT, test)[0] == "named"


def test_a_name_on_which_the_runs_do_not_agree_is_withdrawn() -> None:
    verdict, reasons = decide(found_with(12.0, "bank", p=1.1 * AGREE), 9.0, -1.0, LIMIT, None)
    assert verdict == "unknown" and has_code(reasons, "name_withdrawn")
    assert f"bank (p = {1.1 * AGREE:.2g})" in reasons[0] and len(reasons) == 1
    assert decide(found_with(12.0, "bank", p=0.9 * AGREE), 9.0, -1.0, LIMIT, None)[0] == "named"
    support = held(2 * CONFIRMING_REDUCTION, (0.01, 0.2), 3.0, (1.0, 5.0))
    assert decide(found_with(12.0, "bank", p=1.1 * AGREE), 9.0, -1.0, LIMIT, support)[0] == "named"


@pytest.mark.parametrize(
    "test",
    [
        held(
            -1.1 * LARGE_GROWTH, (-0.3, -0.01), 12.0, (3.0, 20.0)
        ),  # clearly worse over 30 s, whatever the single steps do
        held(-0.5 * LARGE_GROWTH, (-0.2, -0.01), 12.0, (-3.0, 20.0)),  # worse, and single steps not surely better
        held(-0.5 * LARGE_GROWTH, (-0.2, -0.01), None, None),
        held(-1.1 * NOTED_GROWTH, (-0.2, 0.1), 3.0, (-3.0, 8.0)),  # worse by more than a little, and no gain elsewhere
        held(-1.1 * SMALL_GROWTH, (-0.2, 0.1), -0.1, (-3.0, 2.0)),  # a little worse in both
        held(0.01, (-0.1, 0.1), -3.1, (-6.0, -1.0)),  # single steps worse, no gain over 30 s
    ],
)
def test_a_name_that_test_trials_contradict_is_withdrawn(test: HeldOut) -> None:
    verdict, reasons = decide(found_with(12.0, "fouling"), 9.0, -1.0, LIMIT, test)
    assert verdict == "unknown" and len(reasons) == 1


@pytest.mark.parametrize(
    ("test", "verdict"),
    [
        (held(-1.1 * SMALL_GROWTH, (-0.2, 0.1), -0.1, (-3.0, 2.0)), "named"),  # a little worse in both, by chance
        (held(0.01, (-0.1, 0.1), -3.1, (-6.0, 1.0)), "named"),
        (held(0.01, (-0.1, 0.1), -3.1, (-6.0, -1.0)), "unknown"),  # single steps surely worse
        (held(-1.1 * NOTED_GROWTH, (-0.2, -0.01), 3.0, (-3.0, 8.0)), "unknown"),  # windows surely worse
        (held(0.01, (-0.1, 0.1), -3.1, None), "unknown"),  # what chance does cannot be told
    ],
)
def test_a_name_that_no_chance_explains_must_surely_be_contradicted(test: HeldOut, verdict: str) -> None:
    sure, unsure = (Search((), (tried("fouling", 3.0, f * CERTAIN),), a_fit(100.0)) for f in (0.5, 2.0))
    name = found_with(12.0, "fouling")
    assert decide(replace(name, searches=(sure,)), 9.0, -1.0, LIMIT, test)[0] == verdict
    assert decide(replace(name, searches=(unsure,)), 9.0, -1.0, LIMIT, test)[0] == "unknown"
    two = replace(found_with(12.0, "bank", "fouling"), searches=(unsure, sure))
    assert decide(two, 9.0, -1.0, LIMIT, test)[0] == "unknown"


@pytest.mark.parametrize(
    ("again", "gain", "verdict"),
    [
        (FoundAgain(0.7, 2.4), -9.0, "named"),
        (FoundAgain(-0.5, 6.0), -9.0, "unknown"),
        (NOTHING, -9.0, "unknown"),
        (FoundAgain(0.7, 2.4), -350.0, "unknown"),  # more than was gained by it
    ],
)
def test_test_trials_contradict_a_certain_name_where_they_exclude_it_or_cannot_be_asked(
    again: FoundAgain, gain: float, verdict: str
) -> None:
    """Windows and steps hang on all coefficients as they were estimated, and so do their errors on the errors of
    these."""
    test = held(-1.1 * NOTED_GROWTH, (-0.2, -0.01), gain, (1.5 * gain, 0.5 * gain))
    best = replace(tried("fouling", 43.0, 1e-11), again=again)
    found = replace(found_with(12.0, "fouling"), searches=(Search((), (best,), a_fit(100.0)),))
    assert decide(found, 9.0, -1.0, LIMIT, test)[0] == verdict


@pytest.mark.parametrize(
    ("name", "gain", "sure", "verdict"),
    [
        ("gnss_delay", 40.0, (20.0, 60.0), "named"),
        ("gnss_delay", 40.0, (-3.0, 60.0), "named"),
        ("gnss_delay", -4.0, (-9.0, 1.0), "unknown"),
        ("fouling", 40.0, (20.0, 60.0), "unknown"),
    ],
)
def test_windows_that_begin_at_a_late_row_do_not_speak_against_a_late_sensor(
    name: str, gain: float, sure: tuple[float, float], verdict: str
) -> None:
    """A window begins at a logged row, which is itself late: its error grows, though the delay is right. Single steps
    alone tell, as far as they do."""
    test = held(-0.41, (-0.6, -0.2), gain, sure)
    assert decide(found_with(108.0, name), 99.0, -1.0, LIMIT, test)[0] == verdict


@pytest.mark.parametrize(("name", "verdict"), [("heading_bias", "unknown"), ("fouling", "named")])
def test_nor_do_they_speak_for_a_fault_of_an_instrument_that_single_steps_contradict(name: str, verdict: str) -> None:
    """Two runs, one of them for training: a compass was said to be off; windows gained 0.6 %, single steps -40."""
    test = held(0.006, (0.001, 0.01), -40.0, None)
    assert decide(found_with(12.0, name), 9.0, -1.0, LIMIT, test)[0] == verdict
