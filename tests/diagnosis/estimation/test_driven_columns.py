"""Columns that are products, in blocks: the same numbers, in the same order, however many are in a block."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.estimation import driven_columns
from diagnosis.estimation.driven_columns import ProductColumns


@pytest.mark.parametrize("windows", [1, 3])
@pytest.mark.parametrize("most", [1, 4 * 3 * 2 * 5 * 2, 10**6])
def test_blocks_are_the_products_in_their_order(most: int, windows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """values: of each window, or the same in all."""
    monkeypatch.setattr(driven_columns, "BLOCK", most)
    rng = np.random.default_rng(0)
    pushes, values = rng.standard_normal((4, 3, 2, 5)), rng.standard_normal((7, 4, windows))
    columns = ProductColumns(pushes, values)
    blocks = list(columns.blocks())
    found = np.concatenate([block.forcing for block in blocks], axis=3)
    expected = np.einsum("kraf,vkr->kravf", pushes, np.broadcast_to(values, (7, 4, 3))).reshape(4, 3, 2, 35)
    np.testing.assert_array_equal(found, expected)
    assert columns.width == 35 and len(blocks) == {1: 7, 240: 4}.get(most, 1)
    assert not any(block.dense_observed.any() for block in blocks)
