"""The fit with a latent force: slopes of its likelihood, bounds, and truths recovered from synthetic trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis.estimation.candidates import Column, ship_with_all_effects
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.gusts import with_gusts
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Linearisation, Point, Trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_states
from diagnosis.estimation.residual_checks import with_correlation_time
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.prepare import priors_before
from mmg.errors import UserError
from tests.support.diagnosis_cases import (
    FREE,
    OFF_NEUTRAL,
    SHIP,
    WHITE,
    full_steps,
    path_near,
    priors_of,
    pushed_trials,
    quiet,
    short_data,
    theta_of,
)
from tests.support.disturbed_trials import drawn_ship

LONG = (("zigzag:20/20", 120.0), ("random:11", 120.0), ("turning:-20", 120.0))
NOISE = NoiseModel(np.array([0.06, 0.15, 0.1]), 5.0, WHITE)
EFFECTS_TRIED = (
    "log_scale.share", "rudder_stall.loss", "current.x", "wind_force.Y", "gyro.share", "tow.N", "draft.share",
)  # fmt: skip
REMEMBERING = ("hull_memory.T", "gnss_delay.tau", "rudder_lag.T", "control_delay.tau", "velocity_filter.tau")


def columns_of(symbols: tuple[str, ...]) -> Priors:
    """Columns in units of a twentieth of their typical size or prior, without bounds."""
    n = len(symbols)
    std = np.full(n, 0.02)
    return Priors(tuple(Column(s) for s in symbols), np.zeros(n), std, np.full(n, -np.inf), np.full(n, np.inf))


def settled_path(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray, active: np.ndarray) -> Trajectory:
    """The smoothed path at these coefficients, to convergence."""
    path = path_near(steps, data, theta)
    for _ in range(12):
        a = linearise_and_filter(steps, data, Point(theta, NO_PRIORS, np.zeros(0), path, NOISE), active)
        mean, _, _ = a.smoothed()
        z = path.z.copy()
        z[..., active] += mean[..., : len(active)]
        path = path.moved(z, mean[..., len(active) :], data.gusts)
        if np.abs(mean).max() < 1e-10:
            break
    return path


@pytest.mark.slow
@pytest.mark.parametrize("effects", ["at neutral", "off neutral", "with memory", "in gusts"])
def test_slope_of_the_likelihood_is_that_of_finite_differences(effects: str) -> None:
    """At a smoothed path: that of the sum of squares closely, that of the log determinant to what its middle-of-step
    rule allows. How the coefficients move the memory in which a window starts is left out of the columns: a little."""
    steps, data = full_steps(0.5), short_data(0.5)
    data = with_gusts(steps, data) if effects == "in gusts" else data
    assert (data.gusts is not None) == (effects == "in gusts")
    tried = EFFECTS_TRIED + REMEMBERING if effects == "with memory" else EFFECTS_TRIED
    awake = {} if effects == "at neutral" else {s: OFF_NEUTRAL[s] for s in tried}
    asked = FREE + tried
    near = 0.1 if effects == "with memory" else 2e-3
    theta, free = theta_of(steps, awake), columns_of(asked)
    active = active_states(steps, asked, theta)
    path = settled_path(steps, data, theta, active)

    def linearised(symbol: str = "", by: float = 0.0) -> Linearisation:
        t = theta.copy()
        if symbol:
            t[steps.ship.symbols.index(symbol)] += by
        return linearise_and_filter(steps, data, Point(t, free, np.zeros(len(asked)), path, NOISE), active)

    here = linearised()
    chi = np.einsum("krca,krc->a", here.white[..., :-1], here.white[..., -1])
    logdet_gradient = here.logdet_gradient.sum(axis=0)
    assert here.nll == pytest.approx(0.5 * (here.filter.log_det.sum() + (here.white[..., -1] ** 2).sum()), rel=1e-12)
    for i, symbol in enumerate(asked):
        small = 1e-3 * free.std[i]
        up, down = linearised(symbol, small), linearised(symbol, -small)
        by_squares = 0.5 * ((up.white[..., -1] ** 2).sum() - (down.white[..., -1] ** 2).sum()) / (2e-3)
        by_log = 0.5 * (up.filter.log_det.sum() - down.filter.log_det.sum()) / (2e-3)
        spread = float(np.sqrt((here.white[..., i] ** 2).sum()))  # chance moves the slope by so much
        assert abs(chi[i] - by_squares) < near * spread + 1e-6, (symbol, chi[i], by_squares, spread)
        assert abs(logdet_gradient[i] - by_log) < 0.02 * spread + 0.05 * abs(by_log) + 1e-6, (
            symbol,
            logdet_gradient[i],
            by_log,
            spread,
        )


def fit_to(
    trials: Sequence[Trial], h: float = 1.0, iterations: int = 40
) -> tuple[TransitionModel, GriddedTrials, Estimate]:
    """A fit of all coefficients to trials."""
    full_model, base = ship_with_all_effects(SHIP, trials, names=("tow",)), priors_before(SHIP)
    data = grid_trials(trials, full_model.ship.inputs, 3.0, h)
    steps = TransitionModel(full_model.ship, [*base.symbols, *full_model.symbols], h)
    start = initial_point(steps, data, full_model.ship.values, base, initial_noise(full_model.ship))
    return steps, data, estimate(steps, data, start, iterations=iterations)


@cache
def fitted(seed: int, h: float = 1.0) -> tuple[TransitionModel, GriddedTrials, Estimate, dict[str, float]]:
    """A fit of all coefficients to runs of a ship drawn from its prior, with the truth."""
    true = drawn_ship(SHIP, seed)
    steps, data, found = fit_to(pushed_trials(seed, ship=true, runs=LONG), h)
    return steps, data, found, {s: true.coefficients[s].value for s in found.free.symbols}


def against_truth(
    steps: TransitionModel, data: GriddedTrials, found: Estimate, truth: dict[str, float]
) -> tuple[float, np.ndarray]:
    """Twice the loss of log likelihood from the best to the true coefficients, and z of each coefficient.

    The former is chi-squared of their number whatever the curvature, which for some ships is strong.
    """
    error = found.p - (np.array([truth[s] for s in found.free.symbols]) - found.free.mean) / found.free.std
    p, theta = found.p - error, theta_of(steps, truth)
    there = estimate(steps, data, replace(found.fixed(), theta=theta), iterations=30, fixed_noise=True)
    return 2 * (there.nll + 0.5 * float(p @ p) - found.nll), error / np.sqrt(np.diag(found.covariance))


@pytest.mark.slow
def test_sizes_of_what_is_random_are_found() -> None:
    steps, data, found, _ = fitted(1)
    np.testing.assert_allclose(found.noise.white, WHITE, rtol=0.2)
    better = with_correlation_time(steps, data, found)
    how = quiet()
    np.testing.assert_allclose(better.noise.force, [how.X, how.Y, how.N], rtol=0.6)
    assert 0.4 * how.tau < better.noise.tau < 2.5 * how.tau
    assert better.nll < found.nll + 1.0  # of few iterations


@pytest.mark.slow
def test_the_time_of_a_force_that_remembers_for_much_less_than_the_first_guess_is_found() -> None:
    """Further than one parabola about the first guess (6 s) reaches."""
    strong = quiet(X=0.4, Y=1.2, N=0.8, tau=1.0)
    trials = pushed_trials(3, ship=drawn_ship(SHIP, 3), runs=LONG, how=strong)
    steps, data, found = fit_to(trials, 0.2, 12)
    assert found.noise.tau > 5.0
    better = with_correlation_time(steps, data, found)
    assert 0.6 < better.noise.tau < 1.6
    np.testing.assert_allclose(better.noise.force, [strong.X, strong.Y, strong.N], rtol=0.3)
    assert better.nll < found.nll - 50


@pytest.mark.slow
def test_usual_sizes_of_what_is_random_count_as_so_many_samples_more() -> None:
    """The fit ends where the likelihood with their prior is best by each size; a short record stays near them."""
    steps, data, found, _ = fitted(1)
    usual = found.noise.with_(force=2 * found.noise.force, white=0.5 * found.noise.white)
    assert usual.neg_log_prior == 0.0 and usual.with_(prior=usual).neg_log_prior == 0.0
    assert found.noise.with_(prior=usual).neg_log_prior > 0.0

    def last(data: GriddedTrials) -> Estimate:
        noise = found.noise.with_(prior=usual)
        return estimate(steps, data, replace(found.fixed(), noise=noise), iterations=30, tolerance=1e-4)

    def nll(data: GriddedTrials, fit: Estimate, **sizes: np.ndarray) -> float:
        return linearise_and_filter(steps, data, replace(fit, noise=fit.noise.with_(**sizes))).nll

    for few in (data, data.thinned(20)):
        end = last(few)
        for k in ("force", "white"):
            size = getattr(end.noise, k)
            for i in range(len(size)):
                other = [size * np.where(np.arange(len(size)) == i, f, 1.0) for f in (1.3, 1 / 1.3)]
                assert min(nll(few, end, **{k: x}) for x in other) > nll(few, end), (k, i)
    off = [np.abs(np.log(last(d).noise.white / usual.white)).mean() for d in (data, data.thinned(20))]
    assert off[1] < 0.7 * off[0] and off[0] > 0.4


@pytest.mark.slow
def test_the_fit_starts_anywhere_and_ends_at_the_same_place() -> None:
    steps, data, found, _ = fitted(1)
    other = found.noise.with_(force=3 * found.noise.force, white=0.5 * found.noise.white)
    start = initial_point(steps, data, steps.ship.values, found.free, other, found.p + 0.5)
    again = estimate(steps, data, start, iterations=40)
    assert again.nll == pytest.approx(found.nll, abs=0.5)
    errors = np.abs(again.p - found.p) / np.sqrt(np.diag(found.covariance))
    assert errors.max() < 0.7  # a loss of the tolerance, 0.05, is 0.3 standard errors in one direction


def test_states_that_nothing_depends_on_are_left_out() -> None:
    steps = full_steps(0.5)
    theta = steps.ship.values
    assert list(active_states(steps, FREE, theta)) == list(range(6))
    names = [steps.model.states[i] for i in active_states(steps, ("hull_memory.T",), theta)]
    assert len(names) > 6 and all("." not in n or n.startswith("hull_memory") for n in names)
    awake = active_states(steps, FREE, theta_of(steps, {"rudder_backlash.b": 0.05}))
    assert any(steps.model.states[i].startswith("rudder_backlash") for i in awake)


def test_priors_are_those_before_a_calibration() -> None:
    c = SHIP.coefficients["Y_v"]
    calibrated = SHIP.with_coefficients({"Y_v": c.with_(value=1.1 * c.value, std=0.1 * c.std, prior_value=c.value,
                                                        prior_std=c.std)})  # fmt: skip
    a, b = priors_before(SHIP), priors_before(calibrated)
    assert a.symbols == b.symbols
    np.testing.assert_array_equal(a.mean, b.mean)
    np.testing.assert_array_equal(a.std, b.std)
    assert priors_of(SHIP, ("Y_v",)).mean[0] == c.value


@pytest.mark.slow
def test_runs_without_positions_and_with_gaps_are_fitted() -> None:
    trials = pushed_trials(4, runs=LONG[:2])
    bare = replace(trials[0], columns={k: v for k, v in trials[0].columns.items() if k not in ("x", "y")})
    holes = {k: v.copy() for k, v in trials[1].columns.items()}
    holes["u"][300:330] = np.nan
    _, data, found = fit_to([bare, replace(trials[1], columns=holes)])
    assert not data.measured[:, data.run == 0][..., :2].any()
    assert np.isfinite(found.nll) and np.isfinite(found.path.z).all() and np.isfinite(found.covariance).all()
    np.testing.assert_allclose(found.noise.white, WHITE, rtol=0.35)


@pytest.mark.slow
def test_stated_errors_are_right_over_seeds() -> None:
    """Likelihood of the truth, and z of every coefficient, of 6 ships."""
    losses, every, white = [], [], []
    for seed in range(10, 16):
        case = fitted(seed, 0.5)
        lost, z = against_truth(*case)
        losses.append(lost)
        every.append(z)
        white.append(case[2].noise.white / WHITE)
        better = np.linalg.eigvalsh(case[2].covariance)  # in prior variances: never less sure than the prior
        assert better.min() < 0.02 and better.max() < 1.0 + 1e-9 and 28 < lost < 105  # chi-squared of 61: 5e-4 outside
    assert 0.7 < np.sqrt((np.array(every) ** 2).mean()) < 1.4
    assert 300 < sum(losses) < 465, losses  # chi-squared of 366, 27 wide: 2.4 and 3.7 standard deviations
    np.testing.assert_allclose(np.mean(white, axis=0), 1.0, atol=0.1)


@pytest.mark.parametrize("way", ["raises", "nan"])
def test_a_step_at_which_the_filter_breaks_down_is_shortened_and_a_start_refused(
    monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """An iterate may make the ship explode; the fit goes on from the last good point, by shorter steps."""
    steps, data = full_steps(), short_data()
    start = initial_point(steps, data, steps.ship.values, priors_of(SHIP, FREE), NOISE)
    calls: list[float] = []

    def breaking(*args: object, **more: object) -> Linearisation:
        calls.append(0.0)
        if len(calls) in broken and way == "raises":
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        found = linearise_and_filter(*args, **more)  # type: ignore[arg-type]
        return replace(found, nll=np.nan) if len(calls) in broken else found

    monkeypatch.setattr("diagnosis.estimation.linearisation.linearise_and_filter", breaking)
    broken = {2, 3, 4, 5}
    found = estimate(steps, data, start, iterations=12)
    assert np.isfinite(found.nll) and len(calls) > 6 and np.isfinite(found.theta).all()
    calls.clear()
    broken = {1}
    with pytest.raises(UserError):
        estimate(steps, data, start)
