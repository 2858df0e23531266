"""Where the gap lies, in words: the channel with most of it, what it follows, where it is strongest, and what a force
without a name acts like."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis.findings import Findings
from diagnosis.hypotheses.dictionary import AFTER_RUDDER, BY_PLACE
from diagnosis.hypotheses.events import AT_TIMES
from diagnosis.hypotheses.left_findings import UnexplainedForce

SIDES = {
    "surge": ("ahead", "astern"), "sway": ("to starboard", "to port"), "yaw": ("bow to starboard", "bow to port"),
}  # fmt: skip
"""Words for a positive and a negative force of each channel."""
MORE_THAN_CHANCE = 0.05
"""Probability by chance above which the forms of an unexplained force say nothing."""
FOLLOWED = 0.15
"""Share of a missing force that a variable must explain to be mentioned."""
TURN_BACK = ("heading", "apparent wind angle")
PLAIN = {
    "delta": "rudder angle", "n": "revolutions", "u": "speed ahead u", "v": "sway velocity v", "r": "turn rate r",
    "x, north": "position north", "y, east": "position east", "rate of delta": "rate of the rudder",
}  # fmt: skip
"""Variables in words."""


def shown_unit(unit: str) -> tuple[float, str]:
    """The factor from ``unit`` to the one that is shown, which has degrees for radians, and its name."""
    return (180 / math.pi, unit.replace("rad", "deg")) if unit.startswith("rad") else (1.0, unit)


def percent(share: float | None) -> str:
    """A share in percent, true minus sign."""
    if share is None or not math.isfinite(share):
        return "–"
    return f"{100 * share:.{places(share)}f}\u00a0%".replace("-", "−")


def places(share: float) -> int:
    """Decimals with which a ``share`` is written in percent: what is nearly all is not all."""
    return next((k for k in range(4) if round(100 * abs(share), k) != 100), 0)


def band_words(band: Mapping[str, Any]) -> str:
    """A row ``band`` of where["bands"] by its periods."""
    if band["words"]:
        return "constant through a run"
    slow, fast = (1 / band[key] if band[key] > 0 else math.inf for key in ("from_hz", "to_hz"))
    return f"periods of {fast:.2g} to {slow:.3g} s"


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
    kind = "moment" if first == "yaw" else "force"
    words = [
        f"Most of it is in {first}: {percent(row['share'])} of the energy, {row['force_rms']:.2g} {row['unit']} rms.",
        f"That is {percent(row['relative'])} of the net {kind} that moves the ship in {first}.",
    ]
    slow = next((b for b in d.where["bands"] if b["channel"] == first), None)
    if slow is not None and slow["share"] > 0.3:
        words.append(f"{percent(slow['share'])} of that {kind}'s energy is constant through each run.")
    words.append(_follows(d.where.get("variables", []), first) or "It follows none of the variables.")
    if "force_rms_after" in row:
        after, less = row["force_rms_after"], "" if row["force_rms_after"] < 0.9 * row["force_rms"] else ", hardly less"
        words.append(f"With what was named, the rms is {after:.2g} {row['unit']}{less}.")
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
    return f"{abs(mean):.2g} {unit} {SIDES[channel][0 if mean > 0 else 1]} on average"


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
    return f"{percent(share)} in {name}, {size:.2g} {unit} rms"


def unexplained_words(m: UnexplainedForce) -> list[str]:
    """The unexplained force ``m`` in a few sentences: its channels, what it follows, when it is largest."""
    channels = sorted(m.channels.items(), key=lambda item: -item[1].share)
    each = [
        f"{c.force_rms:.2g} {c.unit} rms in {name} (90 % interval {c.interval_90[0]:.2g} to {c.interval_90[1]:.2g})"
        for name, c in channels
        if c.share > FOLLOWED
    ]
    if not each:
        return ["It does not act like a force that motion, inputs, wind or place could explain."]
    words, (name, first) = [f"It acts like a force of {' and '.join(each)}."], channels[0]
    constant = first.mean**2 / max(first.force_rms**2, 1e-300)
    if constant > 0.5:
        words.append(f"{percent(constant)} of it in {name} is constant through the trials.")
    words += filter(None, [_follows([v for v in m.follows if v["channel"] == name], name)])
    for t in m.times[:1]:
        size = f"{t.channel}, {_on_average(t.mean, t.unit, t.channel)}"
        words.append(f"It is largest in {t.trial} from {t.start:.0f} to {t.end:.0f} s ({size}).")
    return words


def unexplained_hint(m: UnexplainedForce | None) -> str:
    """Where the unexplained force ``m`` lives, in half a sentence for the verdict, or nothing."""
    if m is None or not m.channels or m.p_value > MORE_THAN_CHANCE:
        return ""
    name, first = max(m.channels.items(), key=lambda item: item[1].share)
    own = [v for v in m.follows if v["channel"] == name and v["explained"] > FOLLOWED][:1]
    follows = f" and follows the {PLAIN.get(own[0]['variable'], own[0]['variable'])}" if own else ""
    return f" It acts mostly in {name}{follows}." if first.force_rms > 0 else ""


VARIABLES = {
    "u, v, r": "the motion of the hull (u, v, r)",
    "u, n": "speed ahead and revolutions (u, n)",
    "delta, n": "rudder angle and wash (delta, n)",
    "air": "the air and the heading",
}
"""Words for the few variables of a kind of force (``force_forms.by_variables``)."""


def kind_words(kind: str) -> str:
    """A kind of function of the dictionary without names, in words."""
    if kind.endswith(AT_TIMES):
        return f"{kind_words(kind.removesuffix(AT_TIMES))} for some seconds, now and then"
    if kind.endswith(BY_PLACE):
        return f"a {kind.removesuffix(BY_PLACE).replace('wind', 'share of the logged wind')} that differs by place"
    if kind == AFTER_RUDDER:
        return f"a {kind}, as roll does"
    if kind.startswith("force that swings"):
        return f"a {kind} of the ship on her way, as of vortices"
    if kind.startswith("stream that turns"):
        return f"a {kind}"
    what, _, name = kind.partition(" of ")
    name = PLAIN.get(name, name)
    if what == "sensor":
        return f"an error of the logged {name}"
    if what in ("action", "delay"):
        does = "do" if name.endswith("s") else "does"
        return f"a {'change in' if what == 'action' else 'delay of'} what the {name} {does}"
    force, _, few = kind.removesuffix(")").partition(" (")
    if few in VARIABLES:
        return f"a {force} that follows {VARIABLES[few]}"
    variable, alone, force = kind.partition(" alone ")
    if alone:
        return f"a {force} that follows {PLAIN.get(variable, variable)} alone"
    return f"a {kind}" if " " in kind else f"a {kind} of its own"


def likeness(log_bayes: Mapping[str, float]) -> str:
    """The unnamed form that what is missing acts most like, as a sentence; "" where none explains anything by itself.

    log_bayes: of each kind, with that of all together and of the best force alone.
    """
    kinds = {kind: value for kind, value in log_bayes.items() if kind not in ("all", "single")}
    best = max(kinds, key=kinds.__getitem__, default="")
    return f" Among the unnamed forms it acts most like {kind_words(best)}." if best and kinds[best] > 0 else ""
