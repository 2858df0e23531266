"""The compiled elimination of nodes against that in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.nlp.fisher_information import Eliminated, Quadratics
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


@pytest.mark.parametrize("kind", PROBLEMS)
def test_nodes_are_eliminated_as_in_numpy(kind: str) -> None:
    p, x = moved(kind)
    parts, columns = Quadratics.of(p, x), p.columns
    assert elimination(True) is not None
    ours, theirs = (Eliminated.of(p.segments, parts, elimination(way)) for way in (True, False))
    pairs = [(getattr(ours, name), getattr(theirs, name)) for name in ("rows", "slope", "ahead", "pull")]
    pairs += [(e.shared_by_window(p.segments), f.shared_by_window(p.segments)) for e, f in ((ours, theirs),)]
    pairs += [tuple(e.shared_by_group(columns.interval, columns.groups) for e in (ours, theirs))]
    for one, other in pairs:
        assert np.abs(other).max() > 0
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.abs(other).max())


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
