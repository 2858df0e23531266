"""Smooth functions: orthogonal on their trials, with slopes by finite differences, and fine enough."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.hypotheses.force_forms import Forms, SmoothBasis, spread_of

EVERY = np.ones((40, 5), dtype=bool)


def known(values: np.ndarray) -> Forms:
    """Variables (m, K, R) of which the first is the first logged state."""
    gradients = np.zeros((*values.shape, 6))
    gradients[0, ..., 0] = 1.0
    return Forms(tuple(f"v{i}" for i in range(len(values))), values, gradients)


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    return np.random.default_rng(0).uniform(-2.0, 3.0, (3, 40, 5))


def test_functions_are_orthogonal_and_fall(values: np.ndarray) -> None:
    flat = values.reshape(3, -1)
    found = SmoothBasis(flat, 1.4, 12).on(known(values), "smooth", EVERY)
    gram = found.values.reshape(12, -1) @ found.values.reshape(12, -1).T / flat.shape[1]
    assert found.names[0] == "smooth 1" and np.abs(gram - np.diag(np.diag(gram))).max() < 1e-9
    assert np.diag(gram)[0] == pytest.approx(1.0) and (np.diff(np.diag(gram)) <= 1e-9).all()


def test_slopes_are_those_of_finite_differences(values: np.ndarray) -> None:
    flat = values.reshape(3, -1)
    basis = SmoothBasis(flat, 0.7, 8)
    small = 1e-6 * np.array([1.0, 0.0, 0.0])[:, None, None]
    ends = [basis.on(known(values + sign * small), "smooth", EVERY).values for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(basis.on(known(values), "smooth", EVERY).gradients[..., 0], expected, atol=1e-7)


@pytest.mark.parametrize("waves", [1.0, 2.0, 3.0])
def test_waves_of_one_variable_are_spanned(values: np.ndarray, waves: float) -> None:
    """As of an engine map: up to three of them over the range of the variable."""
    flat = values.reshape(3, -1)
    one = SmoothBasis(flat[:1], 0.35 * spread_of(flat)[0], 8)
    found = one.on(known(values[:1]), "one", EVERY).values.reshape(8, -1)
    wave = np.sin(2 * np.pi * waves * flat[0] / 5.0)
    wave -= wave.mean()
    left = wave - np.linalg.lstsq(found.T, wave, rcond=None)[0] @ found
    assert (left**2).mean() < 0.1 * (wave**2).mean()


def test_what_does_not_change_has_no_function() -> None:
    assert (spread_of(np.array([[1.0, 1.0, 1.0], [0.0, 1.0, 2.0]])) > 0).tolist() == [False, True]


def test_there_are_no_functions_where_nothing_is(values: np.ndarray) -> None:
    flat, some = values.reshape(3, -1), EVERY.copy()
    some[30:] = False
    basis = SmoothBasis(flat, 1.4, 8)
    every, part = (basis.on(known(values), "smooth", mask) for mask in (EVERY, some))
    np.testing.assert_array_equal(part.values[:, :30], every.values[:, :30])
    assert not part.values[:, 30:].any() and not part.gradients[:, 30:].any()
