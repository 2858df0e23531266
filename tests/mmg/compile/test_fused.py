"""Rollouts of any number of ships."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.compile.cache import compiler
from mmg.compile.codegen import LANES
from mmg.rollout import Simulator

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@needs_compiler
@pytest.mark.parametrize("count", [1, LANES - 1, LANES + 3, 6 * LANES + 1])
def test_rollouts_of_any_number_of_ships_are_those_without_a_compiler(count: int) -> None:
    ship, rng = load_ship("kvlcc2_l7"), np.random.default_rng(0)
    start = np.vstack([np.zeros((3, count)), rng.uniform(0.5, 1.2, (1, count)), 0.1 * rng.standard_normal((2, count))])
    controls = np.array([10.0, 0.3, 1.0, -2.0]) + 0.2 * rng.standard_normal((7, count, 4))
    controls = np.ascontiguousarray(np.moveaxis(controls, 2, 1))
    theta = ship.values[:, None] * (1 + 0.02 * rng.standard_normal((len(ship.values), count)))
    for linear in (False, True):
        ways = [Simulator(ship, way).run(start, controls, 0.2, theta, linear=linear) for way in (True, False)]
        np.testing.assert_allclose(ways[0], ways[1], rtol=1e-11, atol=1e-12)
