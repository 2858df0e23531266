"""Words and numbers of the report on a diagnosis: effects, their sizes, where the gap lies, how far it shrinks."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from diagnosis.findings import (
    EstimatedParameter,
    Findings,
    HeldOut,
    LearnedResidual,
    NamedEffect,
    RankedCandidate,
)
from diagnosis.hypotheses.forward_selection import Selection
from diagnosis.hypotheses.left_findings import UnexplainedForce
from diagnosis.report.where_words import percent, places, shown_unit, unexplained_hint
from fitting.report.sections import plus_minus
from mmg.effects import EFFECTS
from mmg.effects.effect import Parameter

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
BADGE = {"named": "cause named", "none": "no gap found", "unknown": "cause unknown"}
BETWEEN = {"named": "difference named", "none": "no difference", "unknown": "difference without a name"}


def plain(name: str) -> str:
    """The ``name`` of an effect without underscores. Returns text."""
    return name.replace("_", " ")


def readable(text: str) -> str:
    """Effects in a text without underscores, and true minus signs, but for commands in brackets and manoeuvres."""
    for name in EFFECTS:
        text = text.replace(name, plain(name))
    return re.sub(r"\(mmg [^)]*\)|(?<![\w.:])-(?=\d)", lambda found: found[0] if len(found[0]) > 1 else "−", text)


def sentence(text: str, end: str = ".") -> str:
    """A ``readable`` text with a capital at its beginning and this at its ``end``."""
    words = readable(text.rstrip("."))
    return f"{words[:1].upper()}{words[1:]}{end}"


def meaning(name: str) -> str:
    """What the effect ``name`` is in one sentence, or "" for an unknown one."""
    return sentence(EFFECTS[name].summary.splitlines()[0].split(": ", 1)[-1], "") if name in EFFECTS else ""


def probability(p: float) -> str:
    """A probability ``p`` with two figures, small ones by a power of ten."""
    if not math.isfinite(p):
        return "–"
    if p >= 0.001:
        return f"{p:.2g}"
    if p < 1e-30:
        return "< 10⁻³⁰"
    digit, power = f"{p:.0e}".split("e")
    return f"{digit}·10{str(int(power)).translate(SUPERSCRIPT)}"


HOPELESS = 30.0
"""Typical sizes of an effect above which a dash stands for the size from which it would show."""


def signed(value: float | None, digits: str = ".0f") -> str:
    """A ``value`` with its sign in the format ``digits``, or a dash."""
    return "–" if value is None or not math.isfinite(value) else f"{value:+{digits}}".replace("-", "−")


def quantity(p: EstimatedParameter) -> str:
    """Value, standard error, unit of ``p``; angles in degrees."""
    factor, unit = shown_unit(p.unit)
    return f"{plus_minus(factor * p.value, factor * p.std)} {unit}".strip()


def _parameters(name: str, d: Findings) -> dict[str, Parameter]:
    return {p.symbol: p for p in EFFECTS[name].parameters(d.ship.namespace, dict(d.ship.components))}


def sizes(name: str, parameters: Mapping[str, EstimatedParameter], d: Findings) -> list[dict[str, str]]:
    """Rows symbol, size, words of ``parameters`` of the effect ``name`` in ``d``; a vector also by its direction."""
    known = _parameters(name, d)
    rows = [
        {"symbol": symbol, "size": quantity(p), "words": known[symbol].description if symbol in known else ""}
        for symbol, p in parameters.items()
    ]
    if {"x", "y"} <= set(parameters) and "to the north" in known["x"].description:
        x, y = parameters["x"].value, parameters["y"].value
        towards = math.degrees(math.atan2(y, x)) % 360
        words = f"{math.hypot(x, y):.2g} {parameters['x'].unit} towards {towards:.0f}°"
        rows.append({"symbol": "together", "size": words, "words": ""})
    return rows


def visible(c: RankedCandidate, d: Findings) -> str:
    """The sizes from which the trials of ``d`` would show the candidate ``c``; a dash far above its typical size."""
    known, rows = _parameters(c.name, d), []
    for symbol, size in c.visible_from.items():
        factor, unit = shown_unit(known[symbol].unit)
        if size < HOPELESS * known[symbol].typical:
            rows.append(f"{symbol} {factor * size:.2g} {unit}".strip())
    return ", ".join(rows) or "–"


def ranking(d: Findings) -> list[dict[str, Any]]:
    """The candidates of ``d`` for the table."""
    named = {e.name: e for e in d.effects}
    rows = []
    for c in d.candidates:
        e, role = named.get(c.name, c), d.role(c.name)
        rows.append(
            {
                "name": plain(c.name),
                "meaning": meaning(c.name),
                "role": role,
                "sizes": sizes(c.name, e.parameters, d),
                "score": f"{c.score:.3g}",
                "p": probability(e.p_value) if c.excited else "–",
                "bic": signed(e.delta_bic),
                "absorbed": percent(c.absorbed_share) if c.excited else "–",
                "visible": visible(c, d),
                "note": note_on(c, role, d),
            }
        )
    return rows


def note_on(c: RankedCandidate, role: str, d: Findings) -> str:
    """Why the candidate ``c`` of ``d`` is where it is, in a few words; role: "named", "class" or ""."""
    if not c.excited:
        return "not excited by these trials: neither found nor excluded"
    if role == "named":
        return "named"
    if role == "class":
        return f"cannot be told from {plain(d.effects[0].name)}" if d.effects else "cannot be told apart"
    return "calibration imitates it almost fully" if c.absorbed_share > 0.9 else ""


def next_words(d: Findings) -> str:
    """What to test next after ``d``, also where the diagnosis says nothing of it."""
    if d.next_test:
        return readable(d.next_test)
    if d.verdict == "named" and d.equivalence_class:
        others = " or ".join(plain(name) for name in d.equivalence_class)
        return f"No manoeuvre was found that would tell {plain(d.effects[0].name)} from {others}."
    if d.verdict == "named":
        return "No trial is needed to separate the name from others: none of the candidates comes near it."
    if d.verdict == "none":
        quiet = ", ".join(plain(c.name) for c in d.candidates if not c.excited)
        return "Nothing is left to separate" + (
            f". These trials do not excite {quiet}: other manoeuvres could." if quiet else ": they excite all effects."
        )
    rest = d.unexplained_force
    words = f"{readable(rest.advice)} " if rest is not None and rest.advice else ""
    words += (
        f"Repeat {rest.times[0].trial}, where most is missing"
        if rest is not None and rest.times
        else "Repeat the trials"
    )
    return words + "; if the same is missing again it belongs to the ship, otherwise to the place or the day."


def held_words(h: HeldOut | None, verdict: str) -> str:
    """How far the gap shrinks by the check ``h`` on test trials, for a ``verdict``."""
    if h is None:
        return "No test trials were given (--test), so it was not measured on trials that took no part."
    trials = f"{len(h.by_run)} test trial{'s' * (len(h.by_run) != 1)} ({h.windows} windows of 30 s)"
    if verdict == "none" or (verdict == "unknown" and h.mse_after == h.mse_before):
        return f"Nothing was added, so nothing changes: the mean squared error on {trials} is {h.mse_before:.3g}."
    low, high = h.interval_90
    fell = "shrinks" if h.reduction >= 0 else "GROWS"
    words = f"On {trials} the mean squared error {fell} by {percent(abs(h.reduction))}"
    words += f" (90 % interval of the reduction {percent(low)} to {percent(high)}), "
    words += f"from {h.mse_before:.3g} to {h.mse_after:.3g}."
    if verdict == "unknown":
        return f"With the nearest candidates, whose names were withdrawn: {words[0].lower()}{words[1:]}"
    if low <= 0 <= h.reduction:
        words += " The interval contains zero: the effect is significant, but hardly changes the predictions."
    return words


def learned_words(found: LearnedResidual) -> str:
    """Numbers behind what the learned residual ``found`` closes."""
    each = ", ".join(f"{signed(100 * r, '.1f')} %" for r in found.reductions)
    return (
        f"Reductions by training: {each}; with the mean of their networks {signed(100 * found.together, '.1f')} %. By "
        f"parts of the training trials alone, as mmg train decides: {sentence(found.decision)}"
    )


def unnamed_words(d: Findings) -> str:
    """What the tests of unnamed forms in ``d`` found."""
    before, after = d.unnamed.before.get("all"), d.unnamed.after.get("all")
    if before is None:
        return ""
    words = "Unnamed forms (functions of state, inputs, wind, place) have a log Bayes factor of "
    words += f"{signed(before, '.1f')} without any effect"
    if d.verdict == "named" and after is not None:
        words += f" and {signed(after, '.1f')} with what was named"
    if d.chance is not None:
        how = f"in {d.chance.draws} simulated campaigns" if d.chance.by == "simulation" else "by the law of the tests"
        words += f"; chance leaves as much as the former with probability {probability(d.chance.anything_left)} ({how})"
    return words + "."


def amount(effect: NamedEffect) -> str:
    """The parameters of an ``effect`` in words."""
    return ", ".join(f"{s} = {p.value:.3g} ± {p.std:.2g} {p.unit}".rstrip() for s, p in effect.parameters.items())


def sentence_of(
    verdict: str,
    effects: Sequence[NamedEffect],
    same: Sequence[str],
    remainder: bool,
    held: HeldOut | None,
    found: Selection,
    missing: UnexplainedForce | None = None,
    usual: bool = False,
) -> str:
    """The diagnosis in one sentence, for the top of the report.

    verdict: "none", "named" or "unknown"; effects: those named; same: effects that the data cannot tell from the first;
    remainder: whether something is left unexplained; held: the check on test trials; found: the selection;
    missing: what is left unexplained; usual: whether the trials of the calibration show a misfit of their own, which
    then is no news.
    """
    if verdict == "none":
        than = " and like what the trials of its calibration show as well" if usual else ""
        words = "No effect beyond the ship's model is needed to explain these trials: what remains looks like chance"
        return f"{words}{than}."
    if verdict == "unknown":
        nearest = next((r.candidate.effect for s in found.searches[:1] for r in s.refitted), "")
        hint = f" The nearest known effect, {nearest}, does not account for it." if nearest else ""
        hint += unexplained_hint(missing)
        return f"Something is missing in the model, but none of the known effects explains it.{hint}"
    named = "; ".join(f"{e.name} ({amount(e)})" for e in effects)
    words = f"The trials point to {named}"
    if same:
        words += f", which these trials cannot tell from {' or '.join(same)}"
    if held is not None:
        change, high, low = (f"{-x:+.{places(x)}%}" for x in (held.reduction, *held.interval_90))
        words += f"; with it the error of 30 s predictions of the test trials changes by {change} "
        words += f"(90 % interval {low} to {high})"
    return words + (f". A part of the gap remains unexplained.{unexplained_hint(missing)}" if remainder else ".")
