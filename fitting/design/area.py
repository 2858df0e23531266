"""The basin or sea area of a planned trial: where in it a track begins, so that the hull stays inside."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mmg.errors import BadValue, OutOfRange
from mmg.ship import Ship

HEADINGS = np.radians(np.arange(0, 180, 15))
"""Headings [rad] in which a track is tried; the opposite ones leave as much room."""


@dataclass(frozen=True)
class Placing:
    """Where K tracks begin: x, y [m], psi [rad], (K,) each; excess: by how much each is too large for the area [m]."""

    x: np.ndarray
    y: np.ndarray
    psi: np.ndarray
    excess: np.ndarray


@dataclass(frozen=True)
class Area:
    """A rectangle with x (north) from 0 to ``length`` and y (east) from 0 to ``width`` [m].

    margin: that the hull keeps from its edges [m].
    """

    length: float
    width: float
    margin: float

    @classmethod
    def parse(cls, text: str, ship: Ship, margin: float | None = None) -> Area:
        """The area that ``text`` such as "60x25" names; margin [m], default half the beam of ``ship``.

        Raises UserError for a text that is no area, and for an area that the ship does not fit into.
        """
        try:
            length, width = (float(part) for part in text.lower().split("x"))
        except ValueError:
            length = width = math.nan
        if not (0 < length < math.inf and 0 < width < math.inf):
            raise BadValue(f"--area {text}: give length x width in metres, both positive, such as 60x25")
        L, B = ship.particulars["L"], ship.particulars["B"]
        margin = B / 2 if margin is None else margin
        if not (math.isfinite(margin) and margin >= 0):
            raise OutOfRange(f"--margin {margin:g} m must not be negative")
        if max(length, width) < L + 2 * margin or min(length, width) < B + 2 * margin:
            raise OutOfRange(
                f"--area {text}: {ship.called} ({L:g} m long, {B:g} m wide) with a margin of {margin:g} m does not fit "
                "into it; give a larger area"
            )
        return cls(length, width, margin)

    def check_start(self, start: tuple[float, float, float], ship: Ship) -> None:
        """UserError where the hull of ``ship`` at ``start``, x, y [m], psi [rad], is not inside with its margin."""
        x, y = corners(np.array([start])[..., None], ship)
        m = self.margin - 1e-9
        if x.min() < m or x.max() > self.length - m or y.min() < m or y.max() > self.width - m:
            raise OutOfRange(
                f"--start {start[0]:g}:{start[1]:g}:{math.degrees(start[2]):g}: the hull is not inside the area of "
                f"{self.length:g} x {self.width:g} m with a margin of {self.margin:g} m there; give another start"
            )

    def placing(
        self, tracks: np.ndarray, ship: Ship, start: tuple[float, float, float] | None = None, turned: bool = True
    ) -> Placing:
        """Where ``tracks`` (N, 3, D, K) of x, y [m], psi [rad] begin, K of them with D draws each, all from 0, 0, 0.

        start: x, y, psi if they are given, else the heading with most room is taken and the track is put into the
        middle. turned: the heading may be chosen. Draws that are not finite do not count. ship: whose hull it is.
        """
        px, py = corners(tracks, ship)
        headings = np.array([start[2]]) if start else HEADINGS if turned else HEADINGS[:1]
        inner = np.array([self.length, self.width]) - 2 * self.margin
        found = []
        for psi in headings:
            c, s = math.cos(psi), math.sin(psi)
            low, high = [], []
            for along in (c * px - s * py, s * px + c * py):
                low.append(np.fmin.reduce(along, axis=(0, 1, 2)))
                high.append(np.fmax.reduce(along, axis=(0, 1, 2)))
            lows, highs = np.array(low), np.array(high)
            if start:
                begin = np.repeat(np.array(start[:2])[:, None], lows.shape[1], axis=1)
                ends = self.margin + inner[:, None]
                over = np.maximum(self.margin - begin - lows, 0) + np.maximum(begin + highs - ends, 0)
            else:
                begin = self.margin + 0.5 * inner[:, None] - 0.5 * (lows + highs)
                over = np.maximum(highs - lows - inner[:, None], 0)
            room = np.min(inner[:, None] - highs + lows, axis=0)
            found.append((over.sum(axis=0), room, begin))
        excess, room = np.array([f[0] for f in found]), np.array([f[1] for f in found])
        best, own = np.argmin(excess - 1e-6 * room, axis=0), np.arange(excess.shape[1])
        begins = np.array([f[2] for f in found])[best, :, own]
        return Placing(begins[:, 0], begins[:, 1], headings[best], np.nan_to_num(excess[best, own], nan=1e6))


def corners(tracks: np.ndarray, ship: Ship) -> tuple[np.ndarray, np.ndarray]:
    """x and y (4, N, ...) of the hull's four corners [m] along ``tracks`` (N, 3, ...); ship: whose L and B."""
    x, y, psi = tracks[:, 0], tracks[:, 1], tracks[:, 2]
    c, s = np.cos(psi), np.sin(psi)
    a, b = 0.5 * ship.particulars["L"], 0.5 * ship.particulars["B"]
    places = [(i * a, j * b) for i in (1, -1) for j in (1, -1)]
    return np.array([x + i * c - j * s for i, j in places]), np.array([y + i * s + j * c for i, j in places])
