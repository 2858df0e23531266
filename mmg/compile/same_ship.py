"""What is made of a ship once and taken again while the same object is asked for."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from mmg.ship import Ship

Made = TypeVar("Made")

KEPT = 8
"""Ships that are remembered."""


def once_per_ship(make: Callable[[Ship], Made]) -> Callable[[Ship], Made]:
    """Returns ``make``, which takes long for a ship, with what it made of the last KEPT ships remembered.

    A ship never changes, so that the same object stands for the same model; of an equal copy it is made anew.
    """
    known: deque[tuple[Ship, Made]] = deque(maxlen=KEPT)

    @wraps(make)
    def remembered(ship: Ship) -> Made:
        found = [made for other, made in known if other is ship]
        if not found:
            found = [make(ship)]
            known.append((ship, found[0]))
        return found[0]

    return remembered
