"""From the frames and signs of a file to those of the house: sign, velocity frame, reference point, wind."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cases.io.sidecar import Settings
from mmg.errors import UserError
from mmg.motion.frames import true_wind

RUDDERS = ("delta", "delta_port", "delta_starboard")


def converted(columns: Mapping[str, np.ndarray], settings: Settings, notices: list[str]) -> dict[str, np.ndarray]:
    """Columns with the signs, frames and reference point of the house; each step adds a notice.

    columns: canonical name -> (N,) in house units. Order: signs, velocity frame, reference point, wind.
    Raises UserError when a sign is given for a column that the file lacks.
    """
    out = dict(columns)
    _turn_signs(out, settings, notices)
    if settings.velocity_frame == "earth":
        north, east, psi = out["u"], out["v"], out["psi"]
        out["u"] = north * np.cos(psi) + east * np.sin(psi)
        out["v"] = -north * np.sin(psi) + east * np.cos(psi)
        notices.append("u, v turned from the earth frame into body axes by psi")
    _move_to_midship(out, settings, notices)
    _wind(out, settings, notices)
    if not ("x" in out and "y" in out):
        notices.append("no position: the track, lags of u and v, and position scores are not available")
    return out


def _turn_signs(out: dict[str, np.ndarray], settings: Settings, notices: list[str]) -> None:
    for name, sign in settings.sign.items():
        if name not in out:
            raise UserError(f"{settings.source}: sign.{name}: the file has no column {name}")
        if sign == -1:
            out[name] = -out[name]
            notices.append(f"{name} changed sign ({settings.source})")
    if settings.rudder_positive == "port":
        for name in RUDDERS:
            if name in out:
                out[name] = -out[name]
                notices.append(f"{name} changed sign: positive to port in the file")


def _move_to_midship(out: dict[str, np.ndarray], settings: Settings, notices: list[str]) -> None:
    """Positions and velocities of the measured point P = (l_x, l_y) taken to midship.

    x0 = x_P - l_x cos psi + l_y sin psi, y0 = y_P - l_x sin psi - l_y cos psi;
    u = u_P + l_y r, v = v_P - l_x r.
    """
    l_x, l_y = settings.reference_point
    if l_x == 0.0 and l_y == 0.0:
        return
    if settings.applies_to in ("position", "both") and "x" in out and "y" in out:
        c, s = np.cos(out["psi"]), np.sin(out["psi"])
        out["x"] = out["x"] - l_x * c + l_y * s
        out["y"] = out["y"] - l_x * s - l_y * c
        notices.append(f"positions taken from ({l_x:g}, {l_y:g}) m to midship")
    if settings.applies_to in ("velocity", "both"):
        out["u"] = out["u"] + l_y * out["r"]
        out["v"] = out["v"] - l_x * out["r"]
        notices.append(f"velocities taken from ({l_x:g}, {l_y:g}) m to midship")


def _wind(out: dict[str, np.ndarray], settings: Settings, notices: list[str]) -> None:
    """Directions turned to *coming from*; true wind derived where only the apparent one is given."""
    if settings.wind_direction == "to":
        for name in ("wind_direction", "apparent_wind_direction"):
            if name in out:
                out[name] = (out[name] + math.pi) % (2 * math.pi)
                notices.append(f"{name} turned by 180 deg: the file says where the wind goes to")
    for pair in (("wind_speed", "wind_direction"), ("apparent_wind_speed", "apparent_wind_direction")):
        present = [name for name in pair if name in out]
        if len(present) == 1:
            del out[present[0]]
            notices.append(f"{present[0]} left out: of {pair[0]} and {pair[1]} the file has only one")
    if "wind_speed" in out:
        return
    if "apparent_wind_speed" in out:
        out["wind_speed"], out["wind_direction"] = true_wind(
            out["apparent_wind_speed"], out["apparent_wind_direction"], out["psi"], out["u"], out["v"]
        )
        notices.append("true wind derived from the apparent wind, u, v and psi")
    else:
        notices.append("no wind: wind forces cannot be modelled and are taken as zero")
