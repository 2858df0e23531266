"""Whether the latent force is the same forwards and backwards in time.

Its model is three processes of first order that know nothing of each other, and any sum of random forces of a common
memory looks the same when time runs backwards. A cause that was not modelled often does not: a ship that passes by
pushes first and turns then, a stream that turns pushes along the ship before it pushes across. So a force in one
direction that is followed by one in another is more than chance. The test is the score of a turning of the latent force
in the plane of each pair of channels, in units of their sizes, which leaves their sizes and memory as they are (drift
matrix I / tau + antisymmetric part; Gardiner 2009, Stochastic Methods, section 5.3.6: without detailed balance).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from cases.evidence.tails import f_tail
from diagnosis.estimation.filtering import fastest
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns, Filtered, LinearSystem, NoiseModel, observations
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel

# Channels of the latent force, two by two.
PAIRS = (("surge force", "sway force"), ("surge force", "yaw moment"), ("sway force", "yaw moment"))
DRAWS = 100  # Simulated campaigns for the law of the scores. Set by hand: it bounds time.
TOGETHER = 25  # Campaigns filtered at a time. Set by hand: it bounds memory.
STEP = 0.1  # Of the differences for the scores [rad over a memory of the force]. Set by hand.

# Probability by chance below which channels that follow each other are no random force. Set by hand; without the test 3
# of 400 open cases lose their answer and none gains (row ``force order`` of benchmarks/ablation.md).
LEVEL_OF_ORDER = 0.003


@dataclass(frozen=True)
class ForceOrder:
    """How one channel of the latent force follows another.

    p_value: probability that independent random forces look as ordered; turning: (3,) estimated angles over a memory of
    the force [rad] in the planes of PAIRS; scores: (3,) each over its standard deviation by chance.
    """

    p_value: float
    turning: np.ndarray
    scores: np.ndarray

    @property
    def is_random(self) -> bool:
        """Whether chance explains it."""
        return self.p_value >= LEVEL_OF_ORDER

    @property
    def pair(self) -> tuple[str, str]:
        """The two channels that follow each other most clearly."""
        return PAIRS[int(np.abs(self.scores).argmax())]


@np.errstate(all="ignore")
def force_order(steps: TransitionModel, data: GriddedTrials, fit: Estimate) -> ForceOrder:
    """Test a ``fit`` of ``steps`` to ``data``. Returns the test."""
    active = active_states(steps, fit.free.symbols, fit.theta)
    here = linearise_and_filter(steps, data, fit.fixed(), active)
    return order_of(here.system, here.filter, here.left, fit.noise, data.h)


def order_of(
    system: LinearSystem, run: Filtered, white: np.ndarray, noise: NoiseModel, h: float, seed: int = 0
) -> ForceOrder:
    """Test of whitened residuals.

    system, run: linear model of the trials and its filter run; white: (K + 1, R, 6) residuals; noise: with the latent
    force of the system; h: step [s]; seed: of the draws that give the law of the scores. Returns the test.
    """

    def parts() -> Iterator[np.ndarray]:
        rng = np.random.default_rng(seed)
        yield white[..., None]
        for _ in range(DRAWS // TOGETHER):
            yield rng.standard_normal((*white.shape, TOGETHER))

    scores = turning_scores(system, run, noise, h, parts)
    return order_by_law(scores[:, 0], scores[:, 1:])


def order_by_law(score: np.ndarray, drawn: np.ndarray) -> ForceOrder:
    """Test of a score (3,) whose law is that of ``drawn`` (3, draws): Hotelling's T squared with the mean known."""
    draws = drawn.shape[1]
    covariance = drawn @ drawn.T / draws
    turning = -np.linalg.solve(covariance, score)  # a step of Fisher scoring from no turning
    T2 = -float(turning @ score)
    # T^2 (d - 2) / (3 d) is F with 3 and d - 2 degrees, d draws
    p = f_tail(float(T2) * (draws - 2) / (3 * draws), 3, draws - 2)
    return ForceOrder(p, turning, score / np.sqrt(np.diag(covariance)))


def turning_scores(
    system: LinearSystem, run: Filtered, noise: NoiseModel, h: float, parts: Callable[[], Iterator[np.ndarray]]
) -> np.ndarray:
    """Slopes (3, c) of the negative log likelihood by the turning in the planes of PAIRS, at none.

    system, run, noise, h: as of ``order_of``; parts: yields whitened residuals (K + 1, R, 6, some), c in all.
    """
    others = [with_turning(system, noise, h, way * STEP * pair) for pair in np.eye(3) for way in (1, -1)]
    again = [fastest().filtered(other) for other in others]
    (K, R), values = system.T.shape[:2], []
    for white in parts():
        logged = observations(system, run, np.where(system.good[..., None], white, 0.0))
        column = DrivenColumns.dense(np.zeros((K, R, 0, white.shape[3])), -logged)
        own = (fastest().whitened(other, one, column)[0] for other, one in zip(others, again, strict=True))
        values.append([0.5 * (found**2).sum(axis=(0, 1, 2)) for found in own])
    ends = np.concatenate(values, axis=1) + 0.5 * np.array([[one.log_det.sum()] for one in again])
    return np.asarray((ends[::2] - ends[1::2]) / (2 * STEP))


def with_turning(system: LinearSystem, noise: NoiseModel, h: float, turning: np.ndarray) -> LinearSystem:
    """The ``system`` with a latent force whose channels follow each other.

    noise: sizes and memory of the force; h: step [s]; turning: (3,) angles over a memory in the planes of PAIRS [rad].
    The force's covariance stays what it is, and so does that of what drives it.
    """
    skew, force = np.zeros((3, 3)), noise.force
    skew[(0, 0, 1), (1, 2, 2)] = turning  # planes XY, XN, YN
    # exp(-(I + A) h / tau), in units of the sizes
    block = np.exp(-h / noise.tau) * force[:, None] * expm(-h / noise.tau * (skew - skew.T)) / force
    S, T = system.S, system.T.copy()
    T[:, :, S : S + 3, S : S + 3] = np.where(system.inside[..., None, None], block, np.eye(3))
    return replace(system, T=T)
