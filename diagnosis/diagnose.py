"""Diagnosis of the sim-to-real gap: the pipeline behind ``mmg diagnose``.

Fit without any effect; test all effects at once; refit the best; name one after the other while that is more than
chance; test what is left for unnamed forces; check on trials that took no part.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from cases.io.site import Site
from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis import summary
from diagnosis.estimation.candidates import FITTED_ALONG, find
from diagnosis.estimation.map_estimate import BREAKS_DOWN, BrokenModelError, Estimate
from diagnosis.findings import Between, DiagnosisInputs, HeldOut, RandomSizes
from diagnosis.groups.between import compare_groups
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.next_test import next_test, telling_test
from diagnosis.hypotheses.own_currents import own_currents, taken_out
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unexplained_force import estimated_force, unexplained_force
from diagnosis.hypotheses.wider_priors import likely_widths
from diagnosis.inputs import Case, DiagnosisOptions, case_of, told_of_predictions
from diagnosis.judgement.budget import budget_of
from diagnosis.judgement.verdict import JudgedSearch, judged_search, limits
from diagnosis.location.where import where
from diagnosis.prepare import Prepared, prepare, with_sensor_faults
from diagnosis.report.words import likeness, percent, sentence_of
from diagnosis.result import Diagnosis
from diagnosis.validation.held_out import compare
from fitting.parallel import with_one_thread
from fitting.report.run_folder import data_rows, versions
from fitting.solvers.control import Control, OutOfTimeError
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.messages import LOGGER, Message, OnProgress
from mmg.ship import Ship

Value = TypeVar("Value")


@with_one_thread
def diagnose(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial] = (),
    site: Site | Path | None = None,
    options: DiagnosisOptions | None = None,
    calibrated_on: Path | str | Sequence[Trial] | None = None,
    progress: OnProgress | None = None,
) -> Diagnosis:
    """Say which effect the model of ``ship`` lacks, judged by ``trials``; what ``mmg diagnose`` does.

    ship: calibrated or not; its learned residual is left out. tests: trials to check on, to which those of
    ``trials`` with the role test or validate go over; those that share rows with the rest are left out. site: what
    is known of the place, or its file (default: site.toml beside the trials). calibrated_on: the trials that the
    ship was calibrated on, or the folder of that run. If those are other trials, what they show already is no news;
    otherwise the priors from before the calibration count. options: step, seed, ...; progress: called as the work
    goes on. Returns the verdict with all that led to it; "unknown" with the reason where the ship explodes along
    the trials. Raises UserError for input from which nothing can be concluded, and OutOfTimeError where the time
    limit is reached before there is a verdict; what comes after it is left out then, with a warning.
    """
    o, began = options or DiagnosisOptions(), time.perf_counter()
    control = Control.within(o.time_limit, progress)
    with control.in_force():
        case = case_of(ship, trials, tests, site, o.between, calibrated_on)
        rows, test_rows = tuple(data_rows(case.trials)), tuple(data_rows(case.tests))
        predictions = told_of_predictions(case.ship, calibrated_on)
        inputs = DiagnosisInputs(rows, test_rows, o.command, o.seed, versions(), predictions)
        try:
            diagnosis = _diagnosed(case, o, control.note)
        except (BrokenModelError, np.linalg.LinAlgError) as error:
            why = str(error) if isinstance(error, UserError) else f"{case.ship.name}: {BREAKS_DOWN} ({error})"
            return no_answer(case.ship, why, case.remarks, inputs, time.perf_counter() - began)
        except OutOfTimeError as error:
            words = "before anything could be concluded; give more time, or fewer trials, or a coarser --step"
            raise OutOfTimeError(f"{case.ship.name}: {error} {words}") from None
        timings = {**diagnosis.timings, "total": time.perf_counter() - began}  # with all passes, see ``_diagnosed``
        return replace(diagnosis, warnings=(*case.remarks, *diagnosis.warnings), inputs=inputs, timings=timings)


def _diagnosed(
    case: Case, options: DiagnosisOptions, progress: OnProgress | None, over_ground: Prepared | None = None
) -> Diagnosis:
    """The diagnosis of a ``case``. All is done again where the search shows a sensor's fault, and through the water
    where runs have currents of their own; over_ground: the trials before these were taken out."""
    began, given, sensors = time.perf_counter(), case.ship, case.sensors
    faulty, repairs = with_sensor_faults(case)
    ready = prepare(faulty, options.step)
    timings = {"fit": time.perf_counter() - began}
    if over_ground is None and (through_water := _through_water(case, ready, options, progress)):
        return through_water
    ready, result = _judged(ready, options, progress)
    p = ready.problem
    selection = result.found
    if faults := [sensors.form_of(c.effect) for c in selection.effects if c.effect in FITTED_ALONG]:  # no cause
        return _diagnosed(replace(case, ship=freeing_effects(given, faults)), options, progress, over_ground)
    missing = estimated_force(result.free) if result.is_left or result.verdict == "unknown" else None
    is_fitted = not case.calibration.other and any(c.prior_std is not None for c in given.coefficients.values())
    budget = budget_of(p, selection, missing, options.seed, None if is_fitted else ready.full.ship.values)
    time_error, final, is_found = ready.reading.time_error, selection.final, bool(selection.effects)
    same = summary.equivalence_class(selection) if is_found else ()
    timings["screen, refits, test trials"] = time.perf_counter() - began - timings["fit"]
    LOGGER.info("tested and refitted: " + (", ".join(c.label for c in selection.effects) or "no effect stands out"))
    held_out = _held_out((p, selection.null), over_ground, final, options.seed)
    instruments = summary.instrument_faults(ready.full, final)
    ship = summary.without_exact_gyro(faulty.ship, given, instruments)
    ship_before = summary.fitted_ship(ship, ready.full, selection.null, ())
    remainder = result.is_left and (budget is None or budget.matters)
    reasons = [*result.reasons] if remainder or result.verdict != "named" else []
    reasons += limits(ready, selection, budget, final if is_found else None)
    causes = [c for c in selection.effects if not c.measures]
    effects = tuple(summary.named_effect(ready.full, selection, c, time_error) for c in causes)
    LOGGER.info("locating the gap and planning the next test")
    place = where(p.steps.model.controls, p.data, selection.null, ship, final if is_found else None)
    advice = _unless_impossible(lambda: _advice(ready, selection, same, ship), "the next test", "", reasons)
    after_all = summary.fitted_ship(ship, ready.full, final, selection.effects, time_error) if is_found else ship_before
    unexplained = None
    if missing is not None and (remainder or result.verdict == "unknown"):
        # with the manoeuvre that would tell more of it
        test = partial(telling_test, p, final, missing, after_all)
        describe = partial(unexplained_force, p.data, final, result.free.evidence, missing, after_all)
        unexplained = _unless_impossible(lambda: describe(test()), "the unexplained force", None, reasons)
    between = _between(ready, reasons)
    nearest = next((r.candidate.effect for s in selection.searches[:1] for r in s.refitted), "")
    seen = {r.effect for r in sensors.found}
    off = tuple(f for f in instruments if f.name in {c.effect for c in selection.effects})
    sentence = sentence_of(result.verdict, effects, off, same, remainder, budget, nearest, unexplained)
    if unexplained is not None:
        sentence += likeness(result.free.by_kind)
    sentence += "".join(f" {m}." for m in ready.notices[-1:] if m.code == "wider_priors")
    return Diagnosis(
        verdict=result.verdict,
        sentence=sentence,
        effects=effects,
        instruments=instruments,
        equivalence_class=same,
        remainder=remainder,
        candidates=summary.ranking(ready.full, selection.searches[0]),
        where=place,
        held_out=held_out,
        next_test=advice,
        warnings=(*repairs, *ready.notices, *reasons, *sensors.warnings),
        not_screened=ready.full.left_out,
        noise=RandomSizes.of(selection.null),
        unnamed={"all": result.free.mixture, "single": result.free.single, **result.free.by_kind},
        kinematics=(*(r.sentence for r in sensors.found), *(f.sentence for f in instruments if f.name not in seen)),
        unexplained_force=unexplained,
        budget=budget,
        timings=timings,
        inputs=DiagnosisInputs(),
        ship=after_all,
        before=ship_before,
        null=selection.null,
        final=final,
        data=p.data,
        trials=case.trials,
        tests=case.tests,
        between=between,
    )


def _judged(ready: Prepared, options: DiagnosisOptions, progress: OnProgress | None) -> tuple[Prepared, JudgedSearch]:
    """What is ``ready``, with wider priors where those are likelier, and the verdict of its search by these."""
    result = judged_search(ready, options.seed, options.workers, progress)
    if (wider := likely_widths(ready.problem, result.searched)) is None:
        return ready, result
    words = f"Her coefficients lie {wider.factor:.2g} times as far from their stated values as their standard errors"
    words += f" say (log odds {wider.evidence:.0f}), so these were taken as that much wider, and of causes only her"
    words += " surroundings are named: see that the trials are hers, and units and frames right (mmg check), or state"
    words += " wider ones"
    # where her coefficients are not known, her forces are of another form as likely as changed
    rest = tuple(c for c in wider.problem.candidates if c.measures or EFFECTS[c.effect].surroundings)
    problem, notices = replace(wider.problem, candidates=rest), (*ready.notices, Message(words, "wider_priors"))
    ready = replace(ready, problem=problem, null=wider.fit, notices=notices)
    return ready, judged_search(ready, options.seed, options.workers, progress)


def _held_out(
    through_water: tuple[SearchProblem, Estimate], over_ground: Prepared | None, final: Estimate, seed: int
) -> HeldOut | None:
    """Errors of the test trials by the fit without effects and by the ``final`` one. through_water: the problem and its
    fit without effects; over_ground: those before currents were taken out, which come before then; seed: of draws."""
    p, null = through_water
    first, fit = (over_ground.problem, over_ground.null) if over_ground else (p, null)
    if p.tests is None or first.tests is None:
        return None
    return compare((first.steps, first.tests, fit), (p.steps, p.tests, final), seed)


def _through_water(
    case: Case, ready: Prepared, options: DiagnosisOptions, progress: OnProgress | None
) -> Diagnosis | None:
    """The diagnosis of a ``case`` without the currents that its runs have of their own; None where they have none."""
    # where groups are compared, what differs between their runs is the question
    currents = own_currents(ready.problem, ready.null) if case.groups is None else None
    if currents is None:
        return None
    trials, tests = TrialSet.of(taken_out(case.trials, currents.training)), taken_out(case.tests, currents.tests)
    d, (least, most) = _diagnosed(replace(case, trials=trials, tests=tests), options, progress, ready), currents.speeds
    both = ((d.trials, currents.training), (d.tests, currents.tests))
    rows = [f"{trials[k].name} {x:.2g}, {y:.2g}" for trials, found in both for k, (x, y) in sorted(found.items())]
    words = f"currents by run [m/s to north, to east]: {'; '.join(rows)}"
    what = f"A current that differs from run to run ({least:.2g} to {most:.2g} m/s) moves the ship"
    if d.held_out is not None and not d.effects:  # nothing else lowers it
        what += f"; taken out, the squared error of the test trials falls by {percent(d.held_out.reduction)}"
    return replace(
        d,
        verdict="named" if d.verdict == "none" else d.verdict,
        sentence=f"{what}. What follows is of her motion through the water of each run. {d.sentence}",
        effects=(summary.turning_current(currents), *d.effects),
        warnings=(*d.warnings, Message(words, "own_currents")),
    )


def _unless_impossible(work: Callable[[], Value], name: str, otherwise: Value, reasons: list[Message]) -> Value:
    """The value of ``work``, which makes ``name``; where that fails, ``otherwise``, and why in ``reasons``."""
    try:
        return work()
    except (UserError, np.linalg.LinAlgError) as error:
        code = "out_of_time" if isinstance(error, OutOfTimeError) else "not_found"
        reasons.append(Message(f"{name} could not be found: {error}", code))
        return otherwise


def _between(ready: Prepared, reasons: list[Message]) -> Between | None:
    """What differs between the groups, where this was asked."""
    case = ready.case
    if case.groups is None:
        return None
    work = partial(compare_groups, ready.problem, ready.null, case.sensors, case.groups, case.trials)
    return _unless_impossible(work, "what differs between the groups", None, reasons)


def _advice(ready: Prepared, selection: Selection, same: Sequence[str], ship: Ship) -> str:
    """The next test: of the first effect selected and its class, or of the best two candidates that may be there."""
    p = ready.problem
    if selection.effects:
        rivals = [selection.effects[0], *(find(p.candidates, name) for name in same)]
    else:
        rivals = [r.candidate for r in selection.searches[0].refitted[:2] if r.evidence > 0]
    if not rivals:
        return ""
    after = summary.fitted_ship(ship, ready.full, selection.final, selection.effects)
    return next_test(p, summary.fit_with(selection, rivals[0]), rivals, after)


NOTHING = RandomSizes((0.0, 0.0, 0.0), 0.0, (0.0,) * 6)  # Sizes of noise where none was estimated


def no_answer(ship: Ship, why: str, warnings: Sequence[str], inputs: DiagnosisInputs, seconds: float) -> Diagnosis:
    """The diagnosis "unknown" of a ``ship``, which stays as it is; nothing was tested.

    why: one sentence; warnings: further ones; inputs: what it was made from; seconds: that it took. Returns it.
    """
    return Diagnosis(
        verdict="unknown",
        sentence=f"Nothing can be said: {why}.",
        effects=(),
        instruments=(),
        equivalence_class=(),
        remainder=False,
        candidates=(),
        where={},
        held_out=None,
        next_test="",
        warnings=(Message(why, "model_breaks_down"), *warnings),
        not_screened={},
        noise=NOTHING,
        unnamed={},
        kinematics=(),
        timings={"total": seconds},
        inputs=inputs,
        ship=ship,
        before=ship,
    )
