"""What has sizes of its own in each run: events, and forces that swing.

Events are wrong for some seconds of a run and not, or otherwise, at another time: an actuator that comes late for a
while, the position off for a while. Forces that swing with the ship's way, as of vortices (Strouhal 1878), have a phase
of their own in each. The columns of all runs are filtered side by side, and products of different runs are zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns, ProductColumns
from diagnosis.estimation.linearisation import Linearisation
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.hypotheses.dictionary import DELAYS, Dictionary
from diagnosis.hypotheses.score_test import Projected, projected
from mmg.motion.froude import time_scale

# Length [s of a 3 m model] of a stretch; longer where there would be more than MOST of them. Set by hand.
STRETCH = 10.0
MOST = 150  # Stretches of all runs together. Set by hand: bounds time.
# Delay [s of a 3 m model], of those in the dictionary, of an actuator that stops or limps for a while.
LATE = 4.0  # set by hand: the longest there
# Standard deviation of the time at which an actuator moves between two samples, in their interval: any is alike.
UNKNOWN = 12**-0.5
# Swings of a force on a way of one length of the ship (the Strouhal number).
SWINGS = tuple(round(0.2 + 0.15 * i, 2) for i in range(12))
SEEN = 1e-9  # Information from which a column is seen at all. Set by hand: bounds rounding.
AT_TIMES = " at times"  # End of the kinds of what is wrong for a while
SWINGING = "force that swings"  # Begin of the kinds of forces that swing with the way made
POSITION = (0, 1)  # Logged columns of the position


@dataclass(frozen=True)
class Events:
    """Columns of all runs, those with the same number side by side.

    kinds: what each of E columns is of; columns: these, in parts; forms: the dictionary; stretches: (K, W) which steps
    are in each stretch; allowed: size, by kind, that is nothing, also of actuators that are late throughout: when in
    the interval of a sample they are read, nobody knows.
    """

    kinds: tuple[str, ...]
    columns: tuple[DrivenColumns | ProductColumns, ...]
    forms: Dictionary
    stretches: np.ndarray
    allowed: Mapping[str, float]

    @classmethod
    def of(cls, data: GriddedTrials, forms: Dictionary, linear: LinearModel, length: float) -> Events:
        """The events of trials ``data`` of a ship of this ``length`` [m]; forms, linear: dictionary and model there."""
        K, R = data.inputs.shape[:2]
        # -(-a // b): rounded up
        steps = max(1, round(STRETCH * time_scale(length) / data.h), -(-int(data.steps.sum()) // MOST))
        own = np.arange(K)[:, None] // steps == np.arange(-(-K // steps))
        W = own.shape[1]
        kinds: list[str] = []
        columns: list[DrivenColumns | ProductColumns] = []
        allowed: dict[str, float] = {}
        for name, (action, size) in zip(forms.actions, forms.scaled(linear, forms.actions), strict=True):
            late = action.step * (size * action.delayed[DELAYS.index(LATE)])[..., None]
            columns.append(ProductColumns(late[..., None], own.T[:, :, None]))
            kinds += [f"delay of {name}{AT_TIMES}"] * W
            parts = UNKNOWN * data.sample * action.per_second / (size or np.inf)
            allowed[kinds[-1]] = float(parts[DELAYS.index(LATE)])
            allowed[f"delay of {name}"] = float(parts.max()) / len(parts) ** 0.5  # they are alike, and add up
        seen = np.concatenate([own[:1], own])  # a grid time belongs to the step that ends there, the first to its own
        for channel in POSITION:
            off = np.zeros((K + 1, R, 6, W))
            off[:, :, channel] = forms.noise.white[channel] * seen[:, None, :]
            columns.append(DrivenColumns.misread(off))
            kinds += [f"sensor of position{AT_TIMES}"] * W
        columns.append(DrivenColumns.pushing(_swinging(data, forms, linear, length)))
        kinds += [f"{SWINGING} {rate:g} times a length" for rate in SWINGS for _ in range(4)]
        return cls(tuple(kinds), tuple(columns), forms, own, allowed)

    def logdet_gradient(self, at: Linearisation) -> np.ndarray:
        """Derivative (R, E) of 1/2 log det along each column, of the linearisation ``at``."""
        W, R = self.stretches.shape[1], at.white.shape[1]
        result = np.zeros((R, len(self.kinds)))
        for i, (action, size) in enumerate(self.forms.scaled(at.linear, self.forms.actions)):
            whole = np.einsum("krab,krab->kr", at.by_rates, action.jacobian)
            by_step = size * action.delayed[DELAYS.index(LATE)] * whole
            result[:, i * W : (i + 1) * W] = by_step.T @ self.stretches  # summed over the steps of each stretch
        return result


def _swinging(data: GriddedTrials, forms: Dictionary, linear: LinearModel, length: float) -> np.ndarray:
    """What sway force and yaw moment add over a step that swing with the way made, sine and cosine of each of SWINGS:
    (K, R, A, 4 x 12)."""
    z = forms.path.z
    speed = np.hypot(z[:-1, :, 3] + z[1:, :, 3], z[:-1, :, 4] + z[1:, :, 4]) / 2
    phase = 2 * np.pi * np.cumsum(speed * data.h, axis=0) / length  # by the way, not the time: vortices shed so
    turned = phase[..., None] * np.array(SWINGS)
    waves = np.stack([np.sin(turned), np.cos(turned)], axis=-1).reshape(*phase.shape, -1)
    pushes = linear.force[..., 1:] * forms.noise.force[1:]
    return np.einsum("krac,krw->krawc", pushes, waves).reshape(*pushes.shape[:3], -1)


def event_slopes(
    white: np.ndarray, logdet: np.ndarray, p: np.ndarray, along: np.ndarray, kinds: tuple[str, ...]
) -> dict[str, Projected]:
    """The slopes by kind of events, with their information; those that nothing shows are left out.

    white: (K + 1, R, 6, P + E + 1) whitened columns, P free ones first, the negative residual last; logdet: (P,) slopes
    of half the log determinant by the free ones, along: (R, E) by those of events; p: (P,); kinds: (E,).
    """
    P = len(p)
    known = [*range(P), white.shape[3] - 1]
    flat = white[..., known].reshape(-1, P + 1)
    inner, slopes = flat.T @ flat, {}
    for kind in dict.fromkeys(kinds):
        at = np.array([k == kind for k in kinds])
        own = white[..., P:-1][..., at]
        squares = np.einsum("krce,krcf->ref", own, own, optimize=True)  # within each run
        run, number = np.nonzero(np.einsum("ree->re", squares) > SEEN)
        if not len(run):
            continue
        n = len(run)
        order = [*range(P), P + n]
        gram = np.zeros((P + n + 1, P + n + 1))
        gram[np.ix_(order, order)] = inner
        cross = np.einsum("krce,krcq->req", own, white[..., known], optimize=True)[run, number]
        gram[P : P + n, order], gram[np.ix_(order, range(P, P + n))] = cross, cross.T
        same = run[:, None] == run
        # runs do not touch each other
        gram[P : P + n, P : P + n] = np.where(same, squares[run[:, None], number[:, None], number], 0.0)
        slopes[kind] = projected(gram, np.concatenate([logdet, along[:, at][run, number]]), p)
    return slopes
