"""Ensembles: particles are rollouts of members, distances by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from fitting.prediction.predict import predict_all
from mmg.errors import Missing, UnknownName
from mmg.rollout import Simulator
from residual.hybrid import Hybrid, Residual, to_network
from residual.papers.black_box import BOX_KIND, box_of
from residual.papers.ensemble import mahalanobis, members_of, particles, predict_members
from residual.physics import Physics
from residual.settings import BlackBoxSettings
from residual.system import RolloutBatch, TrainableSystem, rollout
from residual.train import tasks_of, train_one
from tests.residual.test_hybrid import hybrid_and_batch, random_residual
from tests.support import hybrids


class Yaw(TrainableSystem):
    """A ship that only yaws: dr/dt = (K delta - r) / T, surging at constant speed; inputs n, delta, air."""

    def __init__(self, K: float, T: float) -> None:
        super().__init__()
        self.K, self.T = K, T

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        zero = torch.zeros_like(z[0])
        turn = (self.K * controls[1] - z[5]) / self.T
        return torch.stack([z[3], zero, z[5], zero, zero, turn])


def yaw_batch(M: int = 3, N: int = 10) -> RolloutBatch:
    draw = torch.Generator().manual_seed(0)
    controls = torch.randn(N, 4, M, generator=draw, dtype=torch.float64)
    targets = torch.randn(N + 1, 6, M, generator=draw, dtype=torch.float64)
    return RolloutBatch(0.5, controls, targets, torch.ones_like(targets))


def random_residuals(count: int) -> list[Residual]:
    return [random_residual(seed, 8) for seed in range(count)]


# Particles


def test_ts_infinity_is_the_rollouts_of_the_members_one_by_one() -> None:
    members, batch = [Yaw(0.1, 2.0), Yaw(0.2, 2.0), Yaw(0.2, 5.0)], yaw_batch()
    paths = particles(members, batch, 6, "ts-infinity")
    assert paths.shape == (11, 6, 6, 3)
    for p in range(6):
        np.testing.assert_array_equal(paths[:, :, p], rollout(members[p % 3], batch).numpy())


def test_ts1_draws_a_member_anew_at_every_step_and_for_every_particle() -> None:
    """Of the members +a and -a, the turn rate after N steps is a times a random walk: variance N, not N^2."""
    N, P, a, h = 25, 4000, 0.1, 0.5
    controls = torch.zeros(N, 4, 1, dtype=torch.float64)
    controls[:, 1] = 1.0
    start = torch.zeros(N + 1, 6, 1, dtype=torch.float64)
    batch = RolloutBatch(h, controls, start, torch.ones_like(start))
    slow = 1e6
    members = [Yaw(a * slow, slow), Yaw(-a * slow, slow)]
    walk = particles(members, batch, P, "ts1")[-1, 5, :, 0] / (a * h)
    assert walk.mean() == pytest.approx(0.0, abs=4 * math.sqrt(N / P))
    assert walk.var() == pytest.approx(N, rel=0.1)
    kept = particles(members, batch, P, "ts-infinity")[-1, 5, :, 0] / (a * h)
    assert kept.var() == pytest.approx(N**2, rel=1e-3)


def test_the_same_seed_gives_the_same_particles_and_another_one_others() -> None:
    members, batch = [Yaw(0.1, 2.0), Yaw(0.2, 2.0)], yaw_batch()
    one, same, other = (particles(members, batch, 4, "ts1", seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e-6


@pytest.mark.slow
def test_the_members_of_a_saved_network_are_those_it_was_made_of() -> None:
    residuals, (_, batch) = random_residuals(2), hybrid_and_batch(steps=8)
    limit = np.full(len(hybrids.ship().features), np.inf)
    ship = hybrids.ship().with_network(to_network(residuals, hybrids.ship().actuators, -limit, limit))
    paths = particles(members_of(ship), batch, 2)
    physics = Physics(hybrids.ship())
    for p, residual in enumerate(residuals):
        with torch.no_grad():
            expected = rollout(Hybrid(physics, residual, np.zeros((7, 1))), batch).numpy()
        np.testing.assert_allclose(paths[:, :, p], expected, rtol=0, atol=1e-12)
    with pytest.raises(Missing):
        members_of(hybrids.ship())
    alone = [Simulator(member, compiled=False).rates(np.ones((6, 1)), np.ones((4, 1))) for member in ship.members]
    both = Simulator(ship, compiled=False).rates(np.ones((6, 1)), np.ones((4, 1)))
    np.testing.assert_allclose(np.mean(alone, axis=0), both, rtol=0, atol=1e-12)


# Distances


SIGNS = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])
"""Of u, v, r of four particles: uncorrelated, of variance 1."""


def hand_made() -> tuple[np.ndarray, np.ndarray]:
    """Particles (3, 6, 4) and truth (3, 6): in u, v, r independent, with deviations 1, 2 and 0.5 about 1."""
    paths, truth = np.zeros((3, 6, 4)), np.zeros((3, 6))
    paths[:, 3:] = 1.0 + np.array([[1.0], [2.0], [0.5]]) * SIGNS
    truth[:, 3:] = 1.0
    truth[1, 3:] += (1.0, 2.0, 0.0)
    truth[2, 3:] += (0.0, 0.0, 1.5)
    return paths, truth


def test_distances_by_hand() -> None:
    """Rows after the start: 1 + 1 and 2.25 / 0.25; a row that was not measured counts nothing; three members: none."""
    paths, truth = hand_made()
    assert mahalanobis(paths, truth) == pytest.approx((2 + 9) / 2)
    truth[1, 4] = math.nan
    assert mahalanobis(paths, truth) == pytest.approx(9)
    assert math.isnan(mahalanobis(paths[:, :, :3], truth))


def test_distances_see_correlated_states() -> None:
    """u and v that move together make an error across the line dear: e = (1, -1), Cov = [[1, .5], [.5, 1]] -> 4."""
    root = np.linalg.cholesky(np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]))
    paths, truth = np.zeros((2, 6, 4)), np.zeros((2, 6))
    paths[:, 3:], truth[1, 3:] = root @ SIGNS, (1, -1, 0)
    assert mahalanobis(paths, truth) == pytest.approx(4.0)


# Predictions


@pytest.mark.slow
@pytest.mark.parametrize("sampling", ["ts1", "ts-infinity"])
def test_a_prediction_by_members_has_their_mean_and_their_spread(sampling: str) -> None:
    limit, own = np.full(len(hybrids.ship().features), np.inf), hybrids.ship().actuators
    trial = hybrids.trials(hybrids.ship(), 1, 60)[0]
    four = hybrids.ship().with_network(to_network(random_residuals(4), own, -limit, limit))
    windows, notes = predict_members(four, trial, 20.0, 20.0, True, sampling, 1)
    assert [(w.first, w.last) for w in windows] == [(0, 20), (20, 40), (40, 60)] and len(notes) == 1
    alone = [predict_all(Simulator(m, compiled=False), [trial], 20.0, 20.0)[0][0] for m in four.members]
    for k, window in enumerate(windows):
        assert window.std is not None and (window.std[0] < 1e-12).all() and (window.std[1:, 3:] > 0).all()
        if sampling == "ts-infinity":
            paths = np.array([own[k].states for own in alone])
            np.testing.assert_allclose(window.states, paths.mean(axis=0), rtol=0, atol=2e-3)
            np.testing.assert_allclose(window.std, paths.std(axis=0), rtol=0, atol=2e-3)
    with pytest.raises(UnknownName):
        predict_members(four, trial, 20.0, 20.0, True, "ts2")


def test_members_log_by_the_instruments_of_the_campaign_of_the_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_CC", "none")  # a compiler takes longer than these windows
    ship = hybrids.lacking().with_effect("gyro")
    ship = replace(ship, campaigns={"spring": {"gyro.T": 3.0}, "autumn": {"gyro.T": 0.5}})
    trial = replace(hybrids.trials(hybrids.ship(), 1, 40)[0], meta={"campaign": "spring"})
    (window, *_), _ = predict_members(ship, trial, 20.0, 20.0, True)
    (expected, *_), _ = predict_all(Simulator(ship, compiled=False), [trial], 20.0, 20.0)[0]
    np.testing.assert_allclose(window.states, expected.states, rtol=0, atol=2e-3)
    (other, *_), _ = predict_members(ship, replace(trial, meta={"campaign": "autumn"}), 20.0, 20.0, True)
    assert np.abs(other.states - window.states)[:, 5].max() > 2e-3


# Training


def test_members_of_a_black_box_differ_by_seed_and_come_back_the_same() -> None:
    trials = hybrids.trials(hybrids.ship(), 5, 60)
    settings = BlackBoxSettings(kind="rnn-window", seeds=2, epochs=2, width=6, step=1.0, curriculum=((10.0, 1.0),))
    tasks = tasks_of(BOX_KIND, hybrids.ship(), trials, settings, trials, judged_apart=False)
    box = box_of(tasks[0], [train_one(task) for task in tasks])
    (one, _), (again, _) = (predict_members(box, trials[0], 20.0, 20.0, True, "ts1", 3) for _ in range(2))
    np.testing.assert_array_equal(one[0].states, again[0].states)
    assert one[0].std is not None and (one[0].std[1:, 3:] > 0).all()
    kept = predict_members(box, trials[0], 20.0, 20.0, True)[0]
    np.testing.assert_allclose(kept[0].states[1:], predict_all(box, trials[:1], 20.0, 20.0)[0][0][0].states[1:])
