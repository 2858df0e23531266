"""Trials that are little but gaps: no statistic of nothing, and no warning of numpy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from cases.checks import check
from cases.trial import Trial
from fitting.prediction.score import pooled_sigma
from mmg.errors import TooFewData
from tests.support.trial_files import motion_columns


@pytest.mark.parametrize("share", [0.5, 0.9, 0.97, 0.99])
@pytest.mark.parametrize("seed", range(4))
def test_a_trial_of_gaps_is_checked_in_silence(share: float, seed: int) -> None:
    columns, rng = motion_columns(60.0), np.random.default_rng(seed)
    rows = len(columns["t"])
    holes = {k: v if k == "t" else np.where(rng.random(rows) < share, np.nan, v) for k, v in columns.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check([Trial("gaps", holes)])


def test_rows_that_are_never_whole_have_no_sigma() -> None:
    columns = motion_columns(60.0)
    odd = np.arange(len(columns["t"])) % 2 == 0
    columns |= {"u": np.where(odd, np.nan, columns["u"]), "v": np.where(odd, columns["v"], np.nan)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(TooFewData):
            pooled_sigma([Trial("gaps", columns)])
