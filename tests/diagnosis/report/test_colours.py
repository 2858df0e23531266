"""Figures of a diagnosis can be read in grey and with deuteranopia."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from diagnosis.report.figures import BAND_COLOURS, COLOURS, HATCHES, figures_for
from diagnosis.report.where_figures import FELT, to_port
from tests.diagnosis.report.test_report import case
from tests.support.colours import apart, told_by_colour_alone


@pytest.mark.parametrize("verdict", ["named", "unknown", "none"])
def test_nothing_in_a_figure_is_told_by_its_colour_alone(verdict: str) -> None:
    figures = figures_for(case(verdict))
    assert {"ranking", "where_on_track", "where_in_state", "shares"} <= {f.name for f in figures}
    found = case(verdict)
    assert {f.name: told_by_colour_alone(f.draw(found)) for f in figures} == {f.name: [] for f in figures}


@pytest.mark.parametrize("pair", list(combinations(COLOURS, 2)))
def test_bars_of_two_roles_differ_in_hatch_or_in_grey(pair: tuple[str, str]) -> None:
    one, other = pair
    assert HATCHES[one] != HATCHES[other] or apart(COLOURS[one], COLOURS[other])


def test_bands_get_lighter_in_grey() -> None:
    assert all(apart(one, other) for one, other in combinations(BAND_COLOURS, 2))


def test_a_moment_to_port_is_dashed_along_the_track() -> None:
    points = np.column_stack([np.arange(5.0), np.zeros(5)])
    east, north = to_port(points, np.array([1.0, -1.0, -0.05, 0.5]), FELT)
    assert np.isfinite(east).tolist() == [False, True, False, False, False] and north[1] == 0.0
    (track,) = [f for f in figures_for(case("unknown")) if f.name == "where_on_track"]
    dashed = [line for ax in track.draw(case("unknown")).axes for line in ax.get_lines() if line.get_color() == "white"]
    assert dashed and all(line.is_dashed() and np.isfinite(line.get_xdata()).any() for line in dashed)
