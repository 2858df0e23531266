"""A rounded column that stands still in a steady stretch is not frozen: more than its resolution must be missing."""

from __future__ import annotations

import numpy as np
import pytest

from cases.checks.stretches import broken_stretches
from cases.trial import Trial
from mmg_ident import simulate

DEG = np.pi / 180.0
COARSE = {"psi": 0.1 * DEG, "r": 0.05 * DEG, "u": 0.05, "v": 0.05, "x": 0.1, "y": 0.1, "delta": 0.5 * DEG}


def steady_after_weaving(resolution: dict[str, float], stuck: tuple[str, ...] = ()) -> Trial:
    """A ship of 7 m/s that weaves for 150 s and runs straight on with a wander of a tenth of a degree, at 2 Hz.

    resolution: column -> what it is rounded to; stuck: columns that keep one value from 30 to 45 s.
    """
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 400.0, 0.5)
    weave = np.where(t < 150, np.sin(2 * np.pi * t / 75), 0.0)
    psi = (8.0 * weave + 0.08 * np.sin(t / 9) + 0.06 * np.sin(t / 4 + 1)) * DEG
    r = np.gradient(psi, t)
    u, v = 7.0 - 0.4 * weave**2 + 0.01 * np.sin(t / 11), -20.0 * r
    w = (u + 1j * v) * np.exp(1j * psi)
    place = np.concatenate([[0.0], np.cumsum(0.25 * (w[1:] + w[:-1]))])
    exact = {"x": place.real, "y": place.imag, "psi": psi, "u": u, "v": v, "r": r, "n": 2.0 + 0 * t}
    sizes = {"x": 0.02, "y": 0.02, "psi": 0.01 * DEG, "u": 0.005, "v": 0.005, "r": 0.01 * DEG, "n": 0.0}
    columns = {name: values + sizes[name] * rng.standard_normal(len(t)) for name, values in exact.items()}
    columns |= {"t": t, "delta": -10.0 * DEG * weave}
    for name, step in resolution.items():
        columns[name] = np.round(columns[name] / step) * step
    for name in stuck:
        columns[name][60:90] = columns[name][60]
    return Trial("steady", columns)


@pytest.mark.parametrize(
    "resolution",
    [
        {"psi": 0.5 * DEG},
        {"psi": 1.0 * DEG},
        {"u": 0.05, "v": 0.05},
        {"u": 0.1, "v": 0.1},
        {"x": 1.0, "y": 1.0},
        COARSE,
    ],
    ids=["psi 0.5 deg", "psi 1 deg", "u, v 0.1 kn", "u, v 0.1 m/s", "x, y 1 m", "all"],
)
def test_a_rounded_column_that_stands_still_in_a_steady_stretch_is_sound(resolution: dict[str, float]) -> None:
    assert broken_stretches(steady_after_weaving(resolution)) == []


@pytest.mark.parametrize("bias", [0.002, 0.02])
def test_a_heading_of_a_tenth_of_a_degree_on_a_straight_run_is_sound_beside_a_gyro_with_a_bias(bias: float) -> None:
    whole = steady_after_weaving({"psi": 0.1 * DEG})
    t = whole.t
    assert broken_stretches(whole.with_columns(r=whole["r"] + bias * DEG)) == []
    straight = Trial("straight", {name: values[t > 160] for name, values in whole.columns.items()})
    assert broken_stretches(straight.with_columns(r=straight["r"] + bias * DEG)) == []


@pytest.mark.parametrize(("ship", "dt"), [("mariner", 1.0), ("kvlcc2_full", 0.2)])
def test_a_heading_that_stands_still_is_sound_beside_a_gyro_with_noise(ship: str, dt: float) -> None:
    trial = simulate(ship, "zigzag:2/2", dt=dt, duration=900, seed=3)
    noise = 0.05 * DEG * np.random.default_rng(1).standard_normal(len(trial))
    psi = np.round(trial["psi"] / (0.1 * DEG)) * 0.1 * DEG
    assert broken_stretches(trial.with_columns(psi=psi, r=trial["r"] + noise)) == []


def test_a_ship_that_comes_round_again_repeats_nothing() -> None:
    """Rows of a steady circle whose period is a number of samples are equal to the last digit that is logged."""
    t = np.arange(0.0, 900.0)
    psi = 2 * np.pi * t / 150.0
    way = 5.0 * 150.0 / (2 * np.pi) * np.exp(1j * (psi - np.pi / 2))
    still = np.zeros(len(t))
    columns = {
        "x": way.real,
        "y": way.imag,
        "psi": np.mod(psi, 2 * np.pi),
        "u": still + 5.0,
        "v": still,
        "r": still + psi[1],
    }
    rounded = {name: np.round(values, 3) for name, values in columns.items()}
    assert broken_stretches(Trial("circle", {"t": t, **rounded, "n": still + 2.0, "delta": still + 0.3})) == []


@pytest.mark.parametrize("stuck", [("psi",), ("r",), ("x", "y")], ids=", ".join)
def test_a_rounded_column_that_stands_still_while_the_ship_weaves_is_broken(stuck: tuple[str, ...]) -> None:
    (found,) = broken_stretches(steady_after_weaving(COARSE, stuck))
    assert abs(found.begin_s - 30.0) <= 3.0 and abs(found.end_s - 45.0) <= 3.0
