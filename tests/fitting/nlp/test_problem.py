"""The program of a fit: its windows, values and derivatives, its losses, and agreement with independent solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchmarks.optimisers import SingleShooting
from cases.inputs import step_means
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.fisher_information import information
from fitting.nlp.loss import LOSSES, Loss, without_outliers
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import Segments, cut, default_step, pieces_of
from fitting.prediction.score import score
from fitting.settings import Settings
from fitting.solvers.noise import estimate_noise
from fitting.solvers.solve import solve
from mmg.errors import Missing, TooFewData
from mmg.rollout import Simulator
from tests.support import calibrated
from tests.support.quick import first_quick
from tests.support.synthetic_runs import (
    SIGMA,
    assert_exact_derivatives,
    crowded,
    kernel,
    problem,
    runs,
    somewhere,
    with_constants,
)
from tests.support.trial_files import make_trial, motion_columns

TAU = np.array([1.0, 2.0, 1.0, 3.0, 1.5, 1.0])
FREE = ("X_0F", "Y_v", "N_v", "N_r", "Y_r", "C_D", "k_0", "w_P0", "t_R", "gamma_P", "C_rN")


# Windows and intervals: what is kept, what is dropped, and what is said about it
def test_step_means_integrate_held_samples_exactly() -> None:
    t = np.array([0.0, 0.4, 1.0, 1.7, 2.0])
    values = np.array([[1.0], [2.0], [4.0], [8.0], [0.0]])
    means = step_means(t, values, np.array([0.0, 1.0, 2.0]))
    assert means[:, 0] == pytest.approx([0.4 * 1 + 0.6 * 2, 0.7 * 4 + 0.3 * 8])


def test_every_measured_grid_sample_is_used_once_and_intervals_chain_within_a_window() -> None:
    seg = cut([make_trial()], 1.0, 50.0, 7)
    windows = len(seg.run)
    samples = seg.node_mask[:, 0].sum() + seg.mask[:, 0].sum()
    assert samples == seg.steps.sum() + windows  # N steps of a window have N + 1 samples
    assert (np.diff(seg.steps) <= 0).all()
    assert seg.steps.sum() * seg.h == pytest.approx(seg.duration)
    for w in range(windows):
        mine = np.flatnonzero(seg.window == w)
        order = mine[np.argsort(seg.start[mine])]
        assert (seg.end[order[:-1]] == seg.start[order[1:]]).all()


def test_a_gap_splits_a_run_and_nothing_is_invented_across_it() -> None:
    columns = motion_columns()
    keep = np.ones(len(columns["t"]), dtype=bool)
    keep[1000:1200] = False
    trial = Trial("gap", {k: v[keep] for k, v in columns.items()})
    parts = pieces_of([trial], 1.0)
    assert len(parts) == 2
    assert parts[0].t[-1] <= columns["t"][999] and parts[1].t[0] >= columns["t"][1200]
    empty = columns["u"].copy()
    empty[1000:1100] = np.nan  # rows without a number split a run as well
    assert len(pieces_of([Trial("nan", {**columns, "u": empty})], 1.0)) == 2


def test_missing_positions_stay_missing_and_pin_the_start() -> None:
    columns = {k: v for k, v in motion_columns().items() if k not in ("x", "y")}
    seg = cut([Trial("no position", columns)], 1.0, 50.0, 5)
    assert seg.node_mask[:, :2].sum() == 0 and seg.node_mask[:, 2:].all()


def test_a_clock_that_starts_late_changes_nothing_and_uneven_sampling_what_interpolation_does() -> None:
    columns = motion_columns()
    late = Trial("late", {**columns, "t": columns["t"] + 3223.7})
    a, b = cut([make_trial()], 1.0, 50.0, 5), cut([late], 1.0, 50.0, 5)
    np.testing.assert_allclose(a.nodes, b.nodes, atol=1e-9)
    np.testing.assert_allclose(a.controls, b.controls, atol=1e-9)
    keep = np.random.default_rng(1).random(len(columns["t"])) < 0.7
    keep[0] = True
    uneven = Trial("uneven", {k: v[keep] for k, v in columns.items()})
    even, found = (pieces_of([trial], 1.0)[0].logged for trial in (make_trial(), uneven))
    count = min(len(even), len(found))
    np.testing.assert_allclose(even[:count, :2], found[:count, :2], atol=2e-3)


def test_a_record_that_is_too_short_and_twin_rudders_are_refused_with_a_reason() -> None:
    columns = motion_columns()
    with pytest.raises(TooFewData):
        cut([Trial("short", {k: v[:20] for k, v in columns.items()})], 1.0, 50.0, 5)
    del columns["delta"]
    with pytest.raises(Missing):
        cut([Trial("twin", {**columns, "delta_port": columns["n"], "delta_starboard": columns["n"]})], 1.0, 50.0, 5)


def test_the_default_step_follows_froude_scaling() -> None:
    trial = make_trial()
    large = Trial("large", {**trial.columns, "t": trial.t * 10, "u": trial["u"] * 10, "v": trial["v"] * 10})
    assert default_step([large], 300.0) / default_step([trial], 3.0) == pytest.approx(10, rel=0.01)


# Multiple shooting: values, derivatives and optima
def test_intervals_end_where_the_simulator_does_also_short_last_ones() -> None:
    p = problem(K=7)
    seg = p.segments
    start = seg.nodes[seg.start].T
    end, interior = p.shooting.values(start, p.ship.values)
    lengths = np.unique(seg.steps)
    assert len(lengths) > 1 and lengths[-1] == 7
    for n in lengths:
        these = np.flatnonzero(seg.steps == n)
        out = Simulator(p.ship).run(start[:, these], seg.controls[:n, :, these], seg.h)
        np.testing.assert_allclose(end[:, these], out[-1], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(interior[: n - 1, :, these], out[1:-1], rtol=1e-10, atol=1e-12)


def robust(name: str, p: Problem) -> Problem:
    return p.with_changes(loss=Loss(name, TAU))


@pytest.mark.parametrize(
    "make",
    [
        lambda: problem(1),
        lambda: problem(5),
        lambda: robust("huber", problem(5)),
        pytest.param(lambda: crowded(1), marks=pytest.mark.slow),
        pytest.param(lambda: robust("student", crowded(5)), marks=pytest.mark.slow),
        pytest.param(lambda: with_constants(1), marks=pytest.mark.slow),
        lambda: with_constants(7, True),
    ],
    ids=["one step", "plain", "huber", "effects, one step", "effects, student", "constants", "constants, captive"],
)
def test_derivatives_are_exact(make: Callable[[], Problem]) -> None:
    p = make()
    more = () if p.prior.shared == p.P else (np.random.default_rng(1).normal(size=p.n), *np.eye(p.n)[-7:])
    assert_exact_derivatives(p, somewhere(p), *more)  # with constants: along a shared one and each of them


@pytest.mark.parametrize("K", [1, 40])
def test_the_optimum_does_not_depend_on_the_shooting_interval(K: int) -> None:
    reference, other = (solve(p, p.start()) for p in (problem(10), problem(K)))
    assert reference.converged and other.converged
    assert other.objective == pytest.approx(reference.objective, rel=1e-6)


@pytest.mark.slow
def test_scipy_finds_the_same_optimum_and_information_of_a_small_problem() -> None:
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing([s for s in ship.symbols if s not in calibrated.FREE])
    prior = Prior.of(ship)
    trials = runs()[0][:2]
    ours = Problem(ship, prior, kernel(prior.symbols), cut(trials, 1.0, 60.0, 5), SIGMA)
    whole = Problem(ship, prior, kernel(prior.symbols), cut(trials, 1.0, 60.0, 200), SIGMA)
    found = solve(ours, ours.start())
    one = SingleShooting(whole, -np.inf, np.inf)  # never stopped: no goal, no end of time
    states = 6 * one.windows
    theirs = least_squares(one.residuals, np.zeros(states + whole.P), xtol=1e-12, ftol=1e-12)
    assert found.converged
    assert theirs.cost == pytest.approx(found.objective, rel=1e-5)
    np.testing.assert_allclose(theirs.x[states:], ours.split(found.x)[1], atol=1e-3)
    H, n = theirs.jac.T @ theirs.jac, states  # the initial states of the windows projected out
    hessian = H[n:, n:] - H[n:, :n] @ np.linalg.solve(H[:n, :n], H[:n, n:])
    np.testing.assert_allclose(information(ours, found.x).hessian, hessian, atol=5e-3 * np.abs(hessian).max())


def profiled(p: Problem, at: np.ndarray, windows: np.ndarray) -> float:
    """Cost of some windows without the prior, minimised over their states at fixed coefficients."""
    theta = p.prior.mean + p.prior.std * at
    part = Problem(p.ship, p.prior, p.kernels, p.segments.subset(windows), p.sigma).with_bounds(theta, theta)
    s = solve(part, part.start(at), tolerance=1e-10)
    assert s.converged
    return s.objective - 0.5 * float(at @ at)


@pytest.mark.slow
@pytest.mark.parametrize("make", [problem, lambda: crowded(5)], ids=["plain", "effects"])
def test_score_and_information_are_slope_and_curvature_of_the_profiled_cost_of_a_window(
    make: Callable[[], Problem],
) -> None:
    p = make()
    s = solve(p, p.start(), tolerance=1e-9)
    assert s.violation < 1e-8
    found, rng = information(p, s.x), np.random.default_rng(0)
    lower, upper = p.p_bounds()
    inside = (found.p > lower + 1e-2) & (found.p < upper - 1e-2)
    d = rng.normal(size=p.P) * inside
    d /= np.linalg.norm(d) * 1e3
    for w in (0, len(found.run) - 1):
        up, middle, down = (profiled(p, found.p + step * d, np.array([w])) for step in (1, 0, -1))
        size = np.sqrt(d @ found.fisher[w] @ d)
        assert (up - down) / 2 == pytest.approx(found.score[w] @ d, abs=2e-4 * size + 1e-7, rel=2e-3)
        # curvature: Gauss-Newton against the exact one, which sees residuals of the order of the noise
        assert up + down - 2 * middle == pytest.approx(d @ found.fisher[w] @ d, rel=0.35)


# Losses: their derivatives, and spikes that ruin a gaussian fit only
@pytest.mark.parametrize("name", LOSSES)
def test_slope_and_bend_are_the_derivatives_of_the_cost(name: str) -> None:
    loss, rng = Loss(name, TAU), np.random.default_rng(0)
    w, e, h = rng.uniform(0.5, 2, (40, 6)), 4 * rng.normal(size=(40, 6)), 1e-4
    first = (loss.cost(w, e + h) - loss.cost(w, e - h)) / (4 * h)
    second = (loss.cost(w, e + h) - 2 * loss.cost(w, e) + loss.cost(w, e - h)) / (2 * h * h)
    np.testing.assert_allclose(loss.weight(w, e) * e, first, atol=1e-6)
    np.testing.assert_allclose(loss.second_derivative(w, e), second, atol=1e-4)
    cube = np.moveaxis(e[None], 1, 2)
    np.testing.assert_allclose(loss.cost(np.moveaxis(w[None], 1, 2), cube)[0].T, loss.cost(w, e))
    if name == "huber":  # small residuals cost what they cost a gaussian
        np.testing.assert_allclose(loss.cost(w, 1e-3 * e), Loss("gaussian", TAU).cost(w, 1e-3 * e), rtol=1e-3)


def test_trimming_recovers_the_spread_under_outliers() -> None:
    rng = np.random.default_rng(0)
    e = rng.normal(size=5000)
    e[::50] += 100.0
    assert np.nanstd(without_outliers([e])[0]) == pytest.approx(1.0, rel=0.06)


def spiked(trial: Trial, seed: int) -> Trial:
    """2 % of the samples of every state column replaced by gross errors."""
    rng = np.random.default_rng(seed)
    sizes = {"x": 20.0, "y": 20.0, "psi": 1.0, "u": 1.0, "v": 0.6, "r": 0.3}
    columns = dict(trial.columns)
    for name, size in sizes.items():
        hit = rng.random(len(trial)) < 0.02
        columns[name] = np.where(hit, columns[name] + size * np.sign(rng.normal(size=len(trial))), columns[name])
    return Trial(trial.name, columns)


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(["student", "huber"], pytest.mark.longest))
def test_spikes_ruin_the_gaussian_fit_but_not_the_robust_one(name: str) -> None:
    ship = load_ship("esso_osaka_3m")
    truth = hidden_ship()
    start = truth.fixing([s for s in truth.symbols if s not in FREE])
    start = start.with_values({s: ship.coefficients[s].value for s in FREE})
    clean = runs()[0][:5]
    dirty = [spiked(t, i) for i, t in enumerate(clean)]
    found = {n: estimate_coefficients(start, dirty, Settings(loss=n)) for n in ("gaussian", name)}
    clean_fit = estimate_coefficients(start, clean, Settings())
    assert all(c.converged for c in found.values())

    def off(c: Calibration) -> float:
        z = [(c.ship.coefficients[s].value - truth.coefficients[s].value) / ship.coefficients[s].std for s in FREE]
        return float(np.sqrt(np.mean(np.square(z))))

    judged = {n: score(Simulator(c.ship), runs()[1]).window for n, c in found.items()}
    best = score(Simulator(clean_fit.ship), runs()[1]).window
    assert off(found[name]) < 2.0 * off(clean_fit) < 0.1 < 0.5 < off(found["gaussian"])
    assert judged[name] < 1.01 * best < 1.1 * best < judged["gaussian"]
    np.testing.assert_allclose(found[name].noise.rms, [0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006], rtol=0.25)


# States that were derived count as little as their trials say, and are not taken for noise of the others
def both(std: float) -> Segments:
    """Two trials, the second with a surge velocity that was derived."""
    trials = [make_trial(), replace(make_trial(), name="derived", std={"u": std} if std else {})]
    return cut(trials, 1.0, 50.0, 5)


def test_a_sample_weighs_one_over_the_sum_of_variances() -> None:
    segments = both(0.03)
    assert both(0.0).variance is None  # nothing is said: nothing changes
    assert segments.variance is not None and segments.variance.shape == (len(segments.run), 6)
    plain = problem(5)
    tau = np.array([1.0, 1.0, 1.0, 2.0, 1.0, 1.0])
    here = plain.with_changes(segments=segments).with_sigma(SIGMA, tau)
    derived = segments.run[segments.node_window] == 1
    assert here.node_weight[derived, 3] == pytest.approx(1 / (SIGMA[3] ** 2 + 2 * 0.03**2))
    assert here.node_weight[~derived, 3] == pytest.approx(1 / SIGMA[3] ** 2)
    inside = segments.run[segments.window] == 1
    measured = segments.mask[:, 3, inside] > 0
    assert here.weight[:, 3, inside][measured] == pytest.approx(1 / (SIGMA[3] ** 2 + 2 * 0.03**2))
    for channel in (0, 1, 2, 4, 5):
        assert here.node_weight[:, channel] == pytest.approx(1 / SIGMA[channel] ** 2)


def test_the_noise_is_that_of_the_measured_ones() -> None:
    """Residuals of .02 everywhere, those of the derived run larger by what it states."""
    segments, rng = both(0.05), np.random.default_rng(0)
    derived = segments.run[segments.node_window] == 1
    nodes, inside = 0.02 * rng.standard_normal(segments.nodes.shape), 0.02 * rng.standard_normal(segments.targets.shape)
    nodes[derived, 3] += 0.05 * rng.standard_normal(derived.sum())
    at = segments.run[segments.window] == 1
    inside[:, 3, at] += 0.05 * rng.standard_normal(inside[:, 3, at].shape)
    found = estimate_noise(segments, nodes, inside, np.full(6, 1e-6))
    assert found.rms == pytest.approx(np.full(6, 0.02), rel=0.25)
    unaware = estimate_noise(replace(segments, variance=None), nodes, inside, np.full(6, 1e-6))
    assert unaware.rms[3] > 0.035
    part = segments.subset(np.flatnonzero(segments.run == 1))
    assert part.variance is not None and (part.variance[:, 3] == 0.05**2).all()
