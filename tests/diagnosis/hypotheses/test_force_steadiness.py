"""A random force of one size is steady, one that is larger in a part of the trials is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.kalman import LinearSystem, filtered, responses
from diagnosis.hypotheses.force_steadiness import CHANNELS, ForceSteadiness, force_steadiness, steadiness_of
from diagnosis.judgement.not_random import not_random
from tests.diagnosis.estimation.test_force_order import K, R, S, residuals_of, system
from tests.diagnosis.judgement.test_verdict import ready
from tests.support.quick import first_quick

AT = slice(S, S + 3)
TIMES = np.arange(K)[:, None]
WAYS = {
    "fast": (TIMES // 20 + np.arange(R)) % 2,
    "turning": (TIMES // 13) % 3 + np.zeros((K, R), dtype=int),
    "one part": np.zeros((K, R), dtype=int),
}
WEATHER = [np.broadcast_to(np.arange(R), (K, R)), (TIMES // 40) % 4 + np.zeros((K, R), dtype=int)]


def steadiness(white: np.ndarray, seed: int = 0) -> ForceSteadiness:
    """The test of whitened residuals (K + 1, R, 6)."""
    s = system()
    return steadiness_of(s, filtered(s), white[..., None], AT, WAYS, WEATHER, seed)


def unsteady(way: np.ndarray, channel: int, factor: float, draws: int, seed: int) -> np.ndarray:
    """Residuals (K + 1, R, 6, draws), by the filter of a steady force, of a ship whose force in a channel is driven
    ``factor`` times as strongly in part 1 of a way (K, R)."""
    rng, s = np.random.default_rng(seed), system()
    n = s.T.shape[2]
    size = np.ones((K, R, n))
    size[..., S + channel] = np.where(way == 1, factor, 1.0)
    state = np.linalg.cholesky(s.first + 1e-12 * np.eye(n)) @ rng.standard_normal((R, n, draws))
    logged = np.empty((K + 1, R, 6, draws))
    for k in range(K + 1):
        logged[k] = s.Z[k] @ state + np.sqrt(s.R)[:, None] * rng.standard_normal((R, 6, draws))
        if k < K:
            pushed = (np.sqrt(s.Q) * size[k])[..., None] * rng.standard_normal((R, n, draws))
            state = s.T[k] @ state + np.where(s.inside[k][:, None, None], pushed, 0.0)
    return responses(s, filtered(s), np.zeros((K, R, 0, draws)), -logged)[0]


def p_values(white: np.ndarray) -> np.ndarray:
    """Probabilities of residuals (K + 1, R, 6, draws), each with a law of its own."""
    return np.array([steadiness(white[..., i], i).p_value for i in range(white.shape[3])])


@pytest.mark.slow
def test_a_steady_force_is_unsteady_no_more_often_than_chance_has_it() -> None:
    p = p_values(residuals_of(system(), system(), 60, 1))
    assert (p < 0.1).mean() <= 0.1 + 3 * np.sqrt(0.09 / len(p)) and p.min() > 1e-4


@pytest.mark.parametrize("channel", first_quick([2, 1, 0]))
def test_a_force_that_is_larger_in_a_part_is_found_with_its_channel(channel: int) -> None:
    white = unsteady(WAYS["fast"], channel, 3.0, 6, 2)
    found = [steadiness(white[..., i], i) for i in range(white.shape[3])]
    right = [(f.parted_by, f.channel) == ("fast", CHANNELS[channel]) and not f.is_random for f in found]
    assert np.mean(right) > 0.8


@pytest.mark.slow
def test_runs_and_headings_may_differ_in_their_weather() -> None:
    for way in WEATHER:
        assert p_values(unsteady(np.minimum(way, 1), 1, 3.0, 6, 3)).min() > 1e-3


def test_parts_that_are_whole_runs_say_nothing_however_much_these_differ() -> None:
    """Revolutions that stay as they are in each run: what iterations leave of them is no evidence."""
    s, by_run = system(), {"n": np.broadcast_to(np.arange(R) % 2, (K, R))}
    white = unsteady(np.minimum(WEATHER[0], 1), 0, 4.0, 6, 5)
    found = [steadiness_of(s, filtered(s), white[..., i, None], AT, by_run, WEATHER) for i in range(white.shape[3])]
    assert min(f.p_value for f in found) > 0.5


@pytest.mark.slow
def test_a_part_in_which_parameters_take_most_errors_is_no_steadier() -> None:
    s, rng = system(), np.random.default_rng(6)
    fast = np.concatenate([WAYS["fast"], WAYS["fast"][-1:]]) == 1
    J = np.where((s.good & fast[..., None])[..., None], rng.standard_normal((K + 1, R, 6, 900)), 0.0)
    flat, white = J.reshape(-1, 900), np.where(s.good, rng.standard_normal(s.good.shape), 0.0).ravel()
    left = white - flat @ np.linalg.solve(flat.T @ flat + np.eye(900), flat.T @ white)
    left = left.reshape(*s.good.shape, 1)
    assert steadiness(left[..., 0]).p_value < 1e-2
    fitted = np.concatenate([J, left], axis=3)
    assert steadiness_of(s, filtered(s), fitted, AT, WAYS, WEATHER).p_value > 0.02


def test_nothing_is_said_without_two_parts() -> None:
    s = system()
    white = residuals_of(s, s, 1, 4)[..., 0]
    alone = steadiness_of(s, filtered(s), white[..., None], AT, {"one part": WAYS["one part"]}, WEATHER)
    assert alone == ForceSteadiness(1.0, "", "") and alone.is_random


def test_a_system_of_one_run_is_tested_as_well() -> None:
    whole = system()
    by_window = (whole.good[:, :1], whole.inside[:, :1])
    one = LinearSystem(whole.T[:, :1], whole.Z[:, :1], whole.Q, whole.R, whole.first[:1], *by_window, whole.S)
    white = np.where(one.good, np.random.default_rng(0).standard_normal(one.good.shape), 0.0)
    ways = {"fast": WAYS["fast"][:, :1]}
    found = steadiness_of(one, filtered(one), white[..., None], AT, ways, [np.zeros((K, 1), dtype=int)])
    assert 0 < found.p_value <= 1


def test_what_is_found_is_said_unless_the_calibration_shows_it_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    case = replace(ready(), line=(1.0, 3.0))
    p = case.problem
    steady = force_steadiness(p.steps, p.data, case.null)
    assert steady.is_random and not_random(case, case.null) == []
    unsteady = ForceSteadiness(1e-5, "|r|", "yaw moment")
    monkeypatch.setattr("diagnosis.judgement.not_random.force_steadiness", lambda *_: unsteady)
    (message,) = not_random(case, case.null)
    assert message.code == "unsteady_force"
    assert not_random(replace(case, is_unsteady_usual=True), case.null) == []
