"""The fit with a latent force: slopes of its likelihood, bounds, and truths recovered from synthetic trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
import pytest

from cases.maneuvers.definitions import parse_maneuver
from cases.simulation.simulate import Wind, simulate
from cases.trial import Trial
from diagnosis.estimation import map_estimate, noise_sizes
from diagnosis.estimation.candidates import Column, ship_with_all_effects
from diagnosis.estimation.filtering import fastest
from diagnosis.estimation.first_fit import fit_without_effects
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.gusts import with_gusts
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import (
    Linearisation,
    Point,
    Trajectory,
    initial_trajectory,
    linearise_and_filter,
)
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import BESIDE_GUSTS, LEAST_FORCE, initial_noise, least_force
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_states
from diagnosis.estimation.residual_checks import with_correlation_time, with_gust_memory
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.judgement.budget import simulated_trials
from diagnosis.prepare import priors_before
from mmg.errors import UserError
from tests.diagnosis.judgement.test_verdict import ready
from tests.support.diagnosis_cases import (
    FEW,
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
from tests.support.disturbed_trials import disturbed_trial, drawn_ship, process

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
    data = grid_trials(trials, full_model.ship, h)
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
def test_the_fit_starts_anywhere_and_ends_at_the_same_place() -> None:
    steps, data, found, _ = fitted(1)
    other = found.noise.with_(force=3 * found.noise.force, white=0.5 * found.noise.white)
    start = initial_point(steps, data, steps.ship.values, found.free, other, found.p + 0.5)
    again = estimate(steps, data, start, iterations=40)
    assert again.nll == pytest.approx(found.nll, abs=0.5)
    errors = np.abs(again.p - found.p) / np.sqrt(np.diag(found.covariance))
    assert errors.max() < 0.7  # a loss of the tolerance, 0.05, is 0.3 standard errors in one direction


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


SIZES = NoiseModel(np.array([0.1, 0.2, 0.07]), 5.0, np.array([0.02, 0.01, 0.003, 0.005, 0.007, 0.001]))


def nll(here: Linearisation, logs: np.ndarray) -> float:
    """Negative log likelihood of the residual with variances that are larger by the factors exp(logs)."""
    driven, A = len(logs) - 6, len(here.active)
    Q = here.system.Q.copy()
    Q[A:] *= np.exp(logs[:driven])
    system = replace(here.system, Q=Q, R=here.system.R * np.exp(logs[driven:]))
    run = fastest().filtered(system)
    return 0.5 * float(run.log_det.sum() + (fastest().whitened(system, run, here.residual)[0] ** 2).sum())


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences() -> None:
    """About a fitted path with other sizes of the noise."""
    steps, data, found, _ = fitted(1)
    here = linearise_and_filter(steps, data, replace(found, noise=SIZES))
    slope, information = noise_sizes.slope_and_information(here, *here.smoothed()[1:])
    assert slope.shape == (9,) and information.shape == (9, 9)
    for i, step in enumerate(1e-4 * np.eye(9)):
        by_differences = (nll(here, step) - nll(here, -step)) / 2e-4
        assert slope[i] == pytest.approx(by_differences, rel=1e-5, abs=1e-3)


@pytest.mark.slow
def test_they_end_where_steps_of_the_fixed_point_end(monkeypatch: pytest.MonkeyPatch) -> None:
    steps, data, found, _ = fitted(1)
    for factor in (0.3, 3.0):
        noise = found.noise.with_(force=factor * found.noise.force, white=factor**0.6 * found.noise.white)
        fast = estimate(steps, data, replace(found.fixed(), noise=noise), 9)
        assert fast.converged
        with monkeypatch.context() as m:
            m.setattr(map_estimate, "NEAR", -1.0)  # none is near: the fixed point alone
            slow = estimate(steps, data, replace(found.fixed(), noise=noise), 60, tolerance=1e-6)
        assert abs(slow.nll - fast.nll) < 0.05
        sizes = np.concatenate([fast.noise.force / slow.noise.force, fast.noise.white / slow.noise.white])
        np.testing.assert_allclose(sizes, 1.0, atol=0.03)


def test_sizes_stay_within_their_limits() -> None:
    """Far from the optimum a step is shortened; at a limit that it would leave, a size stays."""
    steps, data, found, _ = fitted(1)
    typical = initial_noise(steps.ship)
    least = least_force(found.noise, data, typical)
    tiny = found.noise.with_(force=least.copy(), white=0.03 * found.noise.white)
    here = linearise_and_filter(steps, data, replace(found.fixed(), noise=tiny))
    new, gain = noise_sizes.noise_step(here, *here.smoothed()[1:], typical)
    assert gain > 0 and (new.force >= least).all() and (new.white >= noise_sizes.LEAST * typical.white).all()
    large = found.noise.with_(white=30.0 * found.noise.white)
    here = linearise_and_filter(steps, data, replace(found.fixed(), noise=large))
    new, _ = noise_sizes.noise_step(here, *here.smoothed()[1:], typical)
    assert np.log(new.white / large.white).min() == pytest.approx(0.5 * noise_sizes.SHORTEST)


def test_a_ship_that_explodes_is_fitted_from_her_priors(caplog: pytest.LogCaptureFixture) -> None:
    p = ready().problem
    unbounded = np.full(len(p.base.mean), np.inf)
    wide = replace(p.base, lower=-unbounded, upper=unbounded)
    values = p.steps.ship.values
    wrong = values.copy()
    wrong[p.steps.ship.symbols.index("Y_v")] = 1e7  # a sway force that grows with the sway
    noise = initial_noise(p.steps.ship)
    right = fit_without_effects(p.steps, p.data, values, wide, noise).null
    with caplog.at_level("INFO"):
        found = fit_without_effects(p.steps, p.data, wrong, wide, noise).null
    assert np.allclose(found.p, right.p, atol=0.1) and found.nll == pytest.approx(right.nll, abs=0.5)


WINDY_RUNS = (("zigzag:20/20", 120.0), ("random:11", 120.0), ("turning:-20", 120.0), ("random:5", 120.0))
GUST, MEMORY, WINDY_STEP = 0.15, 1.0, 0.2
WINDS = ((1.0, 0.3), (2.0, 2.0), (3.0, 4.0), (2.5, 5.5))
"""Speed [m/s] and direction [rad] of the steady wind that the logs show."""


def blown_trials(seed: int, share: float = GUST) -> list[Trial]:
    """Runs of a ship with small random forces in wind that swings about what is logged by a ``share`` of it."""
    trials, ship = [], drawn_ship(FEW, seed)
    for number, ((words, seconds), (speed, direction)) in enumerate(zip(WINDY_RUNS, WINDS, strict=True)):
        maneuver = parse_maneuver(words, ship, n=10.0, duration=seconds)
        clean = simulate(ship, maneuver, 0.1, Wind(speed, direction), seed, maneuver.start)
        rng = np.random.default_rng([seed, number])
        felt = clean["wind_speed"] * np.maximum(1 + share * process(len(clean.t), 0.1, MEMORY, rng), 0.1)
        real = replace(clean, columns={**clean.columns, "wind_speed": felt})
        seen = disturbed_trial(ship, real, quiet(X=0.005, Y=0.015, N=0.01), 10 * seed + number)
        logged = {**seen.columns, "wind_speed": clean["wind_speed"]}
        trials.append(replace(seen, columns=logged, name=f"run_{number}"))
    return trials


@lru_cache(maxsize=2)
def blown(share: float = GUST) -> GriddedTrials:
    """Such trials on a grid, with what gusts push by."""
    steps = full_steps(WINDY_STEP)
    return with_gusts(steps, grid_trials(blown_trials(3, share), steps.ship, WINDY_STEP))


@lru_cache(maxsize=2)
def fitted_in_gusts(with_them: bool) -> tuple[GriddedTrials, Estimate]:
    """The fit with gusts among the random forces, or without."""
    steps, data = full_steps(WINDY_STEP), blown() if with_them else replace(blown(), gusts=None)
    start = initial_point(steps, data, steps.ship.values, priors_of(SHIP, FREE), initial_noise(steps.ship))
    found = with_correlation_time(steps, data, estimate(steps, data, start, iterations=12))
    return data, with_gust_memory(steps, data, found)


def test_a_gust_pushes_as_a_stronger_wind_does() -> None:
    """Of the ship's own wind force, once more through the equations of motion."""
    steps, data = full_steps(WINDY_STEP), blown()
    assert data.gusts is not None
    k, at = 200, [steps.model.controls.index(name) for name in ("wind_north", "wind_east")]
    z = steps.settled(data.y[k].T, data.inputs[k].T, steps.ship.values)
    every = steps.coefficients(steps.ship.values, np.zeros((3, data.y.shape[1])))
    for gust, turned in ((0.02, False), (-0.03, True)):
        air = data.inputs[k].T.copy()
        north, east = air[at]
        air[at] += gust * np.array([-east, north] if turned else [north, east])
        push = gust * data.gusts[k, :, :, int(turned)].T
        blown_rates, rates = steps.rates(z, air, every)[0], steps.rates(z, data.inputs[k].T, every)[0]
        pushed_rates = steps.rates(z, data.inputs[k].T, steps.coefficients(steps.ship.values, push))[0]
        change = blown_rates - rates
        assert np.abs(change[:, 3:6]).max() > 1e-6
        assert (np.abs(pushed_rates - rates - change) <= 0.05 * np.abs(change).max(axis=0)).all()


@pytest.mark.slow
def test_their_size_and_memory_are_found() -> None:
    """The wind's own speed along it, little across; the random force stays as small as gusts leave it."""
    (data, found), typical = fitted_in_gusts(True), initial_noise(full_steps(WINDY_STEP).ship)
    noise = found.noise
    assert noise.gust[0] == pytest.approx(GUST, rel=0.25) and noise.gust[1] < 0.4 * GUST
    assert 0.4 * MEMORY < noise.gust_tau < 2.5 * MEMORY
    assert (noise.force < np.maximum(0.03 * typical.force, 1.1 * least_force(noise, data, typical))).all()


@pytest.mark.slow
def test_they_leave_a_share_of_their_force_to_the_random_force() -> None:
    """In a single run the fit would leave nothing, and everything would look sure."""
    steps, data = full_steps(WINDY_STEP), blown()
    assert data.gusts is not None
    typical, noise = initial_noise(steps.ship), fitted_in_gusts(True)[1].noise
    least = least_force(noise.with_(gust=np.array([0.1, 0.0])), data, typical)
    expected = BESIDE_GUSTS * 0.1 * np.sqrt((data.gusts[data.inside] ** 2).mean(axis=0))[:, 0]
    np.testing.assert_allclose(least, np.maximum(expected, LEAST_FORCE * typical.force))
    assert (noise.force >= 0.9 * least_force(noise, data, typical)).all()  # of gusts one step before
    np.testing.assert_array_equal(least_force(noise, replace(data, gusts=None), typical), LEAST_FORCE * typical.force)


@pytest.mark.slow
def test_campaigns_that_are_simulated_have_them_as_well() -> None:
    data, found = fitted_in_gusts(True)
    steps = full_steps(WINDY_STEP)
    (seen,) = simulated_trials(steps, data, found, 1, np.random.default_rng(1))
    again = estimate(steps, seen, replace(found, path=initial_trajectory(steps, seen, found.theta)), 8)
    assert again.noise.gust[0] == pytest.approx(found.noise.gust[0], rel=0.3)


@pytest.mark.slow
def test_what_they_do_is_no_finding() -> None:
    """Without them among the random forces it is one: the likelihood asks for them."""
    steps, (data, found), bare = full_steps(WINDY_STEP), fitted_in_gusts(True), fitted_in_gusts(False)[1]
    assert found.nll < bare.nll - 20.0
    assert unnamed_forms(steps, data, found).evidence < ODDS
