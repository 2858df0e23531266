"""The spiral curve: turn rate against rudder angle from a direct (Dieudonne) spiral, and its unstable loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cases.criteria.figures import rudder_holds
from cases.trial import Trial


@dataclass(frozen=True)
class SpiralCurve:
    """Both branches of a spiral, in the order in which the rudder went.

    rudder [rad] and rate [rad/s], each (K,): steady turn rate per rudder angle; turn: row of the outermost angle of
    the other side, where the second branch begins.
    """

    rudder: np.ndarray
    rate: np.ndarray
    turn: int

    @property
    def branches(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """(rudder, rate) of the way there and of the way back, each by rising rudder angle."""
        there, back = np.arange(self.turn + 1), np.arange(self.turn, len(self.rudder))
        there, back = there[np.argsort(self.rudder[there])], back[np.argsort(self.rudder[back])]
        return (self.rudder[there], self.rate[there]), (self.rudder[back], self.rate[back])


def spiral_curve(trial: Trial, order_time: float) -> SpiralCurve | None:
    """The curve of a ``trial`` with the rudder in steps from ``order_time`` [s] on; None with under three angles."""
    holds = rudder_holds(trial, order_time)
    if len(holds) < 3:
        return None
    rudder, rate = np.array([h.rudder for h in holds]), np.array([h.rate for h in holds])
    side = np.sign(rudder[0]) or 1.0
    return SpiralCurve(rudder, rate, int(np.argmin(side * rudder)))


def spiral_figures(trial: Trial, order_time: float) -> dict[str, float]:
    """loop_height [rad/s], loop_width [rad], rate_at_midships (mean of both branches, [rad/s]).

    Height: largest difference of the turn rates of the two branches at the same rudder angle. Width: difference of
    the rudder angles at which the branches change the side to which the ship turns; 0 for a ship that is stable on
    course, up to half a step on each side where the rudder went in steps. Absent where the spiral lacks the branch.
    trial: the run; order_time: of the order [s].
    """
    curve = spiral_curve(trial, order_time)
    if curve is None:
        return {}
    (there, first), (back, second) = curve.branches
    low, high = max(there[0], back[0]), min(there[-1], back[-1])
    if len(there) < 2 or len(back) < 2 or low >= high:
        return {}
    grid = np.unique(np.concatenate([there, back]))
    grid = grid[(grid >= low - 1e-9) & (grid <= high + 1e-9)]
    gap = np.interp(grid, there, first) - np.interp(grid, back, second)
    figures = {"loop_height": float(np.abs(gap).max())}
    crossings = [_crossing(*branch) for branch in curve.branches]
    if crossings[0] is not None and crossings[1] is not None:
        figures["loop_width"] = abs(crossings[0] - crossings[1])
    if low <= 0 <= high:
        figures["rate_at_midships"] = float(0.5 * (np.interp(0, there, first) + np.interp(0, back, second)))
    return figures


def _crossing(rudder: np.ndarray, rate: np.ndarray) -> float | None:
    """Rudder angle at which the rate changes sign, by linear interpolation; None if it never does."""
    rows = np.flatnonzero((rate[:-1] < 0) & (rate[1:] >= 0))
    if len(rows) == 0:
        return None
    k = int(rows[0])
    return float(rudder[k] - rate[k] * (rudder[k + 1] - rudder[k]) / (rate[k + 1] - rate[k]))
