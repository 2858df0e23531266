"""A lag is told by the motion, and not by what moving a noisy record does to its noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.criteria.standard_runs import simulated_trial
from cases.evidence.shifts import LAGS, candidates, nats, nats_of_lags, shifts
from cases.evidence.signals import Signals, signals, white_noise
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial

EVERY, NOISE = 20, 0.9
"""Rows of 0.1 s between two that are logged, and error of the positions [m]: of a tanker of 320 m."""


def record(place: np.ndarray) -> Signals:
    count = len(place)
    zero = np.zeros(count)
    return Signals(2.0, place, zero, zero + 0j, zero, np.ones(count, dtype=bool))


@pytest.mark.parametrize("rows", [0.5, -0.3, 7.25])
def test_moving_a_record_moves_what_is_smooth_and_keeps_the_size_of_noise(rows: float) -> None:
    k = np.arange(400)

    def way(at: np.ndarray) -> np.ndarray:
        return 3.0 * at + 40.0 * np.exp(2j * np.pi * at / 90.0)

    inner = slice(20, -20)
    smooth = record(way(k)).shifted(2.0 * rows, "place")
    np.testing.assert_allclose(smooth.place[inner], way(k + rows)[inner], atol=0.02)
    assert smooth.good.sum() == len(k) - np.ceil(abs(rows))
    noise = np.random.default_rng(1).normal(size=(len(k), 2)) @ [1.0, 1j]
    moved = record(noise).shifted(2.0 * rows, "place").place
    assert np.std(moved[inner]) == pytest.approx(np.std(noise[inner]), rel=0.03)


def test_moving_by_nothing_changes_nothing() -> None:
    place = np.random.default_rng(2).normal(size=101) + 1j
    np.testing.assert_allclose(record(place).shifted(0.0, "place").place, place, atol=1e-12)


@cache
def coarse_trials(count: int = 2) -> list[Trial]:
    ship, found = load_ship("kvlcc2_full"), []
    for k, words in enumerate(("zigzag:20/20", "turning:35")[:count]):
        run, rng = simulated_trial(ship, words, None, None, False, k), np.random.default_rng(k)
        thin = {name: values[::EVERY].copy() for name, values in run.columns.items()}
        for name in ("x", "y"):
            thin[name] += rng.normal(scale=NOISE, size=len(thin[name]))
        found.append(replace(run, columns=thin, name=f"coarse_{k}"))
    return found


def test_noisy_positions_of_a_slow_ship_are_not_late_and_late_ones_are() -> None:
    """With straight lines between rows these positions were 1 to 2 s late, whatever the truth."""
    trials = coarse_trials()
    known = [s for t in trials if (s := signals(t)) is not None]
    assert len(known) == len(trials)
    assert shifts(candidates(known, 40.0)) == [None] * len(trials)
    late = [s.shifted(-12.0, "place") for s in known]
    found = [shift for shift in shifts(candidates(late, 40.0)) if shift is not None]
    assert len(found) == len(trials) and {shift.name for shift in found} == {"place"}
    assert [float(np.real(shift.value)) for shift in found] == pytest.approx([12.0] * len(trials), abs=1.5)


@pytest.mark.parametrize("name", LAGS)
def test_many_lags_at_once_are_worth_what_each_alone_is(name: str) -> None:
    lags = np.array([-30.0, -1.0, 0.0, 2.5, 30.0])
    for trial in coarse_trials(1):
        s = signals(trial)
        assert s is not None
        together, late = nats_of_lags(s, name, lags), [s.shifted(float(lag), *LAGS[name]) for lag in lags]
        assert together[2] == pytest.approx(0.0, abs=1e-6)
        plain = [nats(replace(s, good=one.good)) for one in late]
        np.testing.assert_allclose(together, np.array([nats(one) for one in late]) - plain, atol=0.02)
        assert np.ptp(together) > 1.0


def test_the_noise_on_a_slow_motion_is_recovered_and_unmeasured_columns_have_none() -> None:
    rng, t = np.random.default_rng(0), np.arange(4000) * 0.1
    sizes = np.array([0.01, 0.02, 0.003, 0.004, 0.005, 0.0006])
    states = np.sin(0.05 * t)[:, None] + sizes * rng.standard_normal((len(t), 6))
    np.testing.assert_allclose(white_noise([states[:2000], states[2000:], states[:2]]), sizes, rtol=0.1)
    states[:, :2] = np.nan
    assert white_noise([states]).tolist() == [0.0] * 6
    noise = white_noise([states], slice(2, None))
    assert noise[:2].tolist() == [0.0, 0.0] and noise[5] == pytest.approx(sizes[5], rel=0.1)
