"""What a diagnosis tells a calibration: tests of the effects freed in it, a second estimate by its filter, and which
of the usual suspects the trials speak for.

A fit knows errors of what is measured only, however long they last. Whether an effect is there is a question to the
likelihood ratio with and without it, in which a random force that wanders along each run may explain the same. The
second estimate is the fit without effects with which a diagnosis begins.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.criteria.standard_runs import approach_speed, simulated_run
from cases.evidence.tails import chi2_tail
from cases.io.campaigns import campaign_labels
from cases.shipfiles.effects import calm_and_deep, parameters
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.estimation.candidates import Candidate, Column, find
from diagnosis.estimation.gridded_trials import grids_as_read, possible_readings
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import priors_of_effects, set_values
from diagnosis.estimation.transition_model import FORCE, TransitionModel
from diagnosis.hypotheses.forward_selection import Selection, select_effects
from diagnosis.hypotheses.own_currents import BY_RUN, by_run, by_run_among
from diagnosis.hypotheses.refit import SearchProblem, gained, refit
from diagnosis.inputs import Case
from diagnosis.prepare import (
    InputReading,
    Prepared,
    fit_as_read,
    fit_of_more,
    prepare,
    priors_before,
    with_sensor_faults,
)
from fitting.calibration import SecondEstimate
from fitting.nlp.windows import default_step
from fitting.record import EffectTest, EffectValue, MessageRow
from fitting.result import FitResult
from mmg.effects import EFFECTS
from mmg.errors import NotCalibrated, Unsupported, UserError
from mmg.messages import Message
from mmg.ship import Ship

# Steps of a filter that take 2 GB (13,460 s of a 3 m model: 0.6 GB). So it was measured; set by hand: it bounds memory.
MOST = 40_000
# Steps of trials that are fitted first where there are at least twice as many: sizes of the noise and how far apart
# samples are compared hardly depend on the rest. On 35 records 20 linearisations of all trials become seven. So it was
# measured; set by hand.
FEW = 3_000
# Samples so short, in steps of the filter, that it hardly matters whether actuators are held or joined between them:
# one reading is fitted then, not both. Set by hand.
FINE = 0.25


# What is wrong with most campaigns where something is, and what to do: instruments and surroundings that coefficients
# make up for. Velocity filter, gyro and inputs held or sampled are found before any fit.
SUSPECTS = {
    "antenna_offset": "if it is known, say reference_point in trials.toml",
    "current": "--per-run current gives each run its own",
    "log_scale": "correct the log, or leave it to the fit",
    "heading_bias": "correct the heading, or leave it to the fit",
}
FREE_IT = {"current": 'free it with "--per-run current", or "--with current" where it is one'}
BY_NAME = 'free it with "--with {}"'
# What trials or the machine may make fail. An error of programming is none of these and must be seen: one of shapes was
# hidden here, and every fit was without its second estimate.
FAILS = (UserError, ArithmeticError, np.linalg.LinAlgError, MemoryError)
# Tested beside them and not said: a steady force is what a resistance looks like that the priors have wrong.
BESIDE = ("tow",)


def second_estimate(
    ship: Ship, trials: Sequence[Trial], frees: bool = True, surroundings: bool = True
) -> SecondEstimate:
    """Values of the free coefficients of ``ship`` from ``trials``, and the usual suspects that these speak for.

    The values are the most likely ones with random forces, gusts and sensor noise of estimated sizes, as predictions of
    the next sample tell; faults of instruments that the kinematics of the trials show are in the model. Priors are the
    values and standard deviations of the ship, as in a calibration. Suspects are selected as a diagnosis selects
    effects, beside coefficients and random forces: with odds of more than 20 to 1 and more evidence than for a free
    force. frees: whether they are fitted along from then on, surroundings only where that is wanted too, and
    all trials are of one campaign or each run has its own current. A message says of each its size and what it moves,
    or why there is no estimate.
    """
    own = {s.partition(".")[0] for s in ship.free if "." in s}
    try:
        case, few = _for_filter(_as_stated(ship), trials)
        ready = _prepared(case, few)
        mine = [c for c in ready.problem.candidates if c.effect not in own]
        mine += by_run_among(mine, ready.problem.data)
        found = _standing(select_effects(replace(ready.problem, candidates=tuple(mine)), ready.null), ready)
        rows = [(k, c) for k, c in enumerate(found.effects) if c.effect not in BESIDE]
        read = _of_reading(ready.reading, frees)
        # instruments stay from day to day, surroundings do not: one current of several days is none
        stays = surroundings and len(set(campaign_labels(case.trials))) == 1
        along = {
            k: frees and (surroundings if c.form == BY_RUN else stays or not EFFECTS[c.effect].surroundings)
            for k, c in rows
        }
        messages = (*read, *(_of_suspect(ship, ready, found, k, along[k]) for k, _ in rows))
        suspects = [c for k, c in rows if along[k]]
        final, free = found.null, ready.problem.base
        if suspects or len(ready.case.trials) < len(case.trials):
            every = range(len(case.trials))
            suspects = [by_run(find(mine, c.effect), every) if c.form == BY_RUN else c for c in suspects]
            free = ready.problem.base + priors_of_effects(suspects)
            final = fit_of_more(ready, case.trials, free, found.final)
    except FAILS as error:  # a fit is not lost by what it is compared with
        return SecondEstimate(f"a filter could not be fitted ({error or type(error).__name__})")
    symbols = tuple(s for c in suspects if c.form != BY_RUN for s in c.symbols)
    turning = tuple(c.effect for c in suspects if c.form == BY_RUN)
    force = dict(zip("XYN", final.noise.force.tolist(), strict=True)) | {"memory_s": float(final.noise.tau)}
    values = {s: final.value(s) for s in free.symbols if "." not in s or s in symbols}
    return SecondEstimate(values, symbols, turning, frees and bool(read), messages, force)


def _standing(found: Selection, ready: Prepared) -> Selection:
    """What stands of the selection ``found`` beside a free force, as in a verdict: a hull whose form is not that of the
    ship looks a little like an antenna or a compass that is off, and more like a force without a name."""
    if not found.effects:
        return found
    from diagnosis.hypotheses.unnamed import unnamed_forms  # late: most campaigns have no suspect
    from diagnosis.judgement.verdict import standing

    p = ready.problem
    left = unnamed_forms(p.steps, p.data, found.final).evidence - p.expected_unnamed
    return found.first(standing(found.evidence, left))


def _prepared(case: Case, few: TrialSet) -> Prepared:
    """The fit without effects to a ``few`` of the trials of a ``case``, or to all where those cannot be fitted."""
    try:
        return prepare(replace(case, trials=few), None, _clear_reading(case), (*SUSPECTS, *BESIDE))
    except UserError:
        if len(few) == len(case.trials):
            raise
        return _prepared(case, case.trials)


def _of_reading(reading: InputReading, frees: bool) -> list[Message]:
    """That inputs were sampled, where the trials speak for it; frees: whether they are taken as such from then on."""
    if not reading.is_sampled:
        return []
    words = "the trials speak for rudder and revolutions that move along straight lines between their samples (log "
    words += f"likelihood +{reading.gain:.0f}), "
    words += "as which they are taken" if frees else "which the fit holds from sample to sample"
    return [Message(f'{words}; say inputs = "sampled" in trials.toml, for other commands too', "suspect")]


def _of_suspect(ship: Ship, ready: Prepared, found: Selection, number: int, frees: bool) -> Message:
    """The effect of this ``number`` in the selection ``found``: its size, what it moved, and what to do."""
    from diagnosis.summary import parameters_of  # late: most campaigns have no suspect

    c = found.effects[number]
    if c.form == BY_RUN:
        values = {s: [found.final.value(*x) for x in c.columns if x.symbol == s] for s in c.symbols}
        sizes = [f"{s.partition('.')[2]} = {min(v):.3g} to {max(v):.3g} m/s by run" for s, v in values.items()]
    else:
        sizes = [
            f"{symbol} = {x.value:.3g} ± {x.std:.2g} {x.unit}".rstrip()
            for symbol, x in parameters_of(ready.full, found.final, c).items()
            if x.std > 0
        ]
    words = f"the trials speak for {c.effect} ({', '.join(sizes)}; log odds {found.evidence[number]:.0f})"
    words += ", which is fitted along" if frees else ", for which coefficients make up"
    before, after = (_tactical_diameter(ship, fit) for fit in found.fits[number : number + 2])
    if before and after:
        words += f": it moves the tactical diameter from {before:.3g} to {after:.3g} L"
    advice = SUSPECTS[c.effect] if frees else FREE_IT.get(c.effect, BY_NAME.format(c.effect))
    return Message(f"{words}; {advice}", "suspect")


def _tactical_diameter(ship: Ship, fit: Estimate) -> float | None:
    """Of the ``ship`` with the coefficients of a ``fit`` and 35 deg of rudder [L], None where she does not turn."""
    calm, _ = calm_and_deep(
        ship.with_values({s: fit.value(s) for s in fit.free.symbols if s in ship.free and "." not in s})
    )
    try:
        run = simulated_run(calm, "turning:35", approach_speed(calm)[0])
    except UserError:
        return None
    return run.figures["tactical_diameter"] / run.length if "tactical_diameter" in run.figures else None


def _for_filter(ship: Ship, trials: Sequence[Trial]) -> tuple[Case, TrialSet]:
    """The case of a ``ship`` with the faults of instruments that her ``trials`` show and of those of them that can be
    diagnosed, and a few of these for a first fit. Raises UserError where a filter would take too much memory."""
    kept, _ = TrialSet.of(trials).moving("fit").once
    case, _ = with_sensor_faults(Case(ship, kept))
    length = ship.particulars["L"]
    step = default_step(kept, length)
    steps = _duration(kept) / step
    if steps > MOST:
        raise Unsupported(f"a filter of {steps:.0f} steps would take too much memory (at most {MOST})")
    few = _some(kept, max(1, int(steps // FEW)))
    return case, few if default_step(few, length) == step else kept


def _as_stated(ship: Ship) -> Ship:
    """The ``ship`` whose values and standard deviations are her priors, without a network."""
    rows = {s: c.with_(prior_value=None, prior_std=None) for s, c in ship.coefficients.items()}
    return ship.without_network().with_coefficients({s: c for s, c in rows.items() if c != ship.coefficients[s]})


def _clear_reading(case: Case) -> bool | None:
    """How actuators are read where samples are so short that it hardly matters, None where it does."""
    is_fine = max(t.dt for t in case.trials) <= FINE * default_step(case.trials, case.ship.particulars["L"])
    return possible_readings(case.trials)[-1] if is_fine else None


def _duration(trials: Sequence[Trial]) -> float:
    """Of all ``trials`` together [s]."""
    return sum(trial.duration for trial in trials)


def _some(trials: TrialSet, every: int) -> TrialSet:
    """One in ``every`` of the ``trials``, beginning where they last nearest to that share of all."""
    share = _duration(trials) / every
    each = [TrialSet(trials[first::every]) for first in range(min(every, len(trials)))]
    return min(each, key=lambda some: abs(_duration(some) - share))


LEVEL = 0.05  # Probability below which an effect is more than chance. Set by hand: a usual level.
APART = 3.0  # Standard errors of their difference from which two estimates are said to differ. Set by hand.


def with_effect_tests(result: FitResult, ship: Ship) -> FitResult:
    """``result`` with a test of each effect that was freed in the ``ship`` as given, in ``effects``.

    As given where none was, and for a result that was read. What fails is a warning, and the result stays.
    """
    free = set(result.estimates)
    names = [e for e in ship.effects if any(s.startswith(f"{e}.") for s in free)]
    if not names or result.objects is None:
        return result
    began = time.perf_counter()
    try:
        tests = effect_tests(result, names, result.objects.trials)
    except FAILS as error:  # a finished fit is not lost by a test of it
        why = f"{', '.join(names)}: not tested by a likelihood with a random force: {error or type(error).__name__}"
        return replace(result, messages=(*result.messages, MessageRow("warning", "effect_not_tested", why)))
    seconds = time.perf_counter() - began
    rows = [MessageRow("warning", "effect_in_doubt", t.sentence) for t in tests if t.in_doubt]
    wall = result.timings_s.get("wall", 0.0) + seconds
    timings = {**result.timings_s, "effects": seconds, "wall": wall}
    return replace(result, effects=tuple(tests), messages=(*result.messages, *rows), timings_s=timings)


def effect_tests(result: FitResult, names: Sequence[str], trials: Sequence[Trial]) -> list[EffectTest]:
    """Likelihood-ratio tests of the effects ``names`` freed in ``result``, on the ``trials`` of the fit.

    Raises UserError where they cannot be made.
    """
    if not result.converged:
        raise NotCalibrated("the fit has not converged")
    if result.per_run:
        raise Unsupported("runs have constants of their own (--per-run)")
    ship = result.ship.without_network()
    candidates = [_freed(ship, result, name) for name in names]
    symbols = [s for c in candidates for s in c.symbols]
    neutral = np.concatenate([c.neutral for c in candidates])
    rows = zip(symbols, neutral, strict=True)
    without = ship.with_coefficients({s: ship.coefficients[s].with_(value=v, fixed=True) for s, v in rows})
    base = priors_before(without)
    full = without if "tow" in without.effects else without.with_effect("tow", {})
    grids = grids_as_read(trials, full, result.settings.step)
    steps = TransitionModel(full, [*base.symbols, *symbols, *FORCE], grids[0].h)
    ready = fit_as_read(steps, grids, full.values, base, initial_noise(full))[0]
    data, null = ready.data, ready.null
    start = {Column(s): result.estimates[s].value for s in symbols}
    problem = SearchProblem(steps, data, base, tuple(candidates))
    every = refit(problem, null, candidates, start)
    tests = []
    for c in candidates:
        rest = [other for other in candidates if other is not c]
        fewer = null
        if rest:
            theta = set_values(full, data, every.theta, c.columns, c.neutral)
            first = {x: every.value(*x) for other in rest for x in other.columns}
            fewer = refit(problem, replace(every, theta=theta), rest, first)
        kept = len(symbols) - len(c.symbols)
        lost = gained(fewer, kept, every, len(symbols))
        chance = chi2_tail(2 * lost, len(c.symbols))
        chance *= 0.5 if len(c.symbols) == 1 and c.neutral[0] <= c.lower[0] else 1.0  # it can only be positive
        tests.append(_test(result, c, every, chance))
    return tests


def _freed(ship: Ship, result: FitResult, name: str) -> Candidate:
    """The parameters of an effect that the fit freed, as a candidate."""
    free = [p for p in parameters(ship, name) if f"{name}.{p.symbol}" in result.estimates]
    sizes = (np.array([getattr(p, k) for p in free]) for k in ("neutral", "typical", "lower", "upper"))
    return Candidate(name, "", tuple(Column(f"{name}.{p.symbol}") for p in free), *sizes)


def _test(result: FitResult, c: Candidate, found: Estimate, chance: float) -> EffectTest:
    """The test of one effect beside what the fit says of it."""
    at = [result.correlation.symbols.index(s) for s in c.symbols]
    rows = [result.estimates[s] for s in c.symbols]
    stds = np.array([math.nan if row.std is None else row.std for row in rows])
    correlation = np.array([[result.correlation.matrix[i][j] for j in at] for i in at], dtype=float)
    off = (np.array([row.value for row in rows]) - c.neutral) / stds
    squares = float(off @ np.linalg.pinv(correlation) @ off) if np.isfinite(off).all() else math.nan
    by_fit = chi2_tail(squares, len(off)) if math.isfinite(squares) else None
    values = {s: EffectValue(found.value(s), found.std(s)) for s in c.symbols}
    apart = [
        abs(row.value - v.value) / np.hypot(std, v.std) for row, v, std in zip(rows, values.values(), stds, strict=True)
    ]
    words, in_doubt = _words(c, result, values, (chance, by_fit), max(apart) > APART, found.noise.tau)
    return EffectTest(c.effect, chance, by_fit, values, float(found.noise.tau), words, in_doubt)


def _words(
    c: Candidate,
    result: FitResult,
    found: dict[str, EffectValue],
    p: tuple[float, float | None],
    differ: bool,
    tau: float,
) -> tuple[str, bool]:
    """Both estimates in a sentence, and whether they disagree. p: by chance, with a random force and by the fit."""
    (chance, by_fit), rows = p, {s: result.estimates[s] for s in found}
    sizes = (f"{s.partition('.')[2]} = {v.value:.3g} ± {v.std:.2g} {rows[s].unit}".rstrip() for s, v in found.items())
    words = f"{c.effect}: p = {chance:.2g} by a likelihood with a random force ({', '.join(sizes)})"
    if by_fit is None:
        return words, False
    fitted = ", ".join(f"{row.value:.3g} ± {row.std or math.nan:.2g}" for row in rows.values())
    words += f", p = {by_fit:.2g} by the standard errors of the fit ({fitted})"
    if by_fit < LEVEL <= chance:
        why = f"a force that wanders over some {tau:.2g} s explains as much, and the fit takes that for the effect"
    elif chance < LEVEL <= by_fit:
        why = "the fit has no random force, and what this moves makes its estimate wide"
    elif differ and chance < LEVEL:
        why = "in one of them the effect stands in for something else; mmg diagnose tests it against all others"
    else:
        return words, False
    return f"{words}; they disagree: {why}", True
