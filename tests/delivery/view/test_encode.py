"""Columns come back as exactly as their bits allow, and no text can leave its script element."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from delivery.view.page import packed, packed_times, safe_json
from tests.support.view_columns import unpacked

EVIL = "</script><script>alert(1)</script><!-- & \u2028"


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e9])
def test_a_column_keeps_a_65534th_of_its_range(size: float) -> None:
    values = size * np.random.default_rng(0).normal(3.0, 1.0, 500)
    found = unpacked(packed(values))
    assert np.abs(found - values).max() <= 0.5001 * np.ptp(values) / 65534


def test_what_is_missing_stays_missing() -> None:
    values = np.array([1.0, np.nan, np.inf, 3.0])
    found = unpacked(packed(values))
    assert np.isnan(found).tolist() == [False, True, True, False]
    assert found[[0, 3]].tolist() == [1.0, 3.0]
    assert np.isnan(unpacked(packed(np.full(3, np.nan)))).all()


def test_a_constant_column_and_a_huge_one_are_no_trouble() -> None:
    assert unpacked(packed(np.full(4, 7.25))).tolist() == [7.25] * 4
    wide = np.array([-1.7e308, 0.0, 1.7e308])
    assert np.allclose(unpacked(packed(wide)), wide, atol=1e304)


def test_times_are_32_bit_floats() -> None:
    t = np.arange(0.0, 50.0, 0.1)
    assert np.abs(np.frombuffer(base64.b64decode(packed_times(t)), "<f4") - t).max() < 1e-5


def test_json_in_a_page_holds_nothing_that_ends_a_script() -> None:
    text = safe_json({EVIL: [EVIL, float("nan"), np.float64(2.0)]})
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == {EVIL: [EVIL, None, 2.0]}
