"""Compiled kernels give the numbers of the portable ways for any ship, and are tried first: shooting intervals, the
elimination of nodes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from fitting.nlp.fisher_information import Eliminated, Quadratics
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Kernels, SampleCost, Shooting, elimination
from fitting.solvers.condensing import carried, gauss_newton
from mmg.compile.batch import batch_functions
from mmg.compile.cache import compiler
from mmg.model import Model, assemble
from mmg.ship import Ship
from tests.support.quick import first_quick
from tests.support.synthetic_runs import problem, with_constants
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


def assert_same(ours: np.ndarray, theirs: np.ndarray, rtol: float = 1e-11) -> None:
    assert np.isfinite(theirs).all() and np.abs(theirs).max() > 0
    np.testing.assert_allclose(ours, theirs, rtol=rtol, atol=1e-12 * np.abs(theirs).max())


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
    ways = compiled, portable = [Shooting(way, *held) for way in (kernels.interval, kernels.portable)]
    diagonal = SampleCost(cost.pull, np.where(np.arange(kernels.S)[:, None] == 4, cost.pull, 0.0))  # of few samples
    pairs = [
        *zip(compiled.values(start, theta), portable.values(start, theta), strict=True),
        *zip(compiled.linearise(start, theta, cost.pull), portable.linearise(start, theta, cost.pull), strict=True),
    ]
    if ship not in LONGEST:
        pairs.append([way.gradient(start, theta, cost.pull, weight) for way in ways])
    for more, options in (
        ((cost,), {"by_window": True}),
        ((cost, weight, False), {}),
        ((cost, weight, True), {}),
        ((diagonal, weight), {}),
    ):
        curved = [way.hessian(start, theta, *more, **options) for way in ways]
        pairs += [[getattr(one, name) for one in curved] for name in ("ends", "slope", "rows", "shared")]
    for ours, theirs in pairs:
        assert_same(ours, theirs)


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
@pytest.mark.parametrize("law", [partly, lambda u: ca.sqrt(-1 - u * u)], ids=["partly", "nowhere"])
def test_where_the_equations_have_no_value_the_code_is_used_and_no_compiler_is_blamed(
    law: Callable[[ca.SX], ca.SX],
) -> None:
    kernels = Kernels(small_model(law), np.arange(3))
    assert kernels.interval is not None and not kernels.interpreted_because
    q = ca.SX.sym("q")
    (batch,), reason = batch_functions([ca.Function("nothing", [q], [law(q)])])
    assert batch.library is not None and not reason


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


PROBLEMS = {"plain": problem, "one interval": lambda: problem(200), "runs": lambda: with_constants(7, True)}


@pytest.mark.parametrize("kind", first_quick(PROBLEMS))
def test_nodes_are_eliminated_and_steps_carried_as_in_numpy(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    p: Problem = PROBLEMS[kind]()
    x = p.start(0.1 * np.random.default_rng(1).normal(size=p.P))
    parts, columns = Quadratics.of(p, x), p.columns
    assert elimination(True) is not None
    ours, theirs = (Eliminated.of(p.segments, parts, elimination(way)) for way in (True, False))
    names = ("rows", "slope", "ahead", "pull")[: 3 if kind == "one interval" else 4]  # no defect that pulls there
    pairs = [(getattr(ours, name), getattr(theirs, name)) for name in names]
    pairs.append(tuple(e.shared_by_window(p.segments) for e in (ours, theirs)))
    pairs.append(tuple(e.shared_by_group(columns.interval, columns.groups) for e in (ours, theirs)))
    sub, rng, W = gauss_newton(p, x), np.random.default_rng(2), len(p.segments.run)
    step = sub.maps, sub.off, rng.normal(size=(W, p.S)), rng.normal(size=(W, p.L))
    compiled = carried(p, *step)
    monkeypatch.setattr(Kernels, "elimination", None)
    for one, other in [*pairs, (compiled, carried(p, *step))]:
        assert_same(one, other, rtol=1e-9)
