"""Paths that were smoothed through a run for one test are there for the next: the same run, written in many ways."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from cases.importing import derived_motion


@pytest.fixture(scope="session", autouse=True)
def remembered_paths() -> Iterator[None]:
    """Smoothing takes nine tenths of an import: of equal values it is done once."""
    smoothed, known = derived_motion.smoothed, {}

    def once(*given: object) -> derived_motion.Smoothed:
        arrays = [np.asarray(np.nan if a is None else a, dtype=float) for a in given]
        key = tuple((a.shape, a.tobytes()) for a in arrays)
        if key not in known:
            known[key] = smoothed(*given)
        return replace(known[key], value=known[key].value.copy(), rate=known[key].rate.copy())

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(derived_motion, "smoothed", once)
        yield
