"""Whether trials that took no part show again an effect that was found in others.

What is found in some trials is the most of many directions in which they may err, so that chance alone makes it large.
Other trials are asked about that direction alone: no further correction for the number of candidates is due
(Cox 1975, A note on data-splitting for the evaluation of significance levels). The direction holds the coefficients as
well: what they made up for without the effect is seen nowhere. Their values by the first trials are open as far as
those left them, which is projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting, linearised
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.dispersion import dispersion, memory_steps
from diagnosis.estimation.driven_columns import DrivenColumns
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Linearisation, Point, linearise_and_filter, timing_columns
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_states, set_values
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.projection import projected
from diagnosis.hypotheses.second_sample import NOTHING, FoundAgain
from mmg.effects import EFFECTS

ITERATIONS = 5
"""Linearisations of the fit of path and noise."""


@dataclass(frozen=True)
class OtherTrials:
    """Trials that took no part at the fit of others.

    point: coefficients of that fit, with path and noise of these trials; known: (P, P) inverse covariance of the
    coefficients by the others; off: (P,) how far they are from where that has them [prior std], None: not at all.
    """

    steps: TransitionModel
    data: GriddedTrials
    point: Point
    known: np.ndarray
    off: np.ndarray | None = None

    @np.errstate(all="ignore")
    def effect(self, candidate: Candidate, phi: np.ndarray, shift: np.ndarray) -> FoundAgain:
        """An effect that was found with parameters ``phi`` (p,) [typical sizes], and moved the coefficients by
        ``shift`` (P,) [prior std]: what these made up for without it shows in no trial.

        The response is that of the effect with the coefficients as they were moved: it is strong beside a coefficient
        that it multiplies.
        """
        steps, at = self.steps, self.point
        data = acting(steps, self.data, at.theta)
        c, active, z = candidate, np.arange(steps.S), at.path.z
        passive = np.setdiff1d(active, active_states(steps, at.free.symbols, at.theta))
        if len(passive):
            z = steps.with_passive_states(z, data.controls, at.theta, at.path.push, passive)
        open_ended = np.full(len(phi), np.inf)
        free = at.free + Priors(c.columns, c.neutral, c.typical, -open_ended, open_ended)
        point = Point(at.theta, free, np.append(at.p, phi * 0), at.path.along(z), at.noise)
        timing = timing_columns(steps, data, point, active)
        columns, along = [steps.symbols.index(s) for s in free.symbols], np.append(shift, phi)
        moved = at.free.mean + at.free.std * (at.p + shift)
        theta = set_values(steps.ship, data, at.theta, at.free.columns, moved)
        there = linearised(steps, data, theta, z, at.path.push[:-1], columns, active)

        def columns_of(_: LinearModel) -> list[DrivenColumns]:
            size = (free.std * along)[:, None]
            return [DrivenColumns.pushing(timing), DrivenColumns.dense(there.G @ size, there.D @ size)]

        here = linearise_and_filter(steps, data, point, active, columns_of)
        logdet = here.logdet_gradient.sum(axis=0)
        logdet[-1] = logdet[: len(along)] @ along
        rest = [*range(len(shift)), *range(len(along), len(logdet) - 1)]
        return self._last(here, logdet, rest, EFFECTS[c.effect].measures)

    def _last(self, here: Linearisation, logdet: np.ndarray, rest: Sequence[int], measures: bool) -> FoundAgain:
        """The slope of a linearisation along the last of its C columns, those of ``rest`` projected out: P
        coefficients, as far as they are open, and errors in the time of the inputs.

        logdet: (C,) slopes of half the log determinant; measures: the column is an error of instruments, whose
        residuals may be correlated in time.
        """
        P, C = len(self.point.p), len(logdet)
        chosen = np.array([*rest, C - 1, C])
        white = here.white[..., chosen]
        flat = white.reshape(-1, len(chosen))
        known = np.eye(len(rest))
        known[:P, :P] = self.known
        off = np.zeros(len(rest))
        off[:P] = 0.0 if self.off is None else self.off
        left = projected(flat.T @ flat, logdet[chosen[:-1]], off, known)
        if not left.S[0, 0] > 0:
            return NOTHING
        ratio = 1.0
        if measures:
            lags = memory_steps(float(self.steps.ship.particulars["L"]), self.data.h)
            column = white[..., -2:-1] - white[..., :-2] @ left.taken
            ratio = dispersion(column, white[..., -1], left.g, left.S, lags)
        size = float(np.sqrt(left.S[0, 0] / ratio))
        return FoundAgain(float(left.g[0]) / ratio / size, size)


def same_trials(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> OtherTrials:
    """The trials ``data`` of the fit ``found`` of ``steps`` themselves, asked in the same way: coefficients are as open
    as others leave them, and their slopes are those with the prior."""
    return OtherTrials(steps, data, found, np.linalg.inv(found.covariance), found.covariance @ found.p)


def other_trials(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> OtherTrials:
    """Follow ``data``, trials that took no part, by the model ``steps`` with the coefficients of the fit ``found``."""
    first = initial_point(steps, data, found.theta, NO_PRIORS, found.noise)
    path = estimate(steps, data, first, ITERATIONS)
    return OtherTrials(steps, data, replace(path.fixed(), free=found.free, p=found.p), np.linalg.inv(found.covariance))
