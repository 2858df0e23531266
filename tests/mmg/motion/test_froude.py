"""Froude's law: ships of equal Froude number move alike."""

from __future__ import annotations

import numpy as np
import pytest

from mmg.motion.froude import MODEL_LENGTH, force_scale, length_scale, reference_speed, state_scale, time_scale


@pytest.mark.parametrize("length", [1.0, MODEL_LENGTH, 320.0])
def test_equal_froude_numbers_give_similar_motions_and_forces(length: float) -> None:
    lam, k = length_scale(length), time_scale(length)
    assert reference_speed(length) / reference_speed(MODEL_LENGTH) == pytest.approx(k)
    assert lam / k == pytest.approx(k)  # a length in a time is a speed
    assert force_scale(length) == pytest.approx(lam**2 * k**2)  # of a pressure on an area
    np.testing.assert_allclose(state_scale(length), [lam, lam, 1.0, k, k, 1 / k])


def test_a_model_of_three_metres_is_the_reference() -> None:
    np.testing.assert_array_equal(state_scale(MODEL_LENGTH), np.ones(6))
