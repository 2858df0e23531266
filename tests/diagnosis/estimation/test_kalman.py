"""Whitening filter, smoother and the slopes of its log determinant against dense algebra and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.kalman import (
    Filtered,
    LinearSystem,
    NoiseModel,
    adjoint,
    filtered,
    linear_system,
    responses,
    smoothed,
)
from diagnosis.estimation.transition_model import LinearModel

K, R, S = 7, 2, 3
STEPS = np.array([7, 5])
NOISE = NoiseModel(
    force=np.array([0.4, 0.7, 0.5]),
    tau=3.0,
    white=np.array([0.1, 0.2, 0.05, 0.3, 0.2, 0.1]),
)
H_STEP = 0.8
FIRST = np.array([1.0, 0.5, 2.0])


def linear(seed: int = 0) -> LinearModel:
    """A stable random linear ship of three states, with forces and two columns."""
    rng = np.random.default_rng(seed)
    F = 0.8 * np.eye(S) + 0.15 * rng.standard_normal((K, R, S, S))
    return LinearModel(
        end=rng.standard_normal((K, R, S)),
        F=F,
        G=rng.standard_normal((K, R, S, 2)),
        force=rng.standard_normal((K, R, S, 3)),
        logged=rng.standard_normal((K + 1, R, 6)),
        H=rng.standard_normal((K + 1, R, 6, S)),
        observed=rng.standard_normal((K + 1, R, 6, 2)),
        observing=np.arange(2),
    )


def case(noise: NoiseModel = NOISE, gusty: bool = False) -> tuple[LinearSystem, LinearModel]:
    """Two windows, the second shorter, with samples missing in both, perhaps with gusts."""
    inside = np.arange(K)[:, None] < STEPS[None]
    good = np.ones((K + 1, R, 6), dtype=bool)
    good[:, 1] &= (np.arange(K + 1) <= STEPS[1])[:, None]
    good[2, 0, 3:] = good[0, 0, :2] = good[4, 1] = False
    model = linear()
    first = np.repeat(np.diag(FIRST**2)[None], R, axis=0)
    gusts = np.random.default_rng(4).standard_normal((K, R, 3, 2)) * inside[..., None, None] if gusty else None
    return linear_system(model, noise, first, good, inside, H_STEP, gusts), model


def dense(s: LinearSystem, w: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of one window: C (states at all times stacked, from start and random changes), its covariance, and rows observed.

    Returns (covariance of all states, Z of all samples observed, R of them), states of K + 1 times stacked.
    """
    count, n = len(s.T) + 1, s.T.shape[2]
    phi = np.zeros((count * n, count * n))  # from (start, changes) to the states
    for k in range(count):
        phi[k * n : (k + 1) * n, k * n : (k + 1) * n] = np.eye(n)
        if k:
            before = phi[(k - 1) * n : k * n]
            phi[k * n : (k + 1) * n] += s.T[k - 1, w] @ before
    inner = np.zeros((count * n, count * n))
    inner[:n, :n] = s.first[w]
    for k in range(1, count):
        if s.inside[k - 1, w]:
            inner[k * n : (k + 1) * n, k * n : (k + 1) * n] = np.diag(s.Q)
    Z = np.zeros((count * 6, count * n))
    for k in range(count):
        Z[k * 6 : (k + 1) * 6, k * n : (k + 1) * n] = s.Z[k, w]
    observed = s.good[:, w].reshape(-1)
    return phi @ inner @ phi.T, Z[observed], np.tile(s.R, count)[observed]


def column(seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a column adds to the states over each step, to the logged columns, and its start."""
    rng = np.random.default_rng(seed)
    n = S + 3
    return rng.standard_normal((K, R, n, 1)), rng.standard_normal((K + 1, R, 6, 1)), rng.standard_normal((R, n, 1))


def propagated(s: LinearSystem, forcing: np.ndarray, start: np.ndarray, w: int) -> np.ndarray:
    """The column's states at all times without noise, (K + 1) n."""
    z = [start[w, :, 0]]
    for k in range(len(s.T)):
        z.append(s.T[k, w] @ z[-1] + np.where(s.inside[k, w], forcing[k, w, :, 0], 0.0))
    return np.concatenate(z)


def test_gusts_push_along_with_the_latent_force_and_have_their_own_size_and_memory() -> None:
    noise = NOISE.with_(gust=np.array([0.2, 0.1]), gust_tau=0.5)
    bare, gusty = case(noise)[0], case(noise, gusty=True)[0]
    own, others = np.arange(S + 3, S + 5), np.r_[: S + 3, S + 5 : gusty.T.shape[2]]
    np.testing.assert_array_equal(gusty.T[:, :, others][..., others], bare.T)
    gusts = np.random.default_rng(4).standard_normal((K, R, 3, 2))
    expected = linear().force @ gusts
    inside = gusty.inside
    np.testing.assert_allclose(gusty.T[:, :, :S, own][inside], expected[inside], rtol=1e-12)
    left = np.exp(-H_STEP / 0.5)
    np.testing.assert_allclose(gusty.Q[own], noise.gust**2 * (1 - left**2))
    np.testing.assert_allclose(np.diagonal(gusty.first[0])[own], noise.gust**2)
    assert not gusty.Z[..., own].any() and (gusty.T[inside][:, own][..., own] == left * np.eye(2)).all()


def test_whitened_sum_of_squares_and_log_det_are_those_of_the_dense_covariance() -> None:
    s, _ = case()
    forcing, observed, start = column()
    f = filtered(s)
    white, _ = responses(s, f, forcing, observed, start)
    for w in range(R):
        P, Z, noise = dense(s, w)
        sigma = Z @ P @ Z.T + np.diag(noise)
        residual = Z @ propagated(s, forcing, start, w) + observed[:, w, :, 0].reshape(-1)[s.good[:, w].reshape(-1)]
        assert (white[:, w] ** 2).sum() == pytest.approx(residual @ np.linalg.solve(sigma, residual), rel=1e-8)
        assert f.log_det[w] == pytest.approx(np.linalg.slogdet(sigma)[1], rel=1e-8)
        assert not white[:, w][~s.good[:, w]].any()


def test_smoothed_states_are_the_conditional_means() -> None:
    """The column is (defect, -residual): the states that it leaves are the mean given that it is nought."""
    s, _ = case()
    f = filtered(s)
    forcing, observed, start = column()
    white, states = responses(s, f, forcing, observed, start)
    mean, r, u = smoothed(s, f, white[..., 0], states[..., 0])
    n = s.T.shape[2]
    for w in range(R):
        P, Z, noise = dense(s, w)
        prior = propagated(s, forcing, start, w)
        sigma = Z @ P @ Z.T + np.diag(noise)
        residual = Z @ prior + observed[:, w, :, 0].reshape(-1)[s.good[:, w].reshape(-1)]
        expected = (prior - P @ Z.T @ np.linalg.solve(sigma, residual)).reshape(K + 1, n)
        np.testing.assert_allclose(mean[:, w], expected, rtol=1e-6, atol=1e-9)
        # u is Sigma^-1 times minus the residual, so white errors are estimated as R u
        scattered = np.zeros((K + 1) * 6)
        scattered[s.good[:, w].reshape(-1)] = -np.linalg.solve(sigma, residual)
        np.testing.assert_allclose(u[:, w].reshape(-1)[s.good[:, w].reshape(-1)],
                                   scattered[s.good[:, w].reshape(-1)], rtol=1e-6, atol=1e-9)  # fmt: skip
        # r is the multiplier of each step: the random change is estimated as Q r
        moved = expected[1:] - np.array([s.T[k, w] @ expected[k] for k in range(K)])
        change = moved - np.where(s.inside[:, w, None], forcing[:, w, :, 0], 0.0)
        np.testing.assert_allclose(np.where(s.inside[:, w, None], s.Q * r[:, w], 0.0), change, atol=1e-8)


def half_log_det(s: LinearSystem) -> float:
    return 0.5 * float(filtered(s).log_det.sum())


def changed(array: np.ndarray, at: tuple[int, ...], by: float) -> np.ndarray:
    result = array.copy()
    result[at] += by
    return result


def test_slopes_of_the_log_determinant_are_those_of_finite_differences() -> None:
    s, _ = case()
    found = adjoint(s, filtered(s))
    rng, small = np.random.default_rng(3), 1e-4
    for name, slope, there in (("T", found.by_T, s.inside), ("Z", found.by_Z, s.good)):
        whole = getattr(s, name)
        for _ in range(40):
            at = tuple(int(rng.integers(count)) for count in whole.shape)
            if there[at[: there.ndim]]:
                up, down = (half_log_det(replace(s, **{name: changed(whole, at, e)})) for e in (small, -small))
                assert slope[at] == pytest.approx((up - down) / (2 * small), rel=1e-5, abs=1e-7)


def test_diagonals_are_the_slopes_by_the_variances() -> None:
    """N and D are twice the slopes of 1/2 log det by a step's variance of change and by a sample's variance."""
    s, _ = case()
    found: Filtered = filtered(s)
    a = adjoint(s, found)
    for name, found_by, there in (("Q", a.N, s.inside[..., None]), ("R", a.D, s.good)):
        whole, small = getattr(s, name), 1e-6
        for j in range(len(whole)):
            up, down = (half_log_det(replace(s, **{name: changed(whole, (j,), e)})) for e in (small, -small))
            own = np.where(there, found_by, 0.0)[..., j].sum()
            assert own == pytest.approx((up - down) / small, rel=1e-5, abs=1e-7)
