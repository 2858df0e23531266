"""From the frames and signs of a file to those of the product: sign, lag, velocity frame, reference point, wind."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cases.io.sidecar import SidecarEntry
from cases.quantities import wraps
from cases.trial import RUDDERS, unwrapped
from mmg.errors import OutOfRange
from mmg.messages import Message
from mmg.motion.frames import true_wind


def converted(columns: Mapping[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> dict[str, np.ndarray]:
    """Columns with the signs, frames and reference point of the product.

    columns: canonical name -> (N,) in SI and radians; entry: what the sidecar says of the file; notices: each step
    adds one. Order: signs, heading, lags, velocity frame, reference point, wind. Raises UserError where no row is left
    after the lags.
    """
    out = dict(columns)
    _turn_signs(out, entry, notices)
    if entry.heading_from == "east":
        out["psi"] = out["psi"] + math.pi / 2
        notices.append(Message("psi turned by 90 deg: the file counts it from east", "heading_from"))
    out = _in_time(out, entry, notices)
    if entry.velocity_frame == "earth":
        north, east, psi = out["u"], out["v"], out["psi"]
        out["u"] = north * np.cos(psi) + east * np.sin(psi)
        out["v"] = -north * np.sin(psi) + east * np.cos(psi)
        notices.append(Message("u, v turned from the earth frame into body axes by psi", "velocity_frame"))
    _move_to_midship(out, entry, notices)
    _wind(out, entry, notices)
    if not ("x" in out and "y" in out):
        text = "no position: the track, lags of u and v, and position scores are not available"
        notices.append(Message(text, "no_position"))
    return out


def _turn_signs(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    turned = [(name, " (sidecar)") for name, sign in entry.sign.items() if sign == -1]
    port = RUDDERS if entry.rudder_positive == "port" else ()
    for name, why in (*turned, *((name, ": positive to port in the file") for name in port)):
        if name in out:
            out[name] = -out[name]
            notices.append(Message(f"{name} changed sign{why}", "sign"))


def _in_time(columns: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> dict[str, np.ndarray]:
    """Columns that are late, taken back in time by straight lines between samples; rows that then lack one are cut."""
    lags = {name: seconds for name, seconds in entry.lag.items() if name in columns and seconds}
    if not lags:
        return columns
    t, out = columns["t"], dict(columns)
    keep = np.ones(len(t), bool)
    for name, seconds in lags.items():
        at = t + seconds
        keep &= (at >= t[0]) & (at <= t[-1])
        values = unwrapped(columns[name]) if wraps(name) else columns[name]
        good = np.isfinite(values)
        if good.any():
            near = np.interp(at, t, good.astype(float))
            out[name] = np.where(near > 0.999, np.interp(at, t[good], values[good]), np.nan)
        if wraps(name) and name != "psi":
            out[name] = np.remainder(out[name], 2 * math.pi)
        notices.append(Message(f"{name} taken back by {seconds:g} s (lag in trials.toml)", "lag"))
    if keep.sum() < 2:
        raise OutOfRange(
            f"lag in trials.toml: no row is left after {max(map(abs, lags.values())):g} s of {t[-1] - t[0]:g} s"
        )
    return {name: values[keep] for name, values in out.items()}


def _move_to_midship(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    """Positions and velocities of the measured point P = (l_x, l_y) taken to midship.

    x0 = x_P - l_x cos psi + l_y sin psi, y0 = y_P - l_x sin psi - l_y cos psi; u = u_P + l_y r, v = v_P - l_x r.
    """
    point = entry.reference_point
    l_x, l_y = point.x, point.y
    if l_x == 0.0 and l_y == 0.0:
        return
    if point.applies_to in ("position", "both") and "x" in out and "y" in out:
        c, s = np.cos(out["psi"]), np.sin(out["psi"])
        out["x"] = out["x"] - l_x * c + l_y * s
        out["y"] = out["y"] - l_x * s - l_y * c
        notices.append(Message(f"positions taken from ({l_x:g}, {l_y:g}) m to midship", "reference_point"))
    if point.applies_to in ("velocity", "both"):
        out["u"] = out["u"] + l_y * out["r"]
        out["v"] = out["v"] - l_x * out["r"]
        notices.append(Message(f"velocities taken from ({l_x:g}, {l_y:g}) m to midship", "reference_point"))


def _wind(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    """Directions turned to *coming from*; true wind derived where only the apparent one is given."""
    if entry.wind_direction == "to":
        for name in ("wind_direction", "apparent_wind_direction"):
            if name in out:
                out[name] = (out[name] + math.pi) % (2 * math.pi)
                text = f"{name} turned by 180 deg: the file says where the wind goes to"
                notices.append(Message(text, "wind_direction"))
    for pair in (("wind_speed", "wind_direction"), ("apparent_wind_speed", "apparent_wind_direction")):
        present = [name for name in pair if name in out]
        if len(present) == 1:
            del out[present[0]]
            text = f"{present[0]} left out: of {pair[0]} and {pair[1]} the file has only one"
            notices.append(Message(text, "wind_incomplete"))
    if "wind_speed" in out:
        return
    if "apparent_wind_speed" in out:
        out["wind_speed"], out["wind_direction"] = true_wind(
            out["apparent_wind_speed"], out["apparent_wind_direction"], out["psi"], out["u"], out["v"]
        )
        notices.append(Message("true wind derived from the apparent wind, u, v and psi", "true_wind_derived"))
    else:
        notices.append(Message("no wind: wind forces cannot be modelled and are taken as zero", "no_wind"))
