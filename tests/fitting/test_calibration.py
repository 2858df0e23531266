"""The calibration as a whole, on synthetic ships whose truth is known and on the real records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.demo_trials import demo_trials, hidden_ship
from cases.trial import Trial
from fitting.calibrate import check_resumable, iterate_of
from fitting.calibration import Calibration, Settings, estimate_coefficients
from fitting.prediction.score import score
from mmg.errors import TooFewData, UserError
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.calibrated import FREE, small_result
from tests.support.synthetic_runs import runs
from tests.support.trial_files import make_trial


@pytest.fixture(scope="module")
def fitted() -> Calibration:
    return estimate_coefficients(load_ship("esso_osaka_3m"), runs()[0], Settings(starts=2))


@pytest.mark.slow
def test_it_converges_every_start_agrees_and_the_noise_of_the_sensors_is_recovered(fitted: Calibration) -> None:
    assert fitted.solution.status == "Solve_Succeeded" and fitted.solution.violation < 1e-6
    assert [s.converged for s in fitted.starts] == [True, True]
    assert max(s.distance for s in fitted.starts) < 1e-2
    np.testing.assert_allclose(fitted.noise.rms, [0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006], rtol=0.1)
    assert (fitted.noise.tau < 1.5).all()


@pytest.mark.slow
def test_starts_spread_over_processes_give_the_same_solutions() -> None:
    inline, spread = (
        estimate_coefficients(few_free(), runs()[0][:2], Settings(passes=1, starts=3, workers=w)) for w in (1, 2)
    )
    assert [s.objective for s in spread.starts] == pytest.approx([s.objective for s in inline.starts], rel=1e-9)
    np.testing.assert_allclose(spread.p, inline.p, atol=1e-6)
    assert set(inline.prior.symbols) == set(FREE)  # others stay as they are
    for symbol in set(inline.ship.symbols) - set(FREE):
        assert inline.ship.coefficients[symbol] == few_free().coefficients[symbol]


@pytest.mark.slow
def test_the_fit_moves_towards_the_truth_and_predicts_better(fitted: Calibration) -> None:
    truth, start = hidden_ship(), load_ship("esso_osaka_3m")
    well = [s for i, s in enumerate(fitted.prior.symbols) if fitted.covariance[i, i] < 0.05]
    moved = [s for s in well if truth.coefficients[s].value != start.coefficients[s].value]
    assert len(moved) >= 8

    def distance(ship: Ship) -> float:
        rows = ((ship.coefficients[s], truth.coefficients[s], start.coefficients[s]) for s in moved)
        return float(np.mean([abs(one.value - true.value) / prior.std for one, true, prior in rows]))

    assert distance(fitted.ship) < 0.35 * distance(start)
    before, after = (score(Simulator(s), runs()[1]) for s in (start, fitted.ship))
    assert after.window < 0.6 * before.window and after.paper < 0.4 * before.paper


@pytest.mark.slow
def test_a_calibrated_ship_is_again_a_ship(fitted: Calibration) -> None:
    again = parse_ship(dump_ship(fitted.ship))
    np.testing.assert_array_equal(again.values, fitted.ship.values)
    c = again.coefficients["Y_v"]
    assert c.prior_value == load_ship("esso_osaka_3m").coefficients["Y_v"].value
    assert c.verdict and c.std == fitted.ship.coefficients["Y_v"].std < c.prior_std


def few_free() -> Ship:
    ship = load_ship("esso_osaka_3m")
    return ship.fixing([s for s in ship.free if s not in FREE])


@pytest.mark.slow
def test_a_draft_lacks_its_last_solve_which_its_iterate_begins() -> None:
    ship, trials, settings = few_free(), runs()[0][:3], Settings()
    whole, draft = (estimate_coefficients(ship, trials, settings, draft=draft) for draft in (False, True))
    assert draft.draft and not draft.converged and draft.solution.iterations == 0 and draft.warnings == ()
    assert len(draft.passes) == len(whole.passes) - 1
    again = estimate_coefficients(ship, trials, settings, warm=draft.iterate, draft=True)
    assert again.draft and again.passes == ()
    np.testing.assert_allclose(again.p, draft.p, rtol=1e-12)
    found = estimate_coefficients(ship, trials, settings, warm=again.iterate)
    assert found.converged and not found.draft and found.solution.status == "Solve_Succeeded"
    assert found.solution.objective == pytest.approx(whole.solution.objective, rel=1e-9)
    np.testing.assert_allclose(found.p, whole.p, atol=1e-6)
    np.testing.assert_allclose(found.covariance, whole.covariance, atol=1e-6)
    assert len(found.passes) == 1 and found.warnings == whole.warnings


@pytest.mark.slow
def test_without_positions_the_rest_is_still_fitted() -> None:
    trials = [Trial(t.name, {k: v for k, v in t.columns.items() if k not in ("x", "y")}) for t in runs()[0][:3]]
    result = estimate_coefficients(load_ship("esso_osaka_3m"), trials, Settings(passes=1))
    assert result.converged and has_code(result.notices, "no_position")


@pytest.mark.slow
def test_an_iteration_limit_leaves_a_flagged_best_iterate() -> None:
    result = estimate_coefficients(load_ship("esso_osaka_3m"), runs()[0][:2], Settings(max_iterations=2))
    assert not result.converged
    assert all("NOT CONVERGED" in result.ship.coefficients[s].verdict for s in result.prior.symbols)


def test_constant_inputs_are_refused() -> None:
    trial = make_trial()
    constant = make_trial(n=np.full(len(trial), 10.0), delta=np.zeros(len(trial)))
    with pytest.raises(TooFewData):
        estimate_coefficients(load_ship("esso_osaka_3m"), [constant])


@pytest.mark.slow
def test_intervals_of_one_seed_hold_most_true_values(fitted: Calibration) -> None:
    truth, found = hidden_ship().coefficients, fitted.ship.coefficients
    z = np.array([(found[s].value - truth[s].value) / found[s].std for s in fitted.prior.symbols])
    assert (np.abs(z) < 1.96).mean() >= 0.85 and np.abs(z).max() < 4.5


@pytest.mark.longest
@pytest.mark.slow
def test_coverage_of_95_percent_intervals_over_20_noise_seeds() -> None:
    """White sensor noise and gusts: the model-based intervals hold; the robust ones, made for worse, hold more."""
    inside, robust = [], []
    truth = hidden_ship().coefficients
    for seed in range(20):
        c = estimate_coefficients(load_ship("esso_osaka_3m"), demo_trials(seed)[0])
        assert c.converged
        model = np.sqrt(np.diag(c.covariance_model)) * c.prior.std
        for s, std in zip(c.prior.symbols, model, strict=True):
            error = abs(c.ship.coefficients[s].value - truth[s].value)
            inside.append(error <= 1.96 * std)
            robust.append(error <= 1.96 * c.ship.coefficients[s].std)
    assert 0.90 <= np.mean(inside) <= 0.995
    assert np.mean(robust) >= np.mean(inside)


@pytest.mark.slow
@pytest.mark.data
def test_a_fit_on_the_real_records_improves_every_development_hold_out(frt) -> None:  # type: ignore[no-untyped-def]
    from cases.io import published_splits as splits
    from cases.io.read import read_trials

    ship = load_ship("esso_osaka_3m")
    result = estimate_coefficients(ship, read_trials(splits.find(splits.TRAIN_TZRB)))
    held_out = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    before, after = (score(Simulator(s), held_out) for s in (ship, result.ship))
    assert result.converged
    for a, b in zip(before.trials, after.trials, strict=True):
        assert b.window < a.window, a.name
    assert before.window / after.window >= 2.5
    for symbol in result.prior.symbols:
        c = result.ship.coefficients[symbol]
        assert c.lower <= c.value <= c.upper


# Going on with an interrupted calibration that has values by campaign
ROW = {"value": 0.9, "std": 0.1, "unit": "s", "prior_value": 0.3, "prior_std": 0.4}


@pytest.mark.slow
def test_with_values_by_campaign_the_shared_coefficients_go_on() -> None:
    result = small_result()
    model, own = result.start, np.array([0.5, -0.5])
    iterate = {**result.iterate, "p": np.concatenate([result.iterate["p"], own])}
    values = {day: {"gyro.T": ROW} for day in ("2026-03-02", "2026-03-09")}
    differ = replace(result, iterate=iterate, campaigns={"values": values})
    begun = iterate_of(differ, model)
    assert begun is not None and set(begun) == {"p"}
    np.testing.assert_array_equal(begun["p"], result.iterate["p"])
    assert iterate_of(result, model) is result.iterate
    assert iterate_of(replace(differ, iterate=None), model) is None


@pytest.mark.slow
def test_a_constant_that_campaigns_took_over_is_no_other_model_and_begins_anew() -> None:
    result = small_result()
    first = next(iter(result.estimates))
    rest = {s: row for s, row in result.estimates.items() if s != first}
    taken = replace(result, estimates=rest, campaigns={"values": {"2026-03-02": {first: ROW}}})
    trials = result.objects.trials if result.objects else ()
    check_resumable(taken, result.start, trials)
    assert iterate_of(taken, result.start) is None
    with pytest.raises(UserError, match="--without, --fix and --only"):
        check_resumable(replace(taken, campaigns=None), result.start, trials)
