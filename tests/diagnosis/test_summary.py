"""Sizes of effects carry what the trials leave open and what the formula of the effect does."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.hypotheses.refit import refit
from diagnosis.summary import estimated, fitted_ship, parameters_of
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import SHIP, candidate, full_model, pushed_problem


@pytest.mark.slow
def test_the_uncertainty_of_a_formula_is_in_the_standard_errors_of_its_sizes() -> None:
    problem, null = pushed_problem(1, "wave_drift:x=0.45,y=-0.35")
    drift, offset = candidate("wave_drift"), candidate("rudder_offset")
    assert EFFECTS["wave_drift"].form_error > 0 and EFFECTS["rudder_offset"].form_error == 0
    effects = [drift, offset]
    start = {c: v for e in effects for c, v in zip(e.columns, e.neutral, strict=True)}
    fit = refit(problem, null, effects, start)
    sizes = parameters_of(full_model(), fit, drift)
    for symbol in ("x", "y"):
        by_trials = estimated(fit, f"wave_drift.{symbol}")
        assert sizes[symbol].value == by_trials.value
        form = EFFECTS["wave_drift"].form_error * abs(by_trials.value)
        assert sizes[symbol].std == pytest.approx(np.hypot(by_trials.std, form))
        ship = fitted_ship(SHIP, full_model(), fit, effects)
        assert ship.coefficients[f"wave_drift.{symbol}"].std == sizes[symbol].std
    assert parameters_of(full_model(), fit, offset)["delta"].std == estimated(fit, "rudder_offset.delta").std
    lag = candidate("rudder_lag")
    late = refit(problem, null, [lag], {lag.columns[0]: 0.2})
    (sure,), (doubtful,) = (parameters_of(full_model(), late, lag, error).values() for error in (0.0, 0.3))
    assert doubtful.std == pytest.approx(np.hypot(sure.std, 0.3))
    assert parameters_of(full_model(), fit, drift, 0.3) == sizes
