"""The optimiser of the objective: the step, the descent, the path of the sparsity."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from fitting.selection import learning as learning_module
from fitting.selection.candidates import candidate
from fitting.selection.learning import (
    Learned,
    Learning,
    Penalties,
    SubsequenceObjective,
    descent,
    follow,
    learn_one,
    minimise_quadratic,
    regression,
    subsequences,
    write_learning,
)
from fitting.settings import Settings
from tests.fitting.selection.paper_problems import ESSO, harbour, problem


@pytest.mark.parametrize("seed", range(6))
def test_the_step_is_the_minimum_of_quadratic_and_moduli_in_the_box(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 12
    B = rng.normal(size=(n, n)) * 10 ** rng.uniform(-2, 1, n)
    H, g, p = B.T @ B + 1e-6 * np.eye(n), 5 * rng.normal(size=n), rng.uniform(-0.5, 0.5, n)
    weight = 2 * np.abs(rng.normal(size=n)) * (np.arange(n) % 2) * (seed > 1)

    def split(z: np.ndarray) -> float:  # x = positive part - negative part
        d = z[:n] - z[n:] - p
        return float(g @ d + 0.5 * d @ H @ d + weight @ (z[:n] + z[n:]))

    x = minimise_quadratic(H, g, p, (-np.ones(n), np.ones(n)), weight)
    start, found = (np.concatenate([np.maximum(at, 0), np.maximum(-at, 0)]) for at in (p, x))
    options = {"maxiter": 10**5, "maxfun": 10**7, "ftol": 1e-15, "gtol": 1e-10}
    least = minimize(split, start, bounds=[(0, 1)] * 2 * n, method="L-BFGS-B", options=options)
    assert split(found) <= least.fun + 1e-6 * abs(least.fun)
    assert np.abs(x).max() <= 1


def test_the_regression_predicts_ten_seconds_better_than_no_force_at_all() -> None:
    one = problem("sm2-order2")
    tried = np.transpose([np.zeros(one.P), regression(one, harbour()[:2])])
    nothing, found = one.errors(tried, subsequences(harbour()[:2], 1.0, 10.0, one.ship.inputs))
    assert found < 0.85 * nothing


def test_the_descent_converges_where_no_slope_is_left() -> None:
    one = problem(penalties=Penalties(deviation=0.02))
    start = regression(one, harbour()[:2])
    *_, p = descent(one, start, 200)
    first, last = one.values(np.transpose([start, p]))
    assert last < 0.9 * first
    inside = (p > one.lower + 1e-9) & (p < one.upper - 1e-9)
    gradient, hessian = one.quadratic(p)
    gain = gradient[inside] @ np.linalg.lstsq(hessian[np.ix_(inside, inside)], gradient[inside])[0]
    assert gain < 5e-3 * last  # what a further step would bring


@pytest.mark.slow
def test_more_sparsity_leaves_fewer_terms_and_none_of_it_most() -> None:
    terms: list[int] = []
    errors: list[float] = []
    p = regression(problem("sm1-order2"), harbour()[:2])
    for weight in (1e-1, 1e-2, 1e-4):
        one = problem("sm1-order2", Penalties(0.0, weight))
        *_, p = descent(one, p, 12)
        terms.append(int((p != 0).sum()))
        errors.append(float(one.errors(p[:, None], one.train)[0]))
    assert terms[0] < terms[1] < terms[2] and errors[0] > errors[1] > errors[2]


def test_the_learning_keeps_the_best_on_validation_and_writes_its_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning_module, "SPARSITIES", (1e-2,))
    one = problem()
    learning = Learning(one)
    follow(learning, regression(one, harbour()[:2]))
    validation = [lesson.validation for lesson in learning.lessons]
    assert one.validate is not None and len(validation) > 3
    assert one.errors(learning.p[:, None], one.validate)[0] == pytest.approx(min(validation))
    assert [s.evaluations for s in learning.lessons] == sorted(s.evaluations for s in learning.lessons)
    learned = Learned("sm1-order1", 0, {}, (), 0.0, 0.0, 0.0, 0.0, 0, tuple(learning.lessons))
    write_learning([learned], tmp_path / "learning.csv")
    lines = (tmp_path / "learning.csv").read_text().splitlines()
    assert len(lines) == 1 + len(validation)
    assert lines[0].split(",")[-1] == "validation" and lines[-1].startswith("sm1-order1,0,")


def test_preparing_counts_against_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on which preparing alone takes longer than the limit: the start, by regression, is the best so far."""
    now, real = [0.0], learning_module.SubsequenceObjective
    clock = SimpleNamespace(perf_counter=lambda: now[0])
    monkeypatch.setattr(learning_module, "time", clock)

    def slow(*arguments: Any, **more: Any) -> SubsequenceObjective:
        now[0] += 100.0
        return real(*arguments, **more)

    monkeypatch.setattr(learning_module, "SubsequenceObjective", slow)
    runs = harbour()
    found = learn_one((candidate(ESSO, "sm1-order1"), 0), (runs[:2], runs[2:]), Settings(time_limit=40.0))
    assert len(found.lessons) == 1 and found.seconds == 100.0 and any(found.values.values())
