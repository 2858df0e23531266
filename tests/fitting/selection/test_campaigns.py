"""What follows the solve of a fit: instruments that differ by day, judged by runs left out, and the mean of two
estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.io.campaigns import Groups, ship_in
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import dump_ship, dump_ship_json, load_ship, parse_ship
from cases.trial import Trial
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions, calibrate
from fitting.calibration import Calibration, SecondEstimate, averages, estimate_coefficients, with_second
from fitting.identifiability.analysis import verdict
from fitting.nlp.fisher_information import Information
from fitting.nlp.prior import ByCampaign, RunConstants, prior_with
from fitting.nlp.problem import Problem
from fitting.prediction.predict import predict_all, values_of
from fitting.prediction.score import pooled_sigma, score
from fitting.result import FitResult
from fitting.selection.campaigns import (
    LEVEL,
    CampaignFit,
    RunReadings,
    by_campaign,
    differences,
    distribution_of,
    gains,
    instruments,
    not_asked,
    readings_as_rows,
    with_constant,
)
from fitting.selection.left_out_runs import each_alone, estimates_without, leave_out, relative_change
from fitting.selection.sisters import Marginal, SisterEvidence, sister_widths
from fitting.settings import Settings
from fitting.solvers import solve as solving
from fitting.solvers.condensing import Lead
from fitting.solvers.control import Control
from fitting.solvers.reduced import ReducedProblem
from fitting.solvers.solve import Solution
from mmg.errors import UserError
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.calibrated import FREE, small_result
from tests.support.quick import first_quick
from tests.support.small_fleets import DAYS, fleet
from tests.support.synthetic_runs import coarse_runs

ESSO = load_ship("esso_osaka_3m")
SHIP = ESSO.fixing([s for s in ESSO.symbols if s not in FREE])
HIDDEN = ESSO.with_values({s: 1.08 * ESSO.coefficients[s].value for s in FREE})
RUNS = ("zigzag:20/20", "turning:35", "zigzag:10/10")
LAGS = (0.0, 0.9)
NUMBER = np.array([0, 0, 1, 1])
READ = RunReadings(np.array([0.1, 0.3, 1.0, np.nan]), np.array([0.1, 0.1, 0.2, np.nan]), NUMBER)
OWN = ByCampaign(("gyro.T",), ("spring", "autumn"), tuple(NUMBER), {"gyro.T": READ.of_campaigns(2)})


def lagging(differ: bool = True) -> list[Trial]:
    """Runs of two days, whose gyro lags by LAGS, or not at all."""
    lags = {day: [f"gyro:T={lag * differ}"] for day, lag in zip(DAYS, LAGS, strict=False)}
    return fleet(HIDDEN, lags, RUNS, 5, 10.0, 100.0)


@lru_cache(maxsize=2)
def calibrated(differ: bool) -> tuple[Calibration, CampaignFit]:
    trials = lagging(differ)
    found = estimate_coefficients(SHIP, trials, Settings(), draft=True)  # without its last solve, as in a fit
    return found, by_campaign(found, ("gyro", "log_scale"))


@pytest.mark.slow
def test_a_turn_rate_that_is_late_on_one_day_is_found_there_and_named() -> None:
    fit = calibrated(True)[1]
    constants = fit.calibration.constants
    assert constants is not None and "gyro.T" in constants.symbols and "log_scale.share" not in constants.symbols
    k = constants.symbols.index("gyro.T")
    off = (constants.value[:, k] - np.array(LAGS)) / constants.std[:, k]
    assert np.abs(off).max() < 3 and np.ptp(constants.value[:, k]) > 0.7
    assert any(DAYS[1] in str(m) for m in fit.messages)
    pairs = [(fit.calibration.ship.coefficients[s], HIDDEN.coefficients[s]) for s in FREE]
    assert all(abs(found.value - true.value) < 3 * found.std for found, true in pairs)
    assert fit.content is not None and fit.content["left_out"]["with"] < fit.content["left_out"]["without"]


@pytest.mark.slow
def test_equal_instruments_leave_the_calibration_as_it_is() -> None:
    found, fit = calibrated(False)
    assert fit.calibration is found and not found.ship.campaigns and fit.content is not None
    assert fit.content["values"] is None and not any(row["taken"] for row in fit.content["tried"])
    assert all(row["measured"] and row["chance"] > LEVEL for row in fit.content["tried"])


@pytest.mark.slow
def test_the_ship_file_holds_the_campaigns_and_predictions_take_that_of_the_trial() -> None:
    _, fit = calibrated(True)
    ship = fit.calibration.ship
    trials = TrialSet.of(fleet(HIDDEN, {DAYS[1]: ["gyro:T=0.9"]}, RUNS[:1], 50, 10.0, 100.0))
    again = parse_ship(dump_ship(ship))
    assert again.campaigns == {name: dict(values) for name, values in ship.campaigns.items()}
    assert f'"{DAYS[0]}"' in dump_ship_json(ship)
    own = ship.campaigns[DAYS[1]]["gyro.T"]
    assert values_of(ship, trials[0])[ship.symbols.index("gyro.T")] == own  # type: ignore[index]
    known = predict_all(Simulator(ship), trials, 30.0, 30.0)[0][0]
    other = predict_all(Simulator(ship), trials.said_campaign(DAYS[0], ship), 30.0, 30.0)[0][0]
    miss = [np.mean(np.vstack([w.error(trials[0].states) for w in windows])[:, 5] ** 2) for windows in (known, other)]
    assert miss[0] < 0.5 * miss[1]
    assert ship_in(ship, trials)[0].coefficients["gyro.T"].value == own
    with pytest.raises(UserError, match=r"--campaign summer.*2026-03-02, 2026-03-09"):
        trials.said_campaign("summer", ship)


@pytest.mark.slow
@pytest.mark.parametrize("differ", first_quick([True, False]))
def test_what_is_handed_out_is_certified_and_nothing_else_is(differ: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    certified: list[int] = []
    by_ipopt = solving.by_ipopt

    def watched(problem: Problem, start: Any, *rest: Any) -> Solution:
        certified.extend([problem.P] if isinstance(start, Lead) else [])
        return by_ipopt(problem, start, *rest)

    monkeypatch.setattr(solving, "by_ipopt", watched)
    options = FitOptions(per_campaign=("gyro",), next_trial=False, instruments=())
    result = calibrate(SHIP, lagging(differ), options=options)
    assert certified == [len(FREE) + (len(LAGS) if differ else 0)]
    assert result.converged and result.status == result.passes[-1].status == "Solve_Succeeded"
    assert result.passes[-1].objective == result.objective


@pytest.mark.slow
def test_a_campaign_that_does_not_tell_a_lag_gets_the_mean_of_all_and_that_is_said() -> None:
    """Straight runs show no turn rate."""
    trials = lagging() + fleet(HIDDEN, {DAYS[2]: ["gyro:T=0.9"]}, ("straight", "acceleration"), 300, 10.0, 100.0)
    fit = by_campaign(estimate_coefficients(SHIP, trials, Settings()), ("gyro",))
    constants = fit.calibration.constants
    assert constants is not None and len(constants.value) == len(DAYS)
    value, std = constants.value[:, constants.symbols.index("gyro.T")], constants.std[:, 0]
    assert np.abs(value[:2] - LAGS).max() < 0.1 and value[2] == pytest.approx(value[:2].mean(), abs=0.15)
    assert std[2] > 5 * std[:2].max()
    assert any(DAYS[2] in m for m in fit.messages)


def test_a_ship_file_with_a_campaign_of_another_ship_is_refused(tmp_path: Path) -> None:
    text = dump_ship(ESSO) + '\n[campaigns."spring"]\n"gyro.Tt" = 0.1\nY_v = 99.0\n'
    with pytest.raises(UserError, match=r"campaigns.*'gyro\.Tt'"):
        parse_ship(text, str(tmp_path / "ship.toml"))


def test_constants_of_runs_are_not_fitted_together_with_values_by_campaign_and_that_is_said() -> None:
    trials = fleet(HIDDEN, {day: () for day in DAYS[:2]}, RUNS[:2], 5, 10.0, 20.0)
    assert [m.code for m in not_asked(TrialSet.of(trials), ())] == ["campaigns_not_asked"]
    assert not_asked(TrialSet.of(trials), ("none",)) == () and not_asked(TrialSet.of(trials[:2]), ()) == ()
    with pytest.raises(UserError, match=r"--per-campaign gyro.*--per-run"):
        calibrate(ESSO, trials, options=FitOptions(per_run=("current",), per_campaign=("gyro",)))


def test_values_are_said_to_the_first_digit_of_their_error() -> None:
    values, std = np.array([[0.00046], [1.0331]]), np.array([[0.04], [0.08]])
    bare = (np.array([0.2584]), np.array([0.6]), np.zeros(2))
    constants = RunConstants(("gyro.T",), DAYS[:2], ("s",), values, std, *bare)
    campaigns = Groups("campaign", DAYS[:2], (0, 0, 1, 1))
    said = [str(m) for m in differences(constants, campaigns, np.array([[0.1], [0.95]]))]
    assert said[0].endswith(f"mean 0.3 +- 0.6 s: {DAYS[0]} 0.00 +- 0.04, {DAYS[1]} 1.03 +- 0.08")
    assert DAYS[1] in said[1] and len(said) == 2


def windows(p: np.ndarray) -> Information:
    """Four windows of four runs that say little of two constants behind a shared coefficient."""
    fisher = np.zeros((4, 3, 3))
    fisher[:, 0, 0] = 4.0
    fisher[np.arange(4), 1 + NUMBER, 1 + NUMBER] = 0.5
    score = (fisher @ (p - 0.2)[:, None])[:, :, 0]
    return Information(fisher, score, p, np.arange(4), ("Y_v", "T@0", "T@1"), np.eye(3), p.copy())


def test_runs_of_a_campaign_are_averaged_by_precision_and_multiply_the_prior_of_their_distribution() -> None:
    assert RunReadings(np.full(2, np.nan), np.full(2, np.nan), np.array([0, 1])).of_campaigns(2)[1][1] == np.inf
    ship = with_constant(ESSO, "gyro.T", 0.5, 0.4)
    told, bare = prior_with(ship, OWN, ()), prior_with(ship, replace(OWN, told={}), ())
    precision = np.array([200.0, 25.0]) + 1 / 0.4**2
    np.testing.assert_allclose(told.std[-2:], precision**-0.5)
    np.testing.assert_allclose(told.mean[-2:], (np.array([0.2 * 200, 1.0 * 25]) + 0.5 / 0.4**2) / precision)
    np.testing.assert_array_equal(told.mean[:-2], bare.mean[:-2])
    np.testing.assert_allclose(bare.std[-2:], 0.4)


def test_as_rows_the_estimate_is_the_same_and_a_run_left_out_takes_its_reading_along() -> None:
    ship = with_constant(ESSO, "gyro.T", 0.5, 0.4)
    prior = prior_with(ship.fixing([s for s in ship.free if s != "Y_v"]), OWN, ())
    info = windows(np.array([0.3, 0.1, -0.2]))
    rows = readings_as_rows(info, prior, OWN, {"gyro.T": READ})
    bounds = (np.full(3, -1e3), np.full(3, 1e3))
    whole, alone = (estimates_without(i, [(), (2,), (3,)], bounds) for i in (info, rows))
    np.testing.assert_allclose(alone[0], whole[0], atol=1e-9)
    np.testing.assert_allclose(alone[2], whole[2], atol=1e-9)
    mean, std = prior.mean[-1], prior.std[-1]
    weight = 0.5 / std**2  # of the window that is left, which says mean + 0.2 std
    left = (weight * (mean + 0.2 * std) + 0.5 / 0.4**2) / (weight + 1 / 0.4**2)
    np.testing.assert_allclose(mean + std * alone[1, 2], left, atol=1e-9)
    assert mean + std * whole[1, 2] > left + 0.05


def test_the_width_of_constants_is_recovered_and_what_only_one_campaign_gains_counts() -> None:
    rng = np.random.default_rng(3)
    noise = np.full(40, 0.2)
    widths = []
    for width in (0.0, 0.8):
        measured = 0.5 + width * rng.standard_normal(40) + noise * rng.standard_normal(40)
        measured[3], noise[3] = 1e6, np.inf  # a campaign without a reading
        widths.append(distribution_of(measured, noise)[1])
    assert widths[0] < 0.12 and 0.6 < widths[1] < 1.05  # none where they are equal
    before = np.ones(4)
    assert gains(before, before - np.array([0.0, 0.0, 0.0, 0.3])) and not gains(before, before + 1e-4)


def test_an_instrument_that_no_longer_differs_by_campaign_is_refused_in_one_line() -> None:
    with pytest.raises(UserError, match=r"--per-campaign fouling.*gyro"):
        instruments(ESSO, ("fouling",))
    held = ESSO.with_effect("gyro").fixing(["gyro.T"])
    assert [each.name for each in instruments(held)] == ["gyro scale", "log_scale"]


# Runs left out of a finished calibration: close to refits, honest about bounds and folds
@cache
def four_runs() -> tuple[list[Trial], Calibration]:
    """Four short runs of the hidden ship of the demo and six coefficients fitted to them."""
    trials = [*coarse_runs()[0][:4]]
    return trials, estimate_coefficients(SHIP, trials, Settings(passes=2))


def quadratic() -> Information:
    """Six windows of three runs whose cost is a quadratic in two coefficients."""
    rng = np.random.default_rng(4)
    J = rng.standard_normal((6, 9, 2))
    F = np.swapaxes(J, 1, 2) @ J
    y = np.einsum("wij,j->wi", F, np.array([0.4, -0.3])) + 0.2 * rng.standard_normal((6, 2))
    p = np.linalg.solve(F.sum(axis=0) + np.eye(2), y.sum(axis=0))
    return Information(F, F @ p - y, p, np.repeat([0, 1, 2], 2), ("a", "b"), np.eye(2), p.copy())


FAR = (np.full(2, -9.0), np.full(2, 9.0))


def test_the_estimate_without_a_run_is_exact_for_a_quadratic_cost():
    info = quadratic()
    found = estimates_without(info, each_alone(3), FAR)
    for run in range(3):
        rest = info.run != run
        F = info.fisher[rest]
        y = (F @ info.p - info.score[rest]).sum(axis=0)
        assert np.allclose(found[run], np.linalg.solve(F.sum(axis=0) + np.eye(2), y))
    nothing, every = estimates_without(info, [(), (0, 1, 2)], FAR)
    assert np.allclose(nothing, info.p) and np.allclose(every, 0.0)  # the estimate itself; the prior


def test_a_bound_holds_and_the_others_follow():
    info = quadratic()
    upper = np.array([info.p[0], 9.0])
    free = estimates_without(info, each_alone(3), FAR)
    held = estimates_without(info, each_alone(3), (FAR[0], upper))
    rising = free[:, 0] > info.p[0]
    assert rising.any() and np.allclose(held[rising, 0], info.p[0])
    assert np.abs(held[rising, 1] - free[rising, 1]).max() > 1e-4
    assert np.allclose(held[~rising], free[~rising])


@pytest.mark.slow
def test_scores_without_a_run_are_near_those_of_a_refit():
    trials, found = four_runs()
    sigma = pooled_sigma(trials)
    fast = leave_out(found, each_alone(len(trials)), sigma)
    inside = score(Simulator(found.ship), trials, sigma).trials
    moved, off = [], []
    for i, trial in enumerate(trials):
        rest = [t for k, t in enumerate(trials) if k != i]
        refit = estimate_coefficients(found.problem.ship, rest, Settings(passes=2), warm={"p": found.p})
        true = score(Simulator(refit.ship), [trial], sigma).trials[0].window
        moved.append(true - inside[i].window)
        off.append(fast[i] - true)
    assert max(moved) > 0  # it matters that a run is left out
    assert np.sqrt(np.mean(np.square(off))) < 0.35 * np.sqrt(np.mean(np.square(moved)))


@pytest.mark.slow
def test_a_fold_of_runs_is_left_out_together():
    trials, found = four_runs()
    folds = [(0, 1), (2, 3)]
    estimates = estimates_without(found.information, [*folds, (0,)], found.problem.p_bounds())
    assert np.abs(estimates[0] - estimates[2]).max() > 0
    rows = leave_out(found, folds, pooled_sigma(trials))
    values = found.prior.mean + found.prior.std * estimates[1]
    ship = found.problem.ship.with_values(dict(zip(found.prior.symbols, values, strict=True)))
    by_hand = score(Simulator(ship), trials[2:], pooled_sigma(trials)).trials
    assert np.allclose(rows[2:], [t.window for t in by_hand])


def test_a_common_factor_is_a_change_without_error():
    before = np.array([0.1, 0.3, 0.8])
    found = relative_change(before, 0.9 * before)
    assert found == (pytest.approx(-0.1), pytest.approx(0, abs=1e-12))
    assert relative_change(before, before[::-1])[1] > 0.3


# The mean of two estimates: halfway between them, less sure by half their difference, and when it is not asked
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


# Sisters: a known width of what differs is recovered
P, DIFFER = 24, 8


def sisters(count: int, width: float, rows: int, seed: int) -> tuple[list[SisterEvidence], np.ndarray]:
    """Ships whose first DIFFER coefficients differ by ``width``, each seen by so many ``rows``; and the truth."""
    rng = np.random.default_rng(seed)
    size = np.where(np.arange(P) < DIFFER, width, 0.0)
    mean = 0.5 * rng.normal(size=P)
    truth = mean + size * rng.normal(size=(count, P))
    found = []
    for c in truth:
        J = rng.normal(size=(rows, P)) * np.geomspace(5.0, 0.2, P)
        y = J @ c + rng.normal(size=rows)
        found.append(SisterEvidence(tuple(f"c{k}" for k in range(P)), np.zeros(P), np.ones(P), J.T @ J, J.T @ y))
    return found, truth


def alone(ships: list[SisterEvidence]) -> np.ndarray:
    return np.array([np.linalg.solve(s.A + np.eye(P), s.b) for s in ships])


def test_a_known_width_is_recovered_the_error_falls_and_standard_errors_hold_the_truth() -> None:
    found, gains, z = [], [], []
    for seed in range(6):
        ships, truth = sisters(10, 0.4, 30, seed)
        w = sister_widths(ships)
        found.append(np.sqrt((w.width[:DIFFER] ** 2).mean()))
        gains.append(((w.estimate - truth) ** 2).mean() / ((alone(ships) - truth) ** 2).mean())
        z.append((w.estimate - truth) / w.std)
        assert np.median(w.width[DIFFER:]) < 0.1
    assert np.mean(found) == pytest.approx(0.4, rel=0.15)
    assert np.mean(gains) < 0.6 and max(gains) < 0.9 and 0.8 < np.std(z) < 1.2


def test_identical_sisters_have_widths_near_zero_and_one_value() -> None:
    for seed in range(4):
        ships, truth = sisters(5, 0.0, 30, seed)
        w = sister_widths(ships)
        assert w.common < 0.03 and w.width.max() < 0.1
        assert ((w.estimate - truth) ** 2).mean() < 0.6 * ((alone(ships) - truth) ** 2).mean()


def test_a_ship_that_is_no_sister_is_told() -> None:
    ships, _ = sisters(8, 0.1, 60, 3)
    ships[2] = replace(ships[2], b=ships[2].b + 3.0 * ships[2].A[:, 1])  # one coefficient three units off
    found = sister_widths(ships)
    assert np.argmin(found.p_alike) == 2 == np.argmax(np.abs(found.from_others[:, 1]))


def test_the_slope_of_the_likelihood_agrees_with_differences_and_units_do_not_matter() -> None:
    ships, _ = sisters(4, 0.4, 15, 1)
    A, b = np.array([s.A for s in ships]), np.array([s.b for s in ships])
    square, h = np.full(P, 0.09), 1e-5
    slope = Marginal.of(A, b, np.sqrt(square)).slope()
    for j in (0, 7, 20):
        step = h * (np.arange(P) == j)
        ends = [Marginal.of(A, b, np.sqrt(square + sign * step)).log_likelihood for sign in (1, -1)]
        assert slope[j] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-6)
    centre, unit = np.linspace(-1, 1, P), np.linspace(0.5, 2, P)
    back = ships[1].in_units(centre, unit).in_units(ships[1].centre, ships[1].unit)
    assert np.allclose(back.A, ships[1].A) and np.allclose(back.b, ships[1].b)
