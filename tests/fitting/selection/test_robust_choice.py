"""The choice of loss and weight of the runs: by runs left out, clear gains only, and said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.fisher_information import information
from fitting.selection.left_out_runs import RunScores
from fitting.selection.robust_choice import choose_weighting, kinds_worse, weighed
from fitting.settings import Settings
from fitting.solvers.noise_iteration import reweighed
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r", "k_0", "gamma_P", "Y_A1")
OPEN = Settings(passes=2, loss=None, weight=None)


def ship() -> Ship:
    start = load_ship("esso_osaka_3m")
    return start.fixing([s for s in start.symbols if s not in FREE])


@cache
def trials() -> tuple[Trial, ...]:
    return tuple(demo_trials(3, dt=0.5)[0][:5])


@cache
def rough() -> Calibration:
    return estimate_coefficients(ship(), trials(), Settings(passes=1))


def spiky(trial: Trial, size: float, seed: int) -> Trial:
    """The trial with one in 25 samples of its velocities off, always to the same side."""
    n, rng = len(trial), np.random.default_rng(seed)
    off = np.zeros(n)
    off[rng.choice(n, n // 25, replace=False)] = size
    changed = {"u": trial["u"] + off, "v": trial["v"] + off, "r": trial["r"] + 0.3 * off}
    return replace(trial, columns={**trial.columns, **changed})


def test_a_share_of_the_information_is_what_the_reweighed_problem_has():
    problem, x = rough().problem, rough().solution.x
    for loss in ("gaussian", "student"):
        whole, part = (information(reweighed(problem, x, loss, w), x) for w in (1.0, 0.3))
        assert np.allclose(part.fisher, weighed(whole, 0.3).fisher, rtol=1e-6, atol=1e-9 * np.abs(whole.fisher).max())
        assert np.allclose(part.score, weighed(whole, 0.3).score, rtol=1e-6, atol=1e-9 * np.abs(whole.score).max())
        assert np.array_equal(part.prior_information, whole.prior_information)


def test_gross_errors_make_the_loss_robust():
    some = [spiky(t, 0.1, k) for k, t in enumerate(demo_trials(3, dt=0.5)[0])]
    found = estimate_coefficients(ship(), some, OPEN)
    assert found.weighting is not None and found.converged
    assert found.weighting.loss in ("huber", "student")
    assert found.settings.loss == found.problem.loss.name == found.weighting.loss
    assert found.settings.weight == found.weighting.weight
    assert any(n.code == "weighting_chosen" for n in found.notices)


def test_a_choice_that_changes_nothing_leaves_the_fit_as_it_was():
    found = estimate_coefficients(ship(), trials()[:3], replace(OPEN, passes=3))
    assert found.weighting is not None and found.weighting.why and found.settings.loss == "gaussian"
    plain = estimate_coefficients(ship(), trials()[:3], Settings(passes=3))
    assert np.allclose(found.p, plain.p, atol=1e-6) and np.allclose(found.sigma, plain.sigma)


def test_what_is_given_is_not_chosen():
    found = choose_weighting(rough().problem, rough().solution.x, trials(), "huber", None)
    assert {row.loss for row in found.tried} == {"huber"}
    fixed = choose_weighting(rough().problem, rough().solution.x, trials(), None, 0.5)
    assert {row.weight for row in fixed.tried} == {0.5}
    assert sum(row.taken for row in fixed.tried) == 1


def test_the_choice_takes_only_what_is_clearly_better():
    found = choose_weighting(rough().problem, rough().solution.x, trials(), None, None)
    for row in found.tried[1:]:
        if row.taken:
            assert row.change < -max(0.005, 1.6 * row.error) and not row.worse
    assert [(row.loss, row.weight) for row in found.tried if row.taken] == [(found.loss, found.weight)]
    assert "runs left out" in found.sentence


def test_few_runs_or_no_positions_keep_the_default_and_say_why():
    few = choose_weighting(rough().problem, rough().solution.x, trials()[:3], None, None)
    assert (few.loss, few.weight, few.tried) == ("gaussian", 1.0, ()) and "fewer than 4" in few.sentence
    bare = [replace(t, columns={k: v for k, v in t.columns.items() if k not in "xy"}) for t in trials()]
    none = choose_weighting(rough().problem, rough().solution.x, bare, None, None)
    assert none.loss == "gaussian" and "positions" in none.why


def test_given_sigma_or_a_single_pass_leave_nothing_to_choose():
    one = estimate_coefficients(ship(), trials()[:1], Settings(passes=1, loss=None, weight=None))
    assert one.weighting is not None and "single pass" in one.weighting.why and one.settings.loss == "gaussian"
    sigma = tuple(one.sigma)
    given = estimate_coefficients(ship(), trials()[:1], Settings(sigma=sigma, loss=None, weight=None))
    assert given.weighting is not None and "sigma" in given.weighting.why


def test_a_stopped_fit_leaves_the_choice_open_for_its_continuation():
    stopped = estimate_coefficients(ship(), trials(), replace(OPEN, max_iterations=1))
    assert not stopped.converged and stopped.weighting is None and stopped.settings.loss is None


def test_a_kind_that_becomes_clearly_worse_forbids_a_candidate():
    kinds, before = ("a",) * 4 + ("b",) * 4, np.array([1.0, 1.1, 0.9, 1.0, 2.0, 2.1, 1.9, 2.0])

    def scores(values: np.ndarray) -> RunScores:
        return RunScores(tuple("12345678"), kinds, values, values, np.ones(8), np.ones(6))

    first = scores(before)
    after = scores(before * np.array([0.5] * 4 + [1.2, 1.21, 1.19, 1.2]))
    assert kinds_worse(first, after) == ("b",)
    scattered = scores(before * np.array([0.5] * 4 + [2.0, 0.6, 1.5, 0.7]))
    assert kinds_worse(first, scattered) == ()


@pytest.mark.parametrize("weight", [0.3, 0.1])
def test_with_less_information_the_prior_decides_more(weight: float):
    whole = estimate_coefficients(ship(), trials(), Settings(passes=2))
    part = estimate_coefficients(ship(), trials(), Settings(passes=2, weight=weight))
    assert np.allclose(part.sigma, whole.sigma / np.sqrt(weight), rtol=0.2)
    assert (np.diag(part.covariance_model) > np.diag(whole.covariance_model)).all()
