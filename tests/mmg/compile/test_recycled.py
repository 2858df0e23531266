"""Memory of large arrays is taken again when nothing refers to them, and never before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from mmg.compile import recycled
from mmg.compile.recycled import LEAST, cleared, forget, kept, room


@pytest.fixture(autouse=True)
def nothing_kept() -> Iterator[None]:
    forget()
    yield
    forget()


def where(array: np.ndarray) -> int:
    return int(array.ctypes.data)


def test_memory_is_taken_again_when_the_last_reference_has_gone() -> None:
    first = room(2, LEAST)
    place = where(first)
    assert where(room(2, LEAST)) != place
    part = first[1, 5:9].reshape(2, 2)
    del first
    assert where(room(LEAST, 2)) != place  # a part of it is still somebody's
    del part
    again = room(LEAST, 2)
    assert where(again) == place and again.shape == (LEAST, 2) and again.flags.c_contiguous


def test_cleared_memory_is_zero_whatever_was_there() -> None:
    first = room(LEAST)
    first[:] = np.nan
    place = where(first)
    del first
    again = cleared(LEAST)
    assert where(again) == place and not again.any()
    assert not cleared(3, 2).any() and cleared(3, 2).shape == (3, 2)


def test_small_arrays_are_not_kept_and_large_ones_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    room(LEAST - 1)
    assert kept() == 0
    monkeypatch.setattr(recycled, "MOST", 3 * LEAST)
    held = room(LEAST)
    for _ in range(4):
        room(LEAST + 1)
        room(LEAST + 2)
    assert LEAST < kept() <= 3 * LEAST
    place = where(held)
    del held
    assert where(room(LEAST)) == place  # the unused ones went first
    forget()
    assert kept() == 0
