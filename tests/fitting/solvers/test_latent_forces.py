"""Sizes of latent forces: the evidence against dense algebra, and recovered from runs pushed by known ones."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.disturbed_trials import Disturbed, disturbed_trials
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import load_ship
from cases.simulation.sensors import SensorNoise
from fitting.calibration import estimate_coefficients
from fitting.nlp.fisher_information import Quadratics
from fitting.nlp.problem import Problem
from fitting.solvers.latent_forces import AXES, free_axes, jump_statistics, log_determinant, typical_sizes
from mmg.ship import Ship
from tests.fitting.nlp.test_fisher_information import latent

RUNS = (("random:60", 200.0), ("zigzag:20/20", 120.0), ("turning:35", 120.0))


def dense(p: Problem, parts: Quadratics, factor: np.ndarray) -> np.ndarray:
    """Hessian of the node states in the basis of first states and jumps, constraints eliminated by substitution."""
    S, B, seg = p.S, p.B, p.segments
    H = np.zeros((S * B, S * B))
    at = [slice(S * b, S * b + S) for b in range(B)]
    for b in range(B):
        H[at[b], at[b]] += parts.nodes[b, :S, :S]
        own = np.arange(S * b, S * b + S)[p.random]
        H[own, own] += (factor - 1) * p.memory_weight[b, p.random - 6] * p.scale[p.random] ** 2
    basis = np.zeros((S * B, 0))
    for i in range(p.M):
        a, b = seg.start[i], seg.end[i]
        H[at[a], at[a]] += parts.inside[i][:S, :S]
        jump = np.zeros((len(p.random), S * B))
        for row, r in enumerate(p.random):
            jump[row, S * a + r], jump[row, S * b + r] = p.decay[i], -1.0
        H += jump.T @ np.diag(p.jump_weight[i] * factor * p.scale[p.random] ** 2) @ jump
    of = {int(seg.end[i]): i for i in range(p.M)}
    columns = []
    for b in range(B):
        for s in range(S) if b not in of else p.random:
            x = np.zeros(S * B)
            x[S * b + s] = 1.0
            columns.append(x)
    basis = np.array(columns).T
    for i in sorted(range(p.M), key=lambda i: seg.start[i]):
        rows = np.arange(S * seg.end[i], S * seg.end[i] + S)[p.fixed]
        basis[rows] = parts.maps[i][p.fixed, :S] @ basis[at[seg.start[i]]]
    return basis.T @ H @ basis


def test_the_log_determinant_is_that_of_the_reduced_hessian() -> None:
    p = latent()
    p = p.with_changes(segments=p.segments.subset(np.array([0, 1])))
    x, factor = p.start(), np.array([1.0, 2.0, 0.7])
    parts = Quadratics.of(p, x)
    whole = dense(p, parts, factor)
    assert log_determinant(p, parts, factor) == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-9)
    weights = dense(p, parts, np.array([2.0, 1.0, 1.0])) - dense(p, parts, np.ones(3))
    trace = np.trace(np.linalg.solve(dense(p, parts, np.ones(3)), weights))
    assert jump_statistics(p, x)[1][0] == pytest.approx(p.M + len(p.segments.run) - trace, rel=1e-4)


def few_free() -> Ship:
    ship = load_ship("esso_osaka_3m")
    return ship.fixing([s for s in ship.symbols if s not in ("Y_v", "N_r", "X_0F", "ell_R")])


@pytest.mark.parametrize("truth", [(0.5, 0.6, 0.4), (0.15, 0.6, 0.15)])
def test_sizes_are_recovered_from_pushed_runs(truth: tuple[float, float, float]) -> None:
    how = Disturbed(*truth, tau=10.0, noise=SensorNoise(), defects=())
    trials = disturbed_trials(load_ship("esso_osaka_3m"), RUNS, 3, how)
    found = estimate_coefficients(freeing_effects(few_free(), ["disturbance"]), trials)
    sizes = [found.ship.coefficients[f"disturbance.{a}"].value for a in AXES]
    assert found.converged
    assert np.abs(np.log(np.array(sizes) / truth)).max() < np.log(1.6), sizes


def test_without_forces_the_sizes_go_to_next_to_nothing_and_given_ones_stay() -> None:
    how = Disturbed(0.0, 0.0, 0.0, tau=10.0, defects=())
    trials = disturbed_trials(load_ship("esso_osaka_3m"), RUNS[:2], 4, how)
    ship = freeing_effects(few_free(), ["disturbance:Y=0.2"])
    assert free_axes(ship) == ("X", "N")
    started = ship.with_values({f"disturbance.{a}": typical_sizes(ship)[a] for a in free_axes(ship)})
    found = estimate_coefficients(ship, trials).ship
    assert found.coefficients["disturbance.Y"].value == 0.2
    for a in ("X", "N"):
        symbol = f"disturbance.{a}"
        assert 0 < found.coefficients[symbol].value < 0.5 * started.coefficients[symbol].value
