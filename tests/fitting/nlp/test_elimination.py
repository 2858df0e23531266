"""The compiled elimination of nodes against that in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.nlp.fisher_information import Eliminated, Quadratics
from fitting.nlp.prior import group_sums
from fitting.nlp.problem import Problem
from fitting.nlp.shooting import Chains, Kernels, elimination
from fitting.solvers.condensing import carried, gauss_newton
from mmg.compile.cache import compiler
from tests.fitting.nlp.test_run_constants import small
from tests.support.synthetic_runs import problem

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

PROBLEMS = {"plain": problem, "one interval": lambda: problem(200), "runs": lambda: small(7, True)}


def moved(kind: str) -> tuple[Problem, np.ndarray]:
    p: Problem = PROBLEMS[kind]()
    return p, p.start(0.1 * np.random.default_rng(1).normal(size=p.P))


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROBLEMS)
def test_nodes_are_eliminated_as_in_numpy(kind: str) -> None:
    p, x = moved(kind)
    parts, columns = Quadratics.of(p, x), p.columns
    assert elimination(True) is not None
    ours, theirs = (Eliminated.of(p.segments, parts, elimination(way)) for way in (True, False))
    pairs = [(getattr(ours, name), getattr(theirs, name)) for name in ("rows", "slope", "ahead", "pull")]
    pairs.append(tuple(e.shared_by_window(p.segments) for e in (ours, theirs)))
    pairs.append(tuple(e.shared_by_group(columns.interval, columns.groups) for e in (ours, theirs)))
    for number, (one, other) in enumerate(pairs):
        # a window of one interval has no defect that pulls: nodes start where the first ends
        assert np.abs(other).max() > 0 or (kind, number) == ("one interval", 3)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.abs(other).max())


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROBLEMS)
def test_steps_are_carried_as_in_numpy(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    p, x = moved(kind)
    sub, rng, W = gauss_newton(p, x), np.random.default_rng(2), len(p.segments.run)
    first = rng.normal(size=(W, p.S))
    for coefficients in (rng.normal(size=(W, p.L)), np.zeros((W, p.L))):
        ours = carried(p, sub.maps, sub.off, first, coefficients)
        with monkeypatch.context() as without:
            without.setattr(Kernels, "elimination", None)
            theirs = carried(p, sub.maps, sub.off, first, coefficients)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max())


def test_chains_go_back_in_time_through_the_intervals_of_each_window() -> None:
    chains = Chains.of(np.array([1, 0, 1, 1]), np.array([4, 0, 2, 3]), np.array([5, 1, 3, 4]))
    assert chains.first.tolist() == [0, 1, 4]
    assert chains.number.tolist() == [1, 0, 3, 2]


# Sums by group are those of ``numpy.add.at`` to the last bit: what a fit ends at hangs on it in the fifth digit
@pytest.mark.parametrize("shape", [(), (1,), (1, 1), (2,), (3,), (8, 1), (9, 72), (62, 62)])
@pytest.mark.parametrize(("rows", "groups"), [(0, 3), (1, 1), (104, 1), (500, 26), (500, 400)])
@pytest.mark.parametrize("in_order", [True, False])
def test_sums_are_those_of_add_at(shape: tuple[int, ...], rows: int, groups: int, in_order: bool) -> None:
    rng = np.random.default_rng(rows)
    group = rng.integers(0, groups, rows)
    group = np.sort(group) if in_order else group
    values, expected = rng.standard_normal((rows, *shape)), np.zeros((groups, *shape))
    np.add.at(expected, group, values)
    for given in (values, np.asfortranarray(values)):
        found = group_sums(group, given, groups)
        assert found.shape == expected.shape and np.array_equal(found, expected)
