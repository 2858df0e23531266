"""The compiled kernel of shooting intervals gives the numbers of the portable path for any ship, and is tried first."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from fitting.nlp.shooting import Kernels, SampleCost, Shooting
from mmg.compile.batch import batch_functions
from mmg.compile.cache import compiler
from mmg.compile.intervals import Lanes
from mmg.model import Model, assemble
from mmg.ship import Ship
from tests.support.wrong_compiler import use_wrong_compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

SHIPS = {
    "plain": lambda: load_ship("esso_osaka_3m"),
    "lags of instruments and of the hull": lambda: (
        load_ship("esso_osaka_3m").with_effect("gyro").with_effect("velocity_filter").with_effect("hull_memory")
    ),
    "twin rudders": lambda: load_ship("vectwin_3m"),
    "depends on its position": lambda: load_ship("kvlcc2_l7").with_effect("bank"),
}


def case(ship: Ship, seed: int = 0) -> tuple[Kernels, tuple, tuple]:
    """Kernels of coefficients of a ship, all where another test compiles these too, arguments of Shooting for 37
    intervals of unequal length in five windows and two groups, and start, coefficients, cost, weight."""
    rng, M, K = np.random.default_rng(seed), 37, 4
    free = [i for i, s in enumerate(ship.symbols) if not ship.effects or i % 9 == 0 or "." in s]
    kernels = Kernels(assemble(ship), np.array(free))
    steps = np.sort(rng.integers(1, K + 1, M))[::-1]
    window = np.arange(M) % 5
    order = np.argsort(window >= 3, kind="stable")  # longest first within each group
    steps, window = steps[order], window[order]
    group = (window >= 3).astype(int)
    controls = 0.2 * rng.standard_normal((K, len(kernels.model.controls), M))
    theta = np.array([ship.values, ship.values * (1 + 0.02 * rng.standard_normal(len(ship.values)))])
    start, weight = 0.1 * rng.standard_normal((2, kernels.S, M))
    inside = (steps > np.arange(1, K)[:, None])[:, None, :]
    own = kernels.measurement.own
    n = kernels.S + len(own)
    half = rng.standard_normal((K - 1, M, n, n)) * np.moveaxis(inside, 2, 1)[..., None]
    pull = rng.standard_normal((K - 1, kernels.S, M)) * inside
    cost = SampleCost(pull, pull, half + np.swapaxes(half, 2, 3), own)
    return kernels, (steps, controls, 0.2, group, window), (start, theta, cost, weight)


LONGEST = ("twin rudders", "lags of instruments and of the hull")  # 12 to 20 s to compile


@pytest.mark.slow
@pytest.mark.parametrize("ship", [pytest.param(s, marks=pytest.mark.longest) if s in LONGEST else s for s in SHIPS])
def test_kernel_and_portable_path_agree(ship: str) -> None:
    kernels, held, (start, theta, cost, weight) = case(SHIPS[ship]())
    assert kernels.interval is not None
    compiled, portable = (Shooting(way, *held) for way in (kernels.interval, kernels.portable))
    every = start, theta, cost, weight
    pairs = [
        *zip(compiled.values(start, theta), portable.values(start, theta), strict=True),
        *zip(compiled.linearise(start, theta, cost.pull), portable.linearise(start, theta, cost.pull), strict=True),
    ]
    for ours, theirs in (
        tuple(way.hessian(start, theta, cost, by_window=True) for way in (compiled, portable)),
        *((compiled.hessian(*every, middle), portable.hessian(*every, middle)) for middle in (False, True)),
    ):
        pairs += [(getattr(ours, name), getattr(theirs, name)) for name in ("ends", "slope", "rows", "shared")]
    for ours, theirs in pairs:
        assert np.isfinite(theirs).all() and np.abs(theirs).max() > 0
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12 * np.abs(theirs).max())


@pytest.mark.slow
def test_a_weight_on_few_samples_is_the_same_with_and_without_the_other_rows() -> None:
    kernels, held, (start, theta, cost, weight) = case(load_ship("esso_osaka_3m"))
    diagonal = SampleCost(cost.pull, np.where(np.arange(kernels.S)[:, None] == 4, cost.pull, 0.0))
    assert kernels.interval is not None
    ways = kernels.interval, kernels.portable
    found = [Shooting(way, *held).hessian(start, theta, diagonal, weight) for way in ways]
    for ours, theirs in ([c.shared for c in found], [c.rows for c in found]):
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12 * np.abs(theirs).max())


@pytest.mark.slow
def test_second_derivatives_in_the_middle_of_steps_tend_to_those_of_the_stages() -> None:
    """The midpoint rule is of second order: a quarter of the error at half the step, in the median interval, as those
    that cross a blend near rest show it at shorter steps alone."""
    kernels, (steps, controls, _, group, window), (start, theta, _, weight) = case(load_ship("esso_osaka_3m"))
    away = []
    for parts in (8, 16, 32):  # the same time in shorter steps
        finer = steps * parts, np.repeat(controls, parts, axis=0), 0.2 / parts, group, window
        nothing = np.zeros((parts * len(controls) - 1, kernels.S, len(steps)))
        cost = SampleCost(nothing, nothing)
        shooting = Shooting(kernels.interval, *finer)
        stages, middle = (shooting.hessian(start, theta, cost, weight, way) for way in (False, True))
        away.append(np.linalg.norm(middle.rows - stages.rows, axis=(1, 2)) / np.linalg.norm(stages.rows, axis=(1, 2)))
        assert np.linalg.norm(middle.shared - stages.shared) < 0.01 * np.linalg.norm(stages.shared)
    np.testing.assert_allclose([np.median(away[k] / away[k + 1]) for k in (0, 1)], 4, rtol=0.01)


def test_every_interval_is_calculated_once_and_each_window_in_one_share() -> None:
    rng = np.random.default_rng(1)
    window = np.sort(rng.integers(0, 40, 500))
    steps = rng.integers(1, 6, 500)
    lanes = Lanes.of(steps, np.zeros((5, 1, 500)), 0.1, np.zeros(500, dtype=int), window)
    assert sorted(lanes.interval[lanes.slot >= 0]) == list(range(500))
    assert (lanes.steps[lanes.slot < 0] == 0).all()
    np.testing.assert_array_equal(lanes.interval[lanes.position], np.arange(500))
    seen = [set(lanes.slot[8 * a : 8 * b]) - {-1} for a, b in lanes.shares]
    assert len(seen) > 1 and sum(map(len, seen)) == len(set(window))


def small_model(change: Callable[[ca.SX], ca.SX]) -> Model:
    """A point mass with drag, drift and a yaw moment, quick to compile; its rate of surge is multiplied by ``change``
    of the surge velocity."""
    model = assemble(load_ship("kvlcc2_l7"))
    z, c, p = (ca.SX.sym(name, model.rates.size1_in(i)) for i, name in enumerate("zcp"))
    _, _, psi, u, v, r = ca.vertsplit(z)
    speed = ca.sqrt(u * u + v * v + 0.01)
    over_ground = u * ca.cos(psi) - v * ca.sin(psi), u * ca.sin(psi) + v * ca.cos(psi), r
    slow = 0.01 * (c[0] - p[0] * u * speed + v * r) * change(u)  # as a ship of 7 m
    return replace(
        model,
        rates=ca.Function(
            "rates", [z, c, p], [ca.vertcat(*over_ground, slow, p[1] * v * speed - u * r, p[2] * u * r + c[1] * speed)]
        ),
    )


def partly(u: ca.SX) -> ca.SX:
    """No number for u < -0.03, at a third of the points of the test, and infinite for u < -0.1 by its derivatives."""
    return 1 + ca.sqrt(u + 0.03)


@pytest.mark.slow
def test_where_the_equations_have_no_value_the_compiler_is_not_blamed() -> None:
    kernels = Kernels(small_model(partly), np.arange(3))
    assert kernels.interval is not None and not kernels.interpreted_because


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "law"),
    [
        ("s/adjoint\\[s\\] + later/adjoint[s] - later/", lambda u: ca.SX(1)),
        ("s/whole\\[s\\] += u/whole[s] -= u/", lambda u: ca.SX(1)),
        ("s/more(part, d3/more(part, -d3/", partly),
    ],
)
def test_wrong_code_of_a_compiler_is_found_also_beside_points_without_a_value_and_not_kept(
    change: str, law: Callable[[ca.SX], ca.SX], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A compiler that turns one product of the sensitivities, or one sum of multipliers, into another: everything still
    runs."""
    cache = use_wrong_compiler(change, tmp_path, monkeypatch)
    kernels = Kernels(small_model(law), np.arange(3))
    assert kernels.interval is None and cache.is_dir() and not list(cache.glob("*.so"))
    assert "cc.sh" in kernels.interpreted_because
    assert float(re.findall(r"by ([0-9.e+-]+),", kernels.interpreted_because)[0]) > 1e-9


@pytest.mark.slow
def test_code_that_cannot_be_compared_is_used_and_no_compiler_is_blamed() -> None:
    q = ca.SX.sym("q")
    (batch,), reason = batch_functions([ca.Function("nothing", [q], [ca.sqrt(-1 - q * q)])])
    kernels = Kernels(small_model(lambda u: ca.sqrt(-1 - u * u)), np.arange(3))
    assert batch.library is not None and kernels.interval is not None
    assert not reason and not kernels.interpreted_because
