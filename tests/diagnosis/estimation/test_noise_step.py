"""Steps of a fit: where it begins, when it ends in vain, and the sizes of the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation import map_estimate, noise_sizes
from diagnosis.estimation.filtering import filtered, whitened
from diagnosis.estimation.first_fit import fit_without_effects
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Linearisation, linearise_and_filter
from diagnosis.estimation.map_estimate import BrokenModelError, estimate
from diagnosis.estimation.noise_sizes import initial_noise, least_force
from tests.diagnosis.estimation.test_latent import fitted
from tests.diagnosis.judgement.test_verdict import ready

SIZES = NoiseModel(np.array([0.1, 0.2, 0.07]), 5.0, np.array([0.02, 0.01, 0.003, 0.005, 0.007, 0.001]))


def nll(here: Linearisation, logs: np.ndarray) -> float:
    """Negative log likelihood of the residual with variances that are larger by the factors exp(logs)."""
    driven, A = len(logs) - 6, len(here.active)
    Q = here.system.Q.copy()
    Q[A:] *= np.exp(logs[:driven])
    system = replace(here.system, Q=Q, R=here.system.R * np.exp(logs[driven:]))
    run = filtered(system)
    return 0.5 * float(run.log_det.sum() + (whitened(system, run, here.residual)[0] ** 2).sum())


@pytest.mark.slow
def test_slopes_are_those_of_finite_differences() -> None:
    """About a fitted path with other sizes of the noise."""
    steps, data, found, _ = fitted(1)
    here = linearise_and_filter(steps, data, replace(found, noise=SIZES))
    slope, information = noise_sizes.slope_and_information(here, *here.smoothed()[1:])
    assert slope.shape == (9,) and information.shape == (9, 9)
    for i, step in enumerate(1e-4 * np.eye(9)):
        by_differences = (nll(here, step) - nll(here, -step)) / 2e-4
        assert slope[i] == pytest.approx(by_differences, rel=1e-5, abs=1e-3)


@pytest.mark.slow
def test_they_end_where_steps_of_the_fixed_point_end(monkeypatch: pytest.MonkeyPatch) -> None:
    steps, data, found, _ = fitted(1)
    for factor in (0.3, 3.0):
        noise = found.noise.with_(force=factor * found.noise.force, white=factor**0.6 * found.noise.white)
        fast = estimate(steps, data, replace(found.fixed(), noise=noise), 9)
        assert fast.converged
        with monkeypatch.context() as m:
            m.setattr(map_estimate, "NEAR", -1.0)  # none is near: the fixed point alone
            slow = estimate(steps, data, replace(found.fixed(), noise=noise), 60, tolerance=1e-6)
        assert abs(slow.nll - fast.nll) < 0.05
        sizes = np.concatenate([fast.noise.force / slow.noise.force, fast.noise.white / slow.noise.white])
        np.testing.assert_allclose(sizes, 1.0, atol=0.03)


def test_sizes_stay_within_their_limits() -> None:
    """Far from the optimum a step is shortened; at a limit that it would leave, a size stays."""
    steps, data, found, _ = fitted(1)
    typical = initial_noise(steps.ship)
    least = least_force(found.noise, data, typical)
    tiny = found.noise.with_(force=least.copy(), white=0.03 * found.noise.white)
    here = linearise_and_filter(steps, data, replace(found.fixed(), noise=tiny))
    new, gain = noise_sizes.noise_step(here, *here.smoothed()[1:], typical)
    assert gain > 0 and (new.force >= least).all() and (new.white >= noise_sizes.LEAST * typical.white).all()
    large = found.noise.with_(white=30.0 * found.noise.white)
    here = linearise_and_filter(steps, data, replace(found.fixed(), noise=large))
    new, _ = noise_sizes.noise_step(here, *here.smoothed()[1:], typical)
    assert np.log(new.white / large.white).min() == pytest.approx(0.5 * noise_sizes.SHORTEST)


@pytest.mark.slow
def test_a_fit_ends_where_that_is_enough_and_where_iterations_are_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    steps, data, found, _ = fitted(1)
    start = replace(found, p=found.p + 0.1)
    first = estimate(steps, data, start, 8, is_enough=lambda here, gain: gain > 0)
    assert first.iterations == 1 and not first.converged
    one_point = map_estimate.linearised_if_finite

    def no_better(*given: object) -> Linearisation | None:
        here = one_point(*given)  # type: ignore[arg-type]
        return None if here is None else replace(here, nll=0.0)

    monkeypatch.setattr(map_estimate, "linearised_if_finite", no_better)
    vain = estimate(steps, data, start, 30, tolerance=1e-9)
    assert vain.iterations == 1 + map_estimate.IN_VAIN and not vain.converged


def test_a_ship_that_explodes_is_fitted_from_her_priors(caplog: pytest.LogCaptureFixture) -> None:
    p = ready().problem
    unbounded = np.full(len(p.base.mean), np.inf)
    wide = replace(p.base, lower=-unbounded, upper=unbounded)
    values = p.steps.ship.values
    wrong = values.copy()
    wrong[p.steps.ship.symbols.index("Y_v")] = 1e7  # a sway force that grows with the sway
    noise = initial_noise(p.steps.ship)
    right = fit_without_effects(p.steps, p.data, values, wide, noise).null
    with caplog.at_level("INFO"):
        found = fit_without_effects(p.steps, p.data, wrong, wide, noise).null
    assert np.allclose(found.p, right.p, atol=0.1) and found.nll == pytest.approx(right.nll, abs=0.5)


def test_one_that_explodes_from_her_priors_too_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise BrokenModelError("esso: the model breaks down")

    monkeypatch.setattr("diagnosis.estimation.first_fit.estimate", broken)
    p = ready().problem
    with pytest.raises(BrokenModelError):
        fit_without_effects(p.steps, p.data, p.steps.ship.values, p.base, initial_noise(p.steps.ship))
