"""The compiled filter against that in numpy, columns in blocks; where it is wrong or a covariance is singular."""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from diagnosis.estimation import filtering, kalman
from diagnosis.estimation.filtering import filtered_by, source, whitened_by
from diagnosis.estimation.kalman import DrivenColumns, Filtered, LinearSystem, ProductColumns
from mmg.compile.batch import LOOP_FLAGS
from mmg.compile.cache import load_library

RUNS, STEPS = 3, 11


@pytest.fixture(scope="module")
def code() -> ctypes.CDLL:
    library, why = load_library(source(), LOOP_FLAGS)
    if library is None:
        pytest.skip(why)
    return library


@pytest.fixture
def forgotten() -> Iterator[None]:
    """The choice between code and numpy is made again, before and after."""
    filtering.compiled.cache_clear()
    yield
    filtering.compiled.cache_clear()


def system(n: int, seed: int = 0) -> LinearSystem:
    """A stable system of n states, some samples missing, the second window shorter."""
    rng, K, R = np.random.default_rng(seed), STEPS, RUNS
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


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """To 1e-12 of the largest."""
    assert np.abs(found - expected).max(initial=0.0) <= 1e-12 * (1 + np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("n", [1, 7, 8, 9, 22])
def test_the_filter_is_that_of_numpy(code: ctypes.CDLL, n: int) -> None:
    s = system(n)
    f, own = kalman.filtered(s), filtered_by(code, s)
    for name in ("gain", "P", "inverse", "root", "log_det"):
        close(getattr(own, name), getattr(f, name))


@pytest.mark.parametrize("c", [1, 8, 13, 128, 131])
def test_responses_are_those_of_numpy_in_any_number_of_columns(code: ctypes.CDLL, c: int) -> None:
    s, rng = system(9), np.random.default_rng(2)
    f, d = kalman.filtered(s), min(c, 3)
    columns = DrivenColumns(
        forcing=rng.standard_normal((STEPS, RUNS, 6, c)),
        observed=rng.standard_normal((STEPS + 1, RUNS, 6, d)),
        observing=rng.permutation(c)[:d],
        scale=rng.random((RUNS, c)),
        start=rng.standard_normal((RUNS, 9, c)),
    )
    assert columns.scale is not None
    scaled = columns.forcing * columns.scale[:, None], columns.dense_observed * columns.scale[:, None]
    white, states = kalman.responses(s, f, *scaled, columns.start)
    wide = np.full((STEPS + 1, RUNS, 6, c + 5), np.nan)
    own = whitened_by(code, s, f, columns, wide[..., 2 : c + 2], True)
    close(wide[..., 2 : c + 2], white)
    close(own, states)
    assert np.isnan(wide[..., :2]).all() and np.isnan(wide[..., c + 2 :]).all(), "it wrote beside its columns"


def test_observations_have_the_residuals_they_were_made_of(code: ctypes.CDLL) -> None:
    s, rng = system(9), np.random.default_rng(3)
    f = filtered_by(code, s)
    white = np.where(s.good[..., None], rng.standard_normal((STEPS + 1, RUNS, 6, 10)), 0.0)
    logged = kalman.observations(s, f, white)
    again = np.empty_like(white)
    whitened_by(code, s, f, DrivenColumns.dense(np.zeros((STEPS, RUNS, 0, 10)), -logged), again, False)
    np.testing.assert_allclose(-again, white, atol=1e-10)


def test_a_window_alone_gives_the_same_bits(code: ctypes.CDLL) -> None:
    s = system(9)
    whole = filtered_by(code, s)
    own = replace(s, **{k: getattr(s, k)[:, 1:2] for k in ("T", "Z", "good", "inside")}, first=s.first[1:2])
    alone: Filtered = filtered_by(code, own)
    assert np.array_equal(alone.P[:, 0], whole.P[:, 1]) and alone.log_det[0] == whole.log_det[1]


def test_a_singular_covariance_is_one_error_in_both(code: ctypes.CDLL) -> None:
    broken = replace(system(7), R=np.array([1.0, 1.0, 1.0, -1e6, 1.0, 1.0]))
    for by in (kalman.filtered, partial(filtered_by, code)):
        with pytest.raises(np.linalg.LinAlgError):
            by(broken)


@pytest.mark.slow
@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize("right, wrong", [("+= root[6 * l + a]", "-= root[6 * l + a]"), ("+= scale[j]", "-= scale[j]")])
def test_wrong_code_is_not_used_and_one_line_says_so(
    code: ctypes.CDLL,
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
        found = filtering.filtered(s)
        filtering.filtered(s)
    assert len([r for r in caplog.records if r.levelno == logging.WARNING]) == 1
    assert np.array_equal(found.P, kalman.filtered(s).P) and not list(tmp_path.glob("*.so"))


@pytest.mark.usefixtures("forgotten")
def test_without_a_compiler_numpy_does_it_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MMG_CC", "none")
    s, rng = system(9), np.random.default_rng(4)
    f = filtering.filtered(s)
    assert np.array_equal(f.P, kalman.filtered(s).P)
    columns = DrivenColumns.dense(
        rng.standard_normal((STEPS, RUNS, 4, 2)), rng.standard_normal((STEPS + 1, RUNS, 6, 2))
    )
    white, none = filtering.whitened(s, f, columns)
    whole, states = filtering.whitened(s, f, columns, np.empty((STEPS + 1, RUNS, 6, 2)), with_states=True)
    assert not none.size and np.array_equal(white, whole) and states.shape == (STEPS + 1, RUNS, 9, 2)


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
