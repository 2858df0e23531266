"""Diagnosis of the sim-to-real gap: the one function that ``mmg diagnose`` calls.

Fit without any effect; screen all effects at once; refit the short list; name one after the other while that is more
than chance; test what is left against a dictionary without names; check on trials that took no part.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cases.io.site import Site, read_site
from cases.trial import Trial
from diagnosis import summary
from diagnosis.estimation.candidates import Candidate, find
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import DiagnosisInputs, HeldOut, LearnedResidual, RandomSizes
from diagnosis.hypotheses.forward_selection import AGREE, LEVEL, ODDS, Found, Problem, explain
from diagnosis.hypotheses.next_test import next_test
from diagnosis.hypotheses.unnamed import Unnamed, unnamed
from diagnosis.inputs import CalibrationTrials, calibration_trials, diagnosable, independent_tests
from diagnosis.location.where import where
from diagnosis.prepare import Prepared, prepare, with_sensor_faults
from diagnosis.report.sentence import sentence_of
from diagnosis.result import Diagnosis
from diagnosis.sensors.kinematics import consistency
from diagnosis.validation.held_out import compare
from fitting.report.run_folder import data_rows, versions
from mmg.errors import UserError, needs_torch
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress
from mmg.ship import Ship

LINE = 1e-6
"""Probability by chance below which a line in the spectrum of the residuals counts as something without a name."""
BEYOND = 1.0
"""Log likelihood, less the log of the number of forms, by which one form without a name must better a fit (in 81 blind
cases without any effect it is .1 at the most)."""
SUPPORTED = 0.1
"""Share by which predictions of the test trials must become better, with an interval above zero, for a name to stand
although more is left than it explains."""
ASIDE, LITTLE = 0.25, 0.05
"""Share of what the named effects explain that may be left without a name before the test trials must support them: the
rule, and where longer predictions of them become worse."""
EXACT = (5.0, 0.1)
"""Log Bayes factor, or share of what the named effects explain, that may be left without a name beside another form of
an instrument's fault. A constant error of v, say, is nearly one of the heading alone."""
SLIGHTLY, WORSE = 0.02, 0.15
"""Shares by which predictions of the test trials may become worse: whatever their one-step likelihood does, and if that
becomes better."""


@dataclass(frozen=True)
class DiagnosisOptions:
    """How to diagnose. step: of the analysis [s] (default: as of a fit); seed: of drawn probabilities and intervals and
    of the learned residual; workers: processes; learn: whether to measure how much a learned residual closes of what
    has no name; command: the words by which result.json says how it was made."""

    step: float | None = None
    seed: int = 0
    workers: int = 1
    learn: bool = True
    command: str = "mmg_ident.diagnose"


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

    ship: calibrated or not; its learned residual is left out. tests: trials to check on; those that share rows with
    ``trials`` are left out. site: what is known of the place, or its file (default: site.toml beside the trials).
    calibrated_on: the trials that the ship was calibrated on, or the folder of that run. If those are other trials,
    what they show already is no news; otherwise the priors from before the calibration count. options: step, seed, ...;
    progress: called as the work goes on. Raises UserError for input from which nothing can be concluded.
    """
    o = options or DiagnosisOptions()
    if o.step is not None and not 0 < o.step < 60:
        raise UserError(f"--step {o.step:g}: must be a positive number of seconds below 60")
    if o.workers < 1:
        raise UserError(f"--workers {o.workers}: must be at least 1")
    ship, remarks = diagnosable(ship)
    place = site if isinstance(site, Site) else read_site(trials, ship, site)
    kept, shared = independent_tests(trials, tests)
    known = calibration_trials(ship, trials, calibrated_on)
    found = _diagnosed(ship, trials, kept, place, o, known, progress)
    remarks += [*shared, *known.remarks, *place.notices]
    inputs = DiagnosisInputs(tuple(data_rows(trials)), tuple(data_rows(kept)), o.command, o.seed, versions())
    found = replace(found, warnings=(*remarks, *found.warnings), inputs=inputs)
    return with_learned(found, trials, kept, o, progress) if o.learn else found


def _diagnosed(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    site: Site,
    options: DiagnosisOptions,
    known: CalibrationTrials,
    progress: OnProgress | None,
) -> Diagnosis:
    """The diagnosis without what is learned, by trials of which none is a copy of another."""
    say, seed, workers = LOGGER.info, options.seed, options.workers
    began = time.perf_counter()
    sensors = consistency(trials, ship)
    ship, mended = with_sensor_faults(ship, sensors)
    ready = prepare(ship, trials, site, options.step, known.other, known.reference)
    timings = {"fit": time.perf_counter() - began}
    p = ready.problem
    test_data = None
    if tests:
        test_data = grid_trials(tests, ready.full.ship.inputs, float(ship.particulars["L"]), p.data.h, ready.straight)
        test_data = test_data.thinned(ready.gap)
    before = unnamed(p.steps, p.data, ready.null)
    answer = _answer(p, ready.null, before, test_data, seed, workers)
    reasons = list(answer.reasons)
    if answer.verdict != "named" and any(c.by_run for c in answer.found.effects):
        say("asking again with the same surroundings in all runs")
        alike = tuple(c for c in p.candidates if not c.by_run)
        answer = _answer(replace(p, candidates=alike), ready.null, before, test_data, seed, workers)
        reasons += answer.reasons
    found, after, held, verdict = answer.found, answer.after, answer.held, answer.verdict
    timings["screen, refits, test trials"] = time.perf_counter() - began - timings["fit"]
    say("screened and refitted: " + (", ".join(c.label for c in found.effects) or "no effect stands out"))
    ship_before = summary.fitted_ship(p, ship, ready.full, found.null, ())
    ship_after = summary.fitted_ship(p, ship, ready.full, found.final, found.effects)
    chance, period = ready.line
    if chance < LINE:
        reasons.append(f"what remains swings with a period of {period:.2g} s, as under waves or an engine")
        verdict = "unknown" if verdict == "none" else verdict
    say("looking at where the gap lies and what to test next")
    effects = tuple(summary.named(p, ready.full, found, c) for c in found.effects) if verdict == "named" else ()
    final = found.final if verdict == "named" else found.null
    same = summary.same(found) if verdict == "named" else ()
    rivals = [found.effects[0], *(find(p.candidates, name) for name in same)] if verdict == "named" else _rivals(found)
    rivals = list(dict.fromkeys(find(p.candidates, c.effect, c.form) for c in rivals))  # the same in all runs
    advice = next_test(p, summary.fit_with(found, rivals[0]), rivals, ship_after) if rivals else ""
    place = where(p.steps.model.controls, p.data, found.null, ship, final if verdict == "named" else None)
    timings["total"] = time.perf_counter() - began
    remainder = verdict == "named" and (incomplete(found, before, after, p.usual) or chance < LINE)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence_of(verdict, effects, same, remainder, held, found),
        effects=effects,
        equivalence_class=same,
        remainder=remainder,
        candidates=summary.ranking(p, ready.full, found),
        where=place,
        held_out=held,
        next_test=advice,
        warnings=(*mended, *ready.notices, *reasons, *_cautions(ready, found, trials, tests), *sensors.warnings),
        not_screened=ready.full.left_out,
        noise=RandomSizes.of(found.null),
        unnamed_before={"all": before.log_bayes, "single": before.single, **before.by_kind},
        unnamed_after={"all": after.log_bayes, "single": after.single, **after.by_kind},
        kinematics=tuple(r.sentence for r in sensors.found),
        timings=timings,
        inputs=DiagnosisInputs(),
        ship=ship_after if verdict == "named" else ship_before,
        before=ship_before,
        null=found.null,
        final=final,
        data=p.data,
    )


def with_learned(
    found: Diagnosis,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    options: DiagnosisOptions,
    progress: OnProgress | None = None,
) -> Diagnosis:
    """``found`` with how much a residual learned from ``trials`` closes of what has no name, measured on ``tests``.

    As given where nothing is left without a name, and without test trials. Where it cannot be measured, a warning says
    why. options, progress: as of ``diagnose``.
    """
    if not tests or not (found.verdict == "unknown" or found.remainder):
        return found
    began = time.perf_counter()
    try:
        rest = _learned(found, trials, tests, options)
    except UserError as reason:
        why = f"how much of the rest a learned residual closes was not measured: {reason}"
        return replace(found, warnings=(*found.warnings, Message(why, "not_learned")))
    seconds = time.perf_counter() - began
    spent = {**found.timings, "learned residual": seconds}
    if "total" in spent:
        spent["total"] = spent.pop("total") + seconds
    return replace(found, learned=rest, timings=spent)


def _learned(
    found: Diagnosis, trials: Sequence[Trial], tests: Sequence[Trial], options: DiagnosisOptions
) -> LearnedResidual:
    """The measurement behind ``with_learned``, which is where torch is imported."""
    needs_torch("a learned residual")
    from diagnosis.validation.learned import learned

    LOGGER.info("learning what has no name, from the training trials")
    step = found.data.h if found.data is not None else options.step
    return learned(found.ship, trials, tests, step, options.seed, options.workers)


@dataclass(frozen=True)
class _Answer:
    """Of one search: what it found, what is left without a name, the test trials, the verdict and why a name went."""

    found: Found
    after: Unnamed
    held: HeldOut | None
    verdict: str
    reasons: list[str]


def _answer(
    p: Problem, null: Estimate, before: Unnamed, tests: GriddedTrials | None, seed: int, workers: int
) -> _Answer:
    found = explain(p, null, seed, workers)
    after = unnamed(p.steps, p.data, found.final) if found.effects else before
    held = compare(p.steps, tests, found.null, found.final, seed) if tests is not None else None
    there = max(before.log_bayes, before.single + ODDS - BEYOND)
    return _Answer(found, after, held, *decide(found, there - p.usual_before, after.log_bayes - p.usual, held))


def incomplete(found: Found, before: Unnamed, after: Unnamed, usual: float = 0.0) -> bool:
    """Whether something without a name is left beside the named effects, more than is usual, or one form without a name
    alone explains more than they do."""
    drop = found.null.nll - found.final.nll
    return bool(after.log_bayes - usual > ODDS or after.single - usual > BEYOND or before.single - usual > drop)


def _rivals(found: Found) -> list[Candidate]:
    """What a next test should tell apart where nothing was named: the best two that were more than chance."""
    first = found.searches[0]
    return [t.candidate for t in first.tried[:2] if t.p_value < LEVEL and t.delta_bic > 0]


def decide(found: Found, before: float, after: float, held: HeldOut | None) -> tuple[str, list[str]]:
    """The verdict, and why a name was withdrawn.

    before, after: log Bayes factors of the dictionary without names at the fit without effects and with those named,
    less what is usual.
    """
    if not found.effects:
        return ("unknown" if before > ODDS else "none"), []
    reason = _inexact(found, after)
    if not reason and not (held is not None and _supports(held)):
        reason = _doubt(found, after, held)
    if not reason and held is not None and _contradicted(held):
        reason = f"{_names(found.effects)} fits the training trials but does not predict the test trials better"
    return ("unknown", [f"{reason}: the name is withdrawn"]) if reason else ("named", [])


def _names(effects: Sequence[Candidate]) -> str:
    return " and ".join(c.label for c in effects)


def _supports(held: HeldOut) -> bool:
    """Whether the test trials become so much more predictable that nothing else is asked of a name."""
    return held.interval_90[0] > 0 and held.reduction > SUPPORTED


def _explained(found: Found) -> tuple[float, str]:
    """Log likelihood that the named effects explain, also in words."""
    drop = found.null.nll - found.final.nll
    return drop, f"would explain a part (log likelihood {drop:.0f})"


def _doubt(found: Found, after: float, held: HeldOut | None) -> str:
    """What speaks against a name that test trials do not support, or nothing; after: as of ``decide``."""
    names, (drop, part) = _names(found.effects), _explained(found)
    if after > max(ODDS, drop):
        return f"{names} {part}, but effects without a name explain more of what is left ({after:.0f})"
    share = ASIDE if held is None or held.reduction >= -SLIGHTLY else LITTLE
    if held is not None and after > max(ODDS, share * drop):
        return (
            f"{names} {part}, but more is left without a name ({after:.0f}), and the test trials are not predicted "
            "better"
        )
    extreme = _extreme(found)
    if extreme:
        return f"{names} {part}, but only with {extreme} at the end of what is possible"
    local = [c.effect for c in found.effects if c.by_run]
    if local and (held is not None or after > ODDS):
        return (
            f"{' and '.join(local)} could differ from run to run and so {part}, but so many parameters need test "
            "trials that they predict"
        )
    apart = [f"{c.label} (p = {p:.2g})" for c, p in found.robust.items() if p > AGREE]
    return f"the runs do not agree on {' and '.join(apart)}" if apart else ""


def _inexact(found: Found, after: float) -> str:
    """Whether too much is left beside a fault of one instrument alone, which would be exact; in words, or nothing."""
    forms = [c for c in found.effects if c.form and not c.by_run]
    drop, part = _explained(found)
    if not forms or after <= max(EXACT[0], EXACT[1] * drop):
        return ""
    return f"{_names(forms)} {part}, but such a fault leaves little over, and something is ({after:.0f})"


def _extreme(found: Found) -> str:
    """The parameters of named effects that the fit put at a bound, unless at none of it: a delay of 0."""
    f, own = found.final.free, {c.effect for c in found.effects}
    value = f.mean + f.std * found.final.p
    near = (np.minimum(value - f.lower, f.upper - value) <= 1e-6 * (f.upper - f.lower)) & (value != 0)
    rows = zip(f.symbols, value, near, strict=True)
    return ", ".join(f"{s} = {v:.3g}" for s, v, n in rows if n and s.split(".")[0] in own)


def _contradicted(held: HeldOut) -> bool:
    """Whether the test trials speak against the named effects: longer predictions become clearly worse, or neither
    those nor the likelihood of one-step predictions becomes better."""
    gain, sure = held.likelihood_gain or 0.0, held.likelihood_interval_90
    worse = held.interval_90[1] < 0 and (held.reduction < -WORSE or not (sure is not None and sure[0] > 0))
    return worse or (gain < 0 and held.reduction < -SLIGHTLY) or (gain < -3 and held.interval_90[0] <= 0)


def _cautions(ready: Prepared, found: Found, trials: Sequence[Trial], tests: Sequence[Trial]) -> list[str]:
    """What cannot be concluded from this input."""
    words = []
    first = found.searches[0]
    every = [s for s in first.scores if s.candidate.label == s.candidate.effect]
    quiet = [s.candidate.effect for s in every if not s.excited]
    if quiet:
        words.append(f"not excited by these trials, so neither found nor excluded: {', '.join(quiet)}")
    hidden = [s.candidate.effect for s in every if s.excited and s.absorbed > 0.9]
    if hidden:
        words.append(
            "absorbed by calibration, visible through the priors only (over 90 % of the information): "
            + ", ".join(hidden)
        )
    unplaced = [t.name for t in trials if not t.has_position]
    if unplaced:
        words.append(
            f"no positions in {', '.join(unplaced)}: effects of place and of satellite sensors are hardly seen there"
        )
    calm = [t.name for t in trials if not t.has_wind]
    if calm and ready.full.ship.components.get("wind"):
        words.append(
            f"no wind columns in {', '.join(calm)}: calm air is assumed, so wind would be taken for something else"
        )
    kinds = {t.kind for t in trials}
    if len(trials) == 1:
        words.append("one trial only: many effects look alike in it, and whether runs agree cannot be asked")
    elif len(kinds) == 1 and "" not in kinds:
        words.append(f"all trials are of one kind ({trials[0].kind}): many effects look alike in them")
    if not tests:
        words.append("no --test trials: how far the gap closes was not checked on trials that took no part")
    return words
