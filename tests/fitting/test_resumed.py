"""Going on with an interrupted calibration that has values by campaign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.calibrate import check_resumable, iterate_of
from mmg.errors import UserError
from tests.support.calibrated import small_result

ROW = {"value": 0.9, "std": 0.1, "unit": "s", "prior_value": 0.3, "prior_std": 0.4}


def test_with_values_by_campaign_the_shared_coefficients_go_on() -> None:
    result = small_result(100)
    model, own = result.start, np.array([0.5, -0.5])
    iterate = {**result.iterate, "p": np.concatenate([result.iterate["p"], own])}
    values = {day: {"gyro.T": ROW} for day in ("2026-03-02", "2026-03-09")}
    differ = replace(result, iterate=iterate, campaigns={"values": values})
    begun = iterate_of(differ, model)
    assert begun is not None and set(begun) == {"p"}
    np.testing.assert_array_equal(begun["p"], result.iterate["p"])
    assert iterate_of(result, model) is result.iterate
    assert iterate_of(replace(differ, iterate=None), model) is None


def test_a_constant_that_campaigns_took_over_is_no_other_model_and_begins_anew() -> None:
    result = small_result(100)
    first = next(iter(result.coefficients))
    rest = {s: row for s, row in result.coefficients.items() if s != first}
    taken = replace(result, coefficients=rest, campaigns={"values": {"2026-03-02": {first: ROW}}})
    trials = result.objects.trials if result.objects else ()
    check_resumable(taken, result.start, trials)
    assert iterate_of(taken, result.start) is None
    with pytest.raises(UserError, match="--without, --fix and --only"):
        check_resumable(replace(taken, campaigns=None), result.start, trials)
