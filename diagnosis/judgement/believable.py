"""Whether an answer is believed: no effect of a size that it cannot have, not where the coefficients are those of
another ship, no delay that may be the way in which the inputs were sampled, and not that nothing is missing where
outliers hide it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.checks.single import VELOCITIES, spikes
from cases.evidence.tails import chi2_tail
from cases.trial import Trial
from diagnosis.estimation.candidates import TIMES
from diagnosis.estimation.linearisation import TIMING
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.findings import NamedEffect
from diagnosis.judgement.judged_search import JudgedSearch
from diagnosis.judgement.possible_size import impossible_size
from diagnosis.judgement.verdict import confirms, surely_confirms
from diagnosis.prepare import Prepared
from mmg.effects import EFFECTS
from mmg.messages import Message
from mmg.ship import Ship

FAR_OFF, RARE = 5.0, 1e-4
"""Prior standard deviations of one coefficient, and probability by chance of all of them together, from which the ship
that fits is not the ship that was given, so that no effect is named."""
FAR_WITHOUT = 8.0
"""The same of one coefficient from which even that nothing is missing cannot be said. Where priors are too narrow by
half, true coefficients are four or five off."""
FAR_BEFORE = 4.0
"""The same of one coefficient without any effect, where something is left beside a name that no test trial confirms."""
DELAYS = ("gnss_delay", "control_delay")
"""Effects that are nothing but times."""
SPIKY = 2e-3
"""Share of single samples far off both neighbours from which they decide the noise that is found."""
SHOWN = 4
"""Coefficients listed."""


def believed(result: JudgedSearch, ready: Prepared, trials: Sequence[Trial] = ()) -> tuple[str, list[Message], str]:
    """The verdict of ``result`` with its reasons, or "unknown" where it is not believed, and a sentence on why.

    result: the selection judged; ready: the problem and its fit without effects; trials: as they were logged. A
    ship whose coefficients are wrong throughout still follows the trials once all of them are free, and an effect
    makes up for the rest: then neither its name nor that nothing is missing is true. Outliers are taken for noise,
    beside which no effect shows. Returns (verdict, reasons, sentence or "").
    """
    reasons = list(result.reasons)
    if result.verdict == "unknown":
        return result.verdict, reasons, ""
    named = result.verdict == "named"
    if named and (words := _within_the_clock(result, ready)):
        return "none", [*reasons, Message(f"{words}: the name is withdrawn", "name_withdrawn")], ""
    found = result.found
    sizes = [impossible_size(ready.full, found.final, c) for c in found.effects]
    if named and any(sizes):
        acts = f"it acts like {' and '.join(filter(None, sizes))}"
        sentence = f"Something is missing in the model, but no known effect of a possible size explains it: {acts}."
        return "unknown", [*reasons, Message(f"{acts}: the name is withdrawn", "impossible_size")], sentence
    doubt, code = _another_ship(result, ready), "not_described"
    outliers = _outliers(trials)
    if outliers and not doubt and not named:
        doubt, code, outliers = outliers, "spikes", ""
    reasons += [Message(outliers, "spikes")] if outliers else []
    if not doubt and named and ready.reading.is_doubtful:
        doubt, code = _half_a_sample(result, ready), "half_a_sample"
    if not doubt:
        return result.verdict, reasons, ""
    outcome = "the name is withdrawn" if named else "that nothing is missing cannot be said"
    return "unknown", [*reasons, Message(f"{doubt}: {outcome}", code)], f"No cause can be named: {doubt}."


def _outliers(trials: Sequence[Trial]) -> str:
    """What is to be said of the outliers in ``trials``, or nothing where they are too few to matter."""
    counts = {t.name: sum(spikes(t[c]) for c in VELOCITIES if c in t) for t in trials}
    if sum(counts.values()) <= SPIKY * sum(len(t) for t in trials):
        return ""
    names = ", ".join(f"{count} in {name}" for name, count in counts.items() if count)
    words = f"single samples of {', '.join(VELOCITIES)} are far off both neighbours ({names})"
    return f"{words}, and so much noise hides what the model lacks; leave these cells empty"


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
    worst = sorted(rows.items(), key=lambda row: -abs(row[1]))[:SHOWN]
    return ", ".join(f"{symbol} ({off:+.1f})" for symbol, off in worst) + " prior standard deviations off"


def _within_the_clock(result: JudgedSearch, ready: Prepared) -> str:
    """Why delays that were named alone are none: they are as short as times of a log are off. Or nothing."""
    found, limit, delays = result.found, TIMING * ready.problem.data.sample, []
    for c in found.effects:
        if c.effect not in DELAYS:
            return ""
        delays += [found.final.value(x.symbol) for x in c.columns]
    if not delays or max(map(abs, delays)) > limit:
        return ""
    names = " and ".join(c.label for c in found.effects)
    return f"{names} of {max(delays, key=abs):.2g} s is shorter than the times of the log are sure to ({limit:.2g} s)"


def _half_a_sample(result: JudgedSearch, ready: Prepared) -> str:
    """Why a delay that was named may be how the actuators were sampled, or nothing. Held samples act later than joined
    ones: where they are taken as held, the other way would ask for a longer delay, not for none."""
    if not ready.reading.straight:
        return ""
    final, half = result.found.final, 0.5 * ready.problem.data.sample
    for c in result.found.effects:
        symbol = f"{c.effect}.{TIMES.get(c.effect, '')}"
        if symbol not in final.free.symbols:
            continue
        value, std = final.value(symbol), final.std(symbol)
        if abs(value) <= half + 2 * std:
            words = f"{c.label} of {value:.2g} +- {std:.1g} s may be half a sample of the actuators ({half:.2g} s)"
            return f"{words}, which nobody says to be held or joined in between (inputs in trials.toml)"
    return ""
