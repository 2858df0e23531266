"""Do the logged velocities follow from the logged position and heading? Axes, lags, gains, lever arm.

The logged u, v, r are compared with the differentiated position (turned into body axes) and heading, both
smoothed alike (motion.py). Nothing here needs a ship model.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cases.checks.axes import heading_offset, lever_arm
from cases.checks.lags import Channel, aligned_track, compare, gain, velocity_lag
from cases.checks.motion import Motion, motion
from cases.checks.report import INFO, Found
from cases.trial import Trial

SOURCE = {"u": "the position", "v": "the position", "r": "the heading"}


def kinematics(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """Of a ``trial``: frame hypotheses; lag, gain, correlation of u, v, r; heading offset, lever arm; sentences."""
    m = motion(trial)
    channels: dict[str, Channel] = {"r": compare(m.r, m.turn, m.dt)}
    names = ("frame_misfit", "velocity_lag", "lever_arm", "heading_offset_deg")
    numbers: dict[str, Any] = dict.fromkeys(names) | {"channels": channels}
    if np.isfinite(m.north).sum() <= 50:
        return numbers, _channel("r", channels["r"])
    track = (m.north + 1j * m.east) * np.exp(-1j * m.psi)
    channels = {"u": compare(m.u, track.real, m.dt), "v": compare(m.v, track.imag, m.dt), **channels}
    numbers["channels"] = channels
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
    """Lag and gain of one channel against its source, where the correlation allows a statement."""
    lag, scale, correlation = channel["lag_s"], channel["gain"], channel["correlation"]
    if correlation is None:
        return []
    if correlation < 0.9:
        return []
    findings = []
    if lag is not None and abs(lag) > 0.3:
        word = "lags" if lag > 0 else "leads"
        text = f"{name} {word} the derivative of {SOURCE[name]} by {abs(lag):.2f} s"
        findings.append((INFO, "lag", f"{text} (correlation {correlation:.3f})."))
    if scale is None or abs(scale - 1) <= 0.005:
        return findings
    if name == "r" or abs(scale - 1) > 0.03:
        word = "high" if scale > 1 else "low"
        kind = " (gyro scale)" if name == "r" else ""
        text = f"{name} reads {abs(scale - 1):.1%} {word} against {SOURCE[name]}{kind}."
        findings.append((INFO, "gain", text))
    return findings
