"""Small synthetic calibrations shared by the tests of fitting."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from mmg.model import assemble

SIGMA = np.array([0.05, 0.05, 0.01, 0.01, 0.01, 0.002])


@lru_cache(maxsize=2)
def runs(seed: int = 5) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Training and held-out trials of the hidden ship of the demo."""
    train, held_out = demo_trials(seed)
    return tuple(train), tuple(held_out)


@lru_cache(maxsize=1)
def coarse_runs() -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Training and held-out trials of the hidden ship of the demo, sampled at 2 Hz."""
    train, held_out = demo_trials(3, dt=0.5)
    return tuple(train), tuple(held_out)


@lru_cache(maxsize=4)
def kernel(free: tuple[str, ...] | None = None):  # type: ignore[no-untyped-def]
    """Derivative kernels of ESSO OSAKA for these free coefficients (default: all that are free)."""
    ship = load_ship("esso_osaka_3m")
    chosen = free or ship.free
    return Kernels(assemble(ship), np.array([ship.symbols.index(s) for s in chosen]), True)


def problem(K: int = 5, window: float = 40.0, trials: tuple[Trial, ...] | None = None) -> Problem:
    """A problem over the first three training runs with step 1 s."""
    ship = load_ship("esso_osaka_3m")
    segments = cut(trials or runs()[0][:3], 1.0, window, K)
    return Problem(ship, Prior.of(ship), kernel(), segments, SIGMA)


def matrix(sparsity: ca.Sparsity, values: np.ndarray) -> sp.csc_matrix:
    """The matrix of this pattern with these nonzeros."""
    return sp.csc_matrix((values, np.array(sparsity.row()), np.array(sparsity.colind())), shape=sparsity.shape)


def assert_exact_derivatives(p: Problem, x: np.ndarray, *directions: np.ndarray) -> None:
    """Gradient, Jacobian and Hessian of the Lagrangian at x agree with central differences along these directions
    (none: one at random).
    """
    rng, e = np.random.default_rng(1), 1e-6
    lam = rng.normal(size=p.m)

    def slope(x: np.ndarray) -> np.ndarray:
        return 0.7 * p.gradient(x) + matrix(p.patterns[0][0], p.jacobian(x)).T @ lam

    H = matrix(p.patterns[1][0], p.hessian(x, 0.7, lam))
    H = H + sp.triu(H, 1).T
    for d in directions or (rng.normal(size=p.n),):
        ahead, behind = x + e * d, x - e * d
        change = (p.objective(ahead) - p.objective(behind)) / (2 * e)
        assert p.gradient(x) @ d == pytest.approx(change, rel=1e-5, abs=1e-5)
        moved = (p.defects(ahead) - p.defects(behind)) / (2 * e)
        J = matrix(p.patterns[0][0], p.jacobian(x))
        np.testing.assert_allclose(J @ d, moved, atol=1e-6 * max(np.abs(moved).max(), 1e-3))
        bent = (slope(ahead) - slope(behind)) / (2 * e)
        np.testing.assert_allclose(H @ d, bent, atol=2e-5 * np.abs(bent).max())
