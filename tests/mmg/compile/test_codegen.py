"""Compiled batch kernels: every operation as CasADi gives it, in vectors and one by one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from mmg.compile import batch, codegen
from mmg.compile.batch import BatchFunction, batch_functions
from mmg.compile.cache import UNIT, compiler
from mmg.compile.codegen import LANES

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")

POINTS = 4 * LANES

UNARY = ("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "exp", "expm1", "erf", "fabs", "floor", "ceil", "sign")
BINARY = ("atan2", "fmin", "fmax", "fmod", "hypot", "copysign")
# Name -> an expression of x and y in which CasADi keeps that operation.
OPERATIONS: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    **{name: lambda x, y, f=getattr(ca, name): f(x) for name in UNARY},
    **{name: lambda x, y, f=getattr(ca, name): f(x, y) for name in BINARY},
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
    "asin": lambda x, y: ca.asin(0.3 * x),
    "acos": lambda x, y: ca.acos(0.3 * x),
    "log": lambda x, y: ca.log(1 + x * x),
    "log1p": lambda x, y: ca.log1p(x * x),
    "power": lambda x, y: ca.fabs(x) ** y,
    "constant power": lambda x, y: ca.fabs(x) ** 2.7,
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


@pytest.mark.slow
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


def test_every_operation_that_has_c_is_in_an_expression_above() -> None:
    """Leaves out only assignment, which CasADi removes."""
    tested = set[int]().union(*(operations_of(one(name)) for name in OPERATIONS))
    assert set(codegen.EXPRESSIONS) - {ca.OP_ASSIGN} | {ca.OP_CONST} == tested - {ca.OP_INPUT, ca.OP_OUTPUT}


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


# Vector functions of the generated C: the C library's values to a few units of the last bit, and at the edges


def arguments_of(name: str) -> tuple[np.ndarray, ...]:
    """Arguments over the whole range of a function, small and large ones and whole multiples of pi / 4 among them."""
    rng = np.random.default_rng(5)
    x = np.concatenate([
        rng.standard_normal(20000), 40 * rng.standard_normal(20000), 10.0 ** rng.uniform(-300, 2, 2000),
        np.arange(-400, 400) * math.pi / 4, rng.uniform(-3e5, 3e5, 2400),
    ])  # fmt: skip
    if name == "atan2":
        return x, rng.permutation(x)
    return (np.clip(x, -700, 700) if name == "exp" else x,)


NUMPY = {"exp": np.exp, "tanh": np.tanh, "sin": np.sin, "cos": np.cos, "atan2": np.arctan2}


def own(name: str) -> BatchFunction:
    """A function of the C code by itself."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    given = [x, y] if name == "atan2" else [x]
    (batch,), reason = batch_functions([ca.Function(f"own_{name}", given, [getattr(ca, name)(*given)])])
    assert reason == ""
    return batch


@needs_compiler
@pytest.mark.parametrize("name", NUMPY)
def test_own_functions_are_those_of_the_c_library_to_four_units_of_the_last_bit(name: str) -> None:
    (got,) = own(name)(*(a[None] for a in arguments_of(name)))
    expected = NUMPY[name](*arguments_of(name))
    assert (np.abs(got[0] - expected) <= 4 * np.spacing(np.abs(expected))).all()


SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e308, -1e308, 800.0, -800.0, 22.0, 3.0, 1e5]


@needs_compiler
@pytest.mark.parametrize("name", NUMPY)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_own_functions_at_the_edges(name: str) -> None:
    grid = np.array(SPECIAL)
    given = tuple(a.ravel() for a in np.meshgrid(grid, grid)) if name == "atan2" else (grid,)
    (got,) = own(name)(*(a[None] for a in given))
    expected = NUMPY[name](*given)
    np.testing.assert_allclose(got[0], expected, rtol=1e-15, atol=1e-320)
    if name in ("tanh", "atan2"):
        there = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(got[0][there]), np.signbit(expected[there]))


# Long functions are compiled in parts


def long_function(terms: int) -> ca.Function:
    """A long sum of products of two arguments."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    total = p[0] * p[1]
    for k in range(terms):
        total = ca.sin(total + k * x[k % 3]) * p[k % 2]
    return ca.Function("sines", [x, p], [total, x[0] * total])


@needs_compiler
def test_a_function_in_parts_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    inputs, found = [np.random.default_rng(j).standard_normal((3 - j, 24)) for j in range(2)], []
    for size in (10**6, 20, 7):
        monkeypatch.setattr(codegen, "FUNCTION_SIZE", size)
        monkeypatch.setenv("MMG_CACHE", str(tmp_path / str(size)))
        (whole,), reason = batch_functions([long_function(30)])
        assert not reason
        found.append(whole(*inputs))
    for parts in found[1:]:
        np.testing.assert_array_equal(parts, found[0])


def test_no_part_has_more_instructions_than_a_compiler_likes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codegen, "FUNCTION_SIZE", 50)
    monkeypatch.setattr(codegen, "UNIT_TEXT", 12_000)
    units = batch.source([long_function(300)]).split(UNIT)
    parts = [part for unit in units for part in unit.split("HIDDEN void ")[1:] if "{" in part]
    operation = re.compile(r"^ *const V w\d+ = ", re.MULTILINE)
    assert max(len(operation.findall(part)) for part in parts) == codegen.FUNCTION_SIZE
    assert len(units) > 2 and sum(part.count("v_sin") for part in parts) == 300
