"""Sums by group are those of ``numpy.add.at`` to the last bit: what a fit ends at hangs on it in the fifth digit."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.nlp.prior import group_sums


@pytest.mark.parametrize("shape", [(), (1,), (1, 1), (2,), (3,), (8, 1), (9, 72), (62, 62)])
@pytest.mark.parametrize(("rows", "groups"), [(0, 3), (1, 1), (104, 1), (500, 26), (500, 400)])
@pytest.mark.parametrize("in_order", [True, False])
def test_sums_are_those_of_add_at(shape: tuple[int, ...], rows: int, groups: int, in_order: bool) -> None:
    rng = np.random.default_rng(rows)
    group = rng.integers(0, groups, rows)
    group = np.sort(group) if in_order else group
    values, expected = rng.standard_normal((rows, *shape)), np.zeros((groups, *shape))
    np.add.at(expected, group, values)
    for given in (values, np.asfortranarray(values)):
        found = group_sums(group, given, groups)
        assert found.shape == expected.shape and np.array_equal(found, expected)
