"""Do the logged velocities follow from the logged position and heading? Axes, lags, gains, lever arm.

The logged u, v, r are compared with the differentiated position (turned into body axes) and heading, both
smoothed alike (motion.py). Nothing here needs a ship model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cases.checks.axes import frame_misfits, heading_offset, lever_arm
from cases.checks.lags import Channel, aligned_track, compare, gain, velocity_lag
from cases.checks.motion import Motion, motion
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, Found
from cases.trial import Trial

LATE = 1.5
"""Lag [s] of a channel beyond which the verdict is no longer "ok"."""

GAIN = {"u": 0.06, "v": 0.1, "r": 0.075}
"""Deviation of a channel's gain from one beyond which the verdict is no longer "ok"."""

SOURCE = {"u": "the position", "v": "the position", "r": "the heading"}


def kinematics(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: frame hypotheses; lag, gain, correlation of u, v, r; heading offset, lever arm; sentences."""
    m = motion(trial)
    channels: dict[str, Channel] = {"r": compare(m.r, m.turn, m.dt)}
    names = ("frame_misfit", "velocity_lag", "lever_arm", "heading_offset_deg")
    numbers: dict[str, Any] = dict.fromkeys(names) | {"channels": channels}
    if np.isfinite(m.north).sum() <= 50:
        return numbers, _channel("r", channels["r"])
    numbers["frame_misfit"], wrong = frame_misfits(m)
    track = (m.north + 1j * m.east) * np.exp(-1j * m.psi)
    channels = {"u": compare(m.u, track.real, m.dt), "v": compare(m.v, track.imag, m.dt), **channels}
    numbers["channels"] = channels
    if wrong:
        return numbers, wrong + _channel("r", channels["r"])
    findings = _aligned(m, channels, numbers)
    return numbers, [found for name, channel in channels.items() for found in _channel(name, channel)] + findings


def _aligned(m: Motion, channels: dict[str, Channel], numbers: dict[str, Any]) -> list[Found]:
    """Gains of u and v, lever arm and heading offset once the lag of the velocities is taken out."""
    lag = numbers["velocity_lag"] = velocity_lag(m)
    aligned = aligned_track(m, lag)
    channels["u"]["gain"], channels["v"]["gain"] = gain(m.u, aligned.real), gain(m.v, aligned.imag)
    numbers["lever_arm"], findings = lever_arm(m, aligned)
    numbers["heading_offset_deg"], turned = heading_offset(m, aligned)
    seconds = lag[f"{lag['frame']}_s"]
    if seconds is not None and abs(seconds) > 0.2 and min(lag["earth_misfit"], lag["body_misfit"]) < 0.3:
        how = "turned by the present heading" if lag["frame"] == "earth" else "late as finished columns"
        word = "lag" if seconds > 0 else "lead"
        text = f"As a vector (u, v) {word} the track by {abs(seconds):.2f} s, {how}."
        findings.insert(0, (INFO, "velocity_lag", text))
    return findings + turned


def _channel(name: str, channel: Channel) -> list[Found]:
    """Sign, lag and gain of one channel against its source, where the correlation allows a statement."""
    lag, scale, correlation = channel["lag_s"], channel["gain"], channel["correlation"]
    if correlation is None:
        return []
    if correlation < -0.7:
        text = (
            f"{name} has the opposite sign of the derivative of {SOURCE[name]} "
            f"(correlation {correlation:.2f}); set sign = {{ {name} = -1 }} in trials.toml."
        )
        return [(CONTRADICTORY, f"{name}_sign", text)]
    if correlation < 0.9:
        return []
    findings = []
    if lag is not None and abs(lag) > 0.3:
        word = "lags" if lag > 0 else "leads"
        text = f"{name} {word} the derivative of {SOURCE[name]} by {abs(lag):.2f} s"
        level = DOUBTFUL if abs(lag) > LATE else INFO
        findings.append((level, "lag", f"{text} (correlation {correlation:.3f})."))
    if scale is None or abs(scale - 1) <= 0.005:
        return findings
    if abs(scale - 1) > GAIN[name]:
        hint = " (knots labelled m/s?)" if abs(scale - 1.944) < 0.1 else ""
        hint = " (m/s labelled kn?)" if abs(scale - 0.514) < 0.03 else hint
        hint = " (time in milliseconds labelled s?)" if abs(scale / 1000 - 1) < 0.1 else hint
        text = f"{name} is {scale:.3g} times the derivative of {SOURCE[name]}{hint}."
        findings.append((CONTRADICTORY if hint else DOUBTFUL, "unit" if hint else "gain", text))
    elif name == "r" or abs(scale - 1) > 0.03:
        word = "high" if scale > 1 else "low"
        kind = " (gyro scale)" if name == "r" else ""
        text = f"{name} reads {abs(scale - 1):.1%} {word} against {SOURCE[name]}{kind}."
        findings.append((INFO, "gain", text))
    return findings
