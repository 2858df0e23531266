"""The approach of a measured manoeuvre: its test speed, and what was not steady, not straight or not recorded of it."""

from __future__ import annotations

import math

import numpy as np

from cases.trial import Trial

STEADY_SPEED, STEADY_RATE = 0.05, 0.05
"""An approach is steady when its speed changes by less than 5 % and r L / U stays below 0.05."""

APPROACH_LENGTHS = 2.0
"""Ship lengths before the execute over which the test speed is taken."""

TURNING_RATE = 0.15
"""A record that begins at r L / U above this begins in a manoeuvre."""


def approach(trial: Trial, length: float, time: float, earliest: float) -> tuple[float, list[str], list[str]]:
    """Test speed [m/s] of a run of a ship of this ``length`` [m], ordered at ``time`` [s after the first sample].

    It is the mean over two ship lengths before the order. earliest: when what came before had ended [s]. Returns also
    what keeps a criterion from being judged, and what is only to be told, both in words. Speed is NaN where none is
    recorded. trial: the run.
    """
    t = trial.t - trial.t[0]
    speed, r = np.hypot(trial["u"], trial["v"]), trial["r"]
    good = np.isfinite(speed) & np.isfinite(r)
    if not good.any():
        return math.nan, ["no speed is recorded"], []
    near = good & (t <= time + 1e-9) & (t >= time - 5 * trial.dt - 1e-9)
    if not near.any():
        near = good & (t <= t[good][np.argmin(np.abs(t[good] - time))] + 1e-9)
    now = max(float(np.median(speed[near])), 1e-9)
    stretch = APPROACH_LENGTHS * length / now
    rows = good & (t <= time + 1e-9) & (t >= max(time - stretch, earliest))
    if rows.sum() < 3:
        return _unrecorded(now, float(np.median(r[near])) * length / now)
    mean, seconds = float(speed[rows].mean()), float(np.ptp(t[rows]))
    blocking, told = [], []
    if seconds < 0.5 * stretch:
        told.append(f"only {seconds:.3g} s of approach are recorded, two ship lengths take {stretch:.3g} s")
    if rows.sum() > 2 and seconds >= 0.1 * stretch:
        change = float(np.polyfit(t[rows], speed[rows], 1)[0]) * seconds / mean
        if abs(change) > STEADY_SPEED:
            words = f"approach not steady: the speed changes by {100 * change:+.0f} % in the last {seconds:.3g} s"
            blocking.append(words)
    turn = float(np.abs(r[rows]).mean()) * length / mean
    if turn > STEADY_RATE and seconds >= 0.1 * stretch:
        blocking.append(f"approach not straight: mean |r| L/V = {turn:.2g} in the last {seconds:.3g} s")
    return mean, blocking, told


def _unrecorded(speed: float, turn: float) -> tuple[float, list[str], list[str]]:
    """Of a run whose record begins with the order, at this ``speed`` [m/s] and dimensionless rate of ``turn``."""
    if abs(turn) > TURNING_RATE:
        words = f"the record begins in the manoeuvre, with r L/V = {turn:.2g}: lengths from the order are not known"
        return speed, [words], []
    words = f"no approach is recorded: V {speed:.4g} m/s is the first speed of the record"
    return speed, [], [words]
