"""Random forces along the runs are kept where runs left out become better, and what was found is said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.selection import disturbance_choice
from fitting.selection.disturbance_choice import EFFECT, choose_disturbance
from fitting.selection.left_out_runs import RunScores, leave_out
from fitting.settings import Settings
from mmg.messages import has_code
from mmg.ship import Ship

FREE = ("X_0F", "Y_v", "N_r")


def ship() -> Ship:
    start = load_ship("esso_osaka_3m")
    return start.fixing([s for s in start.symbols if s not in FREE])


@cache
def trials() -> tuple[Trial, ...]:
    return tuple(demo_trials(3, dt=0.5)[0][:4])


@cache
def found() -> Calibration:
    return estimate_coefficients(ship(), trials(), Settings(passes=2))


@pytest.mark.parametrize(("factor", "kept"), [(0.9, True), (1.0, False), (1.2, False)])
def test_forces_are_kept_where_runs_left_out_become_better(
    factor: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = leave_out(found(), trials())

    def judged(calibration: Calibration, *rest: Any) -> RunScores:
        by = factor if EFFECT in calibration.problem.ship.effects else 1.0
        return replace(scores, window=by * scores.window, paper=by * scores.paper)

    monkeypatch.setattr(disturbance_choice, "leave_out", judged)
    chosen, model = choose_disturbance(found(), ship(), trials())
    assert (EFFECT in chosen.ship.effects) is kept is (EFFECT in model.effects)
    (message,) = (m for m in chosen.notices if has_code([m], "disturbance_chosen"))
    assert message.startswith(f"random forces along the runs {'kept' if kept else 'left out'}: runs left out")


def test_too_few_runs_try_nothing_and_say_so() -> None:
    chosen, model = choose_disturbance(found(), ship(), trials()[:3])
    assert EFFECT not in model.effects and "were not tried" in chosen.notices[-1]


def test_forces_that_were_asked_for_stay() -> None:
    pushed = ship().with_effect(EFFECT)
    assert choose_disturbance(found(), pushed, trials()) == (found(), pushed)
