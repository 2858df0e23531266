"""A torch module and a loss of a user train a residual, which is then in the ship as any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

import mmg_ident as mi
from delivery.c.source import c_files
from residual.hybrid import Hybrid, Residual, Symmetric, layers_of, to_network
from residual.physics import Physics
from residual.settings import BlackBoxSettings, TrainSettings
from tests.support import hybrids
from tests.support.c_products import product

SHIP = hybrids.ship()
F = len(SHIP.features)
QUICK = TrainSettings(seeds=1, epochs=2, step=1.0, stride=10.0, rate=1e-2, batch=4096)


def three_hidden() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(
        nn.Linear(F, 6), nn.Tanh(), nn.Sequential(nn.Linear(6, 5, bias=False), nn.Tanh()), nn.Linear(5, 3)
    )


@pytest.mark.parametrize("symmetric", [False, True])
def test_it_is_the_module_less_its_value_at_the_origin_whatever_its_depth_and_biases(symmetric: bool) -> None:
    rng, module, scale = np.random.default_rng(0), three_hidden().double(), np.array([1e-3, 2e-3, 5e-4])
    residual = Residual(np.linspace(0.1, 2.0, F), scale, layers_of(module))
    q = torch.as_tensor(rng.normal(size=(F, 20)))
    x = q * residual.feature_scale[:, None]
    assert (residual(x) == 0).all()
    with torch.no_grad():
        residual.W3.copy_(module[-1].weight)
        made = (module(q.T) - module(torch.zeros(1, F, dtype=torch.float64))).T
    own = Symmetric(residual, SHIP.actuators) if symmetric else residual
    found = to_network([own], SHIP.actuators, -np.ones(F), np.ones(F)).accelerations(x.numpy())
    np.testing.assert_allclose(found, own(x).detach().numpy(), rtol=1e-12, atol=1e-17)
    if not symmetric:
        np.testing.assert_allclose(found, scale[:, None] * made.numpy(), rtol=1e-12, atol=1e-17)


def test_two_layers_of_one_width_go_through_the_compiled_loop() -> None:
    two = nn.Sequential(nn.Linear(F, 6), nn.Tanh(), nn.Linear(6, 6), nn.Tanh(), nn.Linear(6, 3))
    for module, fused in ((two, True), (three_hidden(), False)):
        residual = Residual(np.ones(F), np.ones(3), layers_of(module))
        assert (Hybrid(Physics(SHIP), residual, np.ones((F, 1))).fused is not None) == fused


@pytest.mark.slow
def test_trained_with_an_own_loss_it_is_in_the_ship_that_is_saved_and_exported(tmp_path: Path) -> None:
    seen = []

    def absolute(errors: torch.Tensor) -> torch.Tensor:
        seen.append(tuple(errors.shape))
        return errors.abs().mean()

    trials = hybrids.trials(SHIP, 2, 120)
    result = mi.train(SHIP, trials, settings=QUICK, keep="always", network=three_hidden(), loss=absolute)
    assert result.network is not None and [len(m.biases) for m in result.network.members] == [2]
    assert seen and all(shape[1] == 6 for shape in seen)
    result.save(tmp_path / "run", report=False)
    again = mi.load_ship(tmp_path / "run")
    assert again.network is not None
    x = np.ones((F, 1))
    np.testing.assert_array_equal(again.network.accelerations(x), result.network.accelerations(x))
    assert c_files(product(again))


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"network": 3}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 3))}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 8), nn.ReLU(), nn.Linear(8, 3))}, "ReLU"),
        ({"network": nn.Sequential(nn.Linear(F + 1, 8), nn.Tanh(), nn.Linear(8, 3))}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 8), nn.Tanh(), nn.Linear(7, 3))}, "network"),
        ({"loss": 3}, "loss"),
        ({"loss": lambda errors: 3.0}, "loss"),
        ({"loss": lambda errors: errors}, "loss"),
        ({"loss": lambda errors: errors.mean(), "settings": TrainSettings(loss="acceleration")}, "loss"),
        ({"loss": lambda errors: errors.mean(), "settings": BlackBoxSettings()}, "loss"),
    ],
)
def test_a_network_or_loss_that_cannot_be_is_refused(changed: dict[str, Any], word: str) -> None:
    with pytest.raises(mi.UserError) as caught:
        mi.train(SHIP, hybrids.trials(SHIP, 2, 120), **{"settings": QUICK, **changed})
    assert word in str(caught.value) and "\n" not in str(caught.value)
