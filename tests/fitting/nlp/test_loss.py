"""Robust losses: exact derivatives, and spikes that ruin a gaussian fit only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.nlp.loss import LOSSES, Loss, without_outliers
from fitting.nlp.problem import Problem
from fitting.nlp.windows import Segments, cut
from fitting.prediction.score import score
from fitting.settings import Settings
from fitting.solvers.noise import estimate_noise
from mmg.rollout import Simulator
from tests.fitting.nlp.test_effects_in_the_fit import away_from_kinks, crowded
from tests.fitting.nlp.test_shooting import somewhere
from tests.support.quick import first_quick
from tests.support.synthetic_runs import SIGMA, assert_exact_derivatives, problem, runs
from tests.support.trial_files import make_trial

TAU = np.array([1.0, 2.0, 1.0, 3.0, 1.5, 1.0])
FREE = ("X_0F", "Y_v", "N_v", "N_r", "Y_r", "C_D", "k_0", "w_P0", "t_R", "gamma_P", "C_rN")


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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["huber", "student"])
@pytest.mark.parametrize("which", ["plain", "crowded"])
def test_robust_derivatives_of_the_problem_are_exact(name: str, which: str) -> None:
    plain = problem(5) if which == "plain" else crowded(5)
    p = plain.with_changes(loss=Loss(name, TAU))
    x = somewhere(p) if which == "plain" else away_from_kinks(p)
    assert_exact_derivatives(p, x)


def test_small_residuals_cost_the_same_whatever_the_loss() -> None:
    p = problem(5)
    x = p.start()
    wide = [Problem(p.ship, p.prior, p.kernels, p.segments, 1e4 * SIGMA, Loss(n)) for n in ("gaussian", "huber")]
    assert wide[1].objective(x) == pytest.approx(wide[0].objective(x), rel=1e-4)


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
@pytest.mark.parametrize("name", first_quick(["student", "huber"]))
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

    def off(c) -> float:  # type: ignore[no-untyped-def]
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
