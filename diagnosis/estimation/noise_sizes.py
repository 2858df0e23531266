"""Sizes of the noise: the initial ones, their bounds, and two ways to better ones.

Far from the optimum of the coefficients they go by the fixed point of their likelihood equations (expectation-
maximisation), near it by their average information. With the residuals e and their covariance V, the sum of a part V_i
for each variance, half the logarithm of V's determinant and half e' V^-1 e have by the logarithm of a variance the
slope (tr V^-1 V_i - e' V^-1 V_i V^-1 e) / 2. The mean of the observed and the expected information on two of them is
e' V^-1 V_i V^-1 V_j V^-1 e / 2, which needs only whitened columns (Gilmour, Thompson & Cullis 1995): each is the
response to what the smoother makes of one source of noise. Steps with it come to the optimum in a few iterations, where
those of the fixed point take dozens.
"""

from __future__ import annotations

import numpy as np

from diagnosis.estimation.filtering import fastest
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import DrivenColumns, NoiseModel
from diagnosis.estimation.linearisation import Linearisation
from mmg.motion.froude import force_scale, length_scale, state_scale, time_scale
from mmg.ship import Ship

LEAST = 0.02  # Least size of a sensor's errors, in that of ``initial_noise``. Set by hand.
# Largest size of the latent force, in that of ``initial_noise``: a larger one, which would swallow all that moves the
# ship, is none of chance. Set by hand.
MOST = 15.0
GUST = (1e-3, 0.5)  # Least and largest size of gusts, in the speed of the wind. Set by hand.
# Least size of the latent force, in that of ``initial_noise``. One that is larger than the truth makes the residuals
# smaller than the filter expects, and then the likelihood grows with the masses, which such a force moves less: in
# trials without any random force 0.02 named ``draft``. So it was measured.
LEAST_FORCE = 1e-3


def initial_noise(ship: Ship) -> NoiseModel:
    """Initial sizes for a ``ship``: those of a 3 m model scaled by Froude's law."""
    length = float(ship.particulars["L"])
    force = np.array([0.2, 0.3, 0.2 * length_scale(length)]) * force_scale(length)  # [N, N, N m]
    white = np.array([0.02, 0.02, 0.003, 0.006, 0.006, 0.001]) * state_scale(length)  # [m, m, rad, m/s, m/s, rad/s]
    return NoiseModel(force, 6.0 * time_scale(length), white, gust_tau=time_scale(length))


def least_noise(ship: Ship) -> NoiseModel:
    """Sizes below which no estimate for a ``ship`` goes: LEAST and LEAST_FORCE of the initial ones."""
    typical = initial_noise(ship)
    return typical.with_(force=LEAST_FORCE * typical.force, white=LEAST * typical.white)


def wider(known: NoiseModel, ship: Ship) -> NoiseModel:
    """First sizes for trials of a ``ship`` that had the sizes ``known`` in others: none below the initial ones.

    A fit that begins with hardly any noise makes coefficients explain an unmodelled effect, and ends far from the ship.
    """
    first = initial_noise(ship)
    force, white = np.maximum(known.force, first.force), np.maximum(known.white, first.white)
    return known.with_(force=force, white=white, gust=np.maximum(known.gust, first.gust))


def swallows(noise: NoiseModel, ship: Ship) -> bool:
    """Whether the force of ``noise`` comes near the most that is allowed for a ``ship``."""
    return bool((noise.force > 0.5 * MOST * initial_noise(ship).force).any())


# Least size of the latent force, in the force of the gusts: they are not the same all along a ship, and wind
# coefficients are not exact. In a single run gusts would leave nothing of it, and a model that is sure of that sees
# effects. Set by hand.
BESIDE_GUSTS = 0.2


def least_force(noise: NoiseModel, data: GriddedTrials, typical: NoiseModel) -> np.ndarray:
    """Least size (3,) [N, N, N m] of the latent force of trials ``data`` whose gusts have the sizes of ``noise``;
    typical: sizes by ``initial_noise``."""
    least = LEAST_FORCE * typical.force
    if data.gusts is None:
        return least
    blown = (data.gusts[data.inside] ** 2).mean(axis=0) @ noise.gust**2  # (3,) mean square of their force
    return np.asarray(np.maximum(least, BESIDE_GUSTS * np.sqrt(blown)))


# Least and largest change of the logarithm of a variance in one step: factors of 20 down and 4 up. Set by hand.
SHORTEST, LONGEST = -3.0, 1.4
# Share of each information that is added to it, and as much again: sources that look alike are not told apart.
RIDGE = 1e-3, 1e-6  # set by hand


def _sizes_and_bounds(here: Linearisation, typical: NoiseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The sizes (q,) that drive the system of ``here``, and their bounds: force, gusts where the trials have any,
    white errors (6). typical: sizes by ``initial_noise``."""
    noise = here.at.noise
    gust = noise.gust if here.data.gusts is not None else np.zeros(0)
    sizes = np.concatenate([noise.force, gust, noise.white])
    least = least_force(noise, here.data, typical)
    lower = np.concatenate([least, np.full(len(gust), GUST[0]), LEAST * typical.white])
    upper = np.full(len(sizes), np.inf)
    upper[: 3 + len(gust)] = [*MOST * typical.force, *np.full(len(gust), GUST[1])]
    return sizes, lower, upper


def _with_sizes(here: Linearisation, sizes: np.ndarray) -> NoiseModel:
    """The noise of ``here`` with other ``sizes`` (q,), in the order of ``_sizes_and_bounds``."""
    force, gust, white = np.split(sizes, [3, len(sizes) - 6])
    return here.at.noise.with_(force=force, white=white, gust=gust if len(gust) else here.at.noise.gust)


def _squares(here: Linearisation, r: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums (q,) of the squares of what each source makes of r (K, R, n) and u (K + 1, R, 6), and their expectations."""
    A = len(here.active)
    parts = ((r[..., A:] ** 2, u**2), (here.adjoint.N[..., A:], here.adjoint.D))
    made, expected = (np.concatenate([x.sum(axis=(0, 1)) for x in own]) for own in parts)
    return made, expected


def updated_noise(here: Linearisation, r: np.ndarray, u: np.ndarray, typical: NoiseModel) -> NoiseModel:
    """The sizes of the noise of a linearisation ``here`` after one step of the fixed point q <- q sum r^2 / sum N
    (force, gusts) and R <- R sum u^2 / sum D.

    r: (K, R, n), u: (K + 1, R, 6) of the smoother; typical: sizes by ``initial_noise``, which bound those returned.
    """
    (sizes, lower, upper), (made, expected) = _sizes_and_bounds(here, typical), _squares(here, r, u)
    # far off it overshoots
    ratio = np.clip(np.where(expected > 0, made / np.maximum(expected, 1e-300), 1.0), 0.1, 10.0)
    return _with_sizes(here, np.clip(sizes * np.sqrt(ratio), lower, upper))


def noise_step(here: Linearisation, r: np.ndarray, u: np.ndarray, typical: NoiseModel) -> tuple[NoiseModel, float]:
    """As ``updated_noise`` by the average information, and the gain of log likelihood that is expected from it.

    here, typical: as there; r: (K, R, n), u: (K + 1, R, 6) of the smoother.
    """
    sizes, lower, upper = _sizes_and_bounds(here, typical)
    slope, information = slope_and_information(here, r, u)
    free = ~((sizes <= lower) & (slope > 0)) & ~((sizes >= upper) & (slope < 0))  # at a bound and pushed against it
    own_information = information[np.ix_(free, free)]
    own_information += np.diag(RIDGE[0] * np.diag(own_information) + RIDGE[1])
    step = np.zeros(len(sizes))
    step[free] = np.clip(-np.linalg.solve(own_information, slope[free]), SHORTEST, LONGEST)
    gain = -float(slope @ step + 0.5 * step @ information @ step)  # of the quadratic model
    new = _with_sizes(here, np.clip(sizes * np.exp(0.5 * step), lower, upper))  # steps are of log variances
    # its bound moved with the gusts
    return new.with_(force=np.maximum(new.force, least_force(new, here.data, typical))), gain


def slope_and_information(here: Linearisation, r: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope (q,) of the negative log likelihood by the logarithms of the variances that drive the system of ``here``,
    without those of its first states, and their average information (q, q), in the order of ``_sizes_and_bounds``.

    r: (K, R, n), u: (K + 1, R, 6) of the smoother.
    """
    system, A = here.system, len(here.active)
    (K, R, n), random = system.T.shape[:3], system.T.shape[2] - A
    made, expected = _squares(here, r, u)
    # by logarithms: variance times derivative
    slope = 0.5 * np.concatenate([system.Q[A:], system.R]) * (expected - made)
    forcing, observed = np.zeros((K, R, n, random + 6)), np.zeros((K + 1, R, 6, 6))
    at, each = np.arange(random), np.arange(6)
    forcing[:, :, A + at, at] = system.Q[A:] * r[..., A:]
    observed[:, :, each, each] = system.R * u
    columns = DrivenColumns(forcing, observed, random + each)
    white = fastest().whitened(system, here.filter, columns, rows=here.rows)[0].reshape(-1, random + 6)
    return slope, 0.5 * white.T @ white
