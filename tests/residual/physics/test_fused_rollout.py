"""Fused rollouts with a network: the same states and gradients as the loop of single steps."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cases.shipfiles.ship_file import load_ship
from mmg.compile.cache import compiler
from residual.bounded_network import Residual
from residual.physics.fused_rollout import FusedRollout
from residual.physics.operator import Physics
from residual.system import Hybrid, TrainableSystem
from tests.residual.physics.test_operator import OTHERS, points
from tests.support.networks import random_network
from tests.support.quick import first_quick

SHIPS = {"esso": load_ship("esso_osaka_3m"), "vectwin": load_ship("vectwin_3m"), **OTHERS}


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize("name", first_quick(SHIPS))
def test_states_and_gradients_are_those_of_single_steps(name, method):
    ship = SHIPS[name]
    physics, residual = Physics(ship), Residual.of_network(random_network(ship, width=10))
    z, c = (a[:, 6:19] for a in points(ship))
    inputs = torch.stack([c * (1 + 0.05 * k) for k in range(12)])
    draw = torch.Generator().manual_seed(0)
    weights = torch.randn((13, *z.shape), generator=draw, dtype=torch.float64)
    results = []
    for fused in (True, False):
        start = z.clone().requires_grad_()
        if fused:
            states = FusedRollout(physics, 10)(start, inputs, 0.05, residual, method)
        else:
            system = Hybrid(physics, residual, np.zeros((len(ship.features), 1)))
            states = TrainableSystem.simulate(system, start, inputs, 0.05, method)
        gradients = torch.autograd.grad((states * weights).sum(), [start, *residual.parameters()])
        results.append([states.detach(), *gradients])
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-10 * float(other.abs().max()))
        assert other.abs().max() > 0


def test_shapes_that_do_not_fit_are_refused():
    ship = SHIPS["esso"]
    z, c = points(ship)
    residual = Residual.of_network(random_network(ship))
    with pytest.raises(ValueError, match="fit"):
        FusedRollout(Physics(ship), 8)(z, c[None, :, :-1], 0.1, residual)
    with pytest.raises(ValueError, match="fit"):
        FusedRollout(Physics(ship), 9)(z, c[None], 0.1, residual)
