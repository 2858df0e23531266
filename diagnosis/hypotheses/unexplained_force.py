"""What is left unexplained, as a force: its size by channel, what it follows, when it acts, and where it would show.

The force is a sum of unnamed forms, products of motion, inputs and wind, whose coefficients have a
Gaussian prior of one size in each channel. The sizes have the largest marginal likelihood (empirical Bayes), 0 where
that is best; the force is the mean of the posterior, without what the free coefficients could imitate.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point, linearise_and_filter
from diagnosis.estimation.parameters import active_in_window
from diagnosis.findings import UnexplainedChannel, UnexplainedForce, UnexplainedTime
from diagnosis.hypotheses.dictionary import FORCES, Dictionary
from diagnosis.hypotheses.unnamed import UnnamedForms
from diagnosis.location.where import CHANNELS, UNITS, Samples, by_variable, variables_of
from mmg.components.rigid_body import inertia
from mmg.motion.froude import time_scale
from mmg.ship import Ship

SIZES = (0.0, *np.geomspace(0.02, 20.0, 13).tolist())  # Sizes that are tried, in those of the latent force
# Information on a sum of forms of the size of the latent force, from which the trials say anything of it.
SEEN = 0.1  # set by hand
SWEEPS = 3  # Rounds over the channels in which the sizes are improved one by one. Set by hand.
DRAWS = 400  # Draws of the posterior, for intervals. Set by hand.
STRETCH = 20.0  # Time [s of a 3 m model] of a stretch in which the force acts most. Set by hand.
MOST = 3  # Stretches listed, one of each trial at the most. Set by hand: display.
FOLLOWED = 0.05  # Share of a channel that a variable must explain to be listed. Set by hand: display.


@dataclass(frozen=True)
class ForceEstimate:
    """Coefficients of the unnamed forms: mean (3, m) and joint covariance (3 m, 3 m), by channel and form, and the
    ``dictionary`` whose forms they multiply; sizes: (3,) of the prior by channel, in those of the latent force; taken:
    (P, 3 m) multiples of the free coefficients that imitate each form."""

    mean: np.ndarray
    covariance: np.ndarray
    dictionary: Dictionary
    sizes: np.ndarray
    taken: np.ndarray

    def on(self, data: GriddedTrials, middle: np.ndarray) -> np.ndarray:
        """The force (K, R, 3) [N, N, N m] on trials ``data`` with states ``middle`` (K, R, S) of each step."""
        forms = self.dictionary.force_forms.on(data, middle)
        return np.einsum("cm,mkr->krc", self.mean, forms.values) * self.dictionary.noise.force


def estimated_force(unnamed: UnnamedForms) -> ForceEstimate:
    """The force that the tests of unnamed forms ``unnamed`` point to."""
    words = unnamed.slopes.dictionary
    chosen = np.array([kind in FORCES for kind in words.kinds])
    # the dictionary has the channels of a form side by side
    order = np.flatnonzero(chosen).reshape(-1, 3).T.ravel()
    g, S = unnamed.slopes.g[order], unnamed.slopes.S[np.ix_(order, order)]
    known, along = np.linalg.eigh(0.5 * (S + S.T))
    seen = along[:, known > SEEN]
    g = seen @ (seen.T @ g)  # sums of forms that vanish on these trials have no force, but may have a slope there
    sizes = np.zeros(3)
    for _, c in itertools.product(range(SWEEPS), range(3)):
        tried = [np.where(np.arange(3) == c, a, sizes) for a in SIZES]
        sizes = max(tried, key=lambda each: _evidence(g, S, each))
    root = np.repeat(sizes, len(g) // 3)
    # (S + root^-2)^-1, also for a size of 0
    covariance = root[:, None] * np.linalg.inv(np.eye(len(g)) + root[:, None] * S * root) * root
    return ForceEstimate((covariance @ g).reshape(3, -1), covariance, words, sizes, unnamed.slopes.taken[:, order])


def _evidence(g: np.ndarray, S: np.ndarray, sizes: np.ndarray) -> float:
    """Log marginal likelihood of prior ``sizes`` (3,) against none; g: (3 m,) slopes, S: their information."""
    root = np.repeat(sizes, len(g) // 3)
    A = np.eye(len(g)) + root[:, None] * S * root  # its determinant is that of the marginal covariance over S
    try:
        half = cholesky(A, lower=True, overwrite_a=True, check_finite=False)
    except np.linalg.LinAlgError:  # what is seen is nothing but rounding
        return -np.inf
    along = solve_triangular(half, root * g, lower=True, check_finite=False)
    return 0.5 * float(along @ along) - float(np.log(np.diag(half)).sum())


def unexplained_force(
    data: GriddedTrials, fit: Point, evidence: float, found: ForceEstimate, ship: Ship, advice: str = ""
) -> UnexplainedForce:
    """The unexplained force ``found`` at a ``fit`` to ``data``, for diagnosis.json and the report.

    evidence: for it, in log units; ship: diagnosed, for its masses; advice: which manoeuvre would tell more.
    """
    forms = _net_forms(found, data, fit)
    force = np.einsum("n,nkrc->krc", found.mean.ravel(), forms)
    coefficients = {symbol: c.value for symbol, c in ship.coefficients.items()}
    body = inertia(ship.namespace, type(ship.namespace)(**coefficients))
    mass = np.array([body.m + body.m_x, body.m + body.m_y, body.I_z])
    stretch = max(1, round(STRETCH * time_scale(float(ship.particulars["L"])) / data.h))
    square = np.einsum("nkrc,np,pkrc->krc", forms, found.covariance, forms, optimize=True)
    return UnexplainedForce(
        evidence=evidence,
        channels=_channels(found, forms[:, data.inside], mass),
        follows=_follows(found, data, fit, force[data.inside]),
        times=_times(data, force, mass, stretch),
        advice=advice,
        force=force,
        std=np.sqrt(np.maximum(square, 0.0)),
    )


def _net_forms(force: ForceEstimate, data: GriddedTrials, fit: Point) -> np.ndarray:
    """Force (3 m, K, R, 3) of a unit of each form, less that of the coefficients that would change with it."""
    values, sizes = force.dictionary.forces.values, force.dictionary.noise.force
    forms = np.zeros((3, *values.shape, 3))
    for c in range(3):
        forms[c, ..., c] = values * sizes[c]
    forms = forms.reshape(-1, *values.shape[1:], 3)
    linear = linearise_and_filter(force.dictionary.force_forms.steps, data, fit).linear
    velocities = np.where(data.inside[..., None, None], linear.force[:, :, 3:6], np.eye(3))
    unit = fit.free.std * active_in_window(fit.free.columns, data)
    # (K, R, 3, P) force that does what a free coefficient does
    by_free = np.linalg.solve(velocities, linear.G[:, :, 3:6] * unit[None, :, None])
    return forms - np.einsum("krcp,pn->nkrc", by_free, force.taken, optimize=True)


def _channels(force: ForceEstimate, forms: np.ndarray, mass: np.ndarray) -> dict[str, UnexplainedChannel]:
    """Median and 90 % interval of the rms by channel, and its share of the energy, from draws of the posterior; forms:
    (3 m, M, 3) net force of each by sample; mass: (3,) of each channel."""
    spread, along = np.linalg.eigh(force.covariance)
    draws = np.random.default_rng(0).standard_normal((DRAWS, len(spread))) * np.sqrt(np.maximum(spread, 0.0)) @ along.T
    every = force.mean.ravel() + draws
    grams = np.einsum("nmc,pmc->cnp", forms, forms, optimize=True) / forms.shape[1]
    sizes = np.sqrt(np.maximum(np.einsum("dn,cnp,dp->dc", every, grams, every, optimize=True), 0.0))
    low, rms, high = np.quantile(sizes, [0.05, 0.5, 0.95], axis=0)
    energy = rms**2 / mass  # as channels are compared in ``location.where``
    means = force.mean.ravel() @ forms.mean(axis=1)
    share = energy / max(energy.sum(), 1e-300)
    return {
        name: UnexplainedChannel(
            float(rms[c]), (float(low[c]), float(high[c])), float(means[c]), UNITS[c], float(share[c])
        )
        for c, name in enumerate(CHANNELS)
    }


def _follows(found: ForceEstimate, data: GriddedTrials, fit: Point, force: np.ndarray) -> tuple[dict[str, Any], ...]:
    """What the force (M, 3) less its mean follows: rows as of where["variables"], the best first."""
    run = np.broadcast_to(data.run, data.inside.shape)[data.inside]
    samples = Samples(force - force.mean(axis=0), None, run, data.h, found.dictionary.noise.tau)
    square = (force**2).mean(axis=0)
    varying = dict(zip(CHANNELS, 1 - force.mean(axis=0) ** 2 / np.maximum(square, 1e-300), strict=True))
    variables = variables_of(list(found.dictionary.force_forms.steps.model.controls), data, fit.path.z)
    rows = [
        row | {"explained": row["explained"] * varying[row["channel"]]} for row in by_variable(variables, samples)[0]
    ]
    return tuple(row for row in sorted(rows, key=lambda row: -row["explained"]) if row["explained"] > FOLLOWED)


def _times(data: GriddedTrials, force: np.ndarray, mass: np.ndarray, n: int) -> tuple[UnexplainedTime, ...]:
    """The stretches of n steps with most energy of the force, the strongest first, one of each trial at the most."""
    energy = force**2 / mass
    if not energy.any():
        return ()
    best: dict[int, tuple[float, int, int]] = {}
    for w, steps in enumerate(data.steps):
        length = min(n, int(steps))
        sums = np.concatenate([[0.0], energy[:steps, w].sum(axis=1).cumsum()])
        means = (sums[length:] - sums[:-length]) / length
        k = int(np.argmax(means))
        row = (float(means[k]), w, k)
        best[int(data.run[w])] = max(best.get(int(data.run[w]), row), row)
    rows = []
    for _, w, k in sorted(best.values(), reverse=True)[:MOST]:
        part = force[k : k + n, w][: data.steps[w] - k]
        c = int(np.argmax((part**2).mean(axis=0) / mass))
        begin, end = data.t[k, w], data.t[min(k + n, data.steps[w]), w]
        rms = math.sqrt(float((part[:, c] ** 2).mean()))
        name = data.trials[data.run[w]]
        rows.append(
            UnexplainedTime(name, float(begin), float(end), CHANNELS[c], rms, float(part[:, c].mean()), UNITS[c])
        )
    return tuple(rows)
