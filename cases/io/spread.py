"""How what is done to each of many files is done: one after the other, or by whoever is given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


class Spread(Protocol):
    """What does a list of independent tasks."""

    def __call__(self, function: Callable[[Item], Outcome], items: Sequence[Item]) -> list[Outcome]:
        """Outcomes of ``function``, which must be picklable, for each of ``items``, in their order. Raises what one
        raises."""


def one_by_one(function: Callable[[Item], Outcome], items: Sequence[Item]) -> list[Outcome]:
    """Outcomes of ``function`` for each of ``items``, in this process."""
    return [function(item) for item in items]
