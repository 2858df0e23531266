"""Events: what is wrong for some seconds of a run and not, or otherwise, at another time.

Each stretch of each run has sizes of its own: of an actuator that comes late then, and of an offset of the logged
position. A column is nothing outside its stretch: those of all runs are filtered side by side, and products of
different runs are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Linearisation
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.hypotheses.dictionary import DELAYS, Dictionary
from diagnosis.hypotheses.projection import projected
from mmg.motion.froude import time_scale

STRETCH = 10.0
"""Length [s of a 3 m model] of a stretch; longer where there would be more than MOST of them."""
MOST = 150
"""Stretches of all runs together."""
LATE = 4.0
"""Delay [s of a 3 m model], of those in the dictionary, of an actuator that stops or limps for a while."""
SEEN = 1e-9
"""Information from which a column is seen at all."""
POSITION = (0, 1)
"""Logged columns of the position."""


@dataclass(frozen=True)
class Events:
    """Columns of all stretches, those with the same number in their runs side by side.

    kinds: what each of E columns is of; forcing: (K, R, A, E) of the active states over a step; observed: (K + 1, R, 6,
    E) of the logged columns; forms: the dictionary; stretches: (K, W) which steps are in each.
    """

    kinds: tuple[str, ...]
    forcing: np.ndarray
    observed: np.ndarray
    forms: Dictionary
    stretches: np.ndarray

    @classmethod
    def of(cls, data: GriddedTrials, forms: Dictionary, linear: LinearModel, length: float) -> Events:
        """The events of trials ``data`` of a ship of this ``length`` [m]; forms, linear: dictionary and model there."""
        K, R = data.inputs.shape[:2]
        steps = max(1, round(STRETCH * time_scale(length) / data.h), -(-int(data.steps.sum()) // MOST))
        own = np.arange(K)[:, None] // steps == np.arange(-(-K // steps))
        W = own.shape[1]
        kinds, forcing, observed = [], [], []
        for name, (action, size) in zip(forms.actions, forms.scaled(linear, forms.actions), strict=True):
            late = action.step * (size * action.delayed[DELAYS.index(LATE)])[..., None]
            forcing.append(late[..., None] * own[:, None, None, :])
            kinds += [f"delay of {name} at times"] * W
            observed.append(np.zeros((K + 1, R, 6, W)))
        seen = np.concatenate([own[:1], own])
        for channel in POSITION:
            off = np.zeros((K + 1, R, 6, W))
            off[:, :, channel] = forms.noise.white[channel] * seen[:, None, :]
            observed.append(off)
            forcing.append(np.zeros((K, R, len(forms.active), W)))
            kinds += ["sensor of position at times"] * W
        return cls(tuple(kinds), np.concatenate(forcing, axis=3), np.concatenate(observed, axis=3), forms, own)

    def logdet_gradient(self, at: Linearisation) -> np.ndarray:
        """Derivative (R, E) of 1/2 log det along each column, of the linearisation ``at``."""
        W, R = self.stretches.shape[1], at.white.shape[1]
        result = np.zeros((R, len(self.kinds)))
        for i, (action, size) in enumerate(self.forms.scaled(at.linear, self.forms.actions)):
            whole = np.einsum("krab,krab->kr", at.by_rates, action.jacobian)
            by_step = size * action.delayed[DELAYS.index(LATE)] * whole
            result[:, i * W : (i + 1) * W] = by_step.T @ self.stretches
        return result


@dataclass(frozen=True)
class EventSlopes:
    """Slopes g (c,) of the log likelihood along the events of one kind, the free parameters projected out, their
    information S (c, c), and how much more the slopes vary where residuals are correlated in time, at least 1."""

    g: np.ndarray
    S: np.ndarray
    dispersion: float


def event_slopes(
    white: np.ndarray, logdet: np.ndarray, p: np.ndarray, along: np.ndarray, kinds: tuple[str, ...], lags: int
) -> dict[str, EventSlopes]:
    """The slopes by kind of events; those that nothing shows are left out.

    white: (K + 1, R, 6, P + E + 1) whitened columns, P free ones first, the negative residual last; logdet: (P,) slopes
    of half the log determinant by the free ones, along: (R, E) by those of events; p: (P,); kinds: (E,); lags: steps
    over which residuals may be correlated.
    """
    P = len(p)
    known = [*range(P), white.shape[3] - 1]
    flat = white[..., known].reshape(-1, P + 1)
    inner, found = flat.T @ flat, {}
    for kind in dict.fromkeys(kinds):
        at = np.array([k == kind for k in kinds])
        own = white[..., P:-1][..., at]
        squares = np.einsum("krce,krcf->ref", own, own, optimize=True)
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
        gram[P : P + n, P : P + n] = np.where(same, squares[run[:, None], number[:, None], number], 0.0)
        left = projected(gram, np.concatenate([logdet, along[:, at][run, number]]), p)
        ratio = _dispersion(own, white[..., -1], lags) if kind.startswith("sensor") else 1.0
        found[kind] = EventSlopes(left.g, left.S, ratio)
    return found


def _dispersion(columns: np.ndarray, white: np.ndarray, lags: int) -> float:
    """Variance of the slopes along columns (K + 1, R, 6, E) over their information, in the mean over those of each
    stretch, at least 1, by Newey & West (1987) about what each explains; white: (K + 1, R, 6) negative residual."""
    information = np.einsum("krce,krce->re", columns, columns, optimize=True)
    size = -np.einsum("krce,krc->re", columns, white, optimize=True) / (1 + information)
    rest = white + np.einsum("krce,re->krc", columns, size, optimize=True)
    each = np.einsum("krce,krc->kre", columns, rest, optimize=True)
    weight = 1 - np.arange(1, lags + 1) / (lags + 1)
    variance = (each**2).sum(axis=0)
    for lag, w in enumerate(weight[: len(each) - 1], start=1):
        variance += 2 * w * (each[lag:] * each[:-lag]).sum(axis=0)
    return max(1.0, float(variance[information > SEEN].sum() / information[information > SEEN].sum()))
