"""Calibrated spread of an ensemble holds the truth; a stacked ensemble has the losses and gradients of its members."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import torch

from benchmarks.ensembles.casadi_to_torch import TorchPhysics
from benchmarks.ensembles.spread_calibration import calibrated, coverage
from benchmarks.ensembles.stacked import Stacked, losses, on
from mmg.errors import UserError
from residual.physics.operator import Physics
from residual.rollout import state_loss
from residual.system import Hybrid
from tests.residual.test_ensemble import hybrid_batch, random_residuals
from tests.support import hybrids


def synthetic(seed: int, M: int, common: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Particles too close together by a factor 3, a common error growing with time; every fifth row unmeasured."""
    rng = np.random.default_rng(seed)
    N, P = 30, 12
    size = rng.uniform(0.2, 2.0, (1, 6, M)) * np.linspace(0, 1, N + 1)[:, None, None]
    paths = size[:, :, None] * rng.normal(size=(1, 6, P, M))
    own = size * rng.normal(size=(1, 6, M)) * 3
    shared = common * np.linspace(0, 1, N + 1)[:, None, None] * rng.normal(size=(1, 6, M))
    mask = np.ones((N + 1, 6, M))
    mask[4::5] = 0.0
    return paths, np.where(mask > 0, paths.mean(axis=2) + own + shared, 99.0), mask


@pytest.mark.parametrize("common", [0.0, 4.0])
def test_calibrated_bands_hold_nine_of_ten_truths_in_other_windows(common: float) -> None:
    spread = calibrated(*synthetic(0, 600, common), h=1.0)
    paths, truth, mask = synthetic(1, 600, common)
    np.testing.assert_allclose(coverage(paths, truth, mask, spread.std(paths)), 0.9, atol=0.035)
    raw = coverage(paths, truth, mask, np.sqrt(paths.var(axis=2)))
    assert (raw < 0.65).all(), "the particles themselves must be too close together in this test"


def test_the_factor_is_found_and_the_common_part_told_from_it() -> None:
    """Twelve particles tell their own deviation with 11 degrees of freedom: 3 t_11(0.95) sqrt(12 / 11) / 1.645."""
    alone = calibrated(*synthetic(0, 800, 0.0), h=1.0, common=False)
    np.testing.assert_allclose(alone.factor, 3 * 1.796 * math.sqrt(12 / 11) / 1.645, rtol=0.08)
    both = calibrated(*synthetic(0, 800, 6.0), h=1.0)
    paths = synthetic(0, 2, 0.0)[0] * 0
    np.testing.assert_allclose(both.std(paths)[-1, :, 0], 6.0, rtol=0.15)
    assert (both.factor < 5.0).all()


def test_the_factor_multiplies_the_particles_and_the_common_part_does_not() -> None:
    spread = calibrated(*synthetic(0, 400, 4.0), h=1.0)
    paths = synthetic(1, 3, 0.0)[0]
    more = spread.std(2 * paths) ** 2 - spread.std(paths) ** 2
    np.testing.assert_allclose(more, 3 * spread.factor[:, None] ** 2 * paths.var(axis=2), atol=1e-12)


def test_too_few_windows_to_calibrate_on_are_refused() -> None:
    with pytest.raises(UserError, match="at least 100"):
        calibrated(*synthetic(0, 2, 1.0), h=1.0)


@pytest.mark.parametrize("make", [Physics, TorchPhysics])
def test_the_stacked_ensemble_has_the_losses_and_gradients_of_its_members(make: type[Physics]) -> None:
    residuals, batch = random_residuals(3), hybrid_batch(4)
    sigma = torch.tensor([1.0, 1.0, 0.3, 0.1, 0.05, 0.02], dtype=torch.float64)
    stacked = Stacked(make(hybrids.ship()), copy.deepcopy(residuals))
    found = losses(stacked, on(batch, 3), sigma)
    found.sum().backward()
    physics = Physics(hybrids.ship())
    for i, residual in enumerate(residuals):
        loss = state_loss(Hybrid(physics, residual, np.zeros((7, 1))), batch, sigma)
        loss.backward()
        assert found[i].item() == pytest.approx(loss.item(), rel=1e-9)
        for mine, single in zip(stacked.members[i].parameters(), residual.parameters(), strict=True):
            torch.testing.assert_close(mine.grad, single.grad, rtol=1e-7, atol=1e-12)
