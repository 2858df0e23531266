"""Whitening filter, smoother and the slopes of its log determinant against dense algebra and finite differences."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.estimation import filtering, kalman
from diagnosis.estimation.filtering import CompiledFilter, source
from diagnosis.estimation.force_order import PAIRS, force_order, order_by_law, order_of, turning_scores, with_turning
from diagnosis.estimation.kalman import (
    DrivenColumns,
    Filtered,
    LinearSystem,
    NoiseModel,
    ProductColumns,
    adjoint,
    filtered,
    linear_system,
    smoothed,
    whitened,
)
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.judgement.verdict import not_random
from mmg.compile.batch import LOOP_FLAGS
from mmg.compile.cache import load_library
from tests.diagnosis.judgement.test_verdict import ready

K, R = 11, 3


def system(n: int = 6, seed: int = 0) -> LinearSystem:
    """A stable system of n states, some samples missing, the second window shorter."""
    rng = np.random.default_rng(seed)
    inside = np.arange(K)[:, None] < np.array([K, K - 4, K])
    good = rng.random((K + 1, R, 6)) > 0.2
    good[3:5] = False
    good[:, 1] &= (np.arange(K + 1) <= K - 4)[:, None]
    T = 0.8 * np.eye(n) + 0.2 * rng.standard_normal((K, R, n, n)) / np.sqrt(n)
    S = max(n - 3, 0)
    T[..., S:, :S] = 0.0  # as of the latent force, which no state of the ship moves
    T[~inside] = np.eye(n)
    Z = np.where(good[..., None], rng.standard_normal((K + 1, R, 6, n)), 0.0)
    first = np.repeat(np.diag(1 + rng.random(n))[None], R, axis=0)
    return LinearSystem(T, Z, 0.1 + rng.random(n), 0.1 + rng.random(6), first, good, inside, S)


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
    rng, n = np.random.default_rng(seed), 6
    return rng.standard_normal((K, R, n, 1)), rng.standard_normal((K + 1, R, 6, 1)), rng.standard_normal((R, n, 1))


def propagated(s: LinearSystem, forcing: np.ndarray, start: np.ndarray, w: int) -> np.ndarray:
    """The column's states at all times without noise, (K + 1) n."""
    z = [start[w, :, 0]]
    for k in range(len(s.T)):
        z.append(s.T[k, w] @ z[-1] + np.where(s.inside[k, w], forcing[k, w, :, 0], 0.0))
    return np.concatenate(z)


def test_whitened_sum_of_squares_and_log_det_are_those_of_the_dense_covariance() -> None:
    s = system()
    forcing, observed, start = column()
    f = filtered(s)
    white, _ = whitened(s, f, DrivenColumns.dense(forcing, observed, start))
    for w in range(R):
        P, Z, noise = dense(s, w)
        sigma = Z @ P @ Z.T + np.diag(noise)
        residual = Z @ propagated(s, forcing, start, w) + observed[:, w, :, 0].reshape(-1)[s.good[:, w].reshape(-1)]
        assert (white[:, w] ** 2).sum() == pytest.approx(residual @ np.linalg.solve(sigma, residual), rel=1e-8)
        assert f.log_det[w] == pytest.approx(np.linalg.slogdet(sigma)[1], rel=1e-8)
        assert not white[:, w][~s.good[:, w]].any()


def test_smoothed_states_are_the_conditional_means() -> None:
    """The column is (defect, -residual): the states that it leaves are the mean given that it is nought."""
    s = system()
    f = filtered(s)
    forcing, observed, start = column()
    white, states = whitened(s, f, DrivenColumns.dense(forcing, observed, start), with_states=True)
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
    s = system()
    found = adjoint(s, filtered(s))
    rng, small = np.random.default_rng(3), 1e-4
    for name, slope, there in (("T", found.by_T, s.inside), ("Z", found.by_Z, s.good)):
        whole = getattr(s, name)
        for _ in range(40):
            at = tuple(int(rng.integers(count)) for count in slope.shape)
            if there[at[: there.ndim]]:
                up, down = (half_log_det(replace(s, **{name: changed(whole, at, e)})) for e in (small, -small))
                assert slope[at] == pytest.approx((up - down) / (2 * small), rel=1e-5, abs=1e-7)


def test_diagonals_are_the_slopes_by_the_variances() -> None:
    """N and D are twice the slopes of 1/2 log det by a step's variance of change and by a sample's variance."""
    s = system()
    found: Filtered = filtered(s)
    a = adjoint(s, found)
    for name, found_by, there in (("Q", a.N, s.inside[..., None]), ("R", a.D, s.good)):
        whole, small = getattr(s, name), 1e-6
        for j in range(len(whole)):
            up, down = (half_log_det(replace(s, **{name: changed(whole, (j,), e)})) for e in (small, -small))
            own = np.where(there, found_by, 0.0)[..., j].sum()
            assert own == pytest.approx((up - down) / small, rel=1e-5, abs=1e-7)


@pytest.fixture(scope="module")
def code() -> CompiledFilter:
    library, why = load_library(source(), LOOP_FLAGS)
    if library is None:
        pytest.skip(why)
    return CompiledFilter(library)


@pytest.fixture
def forgotten() -> Iterator[None]:
    """The choice between code and numpy is made again, before and after."""
    filtering.fastest.cache_clear()
    yield
    filtering.fastest.cache_clear()


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """To 1e-12 of the largest."""
    assert np.abs(found - expected).max(initial=0.0) <= 1e-12 * (1 + np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("n", [1, 7, 8, 9, 22])
def test_the_filter_is_that_of_numpy(code: CompiledFilter, n: int) -> None:
    s = system(n)
    f, own = kalman.filtered(s), code.filtered(s)
    for name in ("gain", "P", "inverse", "root", "log_det"):
        close(getattr(own, name), getattr(f, name))
    back = adjoint(s, f)
    for name, expected in vars(back).items():
        close(getattr(code.adjoint(s, f), name), expected)
    if n > 5:  # three states of the force, two of gusts
        s = replace(s, S=n - 5)
        pushes = back.by_T[:, :, : s.S], 0.5, np.ones((K, R, 3, 2))
        close(code.by_rates(s, *pushes), kalman.by_rates(s, *pushes))
    ones = DrivenColumns.dense(np.ones((K, R, n, 1)), np.ones((K + 1, R, 6, 1)))
    white, states = (a[..., 0] for a in whitened(s, f, ones, with_states=True))
    for one, expected in zip(code.smoothed(s, f, white, states), smoothed(s, f, white, states), strict=True):
        close(one, expected)


@pytest.mark.parametrize("c", [1, 8, 13, 128, 131])
def test_responses_are_those_of_numpy_in_any_number_of_columns(code: CompiledFilter, c: int) -> None:
    s, rng = system(9), np.random.default_rng(2)
    f, d = kalman.filtered(s), min(c, 3)
    columns = DrivenColumns(
        forcing=rng.standard_normal((K, R, 6, c)),
        observed=rng.standard_normal((K + 1, R, 6, d)),
        observing=rng.permutation(c)[:d],
        scale=rng.random((R, c)),
        start=rng.standard_normal((R, 9, c)),
    )
    white, states = kalman.whitened(s, f, columns, with_states=True)
    wide = np.full((K + 1, R, 6, c + 5), np.nan)
    own = code.whitened(s, f, columns, wide[..., 2 : c + 2], True)[1]
    close(wide[..., 2 : c + 2], white)
    close(own, states)
    assert np.isnan(wide[..., :2]).all() and np.isnan(wide[..., c + 2 :]).all(), "it wrote beside its columns"


def test_observations_have_the_residuals_they_were_made_of(code: CompiledFilter) -> None:
    s, rng = system(9), np.random.default_rng(3)
    f = code.filtered(s)
    white = np.where(s.good[..., None], rng.standard_normal((K + 1, R, 6, 10)), 0.0)
    logged = kalman.observations(s, f, white)
    again = np.empty_like(white)
    code.whitened(s, f, DrivenColumns.dense(np.zeros((K, R, 0, 10)), -logged), again, False)
    np.testing.assert_allclose(-again, white, atol=1e-10)


def test_a_singular_covariance_is_one_error_in_both(code: CompiledFilter) -> None:
    broken = replace(system(7), R=np.array([1.0, 1.0, 1.0, -1e6, 1.0, 1.0]))
    for by in (kalman.filtered, code.filtered):
        with pytest.raises(np.linalg.LinAlgError):
            by(broken)


@pytest.mark.slow
@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("right, wrong", [("+= root[6 * l + a]", "-= root[6 * l + a]"), ("+= scale[j]", "-= scale[j]")])
def test_wrong_code_is_not_used_and_one_line_says_so(
    code: CompiledFilter,
    right: str,
    wrong: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    monkeypatch.setenv("MMG_CACHE", str(tmp_path))
    text = source()
    assert code and right in text
    monkeypatch.setattr(filtering, "source", lambda: text.replace(right, wrong))
    s = system(9)
    with caplog.at_level(logging.WARNING):
        found = filtering.fastest().filtered(s)
        filtering.fastest().filtered(s)
    assert len([r for r in caplog.records if r.levelno == logging.WARNING]) == 1
    assert np.array_equal(found.P, kalman.filtered(s).P) and not list(tmp_path.glob("*.so"))


@pytest.mark.usefixtures("forgotten")
def test_without_a_compiler_numpy_does_it_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_CC", "none")
    s, rng = system(9), np.random.default_rng(4)
    f = filtering.fastest().filtered(s)
    assert np.array_equal(f.P, kalman.filtered(s).P)
    columns = DrivenColumns.dense(rng.standard_normal((K, R, 4, 2)), rng.standard_normal((K + 1, R, 6, 2)))
    white, none = filtering.fastest().whitened(s, f, columns)
    whole, states = filtering.fastest().whitened(s, f, columns, np.empty((K + 1, R, 6, 2)), with_states=True)
    assert not none.size and np.array_equal(white, whole) and states.shape == (K + 1, R, 9, 2)


@pytest.mark.parametrize("windows", [1, 3])
@pytest.mark.parametrize("most", [1, 4 * 3 * 2 * 5 * 2, 10**6])
def test_blocks_are_the_products_in_their_order(most: int, windows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """values: of each window, or the same in all."""
    monkeypatch.setattr(kalman, "BLOCK", most)
    rng = np.random.default_rng(0)
    pushes, values = rng.standard_normal((4, 3, 2, 5)), rng.standard_normal((7, 4, windows))
    columns = ProductColumns(pushes, values)
    blocks = list(columns.blocks())
    found = np.concatenate([block.forcing for block in blocks], axis=3)
    expected = np.einsum("kraf,vkr->kravf", pushes, np.broadcast_to(values, (7, 4, 3))).reshape(4, 3, 2, 35)
    np.testing.assert_array_equal(found, expected)
    assert columns.width == 35 and len(blocks) == {1: 7, 240: 4}.get(most, 1)
    assert not any(block.dense_observed.any() for block in blocks)


COUNT, WINDOWS, STATES, SECONDS = 250, 3, 3, 0.8
FORCE_NOISE = NoiseModel(
    force=np.array([0.4, 0.7, 0.5]),
    tau=3.0,
    white=np.array([0.1, 0.2, 0.05, 0.3, 0.2, 0.1]),
)


def damped_ship() -> LinearSystem:
    """Three windows of a damped ship that logs its velocities thrice as well as its positions; one ends early."""
    rng = np.random.default_rng(5)
    F = np.diag([0.9, 0.8, 0.7]) + 0.05 * rng.standard_normal((STATES, STATES))
    see = np.vstack([0.3 * rng.standard_normal((3, STATES)), np.eye(STATES)])
    model = LinearModel(
        end=np.zeros((COUNT, WINDOWS, STATES)),
        F=np.tile(F, (COUNT, WINDOWS, 1, 1)),
        G=np.zeros((COUNT, WINDOWS, STATES, 0)),
        force=np.tile(0.5 * np.eye(STATES), (COUNT, WINDOWS, 1, 1)),
        logged=np.zeros((COUNT + 1, WINDOWS, 6)),
        H=np.tile(see, (COUNT + 1, WINDOWS, 1, 1)),
        observed=np.zeros((COUNT + 1, WINDOWS, 6, 0)),
        observing=np.zeros(0, dtype=int),
    )
    steps = np.array([COUNT, COUNT, COUNT // 2])
    inside = np.arange(COUNT)[:, None] < steps
    good = np.repeat((np.arange(COUNT + 1)[:, None] <= steps)[..., None], 6, axis=2)
    good[::7, 0] = False
    return linear_system(model, FORCE_NOISE, np.tile(np.eye(STATES), (WINDOWS, 1, 1)), good, inside, SECONDS)


def residuals_of(truth: LinearSystem, fitted: LinearSystem, draws: int, seed: int) -> np.ndarray:
    """Whitened residuals (K + 1, R, 6, draws), by the filter of ``fitted``, of trials simulated with ``truth``."""
    rng = np.random.default_rng(seed)
    n = truth.T.shape[2]
    state = np.linalg.cholesky(truth.first + 1e-12 * np.eye(n)) @ rng.standard_normal((WINDOWS, n, draws))
    logged = np.empty((COUNT + 1, WINDOWS, 6, draws))
    for k in range(COUNT + 1):
        logged[k] = truth.Z[k] @ state + np.sqrt(truth.R)[:, None] * rng.standard_normal((WINDOWS, 6, draws))
        if k < COUNT:
            pushed = np.sqrt(truth.Q)[:, None] * rng.standard_normal((WINDOWS, n, draws))
            state = truth.T[k] @ state + np.where(truth.inside[k][:, None, None], pushed, 0.0)
    return whitened(fitted, filtered(fitted), DrivenColumns.dense(np.zeros((COUNT, WINDOWS, 0, draws)), -logged))[0]


def scores_of(white: np.ndarray) -> np.ndarray:
    """Scores (3, draws) of whitened residuals."""
    s = damped_ship()
    return turning_scores(s, filtered(s), FORCE_NOISE, SECONDS, lambda: iter([white]))


@pytest.fixture(scope="module")
def by_chance() -> np.ndarray:
    """Scores of whitened residuals drawn as such, the law by chance."""
    return scores_of(np.random.default_rng(0).standard_normal((COUNT + 1, WINDOWS, 6, 1000)))


@pytest.mark.slow
def test_independent_forces_are_random_at_the_nominal_level(by_chance: np.ndarray) -> None:
    found = np.hstack([scores_of(residuals_of(damped_ship(), damped_ship(), 400, seed)) for seed in range(3)])
    laws = np.random.default_rng(4).choice(by_chance, (1200, 200), axis=1)  # each has drawn a law of its own
    p = np.array([order_by_law(score, laws[:, i]).p_value for i, score in enumerate(found.T)])
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.025)  # three standard errors, with that of the pool of laws
    assert p.mean() == pytest.approx(0.5, abs=0.03)
    ratio = found / np.sqrt((by_chance**2).mean(axis=1, keepdims=True))
    assert np.abs(ratio.mean(axis=1)).max() < 0.15 and np.abs(ratio.std(axis=1) - 1).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("pair", [0, 1, 2])
def test_forces_that_follow_each_other_are_found_with_their_angle(pair: int, by_chance: np.ndarray) -> None:
    angles = np.zeros(3)
    angles[pair] = -0.8
    white = residuals_of(with_turning(damped_ship(), FORCE_NOISE, SECONDS, angles), damped_ship(), 40, 2)
    found = [order_by_law(score, by_chance) for score in scores_of(white).T]
    assert np.mean([o.pair == PAIRS[pair] and not o.is_random for o in found]) > 0.95
    mean = np.mean([o.turning for o in found], axis=0)
    assert mean[pair] == pytest.approx(-0.8, abs=0.2)  # to first order
    assert np.abs(np.delete(mean, pair)).max() < 0.1


def test_a_test_of_residuals_draws_its_own_law() -> None:
    s = damped_ship()
    white = residuals_of(with_turning(s, FORCE_NOISE, SECONDS, np.array([0.0, 0.0, 1.0])), s, 1, 3)[..., 0]
    one, again, other = (order_of(s, filtered(s), white, FORCE_NOISE, SECONDS, seed) for seed in (1, 1, 2))
    assert one.p_value == again.p_value != other.p_value and max(one.p_value, other.p_value) < 1e-6
    assert one.turning == pytest.approx(other.turning, abs=0.3) and one.turning[2] > 0.5


def test_a_turning_leaves_the_size_of_the_force_as_it_is() -> None:
    turned = with_turning(damped_ship(), FORCE_NOISE, SECONDS, np.array([0.5, -1.0, 2.0]))
    block, size = turned.T[0, 0, STATES : STATES + 3, STATES : STATES + 3], np.diag(FORCE_NOISE.force**2)
    assert block @ size @ block.T + np.diag(turned.Q[STATES : STATES + 3]) == pytest.approx(size)
    assert not np.allclose(block, block.T) and np.array_equal(turned.T[-1, 2], np.eye(turned.T.shape[2]))


def test_what_is_found_is_said_unless_the_calibration_shows_it_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    case = ready()
    p = case.problem
    order = force_order(p.steps, p.data, case.null)
    assert order.is_random and not_random(replace(case, line=(1.0, 3.0)), case.null) == []
    monkeypatch.setattr(
        "diagnosis.judgement.verdict.force_order", lambda *_: replace(order, p_value=1e-5, scores=np.eye(3)[2])
    )
    (message,) = not_random(replace(case, line=(1.0, 3.0)), case.null)
    assert message.code == "ordered_forces"
    assert not_random(replace(case, line=(1.0, 3.0), is_order_usual=True), case.null) == []
    both = not_random(replace(case, line=(1e-9, 3.0)), case.null)
    assert [m.code for m in both] == ["oscillating_residuals", "ordered_forces"]
