"""Kernels that go several vectors at a time: the same results, the bits of IEEE 754 in quotients and roots."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from mmg.compile.batch import BatchFunction, batch_functions
from mmg.compile.batch_source import FEW, VECTORS, source
from mmg.compile.cache import compiler
from mmg.compile.codegen import LANES
from mmg.compile.staged_lanes import side_by_side
from mmg.compile.stages import Program
from mmg.rollout import Simulator
from tests.mmg.compile.test_codegen import OPERATIONS, arguments, one

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
BLOCK = VECTORS * LANES


def hot(*functions: ca.Function) -> list[BatchFunction]:
    """The functions compiled for many points."""
    found, reason = batch_functions(functions, hot=True)
    assert reason == ""
    return found


@needs_compiler
@pytest.mark.parametrize("points", [LANES, BLOCK, BLOCK + LANES, 3 * BLOCK])
def test_every_operation_gives_what_numpy_gives_in_whole_blocks_and_in_what_is_left(points: int) -> None:
    x, y = (np.resize(a, (1, points)) for a in arguments())
    for name, kernel in zip(OPERATIONS, hot(*[one(name) for name in OPERATIONS]), strict=True):
        expected = np.array([[float(one(name)(a, b)) for a, b in zip(x[0], y[0], strict=True)]])
        np.testing.assert_allclose(kernel(x, y)[0], expected, rtol=3e-15, atol=1e-300, err_msg=name)


@needs_compiler
def test_quotients_and_roots_have_the_bits_of_ieee_754() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    (f,) = hot(ca.Function("f", [x, y], [x / y, 1 / y, ca.sqrt(x)]))
    a, b = np.exp(20 * np.random.default_rng(0).standard_normal((2, 1, 40 * BLOCK)))
    for found, expected in zip(f(a, b), (a / b, 1 / b, np.sqrt(a)), strict=True):
        np.testing.assert_array_equal(found, expected)
    odd = np.array([0.0, -0.0, 1.0, -3.0, np.inf, -np.inf, np.nan, 1e308, -1e308, 1e-280])
    a, b = (np.resize(each, (1, 14 * LANES)) for each in np.meshgrid(odd, odd))
    with np.errstate(all="ignore"):
        expected = a / b, 1 / b
        root = np.where(np.isinf(a), np.nan, np.sqrt(a))
    for found, wanted in zip(f(a, b)[:2], expected, strict=True):
        np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(np.where(np.isinf(a), np.nan, f(a, b)[2]), root)


@needs_compiler
def test_a_sum_has_the_same_bits_whatever_stands_beside_it() -> None:
    x, y, z = (ca.SX.sym(name) for name in "xyz")
    total = x * y + z
    alone, beside = hot(
        ca.Function("alone", [x, y, z], [total]), ca.Function("beside", [x, y, z], [total, x * y, z - x * y])
    )
    at = np.random.default_rng(0).standard_normal((3, 1, 8 * BLOCK))
    first, product, difference = beside(*at)
    np.testing.assert_array_equal(alone(*at)[0], first)
    np.testing.assert_array_equal(product, at[0] * at[1])
    np.testing.assert_allclose(difference, at[2] - at[0] * at[1], rtol=1e-12, atol=1e-15)


def test_products_that_are_only_added_are_fused_and_others_kept() -> None:
    x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p")
    f = ca.Function("f", [x, y, p], [x * y - p, x**2 + x * y, p * p + x], {"cse": True})
    program = Program.of(f, (2, 2, 1))
    sums, inside = program.fused_sums([0, 1, 2])
    texts = sorted(each.text for each in sums.values())
    assert texts == ["more({}, {}, -{})", "more({}, {}, {})"]  # p * p is of an earlier stage
    operations = [program.values[place].operation for place in inside]
    assert operations == [ca.OP_SQ]  # x * y is taken up twice, in one sum as what is added


def test_statements_side_by_side_have_names_and_places_of_their_own() -> None:
    body = "const V a3 = q[2];\nconst V a14 = a3 * K[0];\nd[1] = a14;"
    assert side_by_side(body, "qKd", 1) == body
    assert side_by_side(body, "qKd", 2).splitlines() == [
        "const V a3_0 = q[4];",
        "const V a3_1 = q[5];",
        "const V a14_0 = a3_0 * K[0];",
        "const V a14_1 = a3_1 * K[1];",
        "d[2] = a14_0;",
        "d[3] = a14_1;",
    ]


def test_long_functions_go_one_vector_at_a_time() -> None:
    x = ca.SX.sym("x")
    y = x
    for _ in range(FEW):
        y = ca.sin(y)
    short, long = ca.Function("short", [x], [ca.sin(x)]), ca.Function("long", [x], [y])
    assert f"vectors = {VECTORS}" in source([short], hot=True)
    assert "vectors" not in source([short]) and "vectors" not in source([short, long], hot=True)


@needs_compiler
@pytest.mark.parametrize("count", [1, LANES - 1, LANES + 3, BLOCK, 3 * BLOCK + 1])
def test_rollouts_of_any_number_of_ships_are_those_without_a_compiler(count: int) -> None:
    ship, rng = load_ship("kvlcc2_l7"), np.random.default_rng(0)
    start = np.vstack([np.zeros((3, count)), rng.uniform(0.5, 1.2, (1, count)), 0.1 * rng.standard_normal((2, count))])
    controls = np.array([10.0, 0.3, 1.0, -2.0]) + 0.2 * rng.standard_normal((7, count, 4))
    controls = np.ascontiguousarray(np.moveaxis(controls, 2, 1))
    theta = ship.values[:, None] * (1 + 0.02 * rng.standard_normal((len(ship.values), count)))
    for linear in (False, True):
        ways = [Simulator(ship, way).run(start, controls, 0.2, theta, linear=linear) for way in (True, False)]
        np.testing.assert_allclose(ways[0], ways[1], rtol=1e-11, atol=1e-12)
