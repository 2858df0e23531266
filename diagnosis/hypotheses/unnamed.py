"""Test of unnamed forms: whether the dictionary explains more of the trials than chance does.

Whether the columns of a kind explain more than chance is a ratio of marginal likelihoods (Bayes factor) with a Gaussian
prior on their sizes, averaged over SIZES: it grows only if there is something, since every column costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.estimation.dispersion import dispersion, memory_steps
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.dictionary import Dictionary

SENSOR = "sensor of "
"""Begin of the kinds that are errors of a sensor."""
SIZES = (0.03, 0.1, 0.3, 1.0)
"""Prior standard deviations of a column's coefficient, in the sizes of what is random."""


TOLERANCE = 0.05
"""Errors of a sensor of this size, in standard deviations of its noise, are none: no instrument is exact."""
DRAWS, LEVEL = 1000, 0.015
"""Draws of the law by chance, and the probability of a false alarm of either test (all kinds; the best force alone)."""


@dataclass(frozen=True)
class UnnamedForms:
    """What the unnamed forms explain: log Bayes factor of each kind, and of their mixture in equal parts.

    single: log Bayes factor of the best force alone, less the log of their number. limit, single_limit: what log_bayes
    and single exceed by chance with the probability LEVEL, from the law of the fitted model on these trials.
    """

    log_bayes: float
    by_kind: dict[str, float]
    single: float
    limit: float
    single_limit: float

    @property
    def beyond_chance(self) -> float:
        """By how much the mixture, or the best force alone, exceeds its limit."""
        return max(self.log_bayes - self.limit, self.single - self.single_limit)


def unnamed_forms(steps: TransitionModel, data: GriddedTrials, found: Estimate, seed: int = 0) -> UnnamedForms:
    """Test the unnamed forms at a fitted hypothesis.

    steps: the transition model; data: the trials; found: the fit; seed: of the drawn law by chance, which is that of
    the fitted model with new random forces and sensor errors, to first order. Returns log Bayes factors.
    """
    slopes = unnamed_slopes(steps, data, found)
    g, S, kinds = slopes.g, slopes.S, slopes.kinds
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    normal, off = np.random.default_rng(seed).standard_normal((2, DRAWS, len(g)))
    allowed = np.array([TOLERANCE if k.startswith(SENSOR) else 0.0 for k in kinds])
    drawn = normal * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    drawn += (off * allowed) @ (S * np.equal.outer(np.array(kinds), np.array(kinds)))
    ratio = np.ones(len(g))
    names = sorted(set(kinds))
    logs = []
    for name in names:
        own = np.array([k == name for k in kinds])
        ratio[own] = slopes.dispersion.get(name, 1.0)
        at = np.vstack([g / ratio, drawn / np.sqrt(ratio)])
        logs.append(log_bayes(at, S / ratio, own, allowed[own].max()))
    mixture = np.logaddexp.reduce(np.stack(logs), axis=0) - np.log(len(names))
    every = np.vstack([g / ratio, drawn / np.sqrt(ratio)])
    forces = [i for i, kind in enumerate(kinds) if kind.endswith(" force")]
    alone = np.max([log_bayes(every, S / ratio, np.arange(len(g)) == i) for i in forces], axis=0) - np.log(len(forces))
    limit, single_limit = (float(np.quantile(x[1:], 1 - LEVEL)) for x in (mixture, alone))
    by_kind = {name: float(log[0]) for name, log in zip(names, logs, strict=True)}
    return UnnamedForms(float(mixture[0]), by_kind, float(alone[0]), limit, single_limit)


@dataclass(frozen=True)
class UnnamedSlopes:
    """Slopes g (C,) of the log likelihood along the dictionary's columns, the free parameters projected out, their
    information S (C, C), the kind of each, and by kind of sensor error the ratio of the slopes' variance to that
    information, at least 1: it is larger where residuals are correlated in time, as of sensors with a memory. The
    memory of forces is in the model."""

    g: np.ndarray
    S: np.ndarray
    kinds: tuple[str, ...]
    dispersion: dict[str, float]


def unnamed_slopes(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> UnnamedSlopes:
    """The slopes along all columns of the dictionary at a fit.

    steps: the transition model; data: the trials; found: the fit.
    """
    active = active_states(steps, found.free.symbols, found.theta)
    forms = Dictionary(steps, data, found, active)
    linearised = linearise_and_filter(steps, data, found, active, forms.columns)
    flat = linearised.white.reshape(-1, linearised.white.shape[-1])
    gram = flat.T @ flat
    P = len(found.free.symbols)
    A = gram[:P, :P] + np.eye(P)
    project = np.linalg.solve(A, gram[:P, P:-1])
    S = gram[P:-1, P:-1] - gram[P:-1, :P] @ project
    logdet = linearised.logdet_gradient.sum(axis=0)
    logdet[P:] = forms.logdet_gradient(linearised)
    slope = -(gram[:-1, -1] + logdet)
    slope[:P] -= found.p
    g = slope[P:] - project.T @ slope[:P]
    lags = memory_steps(steps.ship.particulars["L"], data.h)
    columns = linearised.white[..., P:-1] - linearised.white[..., :P] @ project
    ratios = {}
    for name in (k for k in dict.fromkeys(forms.kinds) if k.startswith(SENSOR)):
        own = np.array([k == name for k in forms.kinds])
        ratios[name] = dispersion(columns[..., own], linearised.white[..., -1], g[own], S[np.ix_(own, own)], lags)
    return UnnamedSlopes(g, S, forms.kinds, ratios)


def log_bayes(g: np.ndarray, S: np.ndarray, chosen: np.ndarray, tolerance: float = 0.0) -> np.ndarray:
    """Log Bayes factors (...) of the columns ``chosen`` (C,), averaged over the prior sizes SIZES above the tolerance.

    g: (..., C) slopes of the log likelihood along all columns; S: (C, C) their information; tolerance: standard
    deviation of what a column may be off where nothing is wrong, too.
    """
    g, S = g[..., chosen], S[np.ix_(chosen, chosen)]
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    values, along = np.maximum(values, 0.0), (g @ vectors) ** 2
    null = 1 + tolerance**2 * values
    logs = []
    for a in (a for a in SIZES if a > tolerance):
        other = 1 + a**2 * values
        logs.append(0.5 * (along @ ((a**2 - tolerance**2) / (null * other)) - np.log(other / null).sum()))
    return np.logaddexp.reduce(logs, axis=0) - np.log(len(logs))
