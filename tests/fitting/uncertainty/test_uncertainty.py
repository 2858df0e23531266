"""Robust covariance, leave-one-run-out, bootstrap by run, profiles and draws: against known laws and each other."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mmg_ident as mi
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN, demo_trials
from cases.trial import inside
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions, calibrate
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.parallel import Shared
from fitting.result import read_fit
from fitting.settings import Settings
from fitting.solvers.solve import Solution, solve
from fitting.uncertainty import posterior as room
from fitting.uncertainty.posterior import JointDensity
from fitting.uncertainty.refits import LIMIT, OUT_OF_TIME, bootstrap, drawn_runs, profiles, refit, reweighted
from fitting.uncertainty.sandwich import changes_without_each, robust
from mmg.errors import Missing, NotCalibrated, NotInstalled, OutOfRange, UnknownName
from tests.support.calibrated import FREE, small_result
from tests.support.disturbed_trials import process
from tests.support.synthetic_runs import SIGMA, kernel, runs

SYMBOLS = ("Y_v", "N_v", "N_r", "C_D", "k_x", "X_0F")


def linear(
    windows: int, per_run: int, P: int, inflation: float, seed: int, shared: float = 0.0
) -> tuple[Information, np.ndarray]:
    """A linear fit with truth from the prior, whose scores vary ``inflation`` times as the informations say.

    shared: part of that variance that windows of one run have in common. Returns it at its optimum, and the truth.
    """
    rng = np.random.default_rng(seed)
    truth = rng.standard_normal(P)
    run = np.arange(windows) // per_run
    J = rng.standard_normal((windows, 2 * P, P)) * np.geomspace(0.05, 1.5, P)
    own = rng.standard_normal((windows, 2 * P))
    common = rng.standard_normal((run[-1] + 1, 2 * P))[run]
    if shared:
        J = J[:1] + 0.1 * J
    e = np.sqrt(inflation) * (np.sqrt(1 - shared) * own + np.sqrt(shared) * common)
    fisher = np.swapaxes(J, 1, 2) @ J
    H = fisher.sum(axis=0) + np.eye(P)
    p = np.linalg.solve(H, np.einsum("wip,wi->p", J, J @ truth + e))
    score = np.einsum("wip,wi->wp", J, J @ (p - truth) - e)
    symbols = tuple(f"c{i}" for i in range(P))
    return Information(fisher, score, p, run, symbols, np.eye(P), p.copy()), truth


def covered(windows: int, per_run: int, P: int, inflation: float, shared: float = 0.0) -> tuple[float, float]:
    """Shares of truths inside the robust and the model-based 95 % intervals over 60 draws."""
    ours, theirs = [], []
    for seed in range(60):
        info, truth = linear(windows, per_run, P, inflation, seed, shared)
        found = robust(info)
        for share, C in ((ours, found.covariance), (theirs, found.model)):
            share.append(np.abs(info.p - truth) < 1.96 * np.sqrt(np.diag(C)))
    return float(np.mean(ours)), float(np.mean(theirs))


@pytest.mark.parametrize("inflation", [1.0, 16.0])
@pytest.mark.parametrize(("windows", "per_run"), [(12, 3), (60, 5)])
def test_intervals_hold_whatever_the_noise_is_like(inflation: float, windows: int, per_run: int) -> None:
    ours, theirs = covered(windows, per_run, 12, inflation)
    assert 0.9 <= ours <= 0.995
    assert inflation < 4 or theirs < 0.86
    if windows < 60:  # also where windows of a run err together
        assert covered(48, 6, 8, 4.0, shared=0.8)[0] >= 0.88


def test_it_is_the_model_based_one_with_many_clusters_and_honest_noise_and_never_narrower_with_few() -> None:
    found = robust(linear(400, 4, 6, 1.0, 0)[0])
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(found.model))
    assert (np.abs(ratio - 1) < 0.15).all() and found.clusters == (400, 100)
    for seed in range(10):
        found = robust(linear(8, 2, 6, 0.2, seed)[0])
        assert (np.diag(found.covariance) > (1 - 1e-9) * np.diag(found.model)).all()


def test_a_coefficient_that_nothing_excites_keeps_its_prior_and_broken_numbers_are_answers_not_errors() -> None:
    info, _ = linear(20, 4, 5, 4.0, 1)
    for part in (info.fisher, np.swapaxes(info.fisher, 1, 2), info.score, info.p, info.prior_score):
        part[..., 4] = 0
    found = robust(info)
    assert found.covariance[4, 4] == pytest.approx(1.0)
    np.testing.assert_allclose(found.covariance[4, :4], 0, atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    info, _ = linear(1, 1, 4, 1.0, 0)
    np.testing.assert_allclose(robust(info).covariance, robust(info).model)  # one window
    info.score[0, 0] = np.nan
    assert np.isnan(robust(info).covariance).all()


def test_one_step_without_a_run_is_exact_for_a_linear_fit() -> None:
    info, _ = linear(12, 3, 5, 2.0, 3)
    by_run = info.by_run()
    for k in range(4):
        rest = info.run != k
        H = info.fisher[rest].sum(axis=0) + np.eye(5)
        # gradient of the rest at p vanishes at the new optimum
        gone = -np.linalg.solve(H, info.score[rest].sum(axis=0) + info.p)
        np.testing.assert_allclose(changes_without_each(by_run)[k], gone, atol=1e-10)


def test_runs_are_drawn_whole() -> None:
    run = np.array([0, 0, 1, 2, 2, 2])
    counts = drawn_runs(run, 50, np.random.default_rng(0))
    assert (counts[:, 0] == counts[:, 1]).all() and (counts[:, 3] == counts[:, 5]).all()
    assert (counts[:, [0, 2, 3]].sum(axis=1) == 3).all() and len(np.unique(counts[:, 0])) > 1


@lru_cache(maxsize=1)
def small() -> tuple[Problem, Solution, Information]:
    """A calibration of six coefficients on five runs."""
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing([s for s in ship.symbols if s not in SYMBOLS])
    prior = Prior.of(ship)
    p = Problem(ship, prior, kernel(prior.symbols), cut(runs()[0][:5], 1.0, 60.0, 5), SIGMA)
    s = solve(p, p.start())
    assert s.converged
    return p, s, information(p, s.x)


@pytest.mark.slow
def test_windows_that_count_twice_cost_twice_and_a_refit_without_some_is_nearly_one_step() -> None:
    p, s, info = small()
    part, _ = reweighted(p, s.x, np.full(len(info.run), 2), np.zeros(p.P))
    prior = 0.5 * info.p @ info.p
    assert part.objective(s.x) - prior == pytest.approx(2 * (p.objective(s.x) - prior))
    step, runs_left = changes_without_each(info.by_run()), info.by_run().run
    counts = np.array([info.run != r for r in runs_left], dtype=int)
    outcomes = refit((Shared((p, s.x, math.inf)), counts, np.zeros((len(step), p.P))))
    assert len(step) == len(p.segments.trials) and not any(why for _, why in outcomes)
    moved = np.array([found for found, _ in outcomes]) - info.p
    assert np.abs(step - moved).max() < 0.2 * np.abs(moved).max()


@pytest.mark.slow
def test_where_a_refit_fails_the_others_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    p, s, info = small()
    fails = iter([True, False])

    def sometimes(*args, **kwargs):  # type: ignore[no-untyped-def]
        if next(fails):
            raise FloatingPointError("made up")
        return solve(*args, **kwargs)

    monkeypatch.setattr("fitting.uncertainty.refits.solve", sometimes)
    found, why = bootstrap(info, 2, 0, p, s.x)
    late, reasons = bootstrap(info, 2, 0, p, s.x, end=0.0)
    assert np.isnan(late).all() and reasons == [OUT_OF_TIME] * 2
    assert why[0] and not why[1]
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()


@pytest.mark.slow
def test_a_profile_is_the_parabola_of_the_model_based_error_near_the_estimate() -> None:
    p, s, info = small()
    found = robust(info)
    (profile,) = profiles(p, s.x, ["N_r"], found.model, found.model)
    i = p.prior.symbols.index("N_r")
    se = np.sqrt(found.model[i, i]) * p.prior.std[i]
    best = p.coefficients(info.p)[p.kernels.free[i]]
    assert profile.increase[len(profile.increase) // 2] == 0 and min(profile.increase) > -1e-6
    assert profile.lower == pytest.approx(best - 1.96 * se, abs=0.3 * se)
    assert profile.upper == pytest.approx(best + 1.96 * se, abs=0.3 * se)
    assert not profile.failures and pytest.approx(1.96**2 / 2, rel=1e-3) == LIMIT
    with pytest.raises(ValueError):
        profiles(p, s.x, ["m_x"], found.model, found.model)


# Intervals on disturbed synthetic trials hold the truth where those of the model alone do not
def test_the_process_has_its_size_and_memory() -> None:
    d = process(200_000, 0.1, 5.0, np.random.default_rng(0))
    assert d.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(d[:-50] * d[50:]) == pytest.approx(np.exp(-1.0), abs=0.06)


@pytest.mark.longest
@pytest.mark.slow
def test_pooled_coverage_of_95_percent_intervals_is_90_to_98_percent() -> None:
    from benchmarks.coverage import disturbed_errors

    assert len(TRAIN) == 7
    inside = np.array([np.abs(disturbed_errors(seed)) < 1.96 for seed in range(100, 120)])
    model, reported = inside.mean(axis=(0, 2))
    assert 0.90 <= reported <= 0.98
    assert model < 0.80


# What stretches that were left out of the trials were worth
@pytest.mark.longest
@pytest.mark.slow
def test_a_calibration_says_what_it_left_out_and_what_that_was_worth(tmp_path) -> None:  # type: ignore[no-untyped-def]
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    train, held_out = demo_trials(3)
    rows = inside(train[0], [(50.0, 58.0)])
    broken = train[0].with_columns(psi=train[0]["psi"] + np.where(rows, 0.3, 0.0))
    (kept,) = TrialSet.of([broken]).sound
    assert kept.whole is broken
    settings, options = Settings(passes=2, compiled=False), FitOptions(next_trial=False, instruments=())
    result = calibrate(start, [kept], held_out[-1:], settings, options)
    whole = small_result()
    assert whole.left_out is None and not [m for m in whole.warnings if m.code == "left_out_worth"]
    worth = result.left_out
    assert worth is not None and list(worth["trials"]) == [broken.name] and 7.0 < worth["seconds"] < 13.0
    errors = worth["scores"]["training"]["window"]
    assert errors["with"] > errors["without"] == pytest.approx(result.scores["training"].after.window)
    assert "validation" not in worth["scores"]
    (message,) = [m for m in result.warnings if m.code == "left_out_worth"]
    assert "30 s" in message and broken.name not in message
    assert read_fit(result.save(tmp_path / "run").folder).left_out == worth
    assert broken.name in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


# The objective of a finished fit by its coefficients, and draws of them
FEW = ("Y_v", "N_v", "N_r")


def small_fit(loss: str, step: float, **effects: dict[str, float]) -> mi.FitResult:
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing(set(ship.free) - set(FEW))
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
        self.problem = SimpleNamespace(prior=Prior(FEW, 0 * ones, ones, -99 * ones, 99 * ones))

    def __call__(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        return 0.5 * float(y @ y), y

    def coefficients(self, y: np.ndarray) -> np.ndarray:
        return self.centre + self.root @ y


@pytest.mark.slow
def test_draws_of_a_gaussian_are_those_of_its_laplace_approximation() -> None:
    pytest.importorskip("nutpie", reason="needs the extra bayes")
    density = Gaussian(np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.3], [0.0, 0.3, 4.0]]))
    trace = room.draws_of_density(density, FEW, 1000, seed=1)  # type: ignore[arg-type]
    table = room.table_of(trace, density)  # type: ignore[arg-type]
    values = np.array([trace.posterior[s].values.ravel() for s in FEW])
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
