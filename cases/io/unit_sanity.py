"""Units that the numbers themselves refute: degrees passed off as radians, and the like.

Only contradictions are reported, never guesses: a heading is compared with the integral of the yaw rate, and a
steady one with the track, a rudder angle with the largest one a rudder can take.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cases.inputs import integral
from cases.quantities import REVOLUTIONS_LIMIT, RUDDER_LIMIT, SPIN_LIMIT, UNITS, wraps
from cases.trial import RUDDERS

DEG = math.pi / 180.0

STEADIER = 0.2
"""Difference of the steadiness of wind, length of its mean over its mean length, that tells one unit from another."""

_DIRECTIONS = tuple(name for name in UNITS if wraps(name) and "wind" in name)

_CAUSES = {
    (DEG, 1.0): "psi holds degrees but is labelled rad (or r holds rad/s but is labelled deg/s)",
    (1.0, DEG): "r holds deg/s but is labelled rad/s (or psi holds radians but is labelled deg)",
}


def implausible(columns: Mapping[str, np.ndarray]) -> str:
    """One sentence about the first contradiction between the units of the columns, "" when there is none.

    columns: canonical name -> (N,) in house units; needs t, psi, r; uses x, y, u, v, n, rudders and wind if present.
    """
    if wrong := mislabelled(columns):
        return wrong[0][2]
    tests = (_full_turn_jumps, _heading_and_rate, _heading_and_course, _spin)
    return next(filter(None, (test(columns) for test in tests)), "")


def _steadier_in_radians(columns: Mapping[str, np.ndarray], name: str) -> bool:
    """Whether the wind over ground is steadier where the direction ``name`` holds radians, which may go on beyond a
    turn as the ship turns, than where it holds degrees."""
    speed = columns.get(name.replace("direction", "speed"), np.ones(len(columns[name])))
    steady = []
    for unit in (1.0, DEG):
        air = -speed * np.exp(1j * columns[name] * unit)
        if name.startswith("apparent") and {"psi", "u", "v"} <= set(columns):
            air = (air + columns["u"] + 1j * columns["v"]) * np.exp(1j * columns["psi"])
        air = air[np.isfinite(air)]
        steady.append(abs(air.mean()) / max(float(np.abs(air).mean()), 1e-12) if len(air) else 0.0)
    return steady[0] > steady[1] + STEADIER


def _full_turn_jumps(columns: Mapping[str, np.ndarray]) -> str:
    """A heading that jumps back by 360 from one sample to the next is wrapped, and counted in degrees."""
    psi = columns["psi"][np.isfinite(columns["psi"])]
    step = np.abs(np.diff(psi))
    jumps = int(np.sum(np.abs(step - 360.0) < 20.0))
    if jumps and jumps == int(np.sum(step > 20.0)):
        return f"psi holds degrees but is labelled rad: it jumps by 360 {jumps} time(s); correct the unit"
    return ""


def _heading_and_rate(columns: Mapping[str, np.ndarray]) -> str:
    """Change of heading over some seconds against the integral of r over the same seconds, of either sign."""
    t, psi, r = columns["t"], columns["psi"], columns["r"]
    good = np.isfinite(psi) & np.isfinite(r)
    t, psi, turned = t[good], psi[good], integral(t[good], r[good])
    for lag in (20, 50, 100) if len(t) >= 20 else ():
        lag = max(1, min(lag, len(t) // 10))
        usable = (t[lag:] - t[:-lag]) < 3 * lag * np.median(np.diff(t))
        turn, misfit = (turned[lag:] - turned[:-lag])[usable], {}
        for units in ((1.0, 1.0), *_CAUSES):
            heading, other = np.unwrap(psi * units[0]), turn * units[1]
            change = (heading[lag:] - heading[:-lag])[usable]
            size = math.sqrt(float(np.mean(change**2) + np.mean(other**2)))
            rms = min(math.sqrt(float(np.mean(error**2))) for error in (change - other, change + other))
            misfit[units] = rms / size if size > 1e-9 else 0.0
        best = min(misfit, key=lambda units: misfit[units])
        if misfit[1.0, 1.0] >= 0.9 and misfit[best] <= 0.4:
            return f"{_CAUSES[best]}; correct the unit"
    return ""


def _heading_and_course(columns: Mapping[str, np.ndarray]) -> str:
    """Displacement over some seconds against (u, v) turned by a steady heading, read as radians and as degrees."""
    if not {"x", "y", "u", "v"} <= set(columns):
        return ""
    t, psi = columns["t"], columns["psi"]
    body, place = columns["u"] + 1j * columns["v"], columns["x"] + 1j * columns["y"]
    good = np.isfinite(psi) & np.isfinite(body) & np.isfinite(place)
    t, psi, body, place = t[good], psi[good], body[good], place[good]
    if len(t) < 20 or np.abs(psi).max() < 2 * math.pi + 0.1:
        return ""
    lag, misfit = max(1, min(20, len(t) // 10)), []
    moved = place[lag:] - place[:-lag]
    for unit in (1.0, DEG):
        way = integral(t, body * np.exp(1j * psi * unit))
        misfit.append(float(np.linalg.norm(moved - way[lag:] + way[:-lag])) / max(float(np.linalg.norm(moved)), 1e-12))
    if misfit[1] < 0.35 and misfit[0] > max(0.3, 4 * misfit[1]):
        return (
            "psi holds degrees but is labelled rad: (u, v) turned by psi misses the track by "
            f"{misfit[0]:.0%} as radians and by {misfit[1]:.0%} as degrees (correct the unit)"
        )
    return ""


def _spin(columns: Mapping[str, np.ndarray]) -> str:
    """A yaw rate that no ship has."""
    r = columns["r"]
    if np.isfinite(r).any() and (typical := float(np.nanpercentile(np.abs(r), 75))) > SPIN_LIMIT:
        return (
            f"r is above {typical:.3g} rad/s a quarter of the time: are these deg/s labelled rad/s? (correct the unit)"
        )
    return ""


def mislabelled(columns: Mapping[str, np.ndarray]) -> list[tuple[str, float, str]]:
    """(column, factor that makes it true, sentence) of revolutions, rudders and wind directions in a unit that no ship
    allows; columns: as ``implausible`` takes them."""
    found = []
    for name in (name for name in ("n", "n_2", *RUDDERS, *_DIRECTIONS) if name in columns):
        size = np.abs(columns[name])
        if not np.isfinite(size).any():
            continue
        largest, typical = float(np.nanmax(size)), float(np.nanpercentile(size, 90))
        if name in ("n", "n_2"):
            usual = float(np.nanpercentile(size, 75))
            if usual > REVOLUTIONS_LIMIT:
                words = f"{name} is {usual:.4g} rps a quarter of the time: are these rpm labelled rps?"
                found.append((name, 1 / 60, f"{words} (label the column '{name} [rpm]')"))
        elif (name in RUDDERS and largest > RUDDER_LIMIT) or (
            name in _DIRECTIONS and typical > 4 * math.pi and not _steadier_in_radians(columns, name)
        ):
            words = f"{name} reaches {largest:.4g} rad: are these degrees labelled rad?"
            found.append((name, DEG, f"{words} (label the column '{name} [deg]')"))
    return found
