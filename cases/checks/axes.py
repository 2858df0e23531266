"""By how much the track is turned from the logged velocities, and where its positions were measured."""

from __future__ import annotations

import math

import numpy as np

from cases.checks.motion import Motion
from cases.checks.report import INFO, Found

BLOCK = 10.0
"""s; differences are averaged over blocks this long before a slope and its standard error are taken."""


def heading_offset(m: Motion, aligned: np.ndarray) -> tuple[float | None, list[Found]]:
    """Angle [deg] by which the track of ``m`` is turned clockwise from its logged (u, v), given as ``aligned`` (N,).

    Returns it with a warning where it is more than 5 deg.
    """
    w = m.u + 1j * m.v
    good = np.isfinite(w) & np.isfinite(aligned)
    product = complex(np.vdot(w[good], aligned[good]))
    size = math.sqrt(float(np.sum(np.abs(w[good]) ** 2)) * float(np.sum(np.abs(aligned[good]) ** 2)))
    if good.sum() < 50 or size <= 0 or abs(product) < 0.7 * size:
        return None, []
    offset = math.degrees(math.atan2(product.imag, product.real))
    side = "clockwise" if offset > 0 else "counter-clockwise"
    text = f"The track is turned {abs(offset):.1f} deg {side} from heading and velocities: heading offset or axes?"
    return offset, [(INFO, "heading_offset", text)] if abs(offset) >= 5.0 else []


def lever_arm(m: Motion, aligned: np.ndarray) -> tuple[dict[str, float | None], list[Found]]:
    """Where the position was measured, from midship [m], with standard errors.

    The velocity of a point (l_x, l_y) is (u - r l_y, v + r l_x): the differences between track and logged
    velocities are regressed on the turning rate of the heading, through the origin, over 10 s blocks. In a
    steady turn a gain error of v, or a lag of arm / u seconds, looks much the same. None where the ship
    hardly turns. m: the motion; aligned: (N,) velocity of its track in body axes, complex [m/s]. Returns the numbers,
    and a sentence per axis along which the arm is at least 5 cm and four standard errors.
    """
    numbers: dict[str, float | None] = dict.fromkeys(("x_m", "x_std_m", "y_m", "y_std_m"))
    findings: list[Found] = []
    across, along = aligned.imag - m.v, m.u - aligned.real
    words = (("x", across, "forward of", "aft of"), ("y", along, "to starboard of", "to port of"))
    for axis, difference, ahead, behind in words:
        fit = _slope(m.turn, difference, max(round(BLOCK / m.dt), 5))
        if fit is None:
            continue
        arm, std = numbers[f"{axis}_m"], numbers[f"{axis}_std_m"] = fit
        if abs(arm) >= max(4 * std, 0.05):
            text = (
                f"The position fits a measured point {abs(arm):.2f} +- {std:.2f} m {ahead if arm > 0 else behind} "
                f"midship (lever arm; in trials.toml reference_point = {{ {axis} = {arm:.2f}, "
                'applies_to = "position" } moves it).'
            )
            findings.append((INFO, "lever_arm", text))
    return numbers, findings


def _slope(x: np.ndarray, y: np.ndarray, block: int) -> tuple[float, float] | None:
    """Slope of y on x through the origin and its standard error, from block means; None when undetermined."""
    count = len(x) // block
    good = np.isfinite(x) & np.isfinite(y)
    if count < 4 or good.sum() < 4 * block or float(np.sqrt(np.mean(x[good] ** 2))) < 1e-4:
        return None

    def blocks(values: np.ndarray) -> np.ndarray:
        return np.where(good, values, 0.0)[: count * block].reshape(count, block).sum(axis=1)

    weight = blocks(np.ones(len(x)))
    use = weight > block / 2
    if use.sum() < 4:
        return None
    mean_x, mean_y = blocks(x)[use] / weight[use], blocks(y)[use] / weight[use]
    power = float(mean_x @ mean_x)
    slope = float(mean_x @ mean_y) / power
    error = mean_y - slope * mean_x
    return slope, math.sqrt(float(error @ error) / (len(mean_x) - 1) / power)
