"""Vector functions of the generated C: the C library's values to a few units of the last bit, and at the edges."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from mmg.compile.batch import BatchFunction, batch_functions
from mmg.compile.cache import compiler

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


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
