"""The objective as a function of the coefficients alone: its gradient, its residuals, its minimum."""

from __future__ import annotations

import numpy as np
import pytest

import mmg_ident as mi
from cases.shipfiles.ship_file import load_ship
from fitting.calibrate import FitOptions
from mmg.errors import Missing, OutOfRange, UnknownName
from tests.support.calibrated import FREE
from tests.support.synthetic_runs import coarse_runs


@pytest.fixture(scope="module", params=["gaussian", "student"])
def fitted(request: pytest.FixtureRequest) -> mi.FitResult:
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing(set(ship.free) - set(FREE))
    options = FitOptions(next_trial=False, instruments=("none",), estimator="windows")
    return mi.calibrate(ship, coarse_runs()[0][:2], options=options, loss=request.param, window=60.0)


def elsewhere(problem: mi.ReducedProblem, seed: int = 0) -> np.ndarray:
    """Coefficients within the bounds, a tenth of a prior standard deviation from the estimate."""
    step = 0.1 * problem.scale * np.random.default_rng(seed).standard_normal(len(problem.symbols))
    return np.clip(problem.start + step, *problem.bounds)


@pytest.mark.slow
def test_the_gradient_is_that_of_differences_and_half_the_squares_of_residuals_the_value(fitted: mi.FitResult) -> None:
    problem = fitted.problem
    here = elsewhere(problem)
    value, gradient = problem.objective(here)
    assert 0.5 * (problem.residuals(here) ** 2).sum() == pytest.approx(value, rel=1e-12)
    steps = np.diag(1e-4 * problem.scale)
    differences = [problem.objective(here + d)[0] - problem.objective(here - d)[0] for d in steps]
    np.testing.assert_allclose(gradient * problem.scale, np.array(differences) / 2e-4, rtol=1e-5, atol=1e-4)


@pytest.mark.slow
def test_its_minimum_is_where_the_fit_ended(fitted: mi.FitResult) -> None:
    problem = fitted.problem
    value, gradient = problem.objective(problem.start)
    assert value == pytest.approx(fitted.objective, rel=1e-8)
    low, high = problem.bounds
    free = (low < problem.start) & (problem.start < high)
    assert np.abs((gradient * problem.scale)[free]).max() < 1e-3
    assert all(problem.objective(elsewhere(problem, seed))[0] > value for seed in range(3))


@pytest.mark.slow
def test_coefficients_by_symbol_are_those_of_the_vector_and_wild_ones_give_an_infinite_value(
    fitted: mi.FitResult,
) -> None:
    problem = fitted.problem
    i = problem.symbols.index("N_r")
    here = problem.start.copy()
    here[i] *= 1.05
    assert problem.objective({"N_r": here[i]})[0] == problem.objective(here)[0]
    with pytest.raises(UnknownName):
        problem.objective({"N_rr": 0.0})
    wild = problem.start + 1e30 * problem.scale
    value, gradient = problem.objective(wild)
    assert value == np.inf and np.isinf(problem.residuals(wild)).all() and (gradient == 0).all()


@pytest.mark.slow
def test_a_refit_that_holds_nothing_changes_nothing(fitted: mi.FitResult) -> None:
    again = mi.refit(fitted)
    assert again.converged and again.objective == pytest.approx(fitted.objective, rel=1e-8)
    for symbol, row in fitted.estimates.items():
        new = again.estimates[symbol]
        assert new.value == pytest.approx(row.value, abs=1e-4 * row.prior_std)
        assert new.std == pytest.approx(row.std, rel=1e-3)
    assert again.scores["training"].after.window == pytest.approx(fitted.scores["training"].after.window, rel=1e-4)


@pytest.mark.slow
def test_a_refit_holds_and_minimises_over_the_others(fitted: mi.FitResult, tmp_path) -> None:  # type: ignore[no-untyped-def]
    row, problem = fitted.estimates["N_r"], fitted.problem
    value = row.value + 0.2 * row.prior_std
    again = mi.refit(fitted, {"N_r": value})
    assert again.converged and again.estimates["N_r"].value == pytest.approx(value, rel=1e-12)
    assert fitted.objective < again.objective < problem.objective({"N_r": value})[0]
    saved = again.save(tmp_path / "held", report=False)
    read = mi.load_run(saved.folder)
    assert read.estimates == again.estimates
    with pytest.raises(Missing):
        mi.refit(read)
    for wrong, error in (({"N_rr": 0.0}, UnknownName), ({"N_r": 1e9}, OutOfRange)):
        with pytest.raises(error):
            mi.refit(fitted, wrong)
