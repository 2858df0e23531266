"""Whether the latent force is as large whatever the ship does.

Its model is a random force of one size. Runs and headings may differ in it, as gusts and waves do. A force that is
larger while the ship turns, drifts or steers is none of the weather: the model errs there, in a way that no form of the
dictionary follows (vortices that are shed, a bearing that sticks, a place where the position jumps). The test is the
score of heterogeneous variance by parts of the trials: the slope of the likelihood by the logarithm of the force's
variance in each part, from the squares of the smoothed disturbances over their expectation (Durbin & Koopman 2012,
section 7.3), once sizes by run and by heading make these agree in the mean. Its law is that of simulated campaigns, in
which the coefficients are fitted to first order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import Filtered, LinearSystem, adjoint
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.location.partings import OUTSIDE, partings

CHANNELS = ("surge force", "sway force", "yaw moment")
"""Channels of the latent force."""
DRAWS, TOGETHER = 400, 25
"""Simulated campaigns for the law of the scores, and how many are smoothed at a time."""
LEAST = 20
"""Steps of a part that counts."""
KEPT = 0.02
"""Least variance of a combination of scores that counts, in that of the largest, sizes by run and heading being one."""
TAIL = 0.25
"""Share of the draws that tells how the law goes on beyond them: sums of few squares have longer tails than those of
many, and the largest of several ways of parting is asked for."""
ROUNDS, SMALLEST = 3, 1e-3
"""Rounds over the sizes by run and heading, and the least of them."""
LEVEL_OF_STEADINESS = 1e-4
"""Probability by chance below which a force that is larger in one part of the trials is none of chance. It is low since
the law is that of the fitted model: errors of sensors with a memory and gusts are not in it, and 2 of 21 cases of
benchmarks.blind without an effect had less than 0.01."""


@dataclass(frozen=True)
class ForceSteadiness:
    """How the size of the latent force differs with what the ship does.

    p_value: probability that a steady random force differs as much, over all ways of parting; parted_by: the way in
    which it differs most; channel: the channel that does.
    """

    p_value: float
    parted_by: str
    channel: str

    @property
    def is_random(self) -> bool:
        """Whether chance explains it."""
        return self.p_value >= LEVEL_OF_STEADINESS


@np.errstate(all="ignore")
def force_steadiness(steps: TransitionModel, data: GriddedTrials, found: Estimate, seed: int = 0) -> ForceSteadiness:
    """Test a fit ``found`` of ``steps`` to ``data``; seed: of the simulated campaigns. Returns the test."""
    active = active_states(steps, found.free.symbols, found.theta)
    here = linearise_and_filter(steps, data, found, active)
    at = slice(len(active), len(active) + 3)
    ways = {name: part[:-1] for name, part in partings(steps, data, found).items()}
    weather = [ways[name] for name in OUTSIDE[:2]]
    return steadiness_of(
        here.system,
        here.filter,
        here.white,
        at,
        {name: part for name, part in ways.items() if name not in OUTSIDE},
        weather,
        seed,
    )


def steadiness_of(
    system: LinearSystem,
    run: Filtered,
    white: np.ndarray,
    at: slice,
    ways: dict[str, np.ndarray],
    weather: list[np.ndarray],
    seed: int = 0,
) -> ForceSteadiness:
    """Test of whitened residuals.

    system, run: linear model of the trials and its filter run; white: (K + 1, R, 6, P + 1) columns of the free
    parameters per prior std and, last, the residuals; at: positions of the latent force among the states; ways: (K, R)
    number of the part of each step, by the name of the way, -1: none; weather: the same of ways in which the size may
    differ; seed: of the draws, whose scores give the law of those of the residuals. Returns the test.
    """
    expected = adjoint(system, run).N[..., at]
    there = system.inside.ravel()
    groups = np.concatenate([_members(part, there) for part in weather])
    members = {name: _members(part, there) for name, part in ways.items()}

    def scores(some: np.ndarray, of_one_size: bool = False) -> dict[str, np.ndarray]:
        square = _squares(system, run, some, at)
        sizes = 1.0 if of_one_size else _sizes(square, expected, groups)
        each = system.Q[at][:, None] * 0.5 * (square / sizes - expected[..., None])
        flat = each.reshape(len(there), -1)
        return {name: (m @ flat).reshape(-1, some.shape[3]) for name, m in members.items() if len(m) > 1}

    rng = np.random.default_rng(seed)
    columns = np.where(system.good[..., None], white[..., :-1], 0.0)
    drawn: list[dict[str, np.ndarray]] = []
    alike: dict[str, np.ndarray] = {}
    for some in _campaigns(rng, columns, system.good):
        drawn.append(scores(some))
        alike = alike or scores(some, True)
    own, law = scores(white[..., -1:]), {n: np.concatenate([d[n] for d in drawn], axis=1) for n in drawn[0]}
    if not own:
        return ForceSteadiness(1.0, "", "")
    rarity = {name: _rarity(np.hstack([score, law[name]]), law[name], alike[name]) for name, score in own.items()}
    most = np.max(list(rarity.values()), axis=0)
    worst = max(rarity, key=lambda name: rarity[name][0])
    each = own[worst][:, 0] / np.sqrt(np.maximum((law[worst] ** 2).mean(axis=1), 1e-300))
    channel = int(np.argmax((each.reshape(-1, 3) ** 2).sum(axis=0)))
    return ForceSteadiness(_beyond(most[0], most[1:]), worst, CHANNELS[channel])


def _campaigns(rng: np.random.Generator, columns: np.ndarray, good: np.ndarray) -> Iterator[np.ndarray]:
    """Whitened residuals (K + 1, R, 6, TOGETHER) of simulated and fitted campaigns, DRAWS of them in all.

    columns: (K + 1, R, 6, P) of the free parameters, which are drawn from their priors and fitted: where few samples
    tell a parameter, it takes most of their errors.
    """
    J = columns.reshape(good.size, columns.shape[3])
    A = J.T @ J + np.eye(J.shape[1])
    for _ in range(DRAWS // TOGETHER):
        noise = np.where(good[..., None], rng.standard_normal((*good.shape, TOGETHER)), 0.0).reshape(-1, TOGETHER)
        seen = noise + J @ rng.standard_normal((J.shape[1], TOGETHER))
        yield (seen - J @ np.linalg.solve(A, J.T @ seen)).reshape(*good.shape, TOGETHER)


def _members(part: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Which of the steps (K R,) belong to each part (parts, K R) of a way (K, R) that has enough of them; there: (K R,)
    those that exist."""
    number = np.where(there, part.ravel(), -1)
    every = [number == g for g in np.unique(number) if g >= 0]
    return np.array([m for m in every if m.sum() >= LEAST], dtype=float).reshape(-1, len(there))


def _squares(system: LinearSystem, run: Filtered, white: np.ndarray, at: slice) -> np.ndarray:
    """Squares (K, R, 3, c) of the smoother's r of the latent force, at the whitened residuals ``white`` (K + 1, R, 6,
    c): those of its smoothed disturbances over their squared variance."""
    K, R, n = system.T.shape[:3]
    v = run.root.swapaxes(2, 3) @ white
    r, square = np.zeros((R, n, white.shape[3])), np.empty((K, R, 3, white.shape[3]))
    for k in range(K, -1, -1):
        if k < K:
            square[k] = r[:, at] ** 2
            r = (system.T[k] - run.gain[k] @ system.Z[k]).swapaxes(1, 2) @ r
        r = r + system.Z[k].swapaxes(1, 2) @ v[k]
    return square


def _sizes(square: np.ndarray, expected: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Factors (K, R, 3, c), products of one for each of the ``groups`` (G, K R) and channel, with which the
    ``expected`` squares (K, R, 3) have the sums of ``square`` (K, R, 3, c) in each group (iterative proportional
    fitting)."""
    shape = square.shape
    top, bottom = square.reshape(len(groups[0]), -1), np.repeat(expected.reshape(-1, 3), shape[3], axis=1)
    factor = np.ones(top.shape)
    for _ in range(ROUNDS):
        for own in groups:
            at = own > 0
            ratio = top[at].sum(axis=0) / np.maximum((factor[at] * bottom[at]).sum(axis=0), 1e-300)
            factor[at] *= np.maximum(ratio, SMALLEST)
    return factor.reshape(shape)


def _rarity(scores: np.ndarray, law: np.ndarray, alike: np.ndarray) -> np.ndarray:
    """Negative logarithms (c,) of the probability of ``scores`` (3 parts, c) by the ``law`` of draws (3 parts, draws):
    Hotelling's T squared with the mean known, in the combinations that vary.

    alike: (3 parts, some) the same of draws whose size is one in all runs and headings: parts that are whole runs say
    nothing once these may differ.
    """
    draws = law.shape[1]
    values, vectors = np.linalg.eigh(law @ law.T / draws)
    before = np.linalg.eigvalsh(alike @ alike.T / alike.shape[1]).max()
    kept = values > KEPT * max(before, values.max(), 1e-300)
    m = int(kept.sum())
    if not m:
        return np.zeros(scores.shape[1])
    along = (vectors.T @ scores)[kept] / np.sqrt(values[kept])[:, None]
    return np.asarray(-np.log(fdtrc(m, draws - m + 1, (along**2).sum(axis=0) * (draws - m + 1) / (m * draws))))


def _beyond(value: float, law: np.ndarray) -> float:
    """Probability of a ``value`` by the ``law`` of draws (draws,): their share or, in the tail, that of an exponential
    law of what is beyond the threshold of it (Pickands 1975)."""
    threshold = float(np.quantile(law, 1 - TAIL))
    if value <= threshold:
        return float((law >= value).mean())
    scale = float((law[law > threshold] - threshold).mean())
    return TAIL * float(np.exp(-(value - threshold) / scale))
