"""Channels of the latent force that follow each other, in trials drawn from a linear ship."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.force_order import PAIRS, force_order, order_by_law, order_of, turning_scores, with_turning
from diagnosis.estimation.kalman import LinearSystem, NoiseModel, filtered, linear_system, responses
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.judgement.verdict import not_random
from tests.diagnosis.judgement.test_verdict import ready

K, R, S, H = 250, 3, 3, 0.8
NOISE = NoiseModel(
    force=np.array([0.4, 0.7, 0.5]),
    tau=3.0,
    white=np.array([0.1, 0.2, 0.05, 0.3, 0.2, 0.1]),
)


def system() -> LinearSystem:
    """Three windows of a damped ship that logs its velocities thrice as well as its positions; one ends early."""
    rng = np.random.default_rng(5)
    F = np.diag([0.9, 0.8, 0.7]) + 0.05 * rng.standard_normal((S, S))
    see = np.vstack([0.3 * rng.standard_normal((3, S)), np.eye(S)])
    model = LinearModel(
        end=np.zeros((K, R, S)),
        F=np.tile(F, (K, R, 1, 1)),
        G=np.zeros((K, R, S, 0)),
        force=np.tile(0.5 * np.eye(S), (K, R, 1, 1)),
        logged=np.zeros((K + 1, R, 6)),
        H=np.tile(see, (K + 1, R, 1, 1)),
        observed=np.zeros((K + 1, R, 6, 0)),
        observing=np.zeros(0, dtype=int),
    )
    steps = np.array([K, K, K // 2])
    inside = np.arange(K)[:, None] < steps
    good = np.repeat((np.arange(K + 1)[:, None] <= steps)[..., None], 6, axis=2)
    good[::7, 0] = False
    return linear_system(model, NOISE, np.tile(np.eye(S), (R, 1, 1)), good, inside, H)


def residuals_of(truth: LinearSystem, fitted: LinearSystem, draws: int, seed: int) -> np.ndarray:
    """Whitened residuals (K + 1, R, 6, draws), by the filter of ``fitted``, of trials simulated with ``truth``."""
    rng = np.random.default_rng(seed)
    n = truth.T.shape[2]
    state = np.linalg.cholesky(truth.first + 1e-12 * np.eye(n)) @ rng.standard_normal((R, n, draws))
    logged = np.empty((K + 1, R, 6, draws))
    for k in range(K + 1):
        logged[k] = truth.Z[k] @ state + np.sqrt(truth.R)[:, None] * rng.standard_normal((R, 6, draws))
        if k < K:
            pushed = np.sqrt(truth.Q)[:, None] * rng.standard_normal((R, n, draws))
            state = truth.T[k] @ state + np.where(truth.inside[k][:, None, None], pushed, 0.0)
    return responses(fitted, filtered(fitted), np.zeros((K, R, 0, draws)), -logged)[0]


def scores_of(white: np.ndarray) -> np.ndarray:
    """Scores (3, draws) of whitened residuals."""
    s = system()
    return turning_scores(s, filtered(s), NOISE, H, lambda: iter([white]))


@pytest.fixture(scope="module")
def by_chance() -> np.ndarray:
    """Scores of whitened residuals drawn as such, the law by chance."""
    return scores_of(np.random.default_rng(0).standard_normal((K + 1, R, 6, 1000)))


@pytest.mark.slow
def test_independent_forces_are_random_at_the_nominal_level(by_chance: np.ndarray) -> None:
    found = np.hstack([scores_of(residuals_of(system(), system(), 400, seed)) for seed in range(3)])
    laws = np.random.default_rng(4).choice(by_chance, (1200, 200), axis=1)  # each has drawn a law of its own
    p = np.array([order_by_law(score, laws[:, i]).p_value for i, score in enumerate(found.T)])
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.02)  # three standard errors
    assert p.mean() == pytest.approx(0.5, abs=0.03)
    ratio = found / np.sqrt((by_chance**2).mean(axis=1, keepdims=True))
    assert np.abs(ratio.mean(axis=1)).max() < 0.15 and np.abs(ratio.std(axis=1) - 1).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("pair", [0, 1, 2])
def test_forces_that_follow_each_other_are_found_with_their_angle(pair: int, by_chance: np.ndarray) -> None:
    angles = np.zeros(3)
    angles[pair] = -0.8
    white = residuals_of(with_turning(system(), NOISE, H, angles), system(), 40, 2)
    found = [order_by_law(score, by_chance) for score in scores_of(white).T]
    assert np.mean([o.pair == PAIRS[pair] and not o.is_random for o in found]) > 0.95
    mean = np.mean([o.turning for o in found], axis=0)
    assert mean[pair] == pytest.approx(-0.8, abs=0.2)  # to first order
    assert np.abs(np.delete(mean, pair)).max() < 0.1


def test_a_test_of_residuals_draws_its_own_law() -> None:
    s = system()
    white = residuals_of(with_turning(s, NOISE, H, np.array([0.0, 0.0, 1.0])), s, 1, 3)[..., 0]
    one, again, other = (order_of(s, filtered(s), white, NOISE, H, seed) for seed in (1, 1, 2))
    assert one.p_value == again.p_value != other.p_value and max(one.p_value, other.p_value) < 1e-6
    assert one.turning == pytest.approx(other.turning, abs=0.3) and one.turning[2] > 0.5


def test_a_turning_leaves_the_size_of_the_force_as_it_is() -> None:
    turned = with_turning(system(), NOISE, H, np.array([0.5, -1.0, 2.0]))
    block, size = turned.T[0, 0, S : S + 3, S : S + 3], np.diag(NOISE.force**2)
    assert block @ size @ block.T + np.diag(turned.Q[S : S + 3]) == pytest.approx(size)
    assert not np.allclose(block, block.T) and np.array_equal(turned.T[-1, 2], np.eye(turned.T.shape[2]))


def test_what_is_found_is_said_unless_the_calibration_shows_it_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    case = ready()
    p = case.problem
    order = force_order(p.steps, p.data, case.null)
    assert order.is_random and not_random(case, case.null) == []
    monkeypatch.setattr(
        "diagnosis.judgement.verdict.force_order", lambda *_: replace(order, p_value=1e-5, scores=np.eye(3)[2])
    )
    (message,) = not_random(case, case.null)
    assert message.code == "ordered_forces"
    assert not_random(replace(case, is_order_usual=True), case.null) == []
