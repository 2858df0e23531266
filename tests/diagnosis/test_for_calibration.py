"""What a diagnosis tells a calibration: tests of freed effects, coefficients by its filter, usual suspects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import diagnosis.for_calibration as module
import mmg_ident
from benchmarks.yards import of_library
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.new_ship import new_ship
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis import for_calibration
from diagnosis.estimation.candidates import find
from diagnosis.estimation.random_states import Noise
from diagnosis.for_calibration import effect_tests, second_estimate, with_effect_tests
from diagnosis.hypotheses.refit import gained, refit
from diagnosis.inputs import Case
from diagnosis.prepare import prepare
from fitting.calibrate import FitOptions
from fitting.record import EffectTest
from fitting.report.page import build_page
from fitting.result import FitResult, read_fit
from fitting.selection.left_out_runs import coefficients_without, each_alone
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.ship import Ship
from mmg_ident import calibrate
from mmg_ident.commands.fit import fit as fit_command
from tests.support.diagnosis_cases import FEW, SHIP, pushed_trials, quiet

SHORT_RUNS = (("zigzag:20/20", 60.0), ("random:11", 60.0), ("turning:-20", 60.0))
SYMBOL = "rudder_offset.delta"


@cache
def trials(offset: float) -> tuple[Trial, ...]:
    return tuple(pushed_trials(4, [f"rudder_offset:delta={offset}"] if offset else [], SHORT_RUNS))


@cache
def fitted(offset: float, *effects: str) -> FitResult:
    """A calibration with some effects freed, of trials with this rudder offset [rad]."""
    options = FitOptions(next_trial=False, instruments=("none",))
    settings = Settings(step=1.0)
    return mmg_ident.calibrate(freeing_effects(FEW, effects), trials(offset), (), settings, options)


def only(result: FitResult) -> EffectTest:
    assert result.effects is not None and len(result.effects) == 1
    return result.effects[0]


@pytest.mark.slow
def test_an_effect_that_is_there_has_its_size_and_the_small_probability_of_a_diagnosis() -> None:
    test = only(fitted(0.06, "rudder_offset"))
    value = test.parameters[SYMBOL]
    assert test.name == "rudder_offset" and test.p_value < 1e-4 and not test.in_doubt
    assert value.value == pytest.approx(0.06, abs=3 * value.std) and value.std < 0.015
    assert f"p = {test.p_value:.2g}" in test.sentence
    # the probability is that of the diagnosis of the same trials
    ready = prepare(Case(FEW, TrialSet.of(trials(0.06))), 1.0)
    p = ready.problem
    c = find(p.candidates, "rudder_offset")
    with_it = refit(p, ready.null, [c], {})
    gain = gained(ready.null, 0, with_it, 1)
    assert np.log(test.p_value) == pytest.approx(-gain, rel=0.15)
    assert value.value == pytest.approx(with_it.value(SYMBOL), abs=0.2 * with_it.std(SYMBOL))


@pytest.mark.slow
def test_of_several_effects_each_is_tested_beside_the_others() -> None:
    result = fitted(0.06, "rudder_offset", "tow:X=0,Y,N=0")
    assert result.effects is not None
    offset, tow = result.effects
    assert (offset.name, tow.name) == ("rudder_offset", "tow") and offset.p_value < 0.01 < tow.p_value
    assert list(tow.parameters) == ["tow.X", "tow.Y", "tow.N"]


def doubted(value: float, std: float, offset: float = 0.0) -> FitResult:
    """The fit of trials with this offset, as if it had found that."""
    result = fitted(offset, "rudder_offset")
    row = replace(result.estimates[SYMBOL], value=value, std=std)
    return replace(result, estimates={**result.estimates, SYMBOL: row})


@pytest.mark.slow
def test_where_both_disagree_a_sentence_says_so_and_why() -> None:
    given = freeing_effects(FEW, ["rudder_offset"])
    sure = with_effect_tests(replace(doubted(0.03, 0.004), messages=()), given)
    test = only(sure)
    assert test.p_fit == pytest.approx(6e-14, rel=0.1) and test.p_value > 0.05 and test.in_doubt
    assert [(m.level, m.code, m.text) for m in sure.messages] == [("warning", "effect_in_doubt", test.sentence)]
    assert not only(with_effect_tests(doubted(0.001, 0.02), given)).in_doubt
    for value, std in ((0.05, 0.2), (0.4, 0.01)):  # the fit does not see it, or another size of it
        assert effect_tests(doubted(value, std, 0.06), ["rudder_offset"], trials(0.06))[0].in_doubt
    assert with_effect_tests(replace(sure, effects=None), FEW.fixing([])).effects is None  # nothing was freed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "words"),
    [({"converged": False}, "converged"), ({"per_run": {"a": {}}}, "--per-run"), ({}, "positive definite")],
)
def test_what_cannot_be_tested_or_fails_is_a_warning_and_the_fit_stays(
    changed: dict[str, object], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise np.linalg.LinAlgError("Matrix is not positive definite")

    result = replace(fitted(0.0, "rudder_offset"), effects=None, **changed)  # type: ignore[arg-type]
    if not changed:
        monkeypatch.setattr(for_calibration, "effect_tests", broken)
    kept = with_effect_tests(result, freeing_effects(FEW, ["rudder_offset"]))
    assert kept.effects is None and kept.estimates == result.estimates
    assert kept.messages[-1].code == "effect_not_tested" and words in kept.messages[-1].text


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_the_folder_the_page_and_the_console_have_the_probability(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    result = fitted(0.06, "rudder_offset")
    result.save(tmp_path / "run")
    read = mmg_ident.load_run(tmp_path / "run")
    assert isinstance(read, FitResult) and read.effects == result.effects and read.timings_s["effects"] > 0
    page = build_page([(read, read.ship, tmp_path / "run")])
    test = only(result)
    assert test.sentence in page
    monkeypatch.setattr("mmg_ident.api.calibrate", lambda *_, **__: result)
    monkeypatch.setattr("cases.trial_set.read_trials", lambda *_, **__: list(trials(0.06)))
    fit_command("esso_osaka_3m", [tmp_path], tmp_path / "again", with_=["rudder_offset"])
    said = capsys.readouterr().err
    assert test.sentence in " ".join(said.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "name"),
    [
        (None, ""),
        ("antenna_offset:x=-0.9", "antenna_offset"),
        ("current:x=0.02,y=0.01", "current"),
        ("log_scale:share=0.03", "log_scale"),
    ],
)
def test_a_usual_suspect_that_is_there_is_fitted_along_and_nothing_else(hidden: str | None, name: str) -> None:
    found = second_estimate(FEW, pushed_trials(4, [hidden] if hidden else [], SHORT_RUNS))
    assert {s.partition(".")[0] for s in found.suspects} == ({name} if name else set())
    assert len(found.messages) == bool(name)
    assert set(found.values) == {*FEW.free, *found.suspects}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [303, 304])
def test_a_hull_of_another_form_is_no_antenna_and_hides_no_current(seed: int) -> None:
    """An antenna 9 m aft, that is not there, has log odds of 22 and 17, a free force of 60 and 54."""
    yard = of_library("mariner", seed)
    found = second_estimate(new_ship("cargo", dict(yard.particulars)), yard.trials)
    assert found.suspects == ("current.x", "current.y")


CURRENT = {"x": 0.02, "y": 0.01}
"""[m/s]"""


@cache
def with_current() -> tuple[Trial, ...]:
    """Trials in a CURRENT."""
    return tuple(pushed_trials(4, [f"current:x={CURRENT['x']},y={CURRENT['y']}"], SHORT_RUNS))


def suspects_said(result: FitResult) -> list[str]:
    """Levels of the messages on suspects."""
    return [m.level for m in result.messages if m.code == "suspect"]


def calibrated(ship: Ship, **options: Any) -> FitResult:
    """A calibration of ``ship`` on the trials ``with_current``."""
    return mmg_ident.calibrate(ship, with_current(), (), Settings(step=1.0), FitOptions(next_trial=False, **options))


@pytest.mark.slow
def test_a_fit_fits_its_suspects_along_and_a_diagnosis_judges_them_anew(tmp_path: Path) -> None:
    result = calibrated(FEW)
    assert suspects_said(result) == ["warning"]
    for name, value in CURRENT.items():
        row = result.estimates[f"current.{name}"]
        assert abs(row.value - value) < 2 * row.std and row.std < 0.01
    result.save(tmp_path / "run")
    found = mmg_ident.diagnose(tmp_path / "run", with_current())
    assert [e.name for e in found.effects] == ["current"]


@pytest.mark.longest
@pytest.mark.slow
def test_suspects_are_said_only_where_they_may_not_be_fitted_or_are_free() -> None:
    said = calibrated(FEW, instruments=("none",))
    assert suspects_said(said) == ["warning"]
    assert set(said.estimates) == set(FEW.free)
    assert second_estimate(freeing_effects(FEW, ("current",)), with_current()).suspects == ()


@pytest.mark.slow
def test_a_current_of_several_days_is_said_and_not_fitted_as_one() -> None:
    """Instruments stay as they are from day to day, the water does not."""
    days = zip(with_current(), ("monday", "tuesday", "tuesday"), strict=True)
    found = second_estimate(FEW, [replace(trial, meta={**trial.meta, "campaign": day}) for trial, day in days])
    assert found.suspects == () and set(found.values) == set(FEW.free)
    assert [m.code for m in found.messages] == ["suspect"] and "--per-run current" in str(found.messages[0])


@pytest.mark.slow
def test_suspects_of_a_calibration_before_are_asked_anew(tmp_path: Path) -> None:
    """Also by a run that goes on: it ends at the mean of the same two estimates."""
    whole, run = calibrated(FEW), tmp_path / "run"
    options = FitOptions(next_trial=False)
    stopped = mmg_ident.calibrate(FEW, with_current(), (), Settings(step=1.0, max_iterations=1), options)
    assert not stopped.converged and set(stopped.estimates) == set(whole.estimates)
    stopped.save(run)
    earlier = read_fit(run)
    resumed = calibrated(earlier.start, resume=earlier)
    again = calibrated(whole.ship)
    for s, row in whole.estimates.items():
        assert resumed.estimates[s].value == pytest.approx(row.value, abs=0.02 * row.std)
    for found in (resumed, again):
        assert suspects_said(found) == ["warning"] and "two_estimates" in [m.code for m in found.messages]
        assert found.effects is None or not found.effects


TRUE = {"X_0F": 1.1, "N_r": 0.95}
"""True coefficients over those of the ship that is fitted."""


@pytest.fixture(scope="module")
def disturbed_runs() -> list[Trial]:
    """Runs of a ship whose coefficients are off, with random forces and sensor noise."""
    ship = SHIP.with_values({s: f * SHIP.coefficients[s].value for s, f in TRUE.items()})
    return pushed_trials(7, ship=ship)


def filter_estimate(ship: Ship, disturbed_runs: list[Trial]) -> Mapping[str, float] | str:
    """Values by symbol, or why there are none."""
    return second_estimate(ship, disturbed_runs).values


@pytest.mark.slow
def test_it_finds_the_coefficients_of_a_ship_that_is_pushed_about(disturbed_runs: list[Trial]) -> None:
    found = filter_estimate(FEW, disturbed_runs)
    assert not isinstance(found, str) and set(found) == set(FEW.free)
    for s, factor in TRUE.items():
        c = SHIP.coefficients[s]
        assert abs(found[s] - factor * c.value) < 0.5 * abs(factor - 1) * abs(c.value) + 0.2 * c.std


@pytest.mark.slow
def test_the_priors_are_those_of_the_calibration_at_hand_not_of_one_before_it(disturbed_runs: list[Trial]) -> None:
    c = FEW.coefficients["N_r"]
    sure = FEW.with_coefficients({"N_r": c.with_(std=1e-4 * c.std, prior_value=3 * c.value, prior_std=c.std)})
    found = filter_estimate(sure, disturbed_runs)
    assert not isinstance(found, str) and found["N_r"] == pytest.approx(c.value, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("can_be_fitted", [True, False])
def test_many_trials_begin_at_the_fit_of_a_few(
    can_be_fitted: bool, disturbed_runs: list[Trial], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From there the fit of all comes to the same estimates, within what its tolerance leaves of their errors (0.32
    standard errors, which are 0.13 to 0.9 of the priors here), and what the correlation time of the few makes of them.
    Where the few cannot be fitted, all are.
    """
    whole, fitted, prepare = filter_estimate(FEW, disturbed_runs), [], module.prepare

    def noted(*given: Any, **more: Any) -> Any:
        fitted.append(len(given[0].trials))
        if not can_be_fitted and len(given[0].trials) < len(disturbed_runs):
            raise UserError("too short")
        return prepare(*given, **more)

    monkeypatch.setattr(module, "prepare", noted)
    monkeypatch.setattr(module, "FEW", 200)
    found = filter_estimate(FEW, disturbed_runs)
    assert (
        0 < fitted[0] < len(disturbed_runs) and fitted[1:] == []
        if can_be_fitted
        else fitted[1:] == [len(disturbed_runs)]
    )
    assert not isinstance(found, str) and not isinstance(whole, str) and set(found) == set(whole)
    for s, value in whole.items():
        assert abs(found[s] - value) <= (0.15 if can_be_fitted else 0.0) * SHIP.coefficients[s].std


def test_it_says_why_there_is_no_estimate(disturbed_runs: list[Trial], monkeypatch: pytest.MonkeyPatch) -> None:
    still = [replace(t, columns={**t.columns, "n": 0 * t["n"] + 10.0, "delta": 0 * t["delta"]}) for t in disturbed_runs]
    found = filter_estimate(FEW, still)
    assert isinstance(found, str)
    monkeypatch.setattr(module, "MOST", 100)
    much = filter_estimate(FEW, disturbed_runs)
    assert isinstance(much, str) and "memory" in much


@pytest.mark.slow
def test_a_calibration_is_the_mean_of_both(disturbed_runs: list[Trial]) -> None:
    options = FitOptions(next_trial=False, instruments=(), per_campaign=("none",))
    settings = Settings(loss="gaussian", weight=1.0, passes=2)
    alone = calibrate(FEW, disturbed_runs, settings=settings, options=replace(options, estimator="windows"))
    both = calibrate(FEW, disturbed_runs, settings=settings, options=options)
    other = filter_estimate(FEW, disturbed_runs)
    assert not isinstance(other, str)
    for s in FEW.free:
        mean = 0.5 * (alone.ship.coefficients[s].value + other[s])
        c = both.ship.coefficients[s]
        assert c.value == pytest.approx(np.clip(mean, c.lower, c.upper), rel=1e-6)
        assert c.std >= alone.ship.coefficients[s].std
    known, how = both.to_dict()["random_force"], quiet()
    assert "random_force" not in alone.to_dict()
    assert Noise.of(known, both.ship).force == pytest.approx([known[s] for s in "XYN"])
    assert all(0.3 < known[s] / true < 3 for s, true in zip("XYN", (how.X, how.Y, how.N), strict=True))
    codes = [{m["code"] for m in result.to_dict()["messages"]} for result in (alone, both)]
    assert "two_estimates" not in codes[0] and "two_estimates" in codes[1]
    assert alone.objects is not None and both.objects is not None
    first, mean = alone.objects.calibration, both.objects.calibration
    at = [first.ship.symbols.index(s) for s in first.prior.symbols]
    folds = each_alone(len(both.objects.trials))
    moved = [coefficients_without(c, folds)[:, at] / first.prior.std for c in (first, mean)]
    assert np.isfinite(moved[0]).all()  # without a run the second estimate keeps its distance
    np.testing.assert_allclose(moved[1] - moved[0], np.tile(mean.p - first.p, (len(disturbed_runs), 1)), atol=1e-6)


def in_a_tide(currents: Sequence[float]) -> list[Trial]:
    """Runs in a stream along north and south that has another speed [m/s] in each."""
    runs = (*SHORT_RUNS, ("turning:20", 60.0))
    return [pushed_trials(4, [f"current:x={c}"], [run])[0] for run, c in zip(runs, currents, strict=True)]


@pytest.mark.slow
def test_a_stream_that_turns_is_fitted_along_run_by_run() -> None:
    """Else nothing was said of it, and half of the figures of a ship tested in a tide lay outside their intervals."""
    tide = (0.06, 0.02, -0.03, -0.06)
    result = mmg_ident.calibrate(FEW, in_a_tide(tide), (), None, FitOptions(next_trial=False))
    codes = {m.code for m in result.messages}
    assert {"suspect", "without_own_constants"} <= codes and "current" not in result.ship.effects
    assert result.per_run is not None and "two_estimates" in codes  # the mean of both, as without a tide
    for trial, speed in zip(in_a_tide(tide), tide, strict=True):
        row = result.per_run[trial.name]["current.x"]
        assert row.value == pytest.approx(speed, abs=max(3 * row.std, 0.01))
    steady = second_estimate(FEW, in_a_tide([0.06] * 4))
    assert "current.x" in steady.suspects and not steady.by_run
