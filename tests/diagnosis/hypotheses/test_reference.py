"""What the trials of the calibration show already is no news in others; what only these show is."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cases.io.read import read_trials
from cases.shipfiles.ship_file import dump_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.estimation.candidates import find
from diagnosis.hypotheses.forward_selection import Selection, select_effects
from diagnosis.hypotheses.reference import Reference, fit_reference
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.inputs import CalibrationTrials, Case, calibration_trials
from diagnosis.prepare import Prepared, prepare
from fitting.report.run_folder import RESULT, data_rows, write_json
from mmg.messages import has_code
from mmg.ship import Ship
from tests.support.diagnosis_cases import FEW, problem_of, pushed_problem, pushed_trials
from tests.support.quick import first_quick

H = 1.0
BEFORE = (("zigzag:20/20", 60.0), ("random:11", 60.0), ("turning:-20", 60.0), ("zigzag:-10/10", 60.0))
"""Runs that the ship was calibrated on."""
NEW = (("zigzag:-20/20", 60.0), ("random:5", 60.0), ("turning:25", 60.0))
MODERATE = {"antenna_offset": "antenna_offset:x=0.3,y=-0.25", "current": "current:x=0.02,y=-0.015"}
"""Effects of one to two typical sizes."""
LARGE = {"antenna_offset": "antenna_offset:x=0.9,y=-0.7", "current": "current:x=0.06,y=-0.05"}
"""Effects of more than STRONG typical sizes."""


LIMIT = 1.1
"""Log Bayes factor of the unnamed forms that chance hardly exceeds."""


@cache
def before(*effects: str) -> list[Trial]:
    return pushed_trials(1, effects, BEFORE)


@cache
def new(*effects: str) -> list[Trial]:
    return pushed_trials(2, effects, NEW)


def calibrated() -> Ship:
    """A ship as ``mmg fit`` would leave it: its priors are kept beside its estimates."""
    rows = {s: FEW.coefficients[s] for s in FEW.free}
    return FEW.with_coefficients({s: c.with_(prior_value=c.value, prior_std=c.std) for s, c in rows.items()})


def case(trials: Sequence[Trial], reference: Sequence[Trial] = (), other: bool = False) -> Case:
    """Of ``trials`` of the ship; reference: trials of her calibration; other: they are others."""
    return Case(calibrated(), TrialSet.of(trials), calibration=CalibrationTrials(other, tuple(reference)))


def diagnosed(trials: Sequence[Trial], reference: Sequence[Trial]) -> tuple[Prepared, Selection]:
    ready = prepare(case(trials, reference, True), H)
    return ready, select_effects(ready.problem, ready.null)


@cache
def known(*effects: str, runs: int = 1) -> tuple[SearchProblem, Reference]:
    """Trials with these effects, and what they show as a reference for so many ``runs`` of others."""
    p, null = pushed_problem(1, *effects, runs=BEFORE, h=H)
    return p, fit_reference(p.steps, p.data, null, p.base, p.candidates, runs)


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(MODERATE, pytest.mark.longest))
def test_an_effect_is_news_only_without_it_in_the_reference(name: str) -> None:
    """The same trials with a reference that has it too, and with one that has not."""
    trials = new(MODERATE[name])
    for reference, news in ((before(MODERATE[name]), ()), (before(), (name,))):
        ready, found = diagnosed(trials, reference)
        assert tuple(c.label for c in found.effects) == news
        assert not has_code(ready.notices, "effects_in_reference")
        assert has_code(ready.notices, "reference_fitted") is bool(reference)
        told = [words for words in ready.notices if has_code([words], "usual_effects")]
        assert bool(told) is bool(reference and not news) and all(f"{name} (p = " in words for words in told)
    # as large as it is, not as much larger as it is than in the reference
    truth = dict(part.split("=") for part in MODERATE[name].split(":")[1].split(","))
    for k, value in truth.items():
        symbol = f"{name}.{k}"
        assert abs(found.final.value(symbol) - float(value)) < 4 * found.final.std(symbol), symbol


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_a_strong_effect_of_both_is_told_and_still_named(name: str) -> None:
    ready, found = diagnosed(new(LARGE[name]), before(LARGE[name]))
    told = [words for words in ready.notices if has_code([words], "effects_in_reference")]
    assert len(told) == 1 and told[0].endswith(f": {name}")
    assert [c.label for c in found.effects] == [name]


@pytest.mark.slow
def test_the_ship_as_its_trials_show_it_needs_nothing() -> None:
    ready, found = diagnosed(new(), before())
    assert found.effects == () and found.final is ready.null
    assert (
        unnamed_forms(ready.problem.steps, ready.problem.data, ready.null).mixture - ready.problem.expected_unnamed
        < LIMIT
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_quick([102, 106]))
def test_few_runs_do_not_take_the_random_force_away(seed: int) -> None:
    """With all effects free the likelihood alone is largest with a hundredth of it, and they were sure of it."""
    problem, null = pushed_problem(seed, runs=BEFORE, h=H)
    found = fit_reference(problem.steps, problem.data, null, problem.base, problem.candidates)
    assert (found.noise.force > 0.1 * null.noise.force).all()


def wrong(trials: Sequence[Trial]) -> list[Trial]:
    """With a constant error of sway velocity, which is no effect of the library."""
    return [t.with_columns(v=t["v"] + 0.015) for t in trials]


@pytest.mark.slow
def test_what_has_no_name_in_the_reference_either_is_usual_and_grows_with_the_number_of_samples() -> None:
    few, many = (prepare(case(wrong(t), wrong(before())), H) for t in (new()[:1], new()))
    assert many.problem.data.samples > 2.5 * few.problem.data.samples
    usual = [ready.problem.expected_unnamed / ready.problem.data.samples for ready in (few, many)]
    assert usual[0] == pytest.approx(usual[1], rel=1e-9) and few.problem.expected_unnamed > LIMIT
    alone = prepare(case(wrong(new())), H)
    assert alone.problem.expected_unnamed == 0.0
    left = [unnamed_forms(r.problem.steps, r.problem.data, r.null).mixture for r in (many, alone)]
    assert min(left) > 10 * LIMIT  # it is seen
    # and mostly expected, although the fit to the reference takes it for an error of the heading alone
    assert (
        left[0] - many.problem.expected_unnamed_null < 0.5 * left[0]
        and many.problem.expected_unnamed_null > many.problem.expected_unnamed
    )


BIASES = (0.03, -0.05, 0.02, -0.04, 0.06, -0.03)
"""Errors of the heading [rad] of six runs: drawn about none with a standard deviation of .04."""


@pytest.mark.slow
def test_the_scatter_between_runs_is_that_which_they_have() -> None:
    """Six runs, each with another error of its heading."""
    kinds = ("zigzag:20/20", "random:11", "turning:-20", "zigzag:-10/10", "random:12", "turning:15")
    biased = [
        pushed_trials(60 + i, [f"heading_bias:psi={bias}"], ((kind, 60.0),))[0]
        for i, (kind, bias) in enumerate(zip(kinds, BIASES, strict=True))
    ]
    p, null = problem_of([replace(trial, name=str(i)) for i, trial in enumerate(biased)], H)
    names = ("heading_bias", "antenna_offset", "rudder_offset")
    found = fit_reference(p.steps, p.data, null, p.base, [find(p.candidates, n) for n in names])
    (psi, scatter), *others = found.scatter.items()
    size = find(p.candidates, "heading_bias").typical[0]
    assert scatter * size == pytest.approx(np.sqrt(np.mean(np.square(BIASES))), rel=0.2)
    assert abs(found.shift[psi] * size - np.mean(BIASES)) < np.std(BIASES) / np.sqrt(len(BIASES))
    assert all(v < 0.5 for _, v in others), others


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run folder of mmg fit, as far as it tells what it was calibrated on, and other trials."""
    for role, seed in (("old", 1), ("new", 2)):
        (tmp_path / role).mkdir()
        for trial in pushed_trials(seed, runs=(("zigzag:20/20", 20.0), ("turning:-20", 20.0))):
            write_trial(trial, tmp_path / role / f"{trial.kind}.csv")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "ship.toml").write_text(dump_ship(calibrated()))
    write_json(tmp_path / "run" / RESULT, {"kind": "calibration", "data": data_rows(read_trials(tmp_path / "old"))})
    return tmp_path


def known_of(
    where: Path | str, trials: Sequence[Trial], ship: Ship | None = None
) -> tuple[bool, list[Trial], list[str]]:
    """Whether the ship was calibrated on other trials, those that serve as a reference, and remarks."""
    found = calibration_trials(ship or calibrated(), trials, where)
    return found.other, list(found.reference), list(found.remarks)


def test_trials_of_the_calibration_are_the_reference_for_others(folder: Path) -> None:
    other_trials, reference, remarks = known_of(folder / "run", read_trials(folder / "new"))
    assert other_trials and remarks == []
    assert [t.sha256 for t in reference] == [t.sha256 for t in read_trials(folder / "old")]
    assert all(t.path and t.path.parent.name == "old" for t in reference)
    without_wind = replace(calibrated(), components={k: v for k, v in calibrated().components.items() if k != "wind"})
    other_trials, reference, remarks = known_of(folder / "run", read_trials(folder / "new"), without_wind)
    assert other_trials and reference == [] and len(remarks) == 1  # none for another model than was calibrated


def test_trials_of_the_calibration_are_no_reference_for_themselves(folder: Path) -> None:
    old, other = read_trials(folder / "old"), read_trials(folder / "new")
    for uncalibrated in ("esso_osaka_3m", folder / "old"):
        assert known_of(uncalibrated, other) == (False, [], [])
    assert known_of(folder / "run", old) == (False, [], [])
    assert known_of(folder / "run", [*other, old[0]]) == (False, [], [])  # nor a part of them
    shutil.copy(folder / "old" / "zigzag.csv", folder / "new" / "renamed.csv")
    assert known_of(folder / "run", read_trials(folder / "new")) == (False, [], [])
    less = shortened(folder / "old" / "zigzag.csv", 3)
    (folder / "new" / "renamed.csv").write_text(less)  # nor another file with their rows
    assert known_of(folder / "run", read_trials(folder / "new")) == (False, [], [])


def shortened(path: Path, rows: int) -> str:
    """The text of a trial file without its last rows."""
    return "\n".join(path.read_text().splitlines()[:-rows]) + "\n"


@pytest.mark.slow
@pytest.mark.parametrize("what", ["gone", "moved", "changed", "broken"])
def test_trials_that_cannot_be_read_as_they_were_are_no_reference_and_that_is_said(what: str, folder: Path) -> None:
    path = folder / "old" / "turning.csv"
    if what == "gone":
        shutil.rmtree(folder / "old")
    elif what == "moved":
        path.rename(folder / "elsewhere.csv")
    else:
        path.write_text("nothing" if what == "broken" else shortened(path, 5))
    other_trials, reference, remarks = known_of(folder / "run", read_trials(folder / "new"))
    assert other_trials and reference == [] and len(remarks) == 1
