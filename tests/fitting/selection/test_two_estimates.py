"""The mean of two estimates: halfway between them, less sure by half their difference, and when it is not asked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from fitting.calibrate import FitOptions, calibrate
from fitting.calibration import Calibration, SecondEstimate, averages, with_second
from fitting.identifiability.analysis import verdict
from fitting.result import FitResult
from fitting.settings import Settings
from fitting.solvers.control import Control
from fitting.solvers.reduced import ReducedProblem
from mmg.errors import UserError
from mmg.ship import Ship
from tests.support.calibrated import small_result
from tests.support.synthetic_runs import coarse_runs


def calibration() -> Calibration:
    """A calibration of six coefficients."""
    objects = small_result().objects
    assert objects is not None
    return objects.calibration


def test_estimates_meet_halfway_and_half_their_difference_is_uncertain() -> None:
    found = calibration()
    prior, first = found.prior, found.ship.values[[found.ship.symbols.index(s) for s in found.prior.symbols]]
    other = dict(zip(prior.symbols, (first + 0.3 * prior.std).tolist(), strict=True))
    del other["N_r"]  # of which the second estimator says nothing
    mean = with_second(found, other)
    moved = np.array([0.15 if s != "N_r" else 0.0 for s in prior.symbols])
    np.testing.assert_allclose(mean.p - found.p, moved, atol=1e-9)
    for s, m in zip(prior.symbols, moved * prior.std, strict=True):
        before, after = found.ship.coefficients[s], mean.ship.coefficients[s]
        assert after.value == pytest.approx(before.value + m)
        assert after.std == pytest.approx(np.hypot(before.std, m), rel=1e-6)
    np.testing.assert_allclose(mean.covariance, found.covariance + np.outer(moved, moved), atol=1e-9)
    far = with_second(found, dict(zip(prior.symbols, prior.upper + 50 * prior.std, strict=True)))
    assert all(far.ship.coefficients[s].value <= c + 1e-12 for s, c in zip(prior.symbols, prior.upper, strict=True))
    shared = slice(len(prior.symbols))
    np.testing.assert_array_equal(mean.spread.covariance[shared, shared], mean.covariance)
    assert sum(m.code == "two_estimates" for m in mean.notices) == 1


def assert_said_of_what_is_shown(result: FitResult) -> None:
    """Findings, verdicts, bounds and warnings of a ``result`` are those of its rows."""
    rows, said = result.estimates, result.identifiability["coefficients"]
    shift = {s: (c.value - c.prior_value) / c.prior_std for s, c in rows.items()}
    assert result.calibration is not None
    for finding in result.calibration.identifiability.findings:
        row = rows[finding.symbol]
        assert finding.shift == pytest.approx(shift[finding.symbol], abs=1e-9)
        assert finding.share == pytest.approx((row.std / row.prior_std) ** 2)
        assert said[finding.symbol]["prior_share"] == pytest.approx(row.prior_share)
        ends = {"lower": row.lower, "upper": row.upper}
        assert (row.at_bound or "") == next((name for name, end in ends.items() if row.value == end), "")
        assert row.verdict == result.ship.coefficients[finding.symbol].verdict == verdict(finding)
    named = {m.code: m for m in result.warnings}
    far = {s for s in rows if abs(shift[s]) > 3}
    assert {s for s in rows if s in named.get("far_from_prior", "")} == far
    assert {s for s in rows if s in named.get("at_bound", "")} == {s for s, c in rows.items() if c.at_bound}


@pytest.mark.slow
def test_what_a_fit_says_it_says_of_the_mean() -> None:
    """Also where the second estimate lies nine prior standard deviations from the prior, in all coefficients."""
    ship, train = small_result().start, coarse_runs()[0][:1]

    def second(ship: Ship, trials: Sequence[Trial], *_: bool) -> SecondEstimate:
        return SecondEstimate({s: ship.coefficients[s].value + 9 * ship.coefficients[s].std for s in ship.free})

    settings = Settings(passes=2, compiled=False)
    result = calibrate(ship, train, (), settings, FitOptions(next_trial=False, instruments=(), second=second))
    assert_said_of_what_is_shown(result)
    assert {"far_from_prior", "at_bound"} <= {m.code for m in result.warnings}


def test_what_no_longer_holds_of_the_mean_is_no_longer_said() -> None:
    found = calibration()
    N_r, k_0 = (found.prior.symbols.index(s) for s in ("N_r", "k_0"))
    away = found.with_estimate(found.p + np.eye(len(found.p))[N_r] * 40, 0 * found.covariance)
    assert {"far_from_prior", "at_bound"} <= {m.code for m in away.warnings}
    assert "bound" in away.ship.coefficients["N_r"].verdict
    back = with_second(away, {"N_r": found.prior.mean[N_r] - away.p[N_r] * found.prior.std[N_r]})
    assert back.warnings == found.warnings
    assert back.identifiability.findings[N_r].kind != "bound" and "bound" not in back.ship.coefficients["N_r"].verdict
    assert back.identifiability.findings[k_0].shift == found.identifiability.findings[k_0].shift


def test_a_mean_that_is_worse_than_the_second_estimate_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """As between two minima: the objective of the problem is replaced by one that has its ridge halfway."""
    found = calibration()
    prior, i = found.prior, found.prior.symbols.index("N_r")
    other = {"N_r": prior.mean[i] + (found.p[i] + 1.0) * prior.std[i]}

    def ridge(_: ReducedProblem, p: Mapping[str, float]) -> float:
        way = (p["N_r"] - prior.mean[i]) / prior.std[i] - found.p[i]
        return way * (1 - way)

    assert with_second(found, other).p[i] == pytest.approx(found.p[i] + 0.5)
    monkeypatch.setattr(ReducedProblem, "value", ridge)
    alone = with_second(found, other)
    np.testing.assert_array_equal(alone.p, found.p)
    np.testing.assert_array_equal(alone.covariance, found.covariance)
    assert sum(m.code == "two_estimates" for m in alone.notices) == 1


def test_why_there_is_no_second_estimate_is_said() -> None:
    found = calibration()
    why = "no filter (singular)"
    alone = with_second(found, why)
    np.testing.assert_array_equal(alone.p, found.p)
    assert alone.ship is found.ship and alone.covariance is found.covariance
    (notice,) = [m for m in alone.notices if m.code == "two_estimates"]
    assert why in notice
    unknown = replace(found, covariance=np.full_like(found.covariance, np.inf))
    assert with_second(unknown, {"X_0F": 1.0}) is unknown


def test_estimates_of_coefficients_and_instruments_alone_are_averaged() -> None:
    ship = small_result().start
    assert averages(ship)
    assert not averages(freeing_effects(ship, ["current"]))
    assert averages(freeing_effects(ship, ["velocity_filter"]))  # an instrument


@pytest.mark.parametrize("limit", [None, 400.0])
def test_a_limit_of_time_leaves_it_half_of_the_time_and_changes_nothing_else(limit: float | None) -> None:
    asked = []

    def second(*_: object) -> SecondEstimate:
        asked.append(Control.within(None).seconds)
        return SecondEstimate("nothing was tried")

    settings = Settings(passes=1, compiled=False, time_limit=limit)
    options = FitOptions(next_trial=False, instruments=(), second=second)
    result = calibrate(small_result().start, coarse_runs()[0][:1], (), settings, options)
    assert asked == [math.inf if limit is None else 0.5 * limit] and result.converged
    assert [m.code for m in result.notices].count("two_estimates") == 1
    held = replace(options, hold=True, start={"N_r": -0.05})
    alone = calibrate(small_result().start, coarse_runs()[0][:1], (), settings, held)
    assert len(asked) == 1 and [m.code for m in alone.notices].count("two_estimates") == 1


def test_it_is_not_asked_where_more_is_fitted_or_less_and_an_unknown_one_is_refused() -> None:
    assert FitOptions().asks_second
    for options in ({"estimator": "windows"}, {"bootstrap": 3}, {"profile": ("X_0F",)}, {"per_run": ("current",)},
                    {"hold": True}, {"captive": object()}):  # fmt: skip
        assert not FitOptions(**options).asks_second, options  # type: ignore[arg-type]
    with pytest.raises(UserError, match="estimator best"):
        calibrate(small_result().start, (), options=FitOptions(estimator="best"))
