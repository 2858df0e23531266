"""Whether trials that took no part show again what was found in others: an effect, or a force without a name.

What is found in some trials is the most of many directions in which they may err, so that chance alone makes it large.
Other trials are asked about that direction alone: no further correction for the number of candidates or forms is due
(Cox 1975, A note on data-splitting for the evaluation of significance levels). The direction holds the coefficients as
well: what they made up for without the effect is seen nowhere. Their values by the first trials are open as far as
those left them, which is projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.dispersion import dispersion, memory_steps
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.input_timing import timing_columns
from diagnosis.estimation.linearisation import Linearisation, Point, Trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_states
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.projection import projected
from diagnosis.hypotheses.second_sample import NOTHING, FoundAgain
from diagnosis.hypotheses.unexplained_force import ForceEstimate
from mmg.effects import EFFECTS

SEEN = 1e-6
"""Share of its information, left after the projection, from which a combination of sizes is tested."""
ITERATIONS = 5
"""Linearisations of the fit of path and noise."""


@dataclass(frozen=True)
class OtherTrials:
    """Trials that took no part at the fit of others.

    point: coefficients of that fit, with path and noise of these trials; known: (P, P) inverse covariance of the
    coefficients by the others.
    """

    steps: TransitionModel
    data: GriddedTrials
    point: Point
    known: np.ndarray

    def effect(self, candidate: Candidate, phi: np.ndarray, shift: np.ndarray) -> FoundAgain:
        """An effect that was found with parameters ``phi`` (p,) [typical sizes], and moved the coefficients by
        ``shift`` (P,) [prior std]: what these made up for without it shows in no trial."""
        steps, data, at = self.steps, self.data, self.point
        c, active, z = candidate, np.arange(steps.S), at.path.z
        passive = np.setdiff1d(active, active_states(steps, at.free.symbols, at.theta))
        if len(passive):
            z = steps.with_passive_states(z, data.controls, at.theta, at.path.force, passive)
        open_ended = np.full(len(phi), np.inf)
        free = at.free + Priors(c.columns, c.neutral, c.typical, -open_ended, open_ended)
        point = Point(at.theta, free, np.append(at.p, phi * 0), Trajectory(z, at.path.force), at.noise)
        timing = timing_columns(steps, data, point, active)
        late = timing, np.zeros((*data.good.shape, timing.shape[3]))
        here = linearise_and_filter(steps, data, point, active, lambda _: late)
        along = np.concatenate([shift, phi, np.zeros(timing.shape[3])])
        return self._along(here, here.logdet_gradient.sum(axis=0), along, len(phi), EFFECTS[c.effect].measures)

    def force(self, found: ForceEstimate) -> FoundAgain:
        """A force that was ``found`` as a function of motion, inputs and wind, less what coefficients make up for."""
        steps, data, at = self.steps, self.data, self.point
        active = active_states(steps, at.free.symbols, at.theta)
        timing = timing_columns(steps, data, at, active)
        middle = 0.5 * (at.path.z[:-1] + at.path.z[1:])
        force, gradient = found.on(data, middle), found.gradient_on(data, middle)

        def columns_of(linear: LinearModel) -> tuple[np.ndarray, np.ndarray]:
            pushed = np.einsum("krac,krc->kra", linear.force, force)[..., None]
            forcing = np.concatenate([pushed, timing], axis=3)
            return forcing, np.zeros((*data.good.shape, forcing.shape[3]))

        here = linearise_and_filter(steps, data, at, active, columns_of)
        K, R = data.inputs.shape[:2]
        every = steps.coefficients(at.theta, at.path.force[:-1].reshape(-1, 3).T)
        _, J = steps.rates(middle.reshape(K * R, -1).T, data.inputs.reshape(K * R, -1).T, every)
        by_force = J[:, active, steps.S :].reshape(K, R, -1, 3)
        pull = np.einsum("kraf,krab->krfb", by_force, here.by_rates[..., : len(active)])[..., :6]
        logdet = here.logdet_gradient.sum(axis=0)
        logdet[len(at.p)] = (pull * gradient).sum()
        along = np.concatenate([-found.taken @ found.mean.ravel(), [1.0], np.zeros(timing.shape[3])])
        return self._along(here, logdet, along, 1, False)

    def _along(
        self, here: Linearisation, logdet: np.ndarray, along: np.ndarray, own: int, measures: bool
    ) -> FoundAgain:
        """The slope of a linearisation along a direction (C,) of its columns: P coefficients, ``own`` of what was
        found, errors in the time of the inputs. Coefficients, as far as they are open, and times are projected out.

        logdet: (C,) slopes of half the log determinant; measures: the direction is an error of instruments, whose
        residuals may be correlated in time.
        """
        P, C = len(self.point.p), len(along)
        flat = here.white.reshape(-1, C + 1)
        gram = flat.T @ flat
        slope = -(gram[:-1, -1] + logdet)
        rest = np.array([*range(P), *range(P + own, C)])
        prior = np.eye(len(rest))
        prior[:P, :P] = self.known
        taken = np.linalg.solve(gram[np.ix_(rest, rest)] + prior, gram[rest, :-1] @ along)
        net = along.copy()
        net[rest] -= taken
        information, g = float(along @ gram[:-1, :-1] @ net), float(along @ slope - taken @ slope[rest])
        if not information > 0:
            return NOTHING
        ratio = 1.0
        if measures:
            lags = memory_steps(float(self.steps.ship.particulars["L"]), self.data.h)
            column = (here.white[..., :-1] @ net)[..., None]
            ratio = dispersion(column, here.white[..., -1], np.array([g]), np.array([[information]]), lags)
        size = float(np.sqrt(information / ratio))
        return FoundAgain(g / ratio / size, size)

    def differs(self, effects: Sequence[Candidate]) -> float:
        """Probability by chance that these trials ask for other sizes of ``effects`` of the fit than the first did.

        The sizes are given columns once more, beside those that the first trials know with all coefficients.
        """
        free = self.point.free
        here = linearise_and_filter(self.steps, self.data, self.point)
        own = np.array([free.columns.index(c) for e in effects for c in e.columns])
        P = len(self.point.p)
        order = np.array([*range(P), *own, P])
        flat = here.white.reshape(-1, P + 1)[:, order]
        logdet = here.logdet_gradient.sum(axis=0)[order[:-1]]
        rest = projected(flat.T @ flat, logdet, np.zeros(P), self.known)
        values, vectors = np.linalg.eigh(0.5 * (rest.S + rest.S.T))
        seen = values > SEEN * np.maximum(np.diag(flat.T @ flat)[own].max(), 1e-300)
        if not seen.any():
            return 1.0
        T = float((((vectors.T @ rest.g)[seen]) ** 2 / values[seen]).sum())
        return float(chi2.sf(T, int(seen.sum())))


def other_trials(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> OtherTrials:
    """Follow ``data``, trials that took no part, by the model ``steps`` with the coefficients of the fit ``found``."""
    first = initial_point(steps, data, found.theta, NO_PRIORS, found.noise)
    path = estimate(steps, data, first, ITERATIONS, tolerance=0.0)  # without free coefficients none is expected to gain
    return OtherTrials(steps, data, replace(path.fixed(), free=found.free, p=found.p), np.linalg.inv(found.covariance))
