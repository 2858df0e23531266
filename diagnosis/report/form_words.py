"""Words for the unnamed forms: what a missing force or a fault acts like."""

from __future__ import annotations

from collections.abc import Mapping

from diagnosis.hypotheses.dictionary import AFTER_RUDDER, BY_PLACE
from diagnosis.hypotheses.events import AT_TIMES
from diagnosis.report.where_words import PLAIN

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
