"""Words and numbers of the report on a diagnosis: effects, their sizes, where the gap lies, how far it shrinks."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cases.shipfiles.effects import parameters as parameters_of
from diagnosis.findings import (
    MATTERS,
    Budget,
    BudgetShare,
    EstimatedParameter,
    Findings,
    HeldOut,
    InstrumentFault,
    NamedEffect,
    RankedCandidate,
    UnexplainedForce,
)
from diagnosis.hypotheses.forward_selection import ODDS
from fitting.report.sections import plus_minus
from mmg.effects import EFFECTS

# Words for a positive and a negative force of each channel.
SIDES = {
    "surge": ("ahead", "astern"), "sway": ("to starboard", "to port"), "yaw": ("bow to starboard", "bow to port"),
}  # fmt: skip
FOLLOWED = 0.15  # Share of a missing force that a variable must explain to be mentioned. Set by hand.
TURN_BACK = ("heading", "apparent wind angle")
# Variables in words.
PLAIN = {
    "delta": "rudder angle", "n": "revolutions", "u": "speed ahead u", "v": "sway velocity v", "r": "turn rate r",
    "x, north": "position north", "y, east": "position east", "rate of delta": "rate of the rudder",
}  # fmt: skip


def shown_unit(unit: str) -> tuple[float, str]:
    """The factor from ``unit`` to the one that is shown, which has degrees for radians, and its name."""
    return (180 / math.pi, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)


def force(size: float, unit: str) -> str:
    """A ``size`` in a ``unit`` of force or moment by two figures, with a prefix where it is far from one: 15 kN."""
    from matplotlib.ticker import EngFormatter

    size = float(f"{size:.2g}")
    return f"{size:g} {unit}" if 0.01 <= size < 1000.0 or not size else EngFormatter(unit)(size)


def percent(share: float | None) -> str:
    """A share in percent, true minus sign."""
    if share is None or not math.isfinite(share):
        return "–"
    return f"{100 * share:.{places(share)}f}\u00a0%".replace("-", "−")


def places(share: float) -> int:
    """Decimals with which a ``share`` is written in percent: what is nearly all is not all."""
    return next((k for k in range(4) if round(100 * abs(share), k) != 100), 0)


def first_channel(d: Findings) -> str:
    """The channel with most of the gap of ``d``."""
    channels = d.where.get("channels", {})
    return max(channels, key=lambda name: channels[name]["share"]) if channels else ""


def where_words(d: Findings) -> list[str]:
    """Where the gap of ``d`` lies, in two or three sentences."""
    if not d.where:
        return []
    first = first_channel(d)
    row = d.where["channels"][first]
    words = [
        f"Most of it is in {first}: {percent(row['share'])} of the energy, {force(row['force_rms'], row['unit'])} rms."
    ]
    words.append(_follows(d.where.get("variables", []), first) or "It follows none of the variables.")
    if "force_rms_after" in row:
        words.append(f"With what was named, the rms is {force(row['force_rms_after'], row['unit'])}.")
    return words


def _follows(variables: Sequence[Mapping[str, Any]], channel: str) -> str:
    """Which of the ``variables`` what is missing in the ``channel`` follows, or else that of another one, as a
    sentence; "" where it follows none."""
    rows = [v for v in variables if v["explained"] > FOLLOWED]
    own = ([v for v in rows if v["channel"] == channel] or rows[:1])[:2]
    if not own:
        return ""
    names = [f"the {PLAIN.get(v['variable'], v['variable'])} ({percent(v['explained'])} of it)" for v in own]
    return f"What is missing in {own[0]['channel']} follows {' and '.join(names)}, {_extreme(own[0])}."


def _extreme(v: Mapping[str, Any]) -> str:
    """Where the mean of a force over its variable is largest."""
    factor, unit = shown_unit(v["unit"])
    at = int(np.argmax(np.abs(v["mean"])))
    place = f"{factor * v['at'][at]:.2g} {unit}".replace("-", "−")
    if unit == "deg" and v["variable"] in TURN_BACK:
        place = f"{round(factor * v['at'][at]) % 360}°"
    size = _on_average(v["mean"][at], v["force_unit"], v["channel"])
    return f"strongest at {PLAIN.get(v['variable'], v['variable'])} {place}: {size}"


def _on_average(mean: float, unit: str, channel: str) -> str:
    """The ``mean`` of the force of a ``channel`` by its size and direction."""
    return f"{force(abs(mean), unit)} {SIDES[channel][0 if mean > 0 else 1]} on average"


def unexplained_only(d: Findings) -> UnexplainedForce | None:
    """The unexplained force of ``d`` where it is all that is known of the gap, or None."""
    rest = d.unexplained_force
    return rest if d.verdict == "unknown" and rest is not None and rest.times else None


def where_big(d: Findings) -> str:
    """The channel with most of the gap of ``d``, or of what is unexplained where no name is, in a few words."""
    rest = unexplained_only(d)
    if rest is not None:
        name, own = max(rest.channels.items(), key=lambda item: item[1].share)
        share, size, unit = own.share, own.force_rms, own.unit
    else:
        name = first_channel(d)
        share, size, unit = (d.where["channels"][name][key] for key in ("share", "force_rms", "unit"))
    return f"{percent(share)} in {name}, {force(size, unit)} rms"


def unexplained_words(m: UnexplainedForce) -> list[str]:
    """The unexplained force ``m`` in a few sentences: its channels, what it follows, when it is largest."""
    channels = sorted(m.channels.items(), key=lambda item: -item[1].share)
    each = [
        f"{force(c.force_rms, c.unit)} rms in {name} "
        f"(90 % interval {' to '.join(force(end, c.unit) for end in c.interval_90)})"
        for name, c in channels
        if c.share > FOLLOWED
    ]
    if not each:
        return ["It does not act like a force that motion, inputs, wind or place could explain."]
    words, name = [f"It acts like a force of {' and '.join(each)}."], channels[0][0]
    words += filter(None, [_follows([v for v in m.follows if v["channel"] == name], name)])
    for t in m.times[:1]:
        size = f"{t.channel}, {_on_average(t.mean, t.unit, t.channel)}"
        words.append(f"It is largest in {t.trial} from {t.start:.0f} to {t.end:.0f} s ({size}).")
    return words


def unexplained_hint(m: UnexplainedForce | None) -> str:
    """Where the unexplained force ``m`` lives, in half a sentence for the verdict, or nothing."""
    if m is None or not m.channels or m.evidence <= ODDS:
        return ""
    name, first = max(m.channels.items(), key=lambda item: item[1].share)
    own = [v for v in m.follows if v["channel"] == name and v["explained"] > FOLLOWED][:1]
    follows = f" and follows the {PLAIN.get(own[0]['variable'], own[0]['variable'])}" if own else ""
    return f" It acts mostly in {name}{follows}." if first.force_rms > 0 else ""


def likeness(log_bayes: Mapping[str, float]) -> str:
    """The unnamed form that what is missing acts most like, as a sentence; "" where none explains anything by itself.

    log_bayes: of each kind, with that of all together and of the best force alone.
    """
    kinds = {kind: value for kind, value in log_bayes.items() if kind not in ("all", "single")}
    best = max(kinds, key=kinds.__getitem__, default="")
    return f" Among the unnamed forms it acts most like: {best}." if best and kinds[best] > 0 else ""


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
    """A probability ``p`` with two figures."""
    return f"{p:.2g}" if math.isfinite(p) else "–"


# Typical sizes of an effect above which a dash stands for the size from which it would show. Set by hand.
HOPELESS = 30.0


def signed(value: float | None, digits: str = ".0f") -> str:
    """A ``value`` with its sign in the format ``digits``, or a dash."""
    return "–" if value is None or not math.isfinite(value) else f"{value:+{digits}}".replace("-", "−")


def quantity(p: EstimatedParameter) -> str:
    """Value, standard error, unit of ``p``; angles in degrees."""
    factor, unit = shown_unit(p.unit)
    return f"{plus_minus(factor * p.value, factor * p.std)} {unit}".strip()


def sizes(name: str, parameters: Mapping[str, EstimatedParameter], d: Findings) -> list[dict[str, str]]:
    """Rows symbol, size, words of ``parameters`` of the effect ``name`` in ``d``."""
    known = {p.symbol: p.description for p in parameters_of(d.ship, name)}
    return [{"symbol": s, "size": quantity(p), "words": known.get(s, "")} for s, p in parameters.items()]


def visible(c: RankedCandidate, d: Findings) -> str:
    """The sizes from which the trials of ``d`` would show the candidate ``c``; a dash far above its typical size."""
    known, rows = {p.symbol: p for p in parameters_of(d.ship, c.name)}, []
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
                "measures": EFFECTS[c.name].measures,
                "evidence": signed(c.evidence, ".1f"),
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
    rest = d.unexplained_force
    advice = d.next_test or (rest.advice if rest is not None else "")
    return readable(advice) or "No manoeuvre of the library would tell more than these trials."


def held_words(h: HeldOut | None, verdict: str) -> str:
    """How far the gap shrinks by the check ``h`` on test trials, for a ``verdict``."""
    if h is None:
        return "No test trials were given (--test), so it was not measured on trials that took no part."
    trials = f"{len(h.by_run)} test trial{'s' * (len(h.by_run) != 1)} ({h.windows} windows of {h.metric})"
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


def amount(effect: NamedEffect | InstrumentFault) -> str:
    """The parameters of an ``effect`` in words; of a vector over the ground its size and direction."""
    p = {symbol: x for symbol, x in effect.parameters.items() if x.std > 0}
    if set(p) == {"x", "y"} and effect.name in OVER_GROUND:
        size, towards = math.hypot(p["x"].value, p["y"].value), math.degrees(math.atan2(p["y"].value, p["x"].value))
        return f"{size:.2g} {p['x'].unit} to {towards % 360:.0f}°"
    return ", ".join(f"{s} = {plus_minus(x.value, x.std)} {x.unit}".rstrip() for s, x in p.items())


def share_words(part: BudgetShare) -> str:
    """A ``part`` of the budget in percent with its interval, cut to between none and all of the error."""
    low, best, high = (abs(min(max(x, 0.0), 1.0)) for x in (part.interval_90[0], part.share, part.interval_90[1]))
    return f"{100 * best:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def budget_parts(budget: Budget) -> list[dict[str, Any]]:
    """The parts of a ``budget`` for a bar, in the order of the bar: kind, name, share of the whole error, words."""
    gap = max(budget.before - budget.floor, 0.0)
    rows = [("part", plain(part.name), part) for part in budget.parts]
    rows += [("rest", part.name, part) for part in [budget.unexplained] if part is not None]
    whole = max(budget.before, 1e-300)
    found = [
        {"kind": kind, "name": name, "share": part.share * gap / whole, "short": f"{100 * part.share:.0f} %",
         "words": f"{name} {share_words(part)} of the avoidable part"}
        for kind, name, part in rows if part.share >= 0.005
    ]  # fmt: skip
    left = budget.floor / whole
    return [*found, {"kind": "floor", "name": "floor", "share": left, "short": percent(left),
                     "words": f"floor {percent(left)} of all"}]  # fmt: skip


def budget_lines(budget: Budget) -> list[list[str]]:
    """Lines of the errors in a ``budget``: of the ship as given, fitted without any effect, with what was found if
    anything was, and of a complete model. Returns what, position, heading and squared error in words."""
    what = ("fitted to the training trials", "with what was found", "floor")
    errors = (budget.before, budget.after, budget.floor)
    lines = list(zip(what, budget.units["position_m"], budget.units["heading_deg"], errors, strict=True))
    if budget.after == budget.before:
        del lines[1]
    if (given := budget.as_given) is not None:
        lines.insert(0, ("as given", given["position_m"], given["heading_deg"], given["error"]))
    return [[name, f"{m:.3g} m", f"{deg:.3g}°", f"{error:.3g}"] for name, m, deg, error in lines]


def sentence_of(
    verdict: str,
    effects: Sequence[NamedEffect],
    instruments: Sequence[InstrumentFault],
    same: Sequence[str],
    remainder: bool,
    budget: Budget | None,
    nearest: str = "",
    missing: UnexplainedForce | None = None,
) -> str:
    """The diagnosis in a sentence or two, for the top of the report.

    verdict: "none", "named" or "unknown"; effects: those named; instruments: those found to be off; same: what the data
    cannot tell from the first of all; remainder: whether something is left unexplained; budget: of the error; nearest:
    the effect with most evidence; missing: what is left unexplained.
    """
    parts = {part.name: part for part in budget.parts} if budget is not None else {}
    rest, words = budget.unexplained if budget is not None else None, []
    found: list[NamedEffect | InstrumentFault] = [*effects, *instruments]
    first, is_small = found[0] if found else None, False
    found.sort(key=lambda f: -parts[f.name].share if f.name in parts else 0.0)  # what causes most heads the sentence
    # what cannot be more than half of the error stands behind the causes that are known
    is_minor = rest is not None and bool(found) and rest.interval_90[1] < HALF
    if verdict == "unknown" and not is_minor:
        words.append("Something is missing in the model, but none of the known effects explains it.")
        if nearest and not instruments:
            words.append(f"The nearest known effect, {nearest}, does not account for it.")
    elif verdict == "none" and not instruments:
        words.append(
            "No effect beyond the ship's model is needed to explain these trials: what remains looks like chance."
        )
    elif rest is not None and rest.share > HALF and parts[found[0].name].interval_90[1] < HALF:
        is_small = True
        words.append(f"Most of the gap ({share_words(rest)}) is not explained.")
    small = [f for f in found[1:] if f.name in parts and not parts[f.name].matters]
    words += [_cause(f, parts.get(f.name), same if f is first else ()) for f in found if f not in small]
    if small:
        words.append(
            f"Also there, but below {percent(MATTERS)} each: {', '.join(f'{f.name} ({amount(f)})' for f in small)}."
        )
    if budget is not None and found:
        # of position and heading what falls by the larger share; 0: no trial logs it
        errors = [e for e in budget.units.items() if e[1][0] > 0]
        if errors:
            key, (before, after, _) = min(errors, key=lambda e: e[1][1] / e[1][0])
            name, unit = key.split("_")
            words.append(f"The {name} error after {budget.metric} goes from {before:.2g} to {after:.2g} {unit}.")
    if verdict == "unknown" and is_minor and rest is not None:
        most = percent(max(min(rest.interval_90[1], 1.0), 0.01))
        words.append(f"Something acts besides that no known effect explains, up to {most} of the avoidable error.")
    elif remainder and rest is not None and rest.interval_90[0] <= MATTERS:
        words.append(f"Something else acts as well, up to {percent(min(rest.interval_90[1], 1.0))} of the gap.")
    elif remainder and not is_small:
        size = f" ({share_words(rest)})" if rest is not None else ""
        words.append(f"A part of the gap{size} remains unexplained.")
    elif found and verdict != "unknown" and not is_small:
        words.append("Nothing else matters." if parts else "The predictions hardly change.")
    hint = unexplained_hint(missing) if remainder or verdict == "unknown" else ""
    return f"{' '.join(words)}{hint}"


def _cause(found: NamedEffect | InstrumentFault, part: BudgetShare | None, same: Sequence[str]) -> str:
    """What an effect that was ``found`` causes, by its ``part`` of the budget; same: what cannot be told from it."""
    alike = f" (or {' or '.join(same)}, which these trials cannot tell from it)" if same else ""
    nature = ", an instrument and not the ship," if isinstance(found, InstrumentFault) else ""
    causes = f"causes {share_words(part)} of the avoidable error" if part is not None else "is there"
    return f"{found.name} ({amount(found)}){alike}{nature} {causes}."


# Effects whose parameters x and y are a vector over the ground.
OVER_GROUND = ("current", "wind_sensor_bias", "wave_drift")
# Share of the avoidable error that a name must be able to cause to head the sentence.
HALF = 0.5  # set by hand: words alone hang on it
