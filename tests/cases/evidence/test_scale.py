"""Gains are found to the error of the data, whatever these err by, and are not where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from cases.checks import check
from cases.criteria.standard_runs import simulated_trial
from cases.evidence.scale import TRACK, TURN, scale
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial

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
    assert [[f.code for f in r.findings if f.level == "doubtful" and f.code == "gain"] for r in check(files)] == [
        [],
        [],
        [],
        ["gain"],
    ]
