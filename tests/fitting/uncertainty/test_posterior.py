"""The objective of a finished fit as a function of its coefficients, refits that hold some, and draws of them."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mmg_ident as mi
from cases.shipfiles.ship_file import load_ship
from fitting.calibrate import FitOptions
from fitting.nlp.prior import Prior
from fitting.uncertainty import posterior as room
from fitting.uncertainty.posterior import JointDensity
from mmg.errors import Missing, NotCalibrated, NotInstalled, OutOfRange, UnknownName
from tests.support.synthetic_runs import runs

FREE = ("Y_v", "N_v", "N_r")


def small_fit(loss: str, step: float, **effects: dict[str, float]) -> mi.FitResult:
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing(set(ship.free) - set(FREE))
    for name, values in effects.items():
        ship = ship.with_effect(name, **values)
    options = FitOptions(next_trial=False, estimator="windows", instruments=("none",))
    return mi.calibrate(ship, runs()[0][:2], options=options, loss=loss, window=60.0, step=step)


@pytest.fixture(scope="module", params=["gaussian", "student"])
def fitted(request: pytest.FixtureRequest) -> mi.FitResult:
    return small_fit(request.param, 1.0, velocity_filter={"tau": 0.5})


# The objective as a function of the coefficients alone: its gradient, its residuals, its minimum
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
def test_a_refit_holds_and_minimises_over_the_others_or_changes_nothing(fitted: mi.FitResult, tmp_path: Path) -> None:
    row, problem, same = fitted.estimates["N_r"], fitted.problem, mi.refit(fitted)  # which holds nothing
    assert same.converged and same.objective == pytest.approx(fitted.objective, rel=1e-8)
    for symbol, estimate in fitted.estimates.items():
        assert same.estimates[symbol].value == pytest.approx(estimate.value, abs=1e-4 * estimate.prior_std)
        assert same.estimates[symbol].std == pytest.approx(estimate.std, rel=1e-3)
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


# Draws: the density and its gradient, a Gaussian, a small fit, and what is refused
def assert_exact_gradient(density: JointDensity, seed: int) -> None:
    """Against a central difference at a point drawn, along a direction drawn."""
    y, along = np.random.default_rng(seed).standard_normal((2, density.n))
    step = 1e-5
    difference = (density(y + step * along)[0] - density(y - step * along)[0]) / (2 * step)
    assert density(y)[1] @ along == pytest.approx(difference, rel=1e-6, abs=1e-5)


@pytest.mark.slow
def test_the_density_is_that_of_the_fit_and_its_gradient_exact(fitted: mi.FitResult) -> None:
    for seed in (3, 4):
        assert_exact_gradient(JointDensity(fitted.calibration), seed)
    density = JointDensity(fitted.calibration, power=1.0)
    y = np.zeros(density.n)
    here, volume = density.coefficients(y), density.within(y)[3]
    assert density(y)[0] + volume == pytest.approx(fitted.problem.value(here), rel=1e-6)
    away = np.abs(here - fitted.problem.start) / fitted.problem.scale
    assert (away < np.sqrt(np.diag(density.covariance))).all()  # near a bound unbounded ones are bent


@pytest.mark.slow
def test_draws_stay_inside_the_bounds_and_the_density_is_right_there(fitted: mi.FitResult) -> None:
    found = fitted.calibration
    prior, half = found.problem.prior, 0.5 * np.sqrt(np.diag(found.covariance)) * found.prior.std
    at = fitted.problem.start
    near = found.problem.with_bounds(at - half, np.maximum(prior.upper, at + half))
    density = JointDensity(SimpleNamespace(**{**vars(found), "problem": near}))
    assert_exact_gradient(density, 0)
    far = np.full(density.n, -9.0)
    assert (density.coefficients(far) >= at - half).all() and (density.coefficients(-far) <= near.prior.upper).all()


@dataclass
class Gaussian:
    """A density whose draws are known: normal, of a covariance, far from all bounds."""

    covariance: np.ndarray

    def __post_init__(self) -> None:
        self.n, self.power, self.centre = len(self.covariance), 1.0, np.array([1.0, -2.0, 0.5])
        self.root, ones = np.linalg.cholesky(self.covariance), np.ones(self.n)
        self.problem = SimpleNamespace(prior=Prior(FREE, 0 * ones, ones, -99 * ones, 99 * ones))

    def __call__(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        return 0.5 * float(y @ y), y

    def coefficients(self, y: np.ndarray) -> np.ndarray:
        return self.centre + self.root @ y


@pytest.mark.slow
def test_draws_of_a_gaussian_are_those_of_its_laplace_approximation() -> None:
    pytest.importorskip("nutpie", reason="needs the extra bayes")
    density = Gaussian(np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.3], [0.0, 0.3, 4.0]]))
    trace = room.draws_of_density(density, FREE, 1000, seed=1)  # type: ignore[arg-type]
    table = room.table_of(trace, density)  # type: ignore[arg-type]
    values = np.array([trace.posterior[s].values.ravel() for s in FREE])
    std = np.sqrt(np.diag(density.covariance))
    error = std / np.sqrt(table["effective"])
    assert (np.abs(table["mean"] - density.centre) < 4 * error).all() and (table["r_hat"] < 1.01).all()
    np.testing.assert_allclose(np.cov(values), density.covariance, atol=0.25)
    assert (table["wider"].abs() < 0.08).all() and (table["skewness"].abs() < 0.05).all()


@pytest.mark.slow
def test_a_small_fit_is_sampled_and_its_draws_are_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("nutpie", reason="needs the extra bayes")
    import pandas as pd

    monkeypatch.setattr(room, "TUNING", 60)
    fitted = small_fit("gaussian", 2.0)
    drawn = fitted.sample(200, method="nuts", seed=2)
    table, draws = drawn.table, drawn.to_pandas()
    assert draws.shape == (200, len(fitted.estimates)) and list(draws) == list(fitted.estimates)
    assert (table["r_hat"] < 1.05).all() and (table["wider"].abs() < 0.3).all()
    frame = fitted.to_pandas()
    low, high = (frame[key].to_numpy(dtype=float) for key in ("lower", "upper"))
    assert ((low <= draws) & (draws <= high)).all(axis=None)
    # the power makes them scatter about as widely as the fit says
    assert 0.5 < np.median(table["std"] / frame["std"].astype(float)) < 1.5
    drawn.save(tmp_path)
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "posterior.parquet"), draws)
    assert drawn.messages[0].code == "posterior" and drawn.messages[-1].code == "against_laplace"


@pytest.mark.slow
def test_laplace_draws_have_the_covariance_of_the_fit(fitted: mi.FitResult) -> None:
    frame, covariance = fitted.sample(4000, seed=1), fitted.covariance
    assert list(frame) == list(covariance) == list(covariance.index)
    std, prior = np.sqrt(np.diag(covariance)), fitted.calibration.prior.std
    np.testing.assert_allclose(std, [row.std for row in fitted.estimates.values()])
    size, scaled = np.outer(std, std), fitted.calibration.covariance * np.outer(prior, prior)
    np.testing.assert_allclose(covariance / size, scaled / size, atol=1e-6)
    np.testing.assert_allclose(np.cov(frame.T.to_numpy()) / size, covariance / size, atol=0.1)
    assert frame.equals(fitted.sample(4000, "laplace", 1)) and not frame.equals(fitted.sample(4000, seed=2))


@pytest.mark.slow
def test_what_cannot_be_drawn_is_refused(fitted: mi.FitResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for n, method, error in ((0, "laplace", OutOfRange), (0, "nuts", OutOfRange), (5, "nut", UnknownName)):
        with pytest.raises(error):
            fitted.sample(n, method)  # type: ignore[call-overload]
    rows = {s: replace(row, std=None) for s, row in fitted.estimates.items()}
    unknown = replace(fitted, estimates=rows)
    for ask in (lambda: unknown.covariance, lambda: unknown.sample(5), lambda: unknown.sample(5, "nuts")):
        with pytest.raises(Missing):
            ask()
    read = mi.load_run(fitted.save(tmp_path / "run", report=False).folder)
    assert isinstance(read, mi.FitResult) and read.covariance.equals(fitted.covariance)
    with pytest.raises(Missing):
        read.sample(5, "nuts")
    found = replace(fitted.calibration, solution=replace(fitted.calibration.solution, converged=False))
    with pytest.raises(NotCalibrated):
        room.sampled_posterior(found, 5)
    monkeypatch.setitem(sys.modules, "nutpie", None)
    with pytest.raises(NotInstalled):
        fitted.sample(5, "nuts")
