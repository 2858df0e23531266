"""Maximum a posteriori estimate of path, latent force and free parameters, with the sizes of the noise.

Each iteration linearises the model about the present path, whitens by a Kalman filter, takes a Gauss-Newton step in the
free parameters, smooths path and latent force, and updates the noise: by the fixed point of its likelihood equations
while parameters are far from the optimum, then by its average information.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Linearisation, Point, initial_trajectory, linearised_if_finite
from diagnosis.estimation.noise_sizes import initial_noise, noise_step, updated_noise
from diagnosis.estimation.parameters import Priors, active_states, set_values
from diagnosis.estimation.transition_model import TransitionModel
from fitting.solvers.condensing import within_bounds
from fitting.solvers.control import check_time
from mmg.errors import UserError
from mmg.ship import Ship

BREAKS_DOWN = (
    "the model breaks down along these trials from its coefficients as they are (it explodes, or a column has no noise "
    "at all): fit it first, and check the trials with `mmg check`"
)


# Gain of log likelihood, expected of an iteration or made by the last one, up to which a rough fit ends; hypotheses
# differ by more. Set by hand.
ROUGH = 0.15
# Expected gain of log likelihood by the parameters up to which the noise goes by its average information.
NEAR = 30.0  # set by hand
# Iterations without a gain after which a fit ends: the slope does not hold along the step, as at a bend.
IN_VAIN = 3  # set by hand
# Of a linearisation and the gain that is expected from it: whether a fit may end there, not converged.
IsEnough = Callable[[Linearisation, float], bool]


def never(here: Linearisation, gain: float) -> bool:
    """No fit ends early. here, gain: as of ``IsEnough``."""
    return False


class BrokenModelError(UserError):
    """The model cannot be followed along the trials from its first coefficients."""


@dataclass(frozen=True)
class Estimate(Point):
    """A fitted point.

    covariance: (P, P) of p; nll: negative log likelihood without constants, the prior of p included;
    iterations: linearisations used; converged: whether the last was expected to gain less than the tolerance.
    """

    covariance: np.ndarray
    nll: float
    iterations: int
    converged: bool

    def value(self, symbol: str, run: int | None = None) -> float:
        """Value of a free parameter [its unit]; symbol: of the ship; run: number of its run, or None."""
        i = self.free.columns.index(Column(symbol, run))
        return float(self.free.mean[i] + self.free.std[i] * self.p[i])

    def std(self, symbol: str, run: int | None = None) -> float:
        """Standard error of a free parameter [its unit]; symbol: of the ship; run: number of its run, or None."""
        i = self.free.columns.index(Column(symbol, run))
        return float(self.free.std[i] * np.sqrt(self.covariance[i, i]))


def initial_point(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    free: Priors,
    noise: NoiseModel,
    p: np.ndarray | None = None,
) -> Point:
    """A point on the measured path of ``data`` from which ``estimate`` may start.

    steps: model; theta: coefficients (all,) or (all, R); free: priors; noise: initial sizes; p: (P,) values less the
    prior mean [prior std] (default: the mean), moved into the bounds.
    """
    low, high = free.scaled_bounds
    p = np.clip(np.zeros(len(low)) if p is None else p, low, high)
    theta = set_values(steps.ship, data, theta, free.columns, free.mean + free.std * p)
    return Point(theta, free, p, initial_trajectory(steps, data, theta), noise)


@dataclass(frozen=True)
class _Iteration:
    """A point with its nll, the Gauss-Newton step from it: dp, dz (K + 1, R, S) and dforce (K + 1, R, 3 or 5) of latent
    force and gusts; the information A (P, P) and the expected gain; the noise after its own step, and the gain that is
    expected from this, infinite far from the optimum."""

    at: Point
    nll: float
    dp: np.ndarray
    dz: np.ndarray
    dforce: np.ndarray
    A: np.ndarray
    gain: float
    noise: NoiseModel
    noise_gain: float

    def moved(self, ship: Ship, data: GriddedTrials, share: float, noise: NoiseModel) -> Point:
        """A share of the way, with this noise."""
        path = self.at.path.moved(self.at.path.z + share * self.dz, share * self.dforce, data.gusts)
        return replace(self.at.with_values(ship, data, self.at.p + share * self.dp), path=path, noise=noise)


def _iteration(here: Linearisation, typical: NoiseModel | None) -> _Iteration:
    """The Gauss-Newton step from a linearisation; typical: sizes of the noise, None where it stays as it is."""
    at, active = here.at, here.active
    flat = here.white.reshape(-1, len(at.p) + 1)
    gram = flat.T @ flat
    A = gram[:-1, :-1] + np.eye(len(at.p))  # p is in prior standard deviations
    slope = gram[:-1, -1] + at.p + here.logdet_gradient.sum(axis=0)
    low, high = at.free.scaled_bounds
    dp = within_bounds(A, slope, low - at.p, high - at.p)  # the Gauss-Newton step where bounds allow it
    mean, r, u = here.smoothed(dp)
    dz, count = np.zeros_like(at.path.z), len(active)
    dz[..., active] = mean[..., :count]
    gain = -float(slope @ dp + 0.5 * dp @ A @ dp)  # of log likelihood, by the quadratic model
    noise, more = at.noise, 0.0
    if typical is not None and gain < NEAR:  # average information holds near the optimum alone
        noise, more = noise_step(here, r, u, typical)
    elif typical is not None:
        noise, more = updated_noise(here, r, u, typical), np.inf
    return _Iteration(at, here.nll, dp, dz, mean[..., count : count + 5], A, gain, noise, more)


@np.errstate(all="ignore")
def estimate(
    steps: TransitionModel,
    data: GriddedTrials,
    start: Point,
    iterations: int = 8,
    tolerance: float = 0.05,
    fixed_noise: bool = False,
    is_rough: bool = False,
    is_enough: IsEnough = never,
) -> Estimate:
    """Fit the free parameters of ``start``, path, latent force and noise to ``data`` by the model ``steps``.

    Stops when an iteration is expected to gain less than ``tolerance`` of log likelihood, after at most ``iterations``
    linearisations or IN_VAIN iterations that gained less than the tolerance. fixed_noise: the noise stays as it is;
    is_rough: it stops, not converged, where less than ROUGH is expected or was gained; is_enough: or where this says so
    of a linearisation and the gain that is expected of the parameters. Returns the likeliest accepted point. Raises
    BrokenModelError where the model cannot be followed along the trials from its first coefficients, and
    OutOfTimeError.
    """
    active = active_states(steps, start.free.symbols, start.theta)
    typical = initial_noise(steps.ship)
    now = start.with_values(steps.ship, data, start.p)
    best: _Iteration | None = None
    likeliest: _Iteration | None = None
    share, reductions, converged, used, in_vain = 1.0, 0, False, 0, 0
    while used < iterations and not converged and in_vain < IN_VAIN:
        check_time()
        used += 1
        here = linearised_if_finite(steps, data, now, active)
        if here is None and best is None:
            raise BrokenModelError(f"{steps.ship.name}: {BREAKS_DOWN}")
        if best is not None and (
            # not <: nan is worse
            here is None or (not here.nll < best.nll + 0.5 * tolerance + 0.05 * best.gain and reductions < 2)
        ):
            reductions, share = reductions + 1, 0.3 * share  # after two, a worse point is taken: the valley may bend
            now = best.moved(steps.ship, data, share, best.at.noise.towards(best.noise, share))
            continue
        assert here is not None
        share, reductions = 1.0, 0
        before = np.inf if best is None else best.nll
        best = _iteration(here, None if fixed_noise else typical)
        in_vain = 0 if likeliest is None or best.nll < likeliest.nll - tolerance else in_vain + 1
        likeliest = best if likeliest is None or best.nll < likeliest.nll else likeliest
        left = best.gain + best.noise_gain
        converged = left < tolerance
        is_settled = min(left, before - best.nll) < ROUGH
        if is_enough(here, best.gain) or (is_rough and is_settled):
            break
        now = best.moved(steps.ship, data, 1.0, best.noise)
    assert likeliest is not None  # a slope may be far off near a bend of the model, and the last point worse
    at, A = likeliest.at, likeliest.A
    return Estimate(at.theta, at.free, at.p, at.path, at.noise, np.linalg.inv(A), likeliest.nll, used, converged)
