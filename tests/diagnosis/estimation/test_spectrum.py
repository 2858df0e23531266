"""Spectra are those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from diagnosis.estimation.residual_checks import periodogram


@pytest.mark.parametrize("count", [64, 65, 2, 3])
def test_it_is_that_of_scipy(count: int) -> None:
    x = np.random.default_rng(count).normal(1.0, 2.0, (count, 3))
    frequency, power = periodogram(x, 0.5)
    expected = signal.periodogram(x, 2.0, scaling="spectrum", axis=0)
    np.testing.assert_allclose(frequency, expected[0])
    np.testing.assert_allclose(power, expected[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(power.sum(axis=0), x.var(axis=0))
