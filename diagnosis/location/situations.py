"""What the ship did at every step of the trials: variables with bins, and phases of a manoeuvre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS
from mmg.motion.frames import relative_air

STEADY, CHANGING = "steady turning", "entering a turn / yaw changing"
STRAIGHT, ACCELERATING = "straight ahead", "accelerating"
STOPPING, SLOW = "stopping / astern (n<0)", "drifting slow"
PHASES = (STRAIGHT, ACCELERATING, CHANGING, STEADY, STOPPING, SLOW)
SLOW_SHARE, ASTERN_SHARE = 0.25, 0.05
"""Shares of the usual speed of the trials: below the first a ship is slow; faster astern than the second, it backs."""
TURNING, TURN_CHANGE, SPEED_CHANGE = 0.1, 0.1, 0.03
"""r L/U, r' (L/U)^2 and u' L/U^2 from which a ship turns, changes its turn, changes its speed."""
FEW = 12
"""An input with no more different values than this has a bin for each of them."""


@dataclass(frozen=True)
class Variable:
    """A variable that a force may depend on.

    values: (M,) by sample; edges: (B + 1,) of its bins, rising; signed: port and starboard.
    """

    name: str
    unit: str
    values: np.ndarray
    edges: np.ndarray
    signed: bool = False


def quantile_edges(values: np.ndarray, bins: int = 6) -> np.ndarray:
    """Edges (B + 1,) of at most ``bins`` bins with about equally many of ``values`` (M,), the last a little above."""
    different = np.unique(values)
    if len(different) <= FEW:
        middles = 0.5 * (different[1:] + different[:-1])
        ends = np.array([different[0], different[-1] + 1e-9 * max(1.0, abs(different[-1]))])
        return np.concatenate([ends[:1], middles, ends[1:]])
    edges = np.unique(np.quantile(values, np.linspace(0, 1, bins + 1)))
    edges[-1] += 1e-9 * max(1.0, abs(edges[-1]))
    return edges


def signed_edges(values: np.ndarray) -> np.ndarray:
    """Edges (B + 1,) by quantiles of negative and positive ``values`` (M,), one of them 0: port and starboard apart."""
    halves = [quantile_edges(part, 3) for part in (values[values < 0], values[values >= 0]) if len(part)]
    if len(halves) < 2 or len(np.unique(values)) <= FEW:
        return quantile_edges(values)
    return np.concatenate([halves[0][:-1], [0.0], halves[1][1:]])


SECTORS = np.linspace(-np.pi / 8, 2 * np.pi - np.pi / 8, 9)
"""Edges [rad] of eight equal sectors of the circle, the first centred at 0."""


def in_sectors(values: np.ndarray) -> np.ndarray:
    """``values`` (M,) [rad] turned by whole circles into the range of SECTORS."""
    return np.mod(values - SECTORS[0], 2 * np.pi) + SECTORS[0]


def variables_of(names: Sequence[str], data: GriddedTrials, z: np.ndarray) -> list[Variable]:
    """All variables that vary over the samples of ``data``, wind only where it was logged.

    names: of the model's inputs; z: (K + 1, R, S) states.
    """
    inside = data.inside
    middle = 0.5 * (z[:-1] + z[1:])[inside]
    x, y, psi, u, v, r = middle[:, :6].T
    inputs = {name: data.inputs[..., i][inside] for i, name in enumerate(names)}
    found = [
        Variable("u", "m/s", u, quantile_edges(u)),
        Variable("v", "m/s", v, signed_edges(v), signed=True),
        Variable("r", "rad/s", r, signed_edges(r), signed=True),
    ]
    for name in (n for n in INPUTS if n in inputs):
        values = inputs[name]
        signed = name in RUDDERS or (INPUTS[name][1] == "rps" and bool((values < 0).any()))
        edges = signed_edges(values) if signed else quantile_edges(values)
        found.append(Variable(name, INPUTS[name][1], values, edges, signed=signed))
        if name in RUDDERS:
            rate = (np.gradient(data.inputs[..., names.index(name)], data.h, axis=0))[inside]
            edges = np.abs(rate).max() * np.array([-1.0001, -0.1, 0.1, 1.0001])  # to port, at rest, to starboard
            found.append(Variable(f"rate of {name}", "rad/s", rate, edges, signed=True))
    if any(np.any(inputs.get(name, 0.0)) for name in ("wind_north", "wind_east")):
        a_x, a_y = relative_air(inputs["wind_north"], inputs["wind_east"], psi, u, v)
        speed, angle = np.hypot(a_x, a_y), in_sectors(np.arctan2(-a_y, -a_x))
        found.append(Variable("apparent wind speed", "m/s", speed, quantile_edges(speed)))
        found.append(Variable("apparent wind angle", "rad", angle, SECTORS))
    found.append(Variable("heading", "rad", in_sectors(psi), SECTORS))
    found.append(Variable("x, north", "m", x, quantile_edges(x, 4)))
    found.append(Variable("y, east", "m", y, quantile_edges(y, 4)))
    clock = data.t[:-1][inside]
    found.append(Variable("time since the start", "s", clock, quantile_edges(clock, 4)))
    return [f for f in found if len(f.edges) > 2 and np.ptp(f.values) > 1e-6 * np.abs(f.values).max()]


def phases(names: Sequence[str], data: GriddedTrials, z: np.ndarray, length: float) -> np.ndarray:
    """Phase (M,) of every sample of ``data``, as a position in PHASES.

    names: of the model's inputs; z: (K + 1, R, S) states; length: of the ship [m]. Thresholds refer to the time L/U of
    the ship, with U not below a share of the usual speed of the trials.
    """
    inside = data.inside
    u, v, r = (0.5 * (z[:-1, :, i] + z[1:, :, i]) for i in (3, 4, 5))
    # over several steps, so that the noise of the path does not count as a change
    reach = max(1, round(0.25 * length / max(float(np.abs(u[inside]).mean()), 1e-6) / data.h))
    du, dr = (_change(z[..., i], reach, data.steps) / (reach * data.h) for i in (3, 5))
    speed = np.hypot(u, v)
    usual = float(np.quantile(speed[inside], 0.8))
    U = np.maximum(speed, max(SLOW_SHARE * usual, 1e-9))
    back = (data.inputs[..., [names.index(name) for name in PROPELLERS if name in names]] < 0).any(axis=-1)
    rules = {
        STOPPING: back | (u < -ASTERN_SHARE * usual),
        SLOW: speed < SLOW_SHARE * usual,
        CHANGING: np.abs(dr) * (length / U) ** 2 > TURN_CHANGE,
        STEADY: np.abs(r) * length / U > TURNING,
        ACCELERATING: np.abs(du) * length / U**2 > SPEED_CHANGE,
    }
    found = np.select(list(rules.values()), [PHASES.index(name) for name in rules], PHASES.index(STRAIGHT))
    return found[inside]


def _change(z: np.ndarray, reach: int, steps: np.ndarray) -> np.ndarray:
    """Change (K, R) of z (K + 1, R) over ``reach`` steps about each step, never beyond the end of its window."""
    k = np.arange(len(z) - 1)[:, None]
    start = np.clip(k - reach // 2, 0, np.maximum(steps - reach, 0)[None])
    end = np.minimum(start + reach, steps[None])
    return np.take_along_axis(z, end, axis=0) - np.take_along_axis(z, start, axis=0)
