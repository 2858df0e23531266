"""Whether an answer is believed: no effect of a size that it cannot have, and not where the coefficients are those of
another ship."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.evidence.tails import chi2_tail
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
SHOWN = 4
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
    worst = sorted(rows.items(), key=lambda row: -abs(row[1]))[:SHOWN]
    return ", ".join(f"{symbol} ({off:+.1f})" for symbol, off in worst) + " prior standard deviations off"
