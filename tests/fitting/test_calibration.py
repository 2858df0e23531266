"""The calibration as a whole, on synthetic ships whose truth is known and on the real records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from cases.checks import check
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.demo_trials import demo_trials, hidden_ship
from cases.simulation.simulate import SensorNoise, add_noise, simulate_controls
from cases.trial import Trial
from fitting.calibrate import FitOptions, calibrate, check_resumable, iterate_of
from fitting.calibration import estimate_coefficients
from fitting.prediction.score import score
from fitting.settings import Settings
from mmg.errors import TooFewData, UserError
from mmg.messages import has_code
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.calibrated import FREE, small_result
from tests.support.synthetic_runs import runs
from tests.support.trial_files import make_trial


def few_free() -> Ship:
    ship = load_ship("esso_osaka_3m")
    return ship.fixing([s for s in ship.free if s not in FREE])


@pytest.mark.slow
def test_every_start_converges_to_one_solution_near_the_truth_that_predicts_better() -> None:
    """It is again a ship, with intervals, and the noise of the sensors is recovered."""
    truth, start = hidden_ship(), load_ship("esso_osaka_3m")
    fitted = estimate_coefficients(start, runs()[0], Settings(starts=2))
    assert fitted.solution.status == "Solve_Succeeded" and fitted.solution.violation < 1e-6
    assert [s.converged for s in fitted.starts] == [True, True]
    assert max(s.distance for s in fitted.starts) < 1e-2
    np.testing.assert_allclose(fitted.noise.rms, [0.01, 0.01, 0.0015, 0.004, 0.004, 0.0006], rtol=0.1)
    assert (fitted.noise.tau < 1.5).all()
    well = [s for i, s in enumerate(fitted.prior.symbols) if fitted.covariance[i, i] < 0.05]
    moved = [s for s in well if truth.coefficients[s].value != start.coefficients[s].value]
    assert len(moved) >= 8

    def distance(ship: Ship) -> float:
        rows = ((ship.coefficients[s], truth.coefficients[s], start.coefficients[s]) for s in moved)
        return float(np.mean([abs(one.value - true.value) / prior.std for one, true, prior in rows]))

    assert distance(fitted.ship) < 0.35 * distance(start)
    before, after = (score(Simulator(s), runs()[1]) for s in (start, fitted.ship))
    assert after.window < 0.6 * before.window and after.paper < 0.4 * before.paper
    again, found = parse_ship(dump_ship(fitted.ship)), fitted.ship.coefficients
    np.testing.assert_array_equal(again.values, fitted.ship.values)
    c = again.coefficients["Y_v"]
    assert c.prior_value == start.coefficients["Y_v"].value
    assert c.verdict and c.std == found["Y_v"].std < c.prior_std
    z = [(found[s].value - truth.coefficients[s].value) / found[s].std for s in fitted.prior.symbols]
    assert (np.abs(z) < 1.96).mean() >= 0.85 and np.abs(z).max() < 4.5


@pytest.mark.slow
def test_a_draft_lacks_its_last_solve_which_its_iterate_begins() -> None:
    ship, trials, settings = few_free(), runs()[0][:3], Settings()
    whole, draft = (estimate_coefficients(ship, trials, settings, draft=draft) for draft in (False, True))
    assert draft.draft and not draft.converged and draft.solution.iterations == 0 and draft.warnings == ()
    assert len(draft.passes) == len(whole.passes) - 1
    again = estimate_coefficients(ship, trials, settings, warm=draft.iterate, draft=True)
    assert again.draft and again.passes == ()
    np.testing.assert_allclose(again.p, draft.p, rtol=1e-12)
    found = estimate_coefficients(ship, trials, settings, warm=again.iterate)
    assert found.converged and not found.draft and found.solution.status == "Solve_Succeeded"
    assert found.solution.objective == pytest.approx(whole.solution.objective, rel=1e-9)
    np.testing.assert_allclose(found.p, whole.p, atol=1e-6)
    np.testing.assert_allclose(found.covariance, whole.covariance, atol=1e-6)
    assert len(found.passes) == 1 and found.warnings == whole.warnings


@pytest.mark.slow
def test_without_positions_the_rest_is_still_fitted() -> None:
    trials = [Trial(t.name, {k: v for k, v in t.columns.items() if k not in ("x", "y")}) for t in runs()[0][:3]]
    result = estimate_coefficients(load_ship("esso_osaka_3m"), trials, Settings(passes=1))
    assert result.converged and has_code(result.notices, "no_position")


def test_constant_inputs_are_refused() -> None:
    trial = make_trial()
    constant = make_trial(n=np.full(len(trial), 10.0), delta=np.zeros(len(trial)))
    with pytest.raises(TooFewData):
        estimate_coefficients(load_ship("esso_osaka_3m"), [constant])


@pytest.mark.slow
@pytest.mark.data
def test_a_fit_on_the_real_records_improves_every_development_hold_out(frt) -> None:  # type: ignore[no-untyped-def]
    from cases.io import published_splits as splits
    from cases.io.read import read_trials

    ship = load_ship("esso_osaka_3m")
    result = estimate_coefficients(ship, read_trials(splits.find(splits.TRAIN_TZRB)))
    held_out = read_trials(splits.find(splits.DEVELOPMENT_HOLDOUT))
    before, after = (score(Simulator(s), held_out) for s in (ship, result.ship))
    assert result.converged
    for a, b in zip(before.trials, after.trials, strict=True):
        assert b.window < a.window, a.name
    assert before.window / after.window >= 2.5
    for symbol in result.prior.symbols:
        c = result.ship.coefficients[symbol]
        assert c.lower <= c.value <= c.upper


# Going on with an interrupted calibration that has values by campaign
ROW = {"value": 0.9, "std": 0.1, "unit": "s", "prior_value": 0.3, "prior_std": 0.4}


def test_with_values_by_campaign_the_shared_coefficients_go_on_and_a_constant_taken_over_begins_anew() -> None:
    result = small_result()
    model, own = result.start, np.array([0.5, -0.5])
    iterate = {**result.iterate, "p": np.concatenate([result.iterate["p"], own])}
    values = {day: {"gyro.T": ROW} for day in ("2026-03-02", "2026-03-09")}
    differ = replace(result, iterate=iterate, campaigns={"values": values})
    begun = iterate_of(differ, model)
    assert begun is not None and set(begun) == {"p"}
    np.testing.assert_array_equal(begun["p"], result.iterate["p"])
    assert iterate_of(result, model) is result.iterate
    assert iterate_of(replace(differ, iterate=None), model) is None
    # a constant that campaigns took over is no other model
    first, *rest = result.estimates
    values = {"2026-03-02": {first: ROW}}
    taken = replace(result, estimates={s: result.estimates[s] for s in rest}, campaigns={"values": values})
    trials = result.objects.trials if result.objects else ()
    check_resumable(taken, model, trials)
    assert iterate_of(taken, model) is None
    with pytest.raises(UserError, match="--without, --fix and --only"):
        check_resumable(replace(taken, campaigns=None), model, trials)


# Trials and ships of which no calibration can make sense are met with a statement, never with a confident answer


def ship(scale: float = 1.0) -> Ship:
    """Esso Osaka, with ``scale`` times each of its coefficients."""
    found, rows = load_ship("esso_osaka_3m"), {}
    for s, c in found.coefficients.items():
        value = scale * c.value
        rows[s] = c.with_(value=value, fixed=s not in FREE, lower=min(c.lower, value), upper=max(c.upper, value))
    return found.with_coefficients(rows)


def noisy_runs(count: int = 2, dt: float = 0.5) -> list[Trial]:
    """A zigzag and a turn of the true ship, with the noise of its sensors."""
    return [demo_trials(3, dt=dt)[0][k] for k in (0, 2)][:count]


def with_gap(trial: Trial, rows: int = 10_000) -> Trial:
    """The ``trial`` with so many rows without states in its middle."""
    half, dt, t = len(trial) // 2, trial.dt, trial["t"]
    late = {name: np.insert(a, half, np.full(rows, np.nan)) for name, a in trial.columns.items()}
    late["t"] = np.concatenate([t[:half], t[half - 1] + dt * np.arange(1, rows + 1), t[half:] + rows * dt])
    late |= {name: np.insert(trial[name], half, np.full(rows, trial[name][half])) for name in ("n", "delta")}
    return replace(trial, columns={**trial.columns, **late}, sha256="")


def weaving(n: float, model: str = "esso_osaka_3m") -> list[Trial]:
    """A run of the ship ``model`` at ``n`` revolutions [1/s] under a weaving rudder, with noise."""
    t = np.arange(0.0, 200.0, 0.5)
    still = dict.fromkeys(("x", "y", "psi", "v", "r"), np.zeros_like(t))
    inputs = {"n": np.full_like(t, n), "delta": 0.35 * np.sign(np.sin(2 * np.pi * t / 40.0))}
    true = load_ship(model)
    trial = simulate_controls(true, Trial("driven", {"t": t, "u": np.full_like(t, 0.4), **still, **inputs}), None, 0)
    return [add_noise(trial, SensorNoise.for_length(true.particulars["L"]), 1)]


# Name -> ship and trials, and what must be said of them, at least
CASES: dict[str, tuple[Callable[[], tuple[Ship, Sequence[Trial]]], set[str]]] = {
    "as it should be": (lambda: (ship(), noisy_runs()), set()),
    "100 Hz": (lambda: (ship(), noisy_runs(1, dt=0.01)), set()),
    "all coefficients times 3": (
        lambda: (ship(3.0), noisy_runs()),
        {"far_from_prior", "implausible", "not_described", "worse_than_persistence"},
    ),
    "trials of a ship of 320 m": (
        lambda: (ship(), weaving(1.0, "kvlcc2_full")),
        {"at_bound", "far_from_prior", "not_described"},
    ),
    "all astern": (lambda: (ship(), weaving(-9.0)), {"not_excited_ahead"}),
    "0.1 Hz": (lambda: (ship(), [t.resample(10.0) for t in noisy_runs()]), {"coarse_sampling", "refused"}),
    "10,000 rows of gaps": (lambda: (ship(), [with_gap(t) for t in noisy_runs()]), {"gaps", "missing_samples"}),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(c, marks=pytest.mark.longest) if c == "100 Hz" else c for c in sorted(CASES)],  # 12 s
)
def test_what_is_said(name: str) -> None:
    made, expected = CASES[name]
    model, trials = made()
    codes, warnings = {f.code for report in check(trials) for f in report.findings}, {"refused"}
    options = FitOptions(next_trial=False, instruments=())
    with suppress(UserError):
        fit = calibrate(model, trials, (), Settings(passes=2, window=20.0), options)
        warnings = {w.code for w in fit.warnings}
    assert expected <= codes | warnings, codes | warnings
    if not expected:
        assert fit.converged and warnings <= {"worse_than_persistence"}  # in u, which hardly changes
