"""Compiled batch kernels: every operation as CasADi gives it, in vectors and one by one."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from mmg.compile import batch, codegen
from mmg.compile.batch import batch_functions, padded
from mmg.compile.cache import compiler
from mmg.compile.codegen import LANES

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")

POINTS = 4 * LANES

OPERATIONS: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "add": lambda x, y: x + y,
    "subtract": lambda x, y: x - y,
    "multiply": lambda x, y: x * y,
    "divide": lambda x, y: x / y,
    "negate": lambda x, y: -x,
    "square": lambda x, y: x**2,
    "twice": lambda x, y: 2 * x,
    "inverse": lambda x, y: 1 / x,
    "assign": lambda x, y: x,
    "constant": lambda x, y: ca.SX(1 / 3) + 0 * x,
    "sqrt": lambda x, y: ca.sqrt(ca.fabs(x)),
    "sin": lambda x, y: ca.sin(x),
    "cos": lambda x, y: ca.cos(x),
    "tan": lambda x, y: ca.tan(x),
    "asin": lambda x, y: ca.asin(0.3 * x),
    "acos": lambda x, y: ca.acos(0.3 * x),
    "atan": lambda x, y: ca.atan(x),
    "sinh": lambda x, y: ca.sinh(x),
    "cosh": lambda x, y: ca.cosh(x),
    "tanh": lambda x, y: ca.tanh(x),
    "exp": lambda x, y: ca.exp(x),
    "log": lambda x, y: ca.log(1 + x * x),
    "log1p": lambda x, y: ca.log1p(x * x),
    "expm1": lambda x, y: ca.expm1(x),
    "erf": lambda x, y: ca.erf(x),
    "fabs": lambda x, y: ca.fabs(x),
    "floor": lambda x, y: ca.floor(x),
    "ceil": lambda x, y: ca.ceil(x),
    "sign": lambda x, y: ca.sign(x),
    "power": lambda x, y: ca.fabs(x) ** y,
    "constant power": lambda x, y: ca.fabs(x) ** 2.7,
    "atan2": lambda x, y: ca.atan2(x, y),
    "fmin": lambda x, y: ca.fmin(x, y),
    "fmax": lambda x, y: ca.fmax(x, y),
    "fmod": lambda x, y: ca.fmod(x, y),
    "hypot": lambda x, y: ca.hypot(x, y),
    "copysign": lambda x, y: ca.copysign(x, y),
    "less": lambda x, y: x < y,
    "less or equal": lambda x, y: x <= y,
    "equal": lambda x, y: ca.eq(x, y),
    "not equal": lambda x, y: ca.ne(x, y),
    "and": lambda x, y: ca.logic_and(x, y),
    "or": lambda x, y: ca.logic_or(x, y),
    "not": lambda x, y: ca.logic_not(x),
    "if_else": lambda x, y: ca.if_else(x > y, ca.sin(x), y * y),
    "if_else of nothing": lambda x, y: ca.if_else(x >= 0, x, 0),
    "if_else keeps away from the branch not taken": lambda x, y: ca.if_else(x > 0, ca.log(x), y),
    "infinite constant": lambda x, y: ca.fmin(x, ca.SX.inf()),
    "undefined constant": lambda x, y: ca.SX.nan() + x,
}
"""Name -> an expression of x and y in which CasADi keeps that operation."""

KEPT = {
    ca.OP_ADD: "add", ca.OP_SUB: "subtract", ca.OP_MUL: "multiply", ca.OP_DIV: "divide", ca.OP_NEG: "negate",
    ca.OP_SQ: "square", ca.OP_TWICE: "twice", ca.OP_INV: "inverse", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin",
    ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_EXP: "exp", ca.OP_LOG: "log",
    ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1", ca.OP_ERF: "erf", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil", ca.OP_SIGN: "sign", ca.OP_POW: "power", ca.OP_CONSTPOW: "constant power",
    ca.OP_ATAN2: "atan2", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_FMOD: "fmod", ca.OP_HYPOT: "hypot",
    ca.OP_COPYSIGN: "copysign", ca.OP_LT: "less", ca.OP_LE: "less or equal", ca.OP_EQ: "equal",
    ca.OP_NE: "not equal", ca.OP_AND: "and", ca.OP_OR: "or", ca.OP_NOT: "not", ca.OP_IF_ELSE_ZERO: "if_else",
    ca.OP_CONST: "constant",
}  # fmt: skip
"""Operation -> the entry of OPERATIONS that must contain it."""


def one(name: str) -> ca.Function:
    """The operation as an SXFunction of x and y with a C name."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return ca.Function("op_" + name.replace(" ", "_"), [x, y], [OPERATIONS[name](x, y)])


def operations_of(function: ca.Function) -> set[int]:
    return {function.instruction_id(k) for k in range(function.n_instructions())}


def arguments() -> tuple[np.ndarray, np.ndarray]:
    """x and y (1, POINTS): all quadrants, zeros, equal values and whole numbers among them."""
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-3, 3, (2, 1, POINTS))
    x[0, :8] = (0.0, 0.0, 1.5, 2.0, -2.0, -0.0, 1.0, 0.0)
    y[0, :8] = (0.0, 2.0, 1.5, -1.0, -1.0, 0.7, 0.0, -1.0)
    return x, y


@pytest.fixture(scope="module")
def compiled() -> dict[str, object]:
    """All operations in one compiled library."""
    functions = [one(name) for name in OPERATIONS]
    batch, reason = batch_functions(functions)
    assert reason == ""
    return dict(zip(OPERATIONS, batch, strict=True))


# Operations


@needs_compiler
@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_gives_the_same_compiled_and_interpreted(name: str, compiled: dict) -> None:
    x, y = arguments()
    expected = np.array([[float(one(name)(a, b)) for a, b in zip(x[0], y[0], strict=True)]])
    assert np.isfinite(expected).any() or "undefined" in name
    (got,) = compiled[name](x, y)
    np.testing.assert_allclose(got, expected, rtol=1e-14, atol=0)
    ((interpreted,), _) = batch_functions([one(name)], compiled=False)
    np.testing.assert_array_equal(interpreted(x, y)[0], expected)


@pytest.mark.parametrize("operation", KEPT)
def test_the_expressions_above_do_contain_their_operation(operation: int) -> None:
    assert operation in operations_of(one(KEPT[operation]))


def test_every_operation_that_has_c_is_among_those_tested() -> None:
    """Leaves out only assignment, which CasADi removes."""
    assert set(codegen.EXPRESSIONS) - {ca.OP_ASSIGN} | {ca.OP_CONST} == set(KEPT)


def test_an_operation_without_c_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match=str(ca.OP_ASINH)):
        batch.kernel(ca.Function("f", [x], [ca.asinh(x)]))


@needs_compiler
def test_derivatives_and_sparse_results_come_out_as_nonzeros_in_order() -> None:
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 3)
    f = ca.vertcat(p[0] * x[0] * x[2], ca.sin(x[1]) * p[1], x[3] / p[2])
    jacobian = ca.Function("sparse", [x, p], [ca.jacobian(f, x), f])
    (batch,), reason = batch_functions([jacobian])
    assert reason == ""
    rng = np.random.default_rng(0)
    points, shared = rng.uniform(0.5, 2, (4, 16)), rng.uniform(0.5, 2, 3)
    nonzeros, values = batch(points, shared)
    for k in range(16):
        expected, value = jacobian(points[:, k], shared)
        np.testing.assert_allclose(nonzeros[:, k], expected.nonzeros(), rtol=1e-14)
        np.testing.assert_allclose(values[:, k], np.array(value).ravel(), rtol=1e-14)


# Points


@needs_compiler
@pytest.mark.parametrize("points", [1, LANES - 1, LANES + 1])
def test_a_number_of_points_that_fills_no_vector_is_refused(points: int) -> None:
    (add,), reason = batch_functions([one("add")])
    assert reason == ""
    with pytest.raises(ValueError, match=f"{points} .*{LANES}"):
        add(np.zeros((1, points)), np.zeros((1, points)))


@pytest.mark.parametrize(("points", "expected"), [(0, 8), (1, 8), (8, 8), (9, 16), (16, 16), (17, 24)])
def test_padding_goes_to_the_next_multiple(points: int, expected: int) -> None:
    assert LANES == 8
    assert padded(points) == expected
