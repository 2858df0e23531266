"""The one Runge-Kutta step serves every kind of array, and has the order it claims."""

from __future__ import annotations

import casadi as ca
import numpy as np
import torch

from mmg.runge_kutta import NODES, PARTS, WEIGHTS, rk4_step


def test_the_step_has_fourth_order() -> None:
    errors = []
    for h in (0.2, 0.1):
        z = np.array([1.0])
        for k in range(round(1 / h)):
            z = rk4_step(lambda state, at, begin=k * h, h=h: state * np.cos(begin + at * h), z, h)
        errors.append(abs(float(z[0]) - np.exp(np.sin(1.0))))
    assert 12 < errors[0] / errors[1] < 20


def test_expressions_and_tensors_take_the_same_step_as_arrays() -> None:
    start, h = np.array([0.3, -1.2]), 0.1
    expected = rk4_step(lambda z, _: z**2 - z, start, h)
    z = ca.SX.sym("z", 2)
    step = ca.Function("step", [z], [rk4_step(lambda state, _: state**2 - state, z, h)])
    np.testing.assert_allclose(np.array(step(start)).ravel(), expected, rtol=1e-15)
    np.testing.assert_allclose(rk4_step(lambda z, _: z**2 - z, torch.tensor(start), h).numpy(), expected, rtol=1e-15)


def test_the_step_is_that_of_its_nodes_and_weights() -> None:
    z, h = np.array([0.7]), 0.3
    rate, total = np.zeros(1), np.zeros(1)
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        rate = np.sin(z + node * h * rate)
        total += weight * rate
    np.testing.assert_allclose(rk4_step(lambda state, _: np.sin(state), z, h), z + h * total, rtol=1e-15)
    assert sum(PARTS) == 6 and abs(sum(WEIGHTS) - 1) < 1e-15
