"""A lag is told by the motion, and not by what moving a noisy record does to its noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from cases.checks import check
from cases.criteria.standard_runs import simulated_trial
from cases.evidence import tails
from cases.evidence.shifts import LAGS, TRACK, TURN, candidates, nats, nats_of_lags, scale, shifts
from cases.evidence.signals import Signals, signals, white_noise
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.hypotheses import events

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


@pytest.mark.slow
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


SHIP = load_ship("kvlcc2_full")


def straight(seed: int, gain: float, seconds: float = 100.0) -> Trial:
    """A straight run of 3 m/s at 2 Hz with satellite positions, whose u and v are ``gain`` times the true ones."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.5)
    still = np.zeros(len(t))
    psi = 0.7 + 0.001 * rng.standard_normal(len(t))
    place = 3.0 * t * np.exp(0.7j) + rng.normal(scale=0.05, size=(len(t), 2)) @ [1.0, 1j]
    u, v = (gain * (true + 0.01 * rng.standard_normal(len(t))) for true in (3.0, 0.0))
    columns = {"t": t, "x": place.real, "y": place.imag, "psi": psi, "u": u, "v": v, "r": still, "n": still + 1.0}
    return Trial("straight", {**columns, "delta": still})


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.98, 1.0, 1.03])
def test_a_gain_shows_in_100_s_of_straight_track(gain: float) -> None:
    for seed in range(4):
        (report,) = check([straight(seed, gain)])
        found = report.numbers["kinematics"]["gain"]["u"]
        assert found == pytest.approx(gain, abs=0.003)
        assert [f.level for f in report.findings if f.code == "gain"] == (["doubtful"] if gain != 1.0 else [])


def test_a_receiver_that_repeats_and_skips_fixes_hides_no_gain() -> None:
    """Fixes of 0.5 Hz on a clock of 2 Hz: of a third of the seconds the way is half or twice as long."""
    trial = straight(1, 1 / 1.0204, 600.0)
    rng, t = np.random.default_rng(2), trial.t
    place, fixes = 3.0 * t * np.exp(0.7j), np.arange(0, len(t), 4)
    shown = np.interp(t, t[fixes] + 1.0 * (rng.random(len(fixes)) < 0.3), place[fixes].real)
    shown = shown + 1j * shown * np.tan(0.7)
    found = scale([trial.with_columns(x=shown.real, y=shown.imag)], TRACK[:6])
    assert found is not None and found.matters("u")
    assert found.values["u"] == pytest.approx(0.0204, abs=4 * found.std["u"]) and found.std["u"] < 0.004


def test_noise_of_a_column_is_no_gain_of_it() -> None:
    """A straight run has no sway and no turn but noise, which no regression may take for a small gain."""
    for seed in range(3):
        trial = simulated_trial(SHIP, parse_maneuver("straight", SHIP, duration=900), None, None, True, seed, 1.0)
        for names in (TRACK[:6], TURN):
            found = scale([trial], names)
            assert found is None or not any(found.matters(name) for name in names if name in "uvr")


def test_a_current_against_a_log_is_told_from_its_gain_by_legs_both_ways() -> None:
    out, back = straight(1, 1.0, 300.0), straight(2, 1.0, 300.0)
    back = back.with_columns(psi=back["psi"] + np.pi, x=-back["x"], y=-back["y"])
    set_by = 0.2
    both = [trial.with_columns(x=trial["x"] + set_by * trial.t) for trial in (out, back)]
    one, two = scale(both[:1], TRACK[:6]), scale(both, TRACK)
    assert one is not None and two is not None
    assert one.matters("u") and not two.significant("u")
    assert two.values["drift_x"] == pytest.approx(set_by, abs=0.01)


def test_a_gain_of_one_file_is_said_of_that_file_alone() -> None:
    files = [straight(seed, 0.97 if seed == 3 else 1.0) for seed in range(4)]
    doubts = [[f.code for f in r.findings if f.level == "doubtful" and f.code == "gain"] for r in check(files)]
    assert doubts == [[], [], [], ["gain"]]


def test_tails_and_quantiles_are_those_of_scipy() -> None:
    for value in (-1.0, 0.0, 0.3, 4.0, 60.0):
        assert tails.normal_tail(value) == pytest.approx(stats.norm.sf(value), rel=1e-12)
        assert tails.chi2_tail(value, 3) == pytest.approx(stats.chi2.sf(value, 3), rel=1e-12)
        assert tails.f_tail(value, 3, 17) == pytest.approx(stats.f.sf(value, 3, 17), rel=1e-9)
        assert tails.gamma_tail(value, 1.7, 2.0) == pytest.approx(stats.gamma.sf(value, 1.7, scale=2.0), rel=1e-12)
    for probability in (1e-300, 0.01, 0.5, 0.9):
        assert tails.student_quantile(probability, 5) == pytest.approx(stats.t.ppf(probability, 5), rel=1e-9)
    assert pytest.approx(stats.chi2.median(1), rel=1e-12) == events.MEDIAN
