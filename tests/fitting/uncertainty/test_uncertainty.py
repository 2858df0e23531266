"""Robust covariance, leave-one-run-out, bootstrap by run and profiles: against known laws and against each other."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import TRAIN, demo_trials
from cases.trial import inside
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions, calibrate
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.parallel import Shared
from fitting.result import read_fit
from fitting.settings import Settings
from fitting.solvers.solve import Solution, solve
from fitting.uncertainty.refits import LIMIT, bootstrap, drawn_runs, profiles, refit, reweighted
from fitting.uncertainty.sandwich import changes_without_each, robust
from tests.support.calibrated import FREE, small_result
from tests.support.disturbed_trials import process
from tests.support.synthetic_runs import SIGMA, kernel, runs

SYMBOLS = ("Y_v", "N_v", "N_r", "C_D", "k_x", "X_0F")


def linear(
    windows: int, per_run: int, P: int, inflation: float, seed: int, shared: float = 0.0
) -> tuple[Information, np.ndarray]:
    """A linear fit with truth from the prior, whose scores vary ``inflation`` times as the informations say.

    shared: part of that variance that windows of one run have in common. Returns it at its optimum, and the truth.
    """
    rng = np.random.default_rng(seed)
    truth = rng.standard_normal(P)
    run = np.arange(windows) // per_run
    J = rng.standard_normal((windows, 2 * P, P)) * np.geomspace(0.05, 1.5, P)
    own = rng.standard_normal((windows, 2 * P))
    common = rng.standard_normal((run[-1] + 1, 2 * P))[run]
    if shared:
        J = J[:1] + 0.1 * J
    e = np.sqrt(inflation) * (np.sqrt(1 - shared) * own + np.sqrt(shared) * common)
    fisher = np.swapaxes(J, 1, 2) @ J
    H = fisher.sum(axis=0) + np.eye(P)
    p = np.linalg.solve(H, np.einsum("wip,wi->p", J, J @ truth + e))
    score = np.einsum("wip,wi->wp", J, J @ (p - truth) - e)
    symbols = tuple(f"c{i}" for i in range(P))
    return Information(fisher, score, p, run, symbols, np.eye(P), p.copy()), truth


def covered(windows: int, per_run: int, P: int, inflation: float, shared: float = 0.0) -> tuple[float, float]:
    """Shares of truths inside the robust and the model-based 95 % intervals over 60 draws."""
    ours, theirs = [], []
    for seed in range(60):
        info, truth = linear(windows, per_run, P, inflation, seed, shared)
        found = robust(info)
        for share, C in ((ours, found.covariance), (theirs, found.model)):
            share.append(np.abs(info.p - truth) < 1.96 * np.sqrt(np.diag(C)))
    return float(np.mean(ours)), float(np.mean(theirs))


@pytest.mark.parametrize("inflation", [1.0, 16.0])
@pytest.mark.parametrize(("windows", "per_run"), [(12, 3), (60, 5)])
def test_intervals_hold_whatever_the_noise_is_like(inflation: float, windows: int, per_run: int) -> None:
    ours, theirs = covered(windows, per_run, 12, inflation)
    assert 0.9 <= ours <= 0.995
    assert inflation < 4 or theirs < 0.86
    if windows < 60:  # also where windows of a run err together
        assert covered(48, 6, 8, 4.0, shared=0.8)[0] >= 0.88


def test_it_is_the_model_based_one_with_many_clusters_and_honest_noise_and_never_narrower_with_few() -> None:
    found = robust(linear(400, 4, 6, 1.0, 0)[0])
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(found.model))
    assert (np.abs(ratio - 1) < 0.15).all() and found.clusters == (400, 100)
    for seed in range(10):
        found = robust(linear(8, 2, 6, 0.2, seed)[0])
        assert (np.diag(found.covariance) > (1 - 1e-9) * np.diag(found.model)).all()


def test_a_coefficient_that_nothing_excites_keeps_its_prior_and_broken_numbers_are_answers_not_errors() -> None:
    info, _ = linear(20, 4, 5, 4.0, 1)
    for part in (info.fisher, np.swapaxes(info.fisher, 1, 2), info.score, info.p, info.prior_score):
        part[..., 4] = 0
    found = robust(info)
    assert found.covariance[4, 4] == pytest.approx(1.0)
    np.testing.assert_allclose(found.covariance[4, :4], 0, atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    info, _ = linear(1, 1, 4, 1.0, 0)
    np.testing.assert_allclose(robust(info).covariance, robust(info).model)  # one window
    info.score[0, 0] = np.nan
    assert np.isnan(robust(info).covariance).all()


def test_one_step_without_a_run_is_exact_for_a_linear_fit() -> None:
    info, _ = linear(12, 3, 5, 2.0, 3)
    by_run = info.by_run()
    for k in range(4):
        rest = info.run != k
        H = info.fisher[rest].sum(axis=0) + np.eye(5)
        # gradient of the rest at p vanishes at the new optimum
        gone = -np.linalg.solve(H, info.score[rest].sum(axis=0) + info.p)
        np.testing.assert_allclose(changes_without_each(by_run)[k], gone, atol=1e-10)


def test_runs_are_drawn_whole() -> None:
    run = np.array([0, 0, 1, 2, 2, 2])
    counts = drawn_runs(run, 50, np.random.default_rng(0))
    assert (counts[:, 0] == counts[:, 1]).all() and (counts[:, 3] == counts[:, 5]).all()
    assert (counts[:, [0, 2, 3]].sum(axis=1) == 3).all() and len(np.unique(counts[:, 0])) > 1


@lru_cache(maxsize=1)
def small() -> tuple[Problem, Solution, Information]:
    """A calibration of six coefficients on five runs."""
    ship = load_ship("esso_osaka_3m")
    ship = ship.fixing([s for s in ship.symbols if s not in SYMBOLS])
    prior = Prior.of(ship)
    p = Problem(ship, prior, kernel(prior.symbols), cut(runs()[0][:5], 1.0, 60.0, 5), SIGMA)
    s = solve(p, p.start())
    assert s.converged
    return p, s, information(p, s.x)


@pytest.mark.slow
def test_windows_that_count_twice_cost_twice_and_a_refit_without_some_is_nearly_one_step() -> None:
    p, s, info = small()
    part, _ = reweighted(p, s.x, np.full(len(info.run), 2), np.zeros(p.P))
    prior = 0.5 * info.p @ info.p
    assert part.objective(s.x) - prior == pytest.approx(2 * (p.objective(s.x) - prior))
    step, runs_left = changes_without_each(info.by_run()), info.by_run().run
    counts = np.array([info.run != r for r in runs_left], dtype=int)
    outcomes = refit((Shared((p, s.x)), counts, np.zeros((len(step), p.P))))
    assert len(step) == len(p.segments.trials) and not any(why for _, why in outcomes)
    moved = np.array([found for found, _ in outcomes]) - info.p
    assert np.abs(step - moved).max() < 0.2 * np.abs(moved).max()


@pytest.mark.slow
def test_where_a_refit_fails_the_others_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    p, s, info = small()
    fails = iter([True, False])

    def sometimes(*args, **kwargs):  # type: ignore[no-untyped-def]
        if next(fails):
            raise FloatingPointError("made up")
        return solve(*args, **kwargs)

    monkeypatch.setattr("fitting.uncertainty.refits.solve", sometimes)
    found = bootstrap(info, 2, 0, p, s.x)
    assert [label for label, _ in found.failures] == ["0"]
    assert np.isnan(found.p[0]).all() and np.isfinite(found.p[1]).all()


@pytest.mark.slow
def test_a_profile_is_the_parabola_of_the_model_based_error_near_the_estimate() -> None:
    p, s, info = small()
    found = robust(info)
    (profile,) = profiles(p, s.x, ["N_r"], found.model, found.model)
    i = p.prior.symbols.index("N_r")
    se = np.sqrt(found.model[i, i]) * p.prior.std[i]
    best = p.coefficients(info.p)[p.kernels.free[i]]
    assert profile.increase[len(profile.increase) // 2] == 0 and min(profile.increase) > -1e-6
    assert profile.lower == pytest.approx(best - 1.96 * se, abs=0.3 * se)
    assert profile.upper == pytest.approx(best + 1.96 * se, abs=0.3 * se)
    assert not profile.failures and pytest.approx(1.96**2 / 2, rel=1e-3) == LIMIT
    with pytest.raises(ValueError):
        profiles(p, s.x, ["m_x"], found.model, found.model)


# Intervals on disturbed synthetic trials hold the truth where those of the model alone do not
def test_the_process_has_its_size_and_memory() -> None:
    d = process(200_000, 0.1, 5.0, np.random.default_rng(0))
    assert d.std() == pytest.approx(1.0, abs=0.05)
    assert np.mean(d[:-50] * d[50:]) == pytest.approx(np.exp(-1.0), abs=0.06)


@pytest.mark.longest
@pytest.mark.slow
def test_pooled_coverage_of_95_percent_intervals_is_90_to_98_percent() -> None:
    from benchmarks.coverage import disturbed_errors

    assert len(TRAIN) == 7
    inside = np.array([np.abs(disturbed_errors(seed).errors) < 1.96 for seed in range(100, 120)])
    model, reported = inside.mean(axis=(0, 2))
    assert 0.90 <= reported <= 0.98
    assert model < 0.80


# What stretches that were left out of the trials were worth
@pytest.mark.longest
@pytest.mark.slow
def test_a_calibration_says_what_it_left_out_and_what_that_was_worth(tmp_path) -> None:  # type: ignore[no-untyped-def]
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    train, held_out = demo_trials(3)
    rows = inside(train[0], [(50.0, 58.0)])
    broken = train[0].with_columns(psi=train[0]["psi"] + np.where(rows, 0.3, 0.0))
    (kept,) = TrialSet.of([broken]).sound
    assert kept.whole is broken
    settings, options = Settings(passes=2, compiled=False), FitOptions(next_trial=False, instruments=())
    result = calibrate(start, [kept], held_out[-1:], settings, options)
    whole = small_result()
    assert whole.left_out is None and not [m for m in whole.warnings if m.code == "left_out_worth"]
    worth = result.left_out
    assert worth is not None and list(worth["trials"]) == [broken.name] and 7.0 < worth["seconds"] < 13.0
    errors = worth["scores"]["training"]["window"]
    assert errors["with"] > errors["without"] == pytest.approx(result.scores["training"].after.window)
    assert "validation" not in worth["scores"]
    (message,) = [m for m in result.warnings if m.code == "left_out_worth"]
    assert "30 s" in message and broken.name not in message
    assert read_fit(result.save(tmp_path / "run").folder).left_out == worth
    assert broken.name in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
