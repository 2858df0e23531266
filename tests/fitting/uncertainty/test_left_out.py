"""What stretches that were left out of the trials were worth."""

from __future__ import annotations

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import inside
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions, calibrate
from fitting.result import read_fit
from fitting.settings import Settings
from tests.support.calibrated import FREE, small_result


@pytest.mark.slow
def test_a_calibration_says_what_it_left_out_and_what_that_was_worth(tmp_path) -> None:  # type: ignore[no-untyped-def]
    start = load_ship("esso_osaka_3m")
    start = start.fixing([s for s in start.symbols if s not in FREE])
    train, held_out = demo_trials(3)
    rows = inside(train[0], [(50.0, 58.0)])
    broken = train[0].with_columns(psi=train[0]["psi"] + np.where(rows, 0.3, 0.0))
    (kept,) = TrialSet.of([broken]).sound
    assert kept.whole is broken
    settings, options = Settings(passes=2, compiled=False), FitOptions(next_trial=False, instruments=())
    result = calibrate(start, [kept], held_out[-1:], settings, options)
    worth = result.left_out
    assert worth is not None and list(worth["trials"]) == [broken.name] and 7.0 < worth["seconds"] < 13.0
    errors = worth["scores"]["training"]["window"]
    assert errors["with"] > errors["without"] == pytest.approx(result.scores["training"].after.window)
    assert "validation" not in worth["scores"]
    (message,) = [m for m in result.warnings if m.code == "left_out_worth"]
    assert "30 s" in message and broken.name not in message
    assert read_fit(result.save(tmp_path / "run").folder).left_out == worth
    assert broken.name in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_a_calibration_of_whole_trials_has_nothing_to_say() -> None:
    assert small_result().left_out is None
    assert not [m for m in small_result().warnings if m.code == "left_out_worth"]
