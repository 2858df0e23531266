"""Tails of the usual distributions are those of ``scipy.stats``."""

from __future__ import annotations

import pytest
from scipy import stats

from cases.evidence import tails
from diagnosis.hypotheses import events


@pytest.mark.parametrize("value", [-1.0, 0.0, 0.3, 4.0, 60.0])
def test_they_are_those_of_scipy(value: float) -> None:
    assert tails.normal_tail(value) == pytest.approx(stats.norm.sf(value), rel=1e-12)
    assert tails.chi2_tail(value, 3) == pytest.approx(stats.chi2.sf(value, 3), rel=1e-12)
    assert tails.f_tail(value, 3, 17) == pytest.approx(stats.f.sf(value, 3, 17), rel=1e-9)
    assert tails.gamma_tail(value, 1.7, 2.0) == pytest.approx(stats.gamma.sf(value, 1.7, scale=2.0), rel=1e-12)


@pytest.mark.parametrize("probability", [1e-300, 0.01, 0.5, 0.9])
def test_quantiles_turn_them_round(probability: float) -> None:
    assert tails.normal_quantile(probability) == pytest.approx(stats.norm.isf(probability), rel=1e-12)
    assert tails.student_quantile(probability, 5) == pytest.approx(stats.t.ppf(probability, 5), rel=1e-9)


def test_the_median_is_that_of_chi_squared() -> None:
    assert pytest.approx(stats.chi2.median(1), rel=1e-12) == events.MEDIAN
