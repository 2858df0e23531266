from __future__ import annotations

import numpy as np
import pytest

from cases.evidence.signals import white_noise


def test_the_noise_on_a_slow_motion_is_recovered_and_unmeasured_columns_have_none():
    rng, t = np.random.default_rng(0), np.arange(4000) * 0.1
    sizes = np.array([0.01, 0.02, 0.003, 0.004, 0.005, 0.0006])
    states = np.sin(0.05 * t)[:, None] + sizes * rng.standard_normal((len(t), 6))
    np.testing.assert_allclose(white_noise([states[:2000], states[2000:], states[:2]]), sizes, rtol=0.1)
    states[:, :2] = np.nan
    assert white_noise([states]).tolist() == [0.0] * 6
    noise = white_noise([states], slice(2, None))
    assert noise[:2].tolist() == [0.0, 0.0] and noise[5] == pytest.approx(sizes[5], rel=0.1)
