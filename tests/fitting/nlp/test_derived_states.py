"""States that were derived count as little as their trials say, and are not taken for noise of the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.nlp.windows import Segments, cut
from fitting.solvers.noise import estimate_noise
from tests.support.synthetic_runs import SIGMA, problem
from tests.support.trial_files import make_trial


def both(std: float) -> Segments:
    """Two trials, the second with a surge velocity that was derived."""
    trials = [make_trial(), replace(make_trial(), name="derived", std={"u": std} if std else {})]
    return cut(trials, 1.0, 50.0, 5)


def test_without_a_statement_nothing_changes() -> None:
    assert both(0.0).variance is None


def test_a_sample_weighs_one_over_the_sum_of_variances() -> None:
    segments = both(0.03)
    assert segments.variance is not None and segments.variance.shape == (len(segments.run), 6)
    plain = problem(5)
    tau = np.array([1.0, 1.0, 1.0, 2.0, 1.0, 1.0])
    here = plain.with_changes(segments=segments).with_sigma(SIGMA, tau)
    derived = segments.run[segments.node_window] == 1
    assert here.node_weight[derived, 3] == pytest.approx(1 / (SIGMA[3] ** 2 + 2 * 0.03**2))
    assert here.node_weight[~derived, 3] == pytest.approx(1 / SIGMA[3] ** 2)
    inside = segments.run[segments.window] == 1
    measured = segments.mask[:, 3, inside] > 0
    assert here.weight[:, 3, inside][measured] == pytest.approx(1 / (SIGMA[3] ** 2 + 2 * 0.03**2))
    for channel in (0, 1, 2, 4, 5):
        assert here.node_weight[:, channel] == pytest.approx(1 / SIGMA[channel] ** 2)


def test_the_noise_is_that_of_the_measured_ones() -> None:
    """Residuals of .02 everywhere, those of the derived run larger by what it states."""
    segments, rng = both(0.05), np.random.default_rng(0)
    derived = segments.run[segments.node_window] == 1
    nodes, inside = 0.02 * rng.standard_normal(segments.nodes.shape), 0.02 * rng.standard_normal(segments.targets.shape)
    nodes[derived, 3] += 0.05 * rng.standard_normal(derived.sum())
    at = segments.run[segments.window] == 1
    inside[:, 3, at] += 0.05 * rng.standard_normal(inside[:, 3, at].shape)
    found = estimate_noise(segments, nodes, inside, np.full(6, 1e-6))
    assert found.rms == pytest.approx(np.full(6, 0.02), rel=0.25)
    unaware = estimate_noise(replace(segments, variance=None), nodes, inside, np.full(6, 1e-6))
    assert unaware.rms[3] > 0.035
    part = segments.subset(np.flatnonzero(segments.run == 1))
    assert part.variance is not None and (part.variance[:, 3] == 0.05**2).all()
