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
from residual.own_network import OwnResidual
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


@pytest.mark.parametrize("actuators", [None, SHIP.actuators])
def test_it_is_exactly_layers_of_a_network_whatever_its_depth_and_biases(actuators: Any) -> None:
    rng = np.random.default_rng(0)
    own = OwnResidual(three_hidden(), np.linspace(0.1, 2.0, F), np.array([1e-3, 2e-3, 5e-4]), actuators)
    x = rng.normal(size=(F, 20))
    assert (own(torch.as_tensor(x)) == 0).all()
    with torch.no_grad():
        own.linear[-1].weight.normal_()
    expected = own(torch.as_tensor(x)).detach().numpy()
    found = own.scale.numpy()[:, None] * own.layers()(x / own.feature_scale.numpy()[:, None])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-17)
    assert (own(torch.zeros(F, 1, dtype=torch.float64)).abs() < 1e-18).all()


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
