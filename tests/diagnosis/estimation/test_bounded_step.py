"""The step of a fit within bounds is the best one: its conditions of optimality hold, whatever was held on the way."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.estimation.map_estimate import bounded_step


def pulls(hessian: np.ndarray, slope: np.ndarray, d: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Slope (P,) at ``d`` of what may still move: zero at the minimum (Karush, Kuhn and Tucker)."""
    pull = slope + hessian @ d
    stopped = (np.isclose(d, low) & (pull > 0.0)) | (np.isclose(d, high) & (pull < 0.0))
    return np.where(stopped, 0.0, pull)


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.floats(0.0, 0.999))
def test_nothing_that_may_move_would_gain(seed: int, count: int, alike: float) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((20, count))
    columns = alike * columns[:, :1] + np.sqrt(1 - alike**2) * columns  # hardly told apart
    hessian = columns.T @ columns + np.eye(count)
    slope, p = 20 * rng.standard_normal(count), rng.uniform(-1, 1, count)
    low, high = p - rng.uniform(0, 1, count) * (rng.random(count) < 0.7), p + rng.uniform(0.01, 2, count)
    d = bounded_step(hessian, slope, p, low, high)
    assert (p + d >= low - 1e-9).all() and (p + d <= high + 1e-9).all()
    assert np.abs(pulls(hessian, slope, d, low - p, high - p)).max() < 1e-6
    assert slope @ d + 0.5 * d @ hessian @ d <= 1e-9
