"""The equations of a ship as torch code: what CasADi gives, values and gradients, on any device."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import torch

from benchmarks.ensembles.casadi_to_torch import TorchPhysics, emitted
from residual.physics.operator import Physics
from tests.residual.physics.test_operator import (
    ESSO,
    OTHERS,
    SHIPS,
    check_features_and_columns,
    check_gradients,
    check_rates,
    points,
)


@pytest.mark.parametrize("name", [*SHIPS, *OTHERS])
def test_values_and_gradients_are_those_of_casadi(name):
    check_rates({**SHIPS, **OTHERS}[name], TorchPhysics)


def test_gradients_are_those_of_finite_differences():
    check_gradients(TorchPhysics)


def test_features_and_columns_are_those_of_the_model():
    check_features_and_columns(TorchPhysics)


def test_every_operation_of_casadi_is_emitted_right():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    one = [ca.sqrt(x * x + 1), ca.tan(x), ca.asin(x / 9), ca.acos(x / 9), ca.atan(x), ca.sinh(x), ca.cosh(x), ca.exp(x)]
    one += [ca.log(x * x + 1), ca.fabs(x), ca.floor(x), ca.ceil(x), ca.erf(x), ca.log1p(x * x), ca.expm1(x), ca.sign(x)]
    one += [-x, 1 / x, x**2.5 * 0 + (x * x + 1) ** 2.5, ca.if_else(x > 0, x, y), ca.logic_not(x > 0), 2 * x]
    two = [ca.fmin(x, y), ca.fmax(x, 0.3), ca.atan2(y, x), ca.fmod(x, 0.7), ca.hypot(x, y), ca.copysign(x, y)]
    two += [x <= y, x < 0.5, x == y, x != y, ca.logic_and(x > 0, y > 0), ca.logic_or(x > 0, y > 0), (x * x + 1) ** y]
    f = ca.Function("every", [x, y], [ca.vertcat(*one, *two), ca.SX([3.0, 0.0])])
    values = torch.tensor([[-1.3, -0.4, 0.2, 0.9], [0.8, -0.4, 0.7, -1.1]], dtype=torch.float64)
    expected = [np.array(a) for a in f.map(4)(*values.numpy()[:, None])]
    for found, reference in zip(emitted(f)(values[:1], values[1:]), expected, strict=True):
        ok = np.isfinite(reference)
        np.testing.assert_allclose(found.numpy()[ok], reference[ok], rtol=1e-13, atol=1e-15)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_the_emitted_code_runs_on_a_gpu():
    z, c = points(ESSO)
    found = TorchPhysics(ESSO).rates(z.cuda(), c.cuda())
    torch.testing.assert_close(found.cpu(), Physics(ESSO).rates(z, c), rtol=1e-9, atol=1e-12)
