"""Measured manoeuvres with stretches left out: bridged, cut off before them, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from cases.criteria.imo import imo_figures_of_trials
from cases.io.leave_out import Span, left_out
from cases.trial import Trial
from mmg.errors import UserError
from mmg.messages import has_code
from mmg_ident import simulate

SHIP = "esso_osaka_3m"


@pytest.fixture(scope="module")
def zigzag() -> Trial:
    return simulate(SHIP, "zigzag:20/20", duration=200.0)


def figures(trial: Trial) -> dict[str, float | None]:
    return {row.figure: row.value for row in imo_figures_of_trials([trial], length=3.0).rows}


def times(trial: Trial) -> tuple[float, ...]:
    (run,) = imo_figures_of_trials([trial], length=3.0).runs
    return (run.order_time, *run.reversals)


def test_a_short_broken_stretch_is_bridged(zigzag: Trial) -> None:
    second = times(zigzag)[1]
    broken = left_out(zigzag, [(second - 2.0, second - 1.5)], "test")
    found = imo_figures_of_trials([broken], length=3.0)
    assert has_code(found.notices, "left_out") and has_code(found.notices, "bridged")
    sound = figures(zigzag)
    assert figures(broken).keys() == sound.keys()
    for name, value in figures(broken).items():
        assert value == pytest.approx(sound[name], rel=0.02), name


def test_a_zigzag_counts_up_to_the_reversal_before_a_stretch_that_decides(zigzag: Trial) -> None:
    last = times(zigzag)[3]
    broken = left_out(zigzag, [(last + 0.5, last + 25.0)], "test")
    found, sound = figures(broken), figures(zigzag)
    assert found["overshoot_1"] == pytest.approx(sound["overshoot_1"], rel=0.02)
    assert found.get("overshoot_3") is None and all(v is None or np.isfinite(v) for v in found.values())


@pytest.mark.parametrize("moved", [True, False])
def test_a_turn_with_a_stretch_that_decides_is_refused_in_a_line(moved: bool) -> None:
    trial = simulate(SHIP, "turning:35", duration=120.0)
    (run,) = imo_figures_of_trials([trial], length=3.0).runs
    read = run.order_time + run.figures["time_90"]
    span: Span = (run.order_time + 20.0, run.order_time + 20.5) if moved else (read - 2.0, read + 2.0)
    broken = left_out(trial, [span], "test", [span] if moved else ())
    with pytest.raises(UserError, match="something else moved the ship" if moved else "turns by more than 5 deg"):
        imo_figures_of_trials([broken], length=3.0)
    many = imo_figures_of_trials([broken, trial], length=3.0)
    assert len(many.runs) == 1 and has_code(many.notices, "no_maneuver_found")


def test_a_turn_without_what_lies_between_its_readings_has_the_same_figures() -> None:
    trial = simulate(SHIP, "turning:35", duration=120.0)
    (run,) = imo_figures_of_trials([trial], length=3.0).runs
    first, second = (run.order_time + run.figures[name] for name in ("time_90", "time_180"))
    broken = left_out(trial, [(run.order_time + 2.0, first - 1.0), (first + 1.0, second - 1.0)], "test")
    for figure, value in figures(broken).items():
        assert value == pytest.approx(figures(trial)[figure], rel=1e-3), figure
