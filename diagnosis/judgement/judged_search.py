"""Effects selected and judged: search, tests of what is left, check on test trials, chance, verdict.

An answer is believed where no effect has a size that it cannot have, and not where the coefficients are those of
another ship.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.tails import chi2_tail
from cases.trial import Trial
from diagnosis.estimation.candidates import Candidate, FullModel, parameters
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.noise_sizes import least_noise
from diagnosis.findings import Chance, HeldOut, NamedEffect
from diagnosis.hypotheses.forward_selection import AGREE, LEVEL, Selection, select_effects
from diagnosis.hypotheses.found_again import CERTAIN, NOTHING, SHOWN, both_by_weight
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.simulated_chance import SimulatedChance, simulated_chance
from diagnosis.hypotheses.unnamed import UnnamedForms, unnamed_forms
from diagnosis.inputs import DiagnosisOptions
from diagnosis.prepare import Prepared
from diagnosis.summary import parameters_of
from diagnosis.validation.held_out import compare, prediction_errors
from mmg.effects import EFFECTS
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress
from mmg.ship import Ship
from mmg.states import STATES

CONFIRMING_REDUCTION = 0.1
"""Reduction of the test error, with a 90 % interval above zero, that confirms a name whatever is left unexplained."""
UNEXPLAINED_RATIO, STRICT_RATIO = 0.25, 0.05
"""Unexplained-to-explained ratio of log likelihood above which test trials must confirm a name; and where their longer
predictions become worse. Where test trials show no gain beyond chance at all, nothing may be left unexplained."""
BESIDE_INSTRUMENT_FAULT = (5.0, 0.1)
"""Log Bayes factor, and share of what the name explains, that may be left unexplained beside a fault of one instrument
alone. A constant error of v, for example, is nearly one of the heading alone."""
SMALL_GROWTH, NOTED_GROWTH, LARGE_GROWTH = 0.02, 0.05, 0.15
"""Growth of the test error that is accepted; that contradicts a name unless one-step predictions surely improve; and
even if they do."""


def has_remainder(found: Selection, before: UnnamedForms, after: UnnamedForms, expected: float = 0.0) -> bool:
    """Whether something is left unexplained beside the named effects.

    found: the selection; before, after: tests of unnamed forces without the effects and with them; expected: log Bayes
    factor that the trials of the calibration show as well. Returns True, too, where one unnamed form alone explains
    more than the named effects do.
    """
    gain = found.null.nll - found.final.nll
    return bool(after.beyond_chance > expected or before.single - expected > gain)


def decide(
    found: Selection, beyond: float, after: float, limit: float, held: HeldOut | None
) -> tuple[str, list[Message]]:
    """The verdict "none", "named" or "unknown", and why a name was withdrawn.

    found: the selection; beyond: by how much the unnamed forms without any effect are beyond chance, and beyond what
    the trials of the calibration show as well; after: log Bayes factor of those with the effects, less what those
    trials show; limit: what it exceeds hardly by chance; held: the check on test trials, None without any.
    """
    if not found.effects:
        return ("unknown" if beyond > 0 else "none"), []
    if held is not None and contradicts(found, held):
        reason = f"{_names(found.effects)} fits the training trials but does not predict the test trials better"
    else:
        reason = _inexact(found, after)
    if not reason and not (held is not None and confirms(held)):
        reason = _doubt(found, after, limit, held)
    if not reason:
        return "named", []
    first = found.searches[0].best if found.searches else None
    chance = first is not None and first.p_both > CERTAIN and beyond <= 0
    return "none" if chance else "unknown", [Message(f"{reason}: the name is withdrawn", "name_withdrawn")]


def _names(effects: Sequence[Candidate]) -> str:
    return " and ".join(c.label for c in effects)


def _measures(found: Selection) -> bool:
    """Whether a named effect is one of the instruments. A window of the test trials begins at a logged row, which is
    then itself late or off: only predictions over one step, from a state filtered over the past, tell."""
    return any(c.measures for c in found.effects)


def _surely_gains(held: HeldOut) -> bool:
    """Whether predictions of the test trials over one step become better beyond chance."""
    return held.likelihood_interval_90 is not None and held.likelihood_interval_90[0] > 0


def _is_certain(found: Selection, effects: Sequence[Candidate]) -> bool:
    """Whether chance is excluded as the cause of each of the ``effects``."""
    by_chance = {s.best.candidate: s.best.p_both for s in found.searches if s.best is not None}
    return all(by_chance.get(c, 1.0) < CERTAIN for c in effects)


def _may_be_there(found: Selection, effects: Sequence[Candidate], held: HeldOut) -> bool:
    """Whether the test trials were asked for each of the ``effects`` in the direction in which it was found, with what
    the training trials left open taken out, and do not exclude it. Predictions by coefficients as they were estimated
    are worse or better by their errors, too: the true ship, begun at the logged rows, lost to a false one in 30 s. But
    single steps of ``held`` that lose more than the effects gained are none of a true ship."""
    best = {s.best.candidate: s.best for s in found.searches if s.best is not None}
    asked = [(best[c].by_others, best[c].gain) if c in best else (NOTHING, 0.0) for c in effects]
    lost = -(held.likelihood_gain or 0.0)
    within = lost <= sum(gain for _, gain in asked)
    return within and all(again.expected > 0 and not again.denies(gain) for again, gain in asked)


def _worse(held: HeldOut) -> bool:
    """Whether the test trials surely become less predictable, over windows by more than a little, or by steps."""
    by_steps = held.likelihood_interval_90 is None or held.likelihood_interval_90[1] < 0  # None: chance is not known
    return (held.interval_90[1] < 0 and held.reduction < -NOTED_GROWTH) or by_steps


def confirms(held: HeldOut) -> bool:
    """Whether the test trials become by ``held`` so much more predictable that nothing else is required of a name."""
    return held.interval_90[0] > 0 and held.reduction > CONFIRMING_REDUCTION


def surely_confirms(held: HeldOut) -> bool:
    """Whether the test trials become by ``held`` as much more predictable, and that surely over single steps."""
    return held.reduction > CONFIRMING_REDUCTION and _surely_gains(held)


def _explained(found: Selection) -> tuple[float, str]:
    """Log likelihood that the named effects explain, also in words."""
    gain = found.null.nll - found.final.nll
    return gain, f"would explain a part (log likelihood {gain:.0f})"


def _doubt(found: Selection, after: float, limit: float, held: HeldOut | None) -> str:
    """What speaks against a name that test trials do not confirm, or nothing; after, limit: as of ``decide``."""
    names, (gain, part) = _names(found.effects), _explained(found)
    if after > max(limit, gain):
        return f"{names} {part}, but unnamed forms explain more of what is left ({after:.0f})"
    fair = held is None or held.reduction >= -SMALL_GROWTH or (_measures(found) and _surely_gains(held))
    ratio = UNEXPLAINED_RATIO if fair else STRICT_RATIO
    if held is not None and held.interval_90[0] <= 0 and not _surely_gains(held):
        ratio = 0.0
    if held is not None and after > max(limit, ratio * gain):
        return f"{names} {part}, but much is left unexplained ({after:.0f}), and the test trials do not confirm it"
    extreme = _at_bound(found)
    if extreme:
        return f"{names} {part}, but only with {extreme} at the end of what is possible"
    best = [s.best for s in found.searches if s.best is not None]
    again = {r.candidate for r in best if r.by_others.p_value < SHOWN}  # other trials agree on it
    apart = [f"{c.label} (p = {p:.2g})" for c, p in found.robust.items() if p > AGREE and c not in again]
    return f"the runs do not agree on {' and '.join(apart)}" if apart else ""


def _inexact(found: Selection, after: float) -> str:
    """Whether too much is left beside a fault of one instrument alone, which would be exact; in words, or nothing."""
    forms = [c for c in found.effects if c.form]
    gain, part = _explained(found)
    if not forms or after <= max(BESIDE_INSTRUMENT_FAULT[0], BESIDE_INSTRUMENT_FAULT[1] * gain):
        return ""
    return f"{_names(forms)} {part}, but such a fault leaves little over, and here much is left ({after:.0f})"


def _at_bound(found: Selection) -> str:
    """Parameters of named effects that the fit put at a bound, except one of zero, as of a delay."""
    f, own = found.final.free, {c.effect for c in found.effects}
    value = f.mean + f.std * found.final.p
    near = (np.minimum(value - f.lower, f.upper - value) <= 1e-6 * (f.upper - f.lower)) & (value != 0)
    rows = zip(f.symbols, value, near, strict=True)
    return ", ".join(f"{s} = {v:.3g}" for s, v, n in rows if n and s.split(".")[0] in own)


def contradicts(found: Selection, held: HeldOut) -> bool:
    """Whether the test trials speak against the named effects: longer predictions become clearly worse, or neither
    those nor the likelihood of one-step predictions improves; of an instrument that likelihood alone counts, also where
    it tells little.

    found: the selection; held: the check on test trials."""
    gain = held.likelihood_gain or 0.0
    sure = _surely_gains(held)
    if sure and _measures(found):
        return False
    if _is_certain(found, found.effects) and (not _worse(held) or _may_be_there(found, found.effects, held)):
        return False
    if _measures(found):
        return gain < 0
    worse = held.interval_90[1] < 0 and (held.reduction < -LARGE_GROWTH or not sure)
    worse = worse or (held.reduction < -NOTED_GROWTH and not sure)
    by_windows = held.interval_90[0] > 0
    return worse or (gain < 0 and held.reduction < -SMALL_GROWTH) or (gain < -3 and not by_windows)


def limits(
    ready: Prepared,
    found: Selection,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    held: HeldOut | None,
    named: Estimate | None = None,
) -> list[Message]:
    """What cannot be concluded from this input; ready: its fit without effects, found: the selection, trials: for
    training, tests: to check on, held: that check, named: the fit with what was named, None: nothing was. Returns one
    sentence for each reason."""
    rows: list[tuple[str, str]] = []
    every = [s for s in found.searches[0].scores if not s.candidate.form]
    quiet = [s.candidate.effect for s in every if not s.excited]
    if quiet:
        rows.append(("not_excited", f"not excited by these trials, so neither found nor excluded: {', '.join(quiet)}"))
    hidden = [s.candidate.effect for s in every if s.excited and s.absorbed > 0.9]
    if hidden:
        words = "the coefficients imitate over 90 % of their information, so only the priors show them"
        rows.append(("absorbed", f"{words}: {', '.join(hidden)}"))
    unplaced = ", ".join(t.name for t in trials if not t.has_position)
    if unplaced:
        words = "effects of place and of satellite sensors hardly show there"
        rows.append(("no_positions", f"no positions in {unplaced}: {words}"))
    calm = ", ".join(t.name for t in trials if not t.has_wind)
    if calm and ready.full.ship.components.get("wind"):
        words = "calm air is assumed, so wind would be taken for something else"
        rows.append(("no_wind", f"no wind columns in {calm}: {words}"))
    kinds = {t.kind for t in trials}
    if len(trials) == 1:
        words = "one trial only: many effects look alike in it, and whether runs agree cannot be tested"
        rows.append(("one_trial", words))
    elif len(kinds) == 1 and "" not in kinds:
        rows.append(("one_kind", f"all trials are of one kind ({trials[0].kind}): many effects look alike in them"))
    rows += _doubts(ready, named)
    if not tests:
        words = "no --test trials: how far the gap closes was not checked on trials that took no part"
        rows.append(("no_tests", words))
    elif held is None:
        words = "the test trials hold no whole window without a gap: how far the gap closes was not checked"
        rows.append(("tests_too_short", words))
    return [Message(words, code) for code, words in rows]


FAR, LONG = 3.0, 3.0
"""Prior standard deviations from which a coefficient is far off; memories of the random force that a run lasts."""


def _doubts(ready: Prepared, named: Estimate | None) -> list[tuple[str, str]]:
    """Code and sentence of each way in which the fit without effects is not what the tests take it for. Coefficients
    that are off are those of the fit with what was ``named``: that it brings back the others speaks for it."""
    null, data, steps = ready.null, ready.problem.data, ready.problem.steps
    rows: list[tuple[str, str]] = []
    fit, beside = (null, "without any effect") if named is None else (named, "with what was named")
    far = [f"{s} ({p:+.1f})" for s, p in zip(fit.free.symbols, fit.p, strict=True) if abs(p) > FAR and "." not in s]
    if far:
        words = f"more than {FAR:g} prior standard deviations off {beside}: {', '.join(far)}"
        advice = "is it this ship, and are units and frames right (mmg check)? An effect may make up for what is not"
        rows.append(("far_from_prior", f"{words}: {advice}"))
    seen = np.asarray(data.good.any(axis=(0, 1)))
    quiet = [
        n
        for n, s, w, f in zip(STATES, seen, null.noise.white, least_noise(steps.ship).white, strict=True)
        if s and w <= 1.01 * f
    ]
    if quiet:
        words = f"hardly any noise in {', '.join(quiet)}, as of simulated or smoothed records"
        advice = "small differences of the numerics then count as effects, so doubt small ones"
        rows.append(("no_noise", f"{words}: {advice}"))
    longest, memory = float(data.steps.max() * data.h), null.noise.tau
    if longest < LONG * memory:
        words = f"no run is longer than {longest:.2g} s without a gap, and the random force remembers {memory:.2g} s"
        rows.append(("short_trials", f"{words}: what is constant in a run can hardly be told from it"))
    return rows


@dataclass(frozen=True)
class JudgedSearch:
    """Of a search: the selection, tests of unnamed forces without and with it, the check on test trials, the verdict,
    and why a name was withdrawn. beside: sentences on effects that were left out beside others, for a size that they
    cannot have."""

    found: Selection
    before: UnnamedForms
    after: UnnamedForms
    held: HeldOut | None
    verdict: str
    reasons: tuple[Message, ...]
    simulated: SimulatedChance | None
    beside: tuple[Message, ...] = ()

    @property
    def chance(self) -> Chance:
        """What chance gives."""
        scores = self.found.searches[0].scores if self.found.searches else ()
        least = min(scores, key=lambda s: s.p_single, default=None)
        if self.simulated is None or least is None:
            p_value = min((s.p_value for s in scores), default=None)
        else:
            p_value = self.simulated.of_smallest(least.p_single)
        by = "law" if self.simulated is None else "simulation"
        return Chance(by, len(self.before.chance), self.before.p_value, p_value)


def judged_search(
    ready: Prepared, tests: GriddedTrials | None, options: DiagnosisOptions, progress: OnProgress | None
) -> JudgedSearch:
    """Select effects and judge them. Beside a name that the ``tests`` contradict it does not matter what else is left.

    ready: the problem and its fit without effects; tests: trials to check on; options: of the diagnosis; progress:
    called as the work goes on. Returns the selection with its verdict.
    """
    p = replace(ready.problem, tests=tests)
    before, simulated = unnamed_forms(p.steps, p.data, ready.null), None
    if options.bootstrap:
        LOGGER.info(f"simulating {options.bootstrap} campaigns in which nothing is missing")
        store = options.store.part("campaigns") if options.store is not None else None
        simulated = simulated_chance(p, ready.null, options.bootstrap, options.seed, options.workers, progress, store)
        before = replace(before, chance=simulated.unnamed)
    found, beside = select_effects(p, ready.null, options.seed, options.workers, progress), list[Message]()
    while len(found.effects) > 1 and (impossible := impossible_size(ready.full, found.final, found.effects[-1])):
        beside.append(Message(f"what is left beside the name acts like {impossible}", "impossible_size"))
        found = found.without_last(p)
    held = None
    if tests is not None:
        without, with_it = (prediction_errors(p.steps, tests, fit) for fit in (found.null, found.final))
        held = compare(tests, without, with_it, options.seed)
    stands = bool(found.effects) and not (held is not None and contradicts(found, held))
    after = unnamed_forms(p.steps, p.data, found.final) if stands else before
    return replace(_answer(found, (before, after), held, p, simulated), beside=tuple(beside))


def _answer(
    found: Selection,
    left: tuple[UnnamedForms, UnnamedForms],
    held: HeldOut | None,
    p: SearchProblem,
    simulated: SimulatedChance | None,
) -> JudgedSearch:
    """The verdict on what was ``found``; left: what unnamed forms explain before and after it; held: the check on test
    trials; p, simulated: of the search."""
    before, after = left
    beyond = before.beyond_chance - p.expected_unnamed_null
    verdict, reasons = decide(found, beyond, after.log_bayes - p.expected_unnamed, after.limit, held)
    result = JudgedSearch(found, before, after, held, verdict, tuple(reasons), simulated)
    if verdict == "named" and simulated is not None and _by_simulation(result) > LEVEL:
        share = f"{_by_simulation(result):.2g}"
        words = f"simulated campaigns without any effect give a candidate as good with probability {share}"
        reason = Message(f"{words}: the name is withdrawn", "name_withdrawn")
        return replace(result, verdict="unknown" if beyond > 0 else "none", reasons=(*reasons, reason))
    return result


def _by_simulation(result: JudgedSearch) -> float:
    """Probability that chance gives a candidate as good, by simulated campaigns and the test trials."""
    best, share = result.found.searches[0].best, result.chance.largest_candidate or 0.0
    return min(share, 2 * both_by_weight(share, best.gain, best.again)) if best is not None else share


def impossible_size(full: FullModel, fit: Estimate, candidate: Candidate) -> str:
    """Which parameter of a ``candidate`` in a ``fit`` of the ``full`` model is surely less or more than it can be in
    nature, in words, or nothing."""
    limited = [p for p in parameters(full.ship, candidate.effect) if math.isfinite(p.least) or math.isfinite(p.most)]
    sizes = parameters_of(full, fit, candidate) if limited else {}
    calibrated = any(c.prior_std is not None for c in full.ship.coefficients.values())
    for p in (p for p in limited if p.symbol in sizes):
        found, least = sizes[p.symbol], p.least - (p.lost if calibrated else 0.0)
        limit = f"less than {least:.3g}" if found.value + 2 * found.std < least else ""
        limit = f"more than {p.most:.3g}" if found.value - 2 * found.std > p.most else limit
        if limit:
            size = f"{p.symbol} = {found.value:.3g} ± {found.std:.2g} {found.unit}".rstrip()
            return f"{candidate.effect} ({size}), which cannot be {limit} {found.unit}".rstrip()
    return ""


FAR_OFF, RARE = 5.0, 1e-4
"""Prior standard deviations of one coefficient, and probability by chance of all of them together, from which the ship
that fits is not the ship that was given, so that no effect is named."""
FAR_WITHOUT = 8.0
"""The same of one coefficient from which even that nothing is missing cannot be said. Where priors are too narrow by
half, true coefficients are four or five off."""
FAR_BEFORE = 4.0
"""The same of one coefficient without any effect, where something is left beside a name that no test trial confirms."""
LISTED = 4
"""Coefficients listed."""


def believed(result: JudgedSearch, ready: Prepared) -> tuple[str, list[Message], str]:
    """The verdict of ``result`` with its reasons, or "unknown" where it is not believed, and a sentence on why.

    result: the selection judged; ready: the problem and its fit without effects. A ship whose coefficients are wrong
    throughout still follows the trials once all of them are free, and an effect makes up for the rest: then neither its
    name nor that nothing is missing is true. Returns (verdict, reasons, sentence or "").
    """
    reasons = list(result.reasons)
    if result.verdict == "unknown":
        return result.verdict, reasons, ""
    named = result.verdict == "named"
    found = result.found
    sizes = [impossible_size(ready.full, found.final, c) for c in found.effects]
    if named and any(sizes):
        acts = f"it acts like {' and '.join(filter(None, sizes))}"
        sentence = f"Something is missing in the model, but no known effect of a possible size explains it: {acts}."
        return "unknown", [*reasons, Message(f"{acts}: the name is withdrawn", "impossible_size")], sentence
    doubt = _another_ship(result, ready)
    if not doubt:
        return result.verdict, reasons, ""
    outcome = "the name is withdrawn" if named else "that nothing is missing cannot be said"
    return "unknown", [*reasons, Message(f"{doubt}: {outcome}", "not_described")], f"No cause can be named: {doubt}."


def beyond_reported(effects: Sequence[NamedEffect], ship: Ship) -> list[Message]:
    """A sentence on each of the named ``effects`` of a ``ship`` that is surely larger than any known of."""
    rows = []
    for e in effects:
        for p in EFFECTS[e.name].parameters(ship.namespace, dict(ship.components)):
            found = e.parameters.get(p.symbol)
            if found is None or abs(found.value - p.neutral) - 2 * found.std <= p.reported:
                continue
            size = f"{found.value:.3g} +- {found.std:.2g} {found.unit}".rstrip()
            words = f"{e.name} of {p.symbol} {size} is more than any that is known of ({p.reported:g})"
            rows.append(Message(f"{words}: something else adds to it, or stands behind it", "beyond_reported"))
    return rows


def deviations(fit: Estimate, ship: Ship) -> dict[str, float]:
    """Coefficient of the ship -> how far it is by ``fit`` from its prior mean, in stated prior standard deviations.

    ship: as given. Where its calibration is the prior, the wider one from before the calibration is the measure.
    """
    rows = {}
    for symbol, p, std in zip(fit.free.symbols, fit.p, fit.free.std, strict=True):
        if "." not in symbol and symbol in ship.coefficients:
            before = ship.coefficients[symbol].prior_std or 0.0
            rows[symbol] = float(p * std / max(std, before))
    return rows


def _another_ship(result: JudgedSearch, ready: Prepared) -> str:
    """Why the ship that fits is another one than was given, or nothing."""
    found, ship = result.found, ready.full.ship
    named = result.verdict == "named"
    fit = found.final if named else found.null
    final = deviations(fit, ship)
    sizes = np.abs(list(final.values()))
    together = chi2_tail(float((sizes**2).sum()), len(sizes))
    advice = "see that the trials are hers, and units and frames right (mmg check), or state wider standard deviations"
    most = sizes.max(initial=0.0)
    if (named and (most > FAR_OFF or together < RARE)) or most > FAR_WITHOUT:
        beside = f"with {' and '.join(c.label for c in found.effects)}" if named else "without any effect"
        return f"{beside} the trials need coefficients that are not this ship's, {_listed(final)}; {advice}"
    before = deviations(found.null, ship)
    left = result.after.beyond_chance > ready.problem.expected_unnamed
    confirmed = result.held is not None and (confirms(result.held) or surely_confirms(result.held))
    if named and left and not confirmed and max(map(abs, before.values()), default=0) > FAR_BEFORE:
        names = " and ".join(c.label for c in found.effects)
        words = f"without any effect the trials need coefficients that are not this ship's, {_listed(before)}, and with"
        return f"{words} {names} something is left unexplained; {advice}"
    return ""


def _listed(rows: dict[str, float]) -> str:
    """The coefficients that are farthest off, in words."""
    worst = sorted(rows.items(), key=lambda row: -abs(row[1]))[:LISTED]
    return ", ".join(f"{symbol} ({off:+.1f})" for symbol, off in worst) + " prior standard deviations off"
