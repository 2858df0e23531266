"""Runs left out of a finished calibration: close to refits, honest about constants, bounds and files."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.fisher_information import Information
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.left_out_runs import each_alone, estimates_without, leave_out, relative_change
from fitting.settings import Settings
from mmg.rollout import Simulator
from tests.support.synthetic_runs import coarse_runs

FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "Y_A1")


@cache
def calibrated() -> tuple[list[Trial], Calibration]:
    """Four short runs of the hidden ship of the demo and six coefficients fitted to them."""
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    trials = coarse_runs()[0][:4]
    return trials, estimate_coefficients(start, trials, Settings(passes=2))


def quadratic() -> Information:
    """Six windows of three runs whose cost is a quadratic in two coefficients."""
    rng = np.random.default_rng(4)
    J = rng.standard_normal((6, 9, 2))
    F = np.swapaxes(J, 1, 2) @ J
    y = np.einsum("wij,j->wi", F, np.array([0.4, -0.3])) + 0.2 * rng.standard_normal((6, 2))
    p = np.linalg.solve(F.sum(axis=0) + np.eye(2), y.sum(axis=0))
    return Information(F, F @ p - y, p, np.repeat([0, 1, 2], 2), ("a", "b"), np.eye(2), p.copy())


FAR = (np.full(2, -9.0), np.full(2, 9.0))


def test_the_estimate_without_a_run_is_exact_for_a_quadratic_cost():
    info = quadratic()
    found = estimates_without(info, each_alone(3), FAR)
    for run in range(3):
        rest = info.run != run
        F = info.fisher[rest]
        y = (F @ info.p - info.score[rest]).sum(axis=0)
        assert np.allclose(found[run], np.linalg.solve(F.sum(axis=0) + np.eye(2), y))
    nothing, every = estimates_without(info, [(), (0, 1, 2)], FAR)
    assert np.allclose(nothing, info.p) and np.allclose(every, 0.0)  # the estimate itself; the prior


def test_a_bound_holds_and_the_others_follow():
    info = quadratic()
    upper = np.array([info.p[0], 9.0])
    free = estimates_without(info, each_alone(3), FAR)
    held = estimates_without(info, each_alone(3), (FAR[0], upper))
    rising = free[:, 0] > info.p[0]
    assert rising.any() and np.allclose(held[rising, 0], info.p[0])
    assert np.abs(held[rising, 1] - free[rising, 1]).max() > 1e-4
    assert np.allclose(held[~rising], free[~rising])


@pytest.mark.slow
def test_scores_without_a_run_are_near_those_of_a_refit():
    trials, found = calibrated()
    sigma = pooled_sigma(trials)
    fast = leave_out(found, each_alone(len(trials)), sigma)
    inside = score(Simulator(found.ship), trials, sigma).trials
    moved, off = [], []
    for i, trial in enumerate(trials):
        rest = [t for k, t in enumerate(trials) if k != i]
        refit = estimate_coefficients(found.problem.ship, rest, Settings(passes=2), warm={"p": found.p})
        true = score(Simulator(refit.ship), [trial], sigma).trials[0].window
        moved.append(true - inside[i].window)
        off.append(fast[i] - true)
    assert max(moved) > 0  # it matters that a run is left out
    assert np.sqrt(np.mean(np.square(off))) < 0.35 * np.sqrt(np.mean(np.square(moved)))


@pytest.mark.slow
def test_a_fold_of_runs_is_left_out_together():
    trials, found = calibrated()
    folds = [(0, 1), (2, 3)]
    estimates = estimates_without(found.information, [*folds, (0,)], found.problem.p_bounds())
    assert np.abs(estimates[0] - estimates[2]).max() > 0
    rows = leave_out(found, folds, pooled_sigma(trials))
    values = found.prior.mean + found.prior.std * estimates[1]
    ship = found.problem.ship.with_values(dict(zip(found.prior.symbols, values, strict=True)))
    by_hand = score(Simulator(ship), trials[2:], pooled_sigma(trials)).trials
    assert np.allclose(rows[2:], [t.window for t in by_hand])


def test_a_common_factor_is_a_change_without_error():
    before = np.array([0.1, 0.3, 0.8])
    found = relative_change(before, 0.9 * before)
    assert found == (pytest.approx(-0.1), pytest.approx(0, abs=1e-12))
    assert relative_change(before, before[::-1])[1] > 0.3
