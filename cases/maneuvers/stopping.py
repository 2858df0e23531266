"""What must be known of a ship that is stopped: the engine and the resistance that are assumed of her."""

from __future__ import annotations

from cases.maneuvers.definitions import Maneuver
from cases.maneuvers.engine import engine_words
from mmg.messages import Message

CODES = ("assumed_engine", "stopping_resistance")
"""Of these messages."""


def stopping_notices(plan: Maneuver) -> list[Message]:
    """What the manoeuvre ``plan`` assumes of engine and resistance; empty for one that stops no ship."""
    words = engine_words(plan.engine) if plan.engine else ""
    found = [Message(f"{plan.kind}: {words}", CODES[0])] if words else []
    for symbol, share in plan.factors.items():
        said = f"{symbol} is {share:g} of that of the ship file (stopping_resistance)"
        found.append(Message(f"{plan.kind}: {said}, so the approach is at {plan.n:.4g} rps", CODES[1]))
    return found
