"""Functions by numpy against CasADi's virtual machine: every operation, blocks, shared inputs, sparse results."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mmg.compile import codegen, vectorised
from mmg.compile.batch import BatchFunction
from mmg.compile.vectorised import FEWEST, VectorisedFunction
from tests.mmg.compile.test_codegen import OPERATIONS, arguments, one

MANY = FEWEST + 37


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_gives_what_the_virtual_machine_gives(name: str) -> None:
    x, y = (np.resize(a, (1, MANY)) for a in arguments())
    expected = np.array([[float(one(name)(a, b)) for a, b in zip(x[0], y[0], strict=True)]])
    (found,) = VectorisedFunction(one(name))(MANY, [x, y])
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-300)


def test_all_operations_that_have_c_have_numpy() -> None:
    assert set(vectorised.OPERATIONS) == set(codegen.EXPRESSIONS)


@pytest.mark.parametrize("block", [7, FEWEST, 2 * MANY])
def test_blocks_shared_inputs_and_sparse_results(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vectorised, "BLOCK", block)
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    each = ca.vertcat(ca.sin(x[0]) * p[0], x[1] ** 2 / (2 + ca.cos(x[2])), p[1])
    f = ca.Function("f", [x, p], [each, ca.jacobian(each, x)])
    rng = np.random.default_rng(0)
    at, shared = rng.standard_normal((3, MANY)), rng.standard_normal(2)
    value, J = VectorisedFunction(f)(MANY, [at, shared])
    assert J.shape == (f.nnz_out(1), MANY) and f.nnz_out(1) < 9
    for i in (0, block % MANY, MANY - 1):
        expected, dense = f(at[:, i], shared)
        np.testing.assert_allclose(value[:, i], np.array(expected).ravel(), rtol=1e-14)
        np.testing.assert_allclose(J[:, i], np.array(dense.nonzeros()), rtol=1e-14)


def test_few_points_and_operations_that_numpy_lacks_go_through_the_virtual_machine() -> None:
    x = ca.SX.sym("x")
    f = BatchFunction(ca.Function("f", [x], [ca.asinh(x)]), None)
    at = np.linspace(-2.0, 2.0, MANY)[None]
    np.testing.assert_allclose(f(at)[0], np.arcsinh(at), rtol=1e-13)
    with pytest.raises(NotImplementedError, match=str(ca.OP_ASINH)):
        VectorisedFunction(f.function)
    g = BatchFunction(ca.Function("g", [x], [ca.sin(x) + x]), None)
    np.testing.assert_allclose(g(at)[0][:, :8], g(at[:, :8])[0], rtol=1e-14)
