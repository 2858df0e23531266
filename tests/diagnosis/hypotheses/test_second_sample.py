"""What two samples say together keeps its level, and gains by what the second one shows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, norm

from diagnosis.hypotheses.forward_selection import RefittedEffect
from diagnosis.hypotheses.found_again import NOTHING, FoundAgain, both_by_weight
from tests.support.diagnosis_cases import candidate


def test_both_together_are_uniform_by_chance() -> None:
    rng = np.random.default_rng(0)
    p, z = rng.uniform(size=2000), rng.standard_normal(2000)
    weighted = [both_by_weight(a, 3.0, FoundAgain(b, 1.7)) for a, b in zip(p, z, strict=True)]
    assert kstest(weighted, "uniform").pvalue > 0.01


def test_trials_that_do_not_show_it_change_nothing() -> None:
    assert both_by_weight(0.02, 5.0, NOTHING) == 0.02
    assert both_by_weight(0.02, 5.0, FoundAgain(-3.0, 1e-6)) == pytest.approx(0.02, rel=1e-3)


def test_a_weak_effect_that_is_found_again_is_more_than_chance_and_one_that_is_not_is_less() -> None:
    there, gone = FoundAgain(2.5, 2.5), FoundAgain(-0.5, 2.5)
    assert both_by_weight(0.2, 4.0, there) < 0.02 < 0.2 < both_by_weight(0.2, 4.0, gone)
    equal = both_by_weight(float(norm.sf(2.0)), 2.0, FoundAgain(2.0, 2.0))
    assert equal == pytest.approx(norm.sf(2 * np.sqrt(2.0)))


def test_the_gain_of_other_trials_is_largest_at_the_size_that_they_show() -> None:
    assert FoundAgain(2.0, 2.0).gain == pytest.approx(2.0) and FoundAgain(2.0, 4.0).gain == pytest.approx(0.0)
    assert FoundAgain(-1.0, 2.0).gain < 0 and NOTHING.gain == 0


def test_less_is_expected_of_a_response_that_is_less_than_linear_where_it_was_found() -> None:
    assert FoundAgain(3.0, 10.0).scaled(FoundAgain(2.0, 8.0)) == FoundAgain(3.0, 2.5)
    assert FoundAgain(3.0, 10.0).scaled(FoundAgain(-0.1, 8.0)) == NOTHING == FoundAgain(3.0, 10.0).scaled(NOTHING)


def test_probabilities_of_nought_and_one_are_borne() -> None:
    for again in (NOTHING, FoundAgain(40.0, 3.0), FoundAgain(-40.0, 3.0)):
        for p in (0.0, 1.0):
            assert 0 <= both_by_weight(p, 2.0, again) <= 1


def test_only_a_size_that_other_trials_would_show_is_denied_by_them() -> None:
    assert FoundAgain(-2.0, 1.8).denies(6.0)
    assert not FoundAgain(-0.5, 1.8).denies(6.0)  # would hardly show
    assert not FoundAgain(2.0, 9.0).denies(6.0)  # of another size, but there
    assert not NOTHING.denies(6.0)
    rng = np.random.default_rng(1)
    size, first = 4.0, rng.normal(4.0, 1.0, 4000)  # found with an error of a quarter, in as many other trials
    denied = [FoundAgain(z, f).denies(0.5 * f**2) for f, z in zip(first, rng.normal(size, 1.0, 4000), strict=True)]
    assert np.mean(denied) <= 0.005


def refitted(p_value: float, gain: float, again: FoundAgain) -> RefittedEffect:
    """A candidate with these probability, gain and test trials; its fit takes no part."""
    return RefittedEffect(candidate("current"), None, gain, 1.0, p_value, again)  # type: ignore[arg-type]


def test_test_trials_speak_against_a_weak_effect_and_may_only_help_a_sure_one() -> None:
    gone = FoundAgain(-1.0, 3.0)
    assert refitted(0.02, 5.0, gone).p_both > 0.03 and refitted(1e-6, 15.0, gone).p_both == 1e-6
    there = FoundAgain(3.0, 3.0)
    assert refitted(0.02, 5.0, there).p_both < 0.001
    promised = FoundAgain(-1.0, 10.0)  # three times what the trials show: no linear response
    assert refitted(0.02, 5.0, promised).p_both == 0.02 and refitted(0.02, 5.0, promised).by_others == NOTHING
