"""Figures can be read in grey and with deuteranopia: where two colours look alike there, hatches or dashes differ."""

from __future__ import annotations

from matplotlib.figure import Figure

from fitting.report.plot_maneuvers import COLOURS as LINES
from fitting.report.plot_style import DASHES
from tests.support.colours import apart, told_by_colour_alone


def test_lines_of_manoeuvres_differ_in_their_dashes() -> None:
    assert len(DASHES) == len(LINES) and len({str(d) for d in DASHES}) == len(DASHES)


def test_two_blues_are_told_apart_and_equal_greys_are_not() -> None:
    assert apart("#0072B2", "#7FB8D9") and not apart("#C00000", "#006000") and not apart("#808080", "#818181")


def test_what_only_colours_tell_apart_is_found() -> None:
    figure = Figure()
    ax = figure.subplots()
    ax.plot([0, 1], color="#C00000", label="one")
    ax.plot([0, 1], color="#006000", label="other")
    ax.bar([0, 1], [1, 1], color=["#C00000", "#006000"])
    assert len(told_by_colour_alone(figure)) == 2
    figure = Figure()
    ax = figure.subplots()
    ax.plot([0, 1], color="#C00000", label="one")
    ax.plot([0, 1], color="#006000", ls="--", label="other")
    ax.bar([0, 1], [1, 1], color=["#C00000", "#006000"], hatch=["", "////"])
    assert told_by_colour_alone(figure) == []
