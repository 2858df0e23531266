"""Whether trials that took no part show again what was found in others: an effect, or a force without a name.

What is found in some trials is the most of many directions in which they may err, so that chance alone makes it large.
Other trials are asked about that direction alone: no further correction for the number of candidates or forms is due
(Cox 1975, A note on data-splitting for the evaluation of significance levels). Their coefficients are those of the
first trials within what those left open, and are projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.input_timing import timing_columns
from diagnosis.estimation.linearisation import Point, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.parameters import NO_PRIORS, active_states
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.projection import projected
from diagnosis.hypotheses.score_test import slopes
from diagnosis.hypotheses.second_sample import NOTHING, FoundAgain
from diagnosis.hypotheses.unexplained_force import ForceEstimate

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

    def effect(self, candidate: Candidate, phi: np.ndarray) -> FoundAgain:
        """An effect that was found with parameters ``phi`` (p,) [typical sizes], to first order."""
        s = slopes(self.steps, self.data, self.point, [candidate], self.known)
        at = [s.columns.index(c) for c in candidate.columns]
        ratio = s.dispersion.get(candidate, 1.0)
        return _along(phi, s.g[at], s.S[np.ix_(at, at)], ratio)

    def force(self, found: ForceEstimate) -> FoundAgain:
        """A force that was ``found`` as a function of motion, inputs and wind."""
        if not found.mean.any():
            return NOTHING
        steps, data, at = self.steps, self.data, self.point
        active = active_states(steps, at.free.symbols, at.theta)
        timing = timing_columns(steps, data, at, active)
        middle = 0.5 * (at.path.z[:-1] + at.path.z[1:])
        force, gradient = found.on(data, middle), found.gradient_on(data, middle)

        def columns_of(linear: LinearModel) -> tuple[np.ndarray, np.ndarray]:
            pushed = np.einsum("krac,krc->kra", linear.force, force)[..., None]
            forcing = np.concatenate([timing, pushed], axis=3)
            return forcing, np.zeros((*data.good.shape, forcing.shape[3]))

        here = linearise_and_filter(steps, data, at, active, columns_of)
        K, R = data.inputs.shape[:2]
        every = steps.coefficients(at.theta, at.path.force[:-1].reshape(-1, 3).T)
        _, J = steps.rates(middle.reshape(K * R, -1).T, data.inputs.reshape(K * R, -1).T, every)
        by_force = J[:, active, steps.S :].reshape(K, R, -1, 3)
        pull = np.einsum("kraf,krab->krfb", by_force, here.by_rates[..., : len(active)])[..., :6]
        P, c = len(at.p), timing.shape[3]
        logdet = np.concatenate([here.logdet_gradient.sum(axis=0)[: P + c], [(pull * gradient).sum()]])
        flat = here.white.reshape(-1, here.white.shape[-1])
        known = np.eye(P + c)
        known[:P, :P] = self.known
        rest = projected(flat.T @ flat, logdet, np.zeros(P + c), known)
        return _along(np.ones(1), rest.g, rest.S)

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


def _along(phi: np.ndarray, g: np.ndarray, S: np.ndarray, ratio: float = 1.0) -> FoundAgain:
    """The slopes g (p,) along ``phi`` (p,), with information S (p, p) and ``ratio`` of their variance to it."""
    information = float(phi @ S @ phi) / ratio
    if not information > 0:
        return NOTHING
    size = float(np.sqrt(information))
    return FoundAgain(float(phi @ g) / ratio / size, size)
