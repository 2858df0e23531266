"""Figures of a diagnosis can be read in grey and with deuteranopia."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.report.page import FELT, figures_for, to_port, track_figure
from tests.diagnosis.report.test_report import case
from tests.support.colours import told_by_colour_alone


@pytest.mark.parametrize("verdict", ["named", "unknown", "none"])
def test_nothing_in_a_figure_is_told_by_its_colour_alone(verdict: str) -> None:
    found = case(verdict)
    looks = {name: told_by_colour_alone(draw(found)) for name, draw, *_ in figures_for(found)}
    assert looks == {name: [] for name in looks} and {"where_on_track", "where_in_state"} <= set(looks)


def test_a_moment_to_port_is_dashed_along_the_track() -> None:
    points = np.column_stack([np.arange(5.0), np.zeros(5)])
    east, north = to_port(points, np.array([1.0, -1.0, -0.05, 0.5]), FELT)
    assert np.isfinite(east).tolist() == [False, True, False, False, False] and north[1] == 0.0
    dashed = [
        line for ax in track_figure(case("unknown")).axes for line in ax.get_lines() if line.get_color() == "white"
    ]
    assert dashed and all(line.is_dashed() and np.isfinite(line.get_xdata()).any() for line in dashed)
