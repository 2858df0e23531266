"""The first fit of a diagnosis: from the ship's coefficients or, where she explodes with them, from her priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.first_fit import fit_without_effects
from diagnosis.estimation.map_estimate import BrokenModelError
from diagnosis.estimation.noise_sizes import initial_noise
from tests.diagnosis.judgement.test_verdict import ready


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
