"""Library effects of the instruments: antenna, compass, log, satellite receiver; all act on the logged columns."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import Array, Drawn, Effect, History, effect, vector


def turned(u: Array, v: Array, angle: Array) -> tuple[Array, Array]:
    """Components of a body-fixed velocity in axes turned clockwise by ``angle`` [rad]."""
    return u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)


class AntennaOffset(Effect):
    """Position and velocity belong to a point off midship: lever arm, and its speed in the turn."""

    name, levels = "antenna_offset", (0.08, 0.2, 0.6)
    neutral = {"x": 0.0, "y": 0.0}  # noqa: RUF012

    def draw(self, strength: str, rng: np.random.Generator, runs: int) -> Drawn:
        x, y = vector(self.size(strength, rng), rng)
        return Drawn({"x": x, "y": y}, {"x": x, "y": y})

    def columns(self, y: Array, history: History, rows: Array, e: Any) -> Array:
        out, psi, r = y.copy(), history.states[rows, 2], history.states[rows, 5]
        out[:, 0] += e.x * np.cos(psi) - e.y * np.sin(psi)
        out[:, 1] += e.x * np.sin(psi) + e.y * np.cos(psi)
        out[:, 3] -= r * e.y
        out[:, 4] += r * e.x
        return out


@effect("columns", (0.25, 0.5, 1.0), number="tau")
def gnss_delay(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Position and velocity over ground are those of a while ago; heading, and the axes of u and v, are of now."""
    s = history.states
    north = s[:, 3] * np.cos(s[:, 2]) - s[:, 4] * np.sin(s[:, 2])
    east = s[:, 3] * np.sin(s[:, 2]) + s[:, 4] * np.cos(s[:, 2])
    at = np.maximum(rows[:, None] - e.tau[None, :] / history.dt, 0.0)
    low = np.floor(at).astype(int)
    high, share, run = np.minimum(low + 1, rows[:, None]), at - low, np.arange(s.shape[2])[None, :]
    late = [a[low, run] + share * (a[high, run] - a[low, run]) for a in (s[:, 0], s[:, 1], north, east)]
    out, psi = y.copy(), s[rows, 2]
    here = (
        s[rows, 3] * np.cos(psi) - s[rows, 4] * np.sin(psi),
        s[rows, 3] * np.sin(psi) + s[rows, 4] * np.cos(psi),
    )
    u, v = turned(late[2] - here[0], late[3] - here[1], psi)
    out[:, 0] += late[0] - s[rows, 0]
    out[:, 1] += late[1] - s[rows, 1]
    out[:, 3] += u
    out[:, 4] += v
    return out


@effect("columns", tuple(np.radians((0.14, 0.57, 2.0))), two_sided=True, number="psi")
def heading_bias(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Logged heading off by a constant; u and v come from the velocity over ground and are turned with it."""
    out = y.copy()
    out[:, 2] += e.psi
    out[:, 3], out[:, 4] = turned(y[:, 3], y[:, 4], e.psi)
    return out


@effect("columns", (0.002, 0.01, 0.05), two_sided=True, number="share")
def log_scale(y: Array, history: History, rows: Array, e: Any) -> Array:
    """Logged u off by a share, which is 8 % larger at high than at low speed."""
    out = y.copy()
    out[:, 3] *= 1 + e.share * (0.96 + 0.08 * np.abs(y[:, 3]) / (np.abs(y[:, 3]) + 0.2))
    return out


EFFECTS = (gnss_delay, AntennaOffset(), heading_bias, log_scale)
