"""Ensembles: particles are rollouts of members, moments and distances by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from fitting.nlp.windows import pieces_of
from mmg.errors import Missing
from residual.hybrid import HYBRID_KIND, Hybrid, Residual, to_network
from residual.papers.ensemble import bootstrapped, distances, members_of_ship, moments, particles
from residual.physics import Physics
from residual.settings import TrainSettings
from residual.system import RolloutBatch, TrainableSystem, rollout
from residual.train import restored, tasks_of, train_one
from residual.windows import windows
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
    F, result = len(hybrids.ship().features), []
    for seed in range(count):
        residual = Residual(np.linspace(0.1, 1.0, F), np.array([1e-3, 2e-3, 5e-4]), 8, seed)
        with torch.no_grad():
            residual.W3.normal_(generator=torch.Generator().manual_seed(seed))
        result.append(residual)
    return result


def hybrid_batch(steps: int = 8) -> RolloutBatch:
    pieces = pieces_of(hybrids.trials(hybrids.ship(), 2, 60), 1.0, hybrids.ship().inputs)
    batch = windows(pieces, 1.0, steps, steps)
    assert batch is not None
    return batch


# Particles


def test_ts_infinity_is_the_rollouts_of_the_members_one_by_one() -> None:
    members, batch = [Yaw(0.1, 2.0), Yaw(0.2, 2.0), Yaw(0.2, 5.0)], yaw_batch()
    paths = particles(members, batch, 6, "ts-infinity")
    assert paths.shape == (11, 6, 6, 3)
    for p in range(6):
        np.testing.assert_array_equal(paths[:, :, p], rollout(members[p % 3], batch).numpy())


@pytest.mark.parametrize("sampling", ["ts1", "ts-infinity"])
def test_members_that_agree_are_one_model_without_spread(sampling: str) -> None:
    batch = yaw_batch()
    paths = particles([Yaw(0.1, 2.0), Yaw(0.1, 2.0)], batch, 5, sampling)
    expected = rollout(Yaw(0.1, 2.0), batch).numpy()
    np.testing.assert_allclose(paths, np.repeat(expected[:, :, None], 5, axis=2), rtol=0, atol=1e-14)


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
    with pytest.raises(ValueError, match="ts2"):
        particles(members, batch, 4, "ts2")


def test_the_members_of_a_saved_network_are_those_it_was_made_of() -> None:
    residuals, batch = random_residuals(2), hybrid_batch()
    limit = np.full(len(hybrids.ship().features), np.inf)
    ship = hybrids.ship().with_network(to_network(residuals, hybrids.ship().actuators, -limit, limit))
    paths = particles(members_of_ship(ship), batch, 2)
    physics = Physics(hybrids.ship())
    for p, residual in enumerate(residuals):
        with torch.no_grad():
            expected = rollout(Hybrid(physics, residual, np.zeros((7, 1))), batch).numpy()
        np.testing.assert_allclose(paths[:, :, p], expected, rtol=0, atol=1e-12)
    with pytest.raises(Missing):
        members_of_ship(hybrids.ship())


# Moments and distances


def hand_made() -> tuple[np.ndarray, np.ndarray]:
    """Particles (3, 6, 4, 1) and truth (3, 6, 1): in u, v, r independent, with deviations 1, 2 and 0.5 about 1."""
    paths, truth = np.zeros((3, 6, 4, 1)), np.zeros((3, 6, 1))
    signs = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])
    for c, (sign, deviation) in enumerate(zip(signs, (1.0, 2.0, 0.5), strict=True)):
        paths[:, 3 + c, :, 0] = 1.0 + deviation * sign
    truth[:, 3:] = 1.0
    truth[1, 3:, 0] += (1.0, 2.0, 0.0)
    truth[2, 3:, 0] += (0.0, 0.0, 1.5)
    return paths, truth


def test_mean_and_covariance_by_hand() -> None:
    mean, covariance = moments(hand_made()[0])
    np.testing.assert_allclose(mean[1, 3:, 0], 1.0)
    np.testing.assert_allclose(covariance[1, 3:, 3:, 0], np.diag([1.0, 4.0, 0.25]), atol=1e-15)
    tied = np.array([1.0, 2.0, 3.0, 6.0])
    paths = np.zeros((1, 6, 4, 1))
    paths[0, 0, :, 0], paths[0, 4, :, 0] = tied, 2 * tied
    assert moments(paths)[1][0, 0, 4, 0] == pytest.approx(2 * tied.var())


def test_distances_by_hand() -> None:
    """Rows after the start: |e|^2 = 5 and 2.25; weighted 1 + 1 and 2.25 / 0.25."""
    paths, truth = hand_made()
    found = distances(paths, truth, np.ones_like(truth))
    assert found.euclidean[0] == pytest.approx((5 + 2.25) / 2)
    assert found.mahalanobis[0] == pytest.approx((2 + 9) / 2)
    assert found.variance[0] == pytest.approx(5.25)
    mask = np.ones_like(truth)
    mask[1, 4] = 0.0
    assert distances(paths, truth, mask).mahalanobis[0] == pytest.approx(9)
    noisy = distances(paths, truth, np.ones_like(truth), np.array([9, 9, 9, 0.0, 0.0, math.sqrt(0.75)]))
    assert noisy.mahalanobis[0] == pytest.approx((2 + 2.25) / 2)
    with pytest.raises(ValueError, match="4"):
        distances(paths[:, :, :2], truth, mask)


def test_distances_see_correlated_states() -> None:
    """u and v that move together make an error across the line dear: e = (1, -1), Cov = [[1, .5], [.5, 1]] -> 4."""
    root = np.linalg.cholesky(np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]))
    signs = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])
    paths, truth = np.zeros((2, 6, 4, 1)), np.zeros((2, 6, 1))
    paths[:, 3:, :, 0], truth[1, 3:, 0] = root @ signs, (1, -1, 0)
    found = distances(paths, truth, np.ones_like(truth))
    assert found.mahalanobis[0] == pytest.approx(4.0)
    assert found.euclidean[0] == pytest.approx(2.0)


def test_correlation_is_lower_when_the_spread_grows_with_the_bias() -> None:
    rng = np.random.default_rng(0)
    size = rng.uniform(0.1, 10, 400)
    draw = rng.normal(size=(2, 6, 20, 400))
    error = rng.normal(size=(2, 6, 400))
    truth, mask = error * size, np.ones((2, 6, 400))
    told, untold = distances(draw * size, truth, mask), distances(draw * 3.0, truth, mask)

    def correlation(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.corrcoef(np.sqrt(one), np.sqrt(other))[0, 1])

    weighted, spread = ([correlation(d.euclidean, d[i]) for d in (told, untold)] for i in (1, 2))
    assert weighted[0] < 0.5 < 0.95 < weighted[1] and spread[0] > 0.6 > abs(spread[1])


# Training


def test_members_differ_by_seed_or_resampled_blocks_and_come_back_the_same() -> None:
    trials = hybrids.trials(hybrids.lacking(), 2, 150)
    ship = hybrids.ship()
    settings = TrainSettings(seeds=2, epochs=2, width=6, step=1.0, curriculum=((10.0, 1.0),), block=50.0)

    def trained(bootstrap: bool) -> list[TrainableSystem]:
        tasks = tasks_of(HYBRID_KIND, ship, trials, settings, trials, judged_apart=False)
        return restored(tasks[0], [train_one(bootstrapped(t) if bootstrap else t) for t in tasks])

    batch = hybrid_batch()
    first, again, resampled = (particles(trained(b), batch, 2) for b in (False, False, True))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first[-1, :, 0] - first[-1, :, 1]).max() > 0
    assert np.abs(first - resampled).max() > 0


def test_resampled_blocks_are_as_many_as_there_were() -> None:
    trials = hybrids.trials(hybrids.ship(), 3, 200)
    settings = TrainSettings(seeds=2, step=1.0, block=50.0)
    tasks = tasks_of(HYBRID_KIND, hybrids.ship(), trials, settings, trials, judged_apart=False)
    one, again, other = (bootstrapped(task).split.train for task in (tasks[0], tasks[0], tasks[1]))
    assert sum(p.steps for p in one) == 600 and {p.steps for p in one} == {50}
    assert len({(p.run, p.first) for p in one}) < 12
    assert one == again != other
