"""Figures of trainings and comparisons, and lines of the interactive page, can be read in grey."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import delivery.view
from residual.figures import learning_plot
from residual.papers.comparison_figures import COLOURS, DASHED, MARKERS
from tests.support.colours import told_by_colour_alone


def seeds(count: int) -> list[dict]:
    """Rows of trainings that went about the same way."""
    history = [{"epoch": k, "stop": 1.0 - 0.01 * k} for k in range(5)]
    pair = {"before": 1.0, "after": 0.97}
    row = {"history": history, "stop_window": pair, "judged_window": pair, "status": "finished"}
    return [row | {"seed": k} for k in range(count)]


@pytest.mark.parametrize("count", [1, 5])
def test_learning_curves_of_seeds_differ_in_their_dashes(count: int) -> None:
    figure = learning_plot(seeds(count))
    lines = [x for x in figure.axes[0].get_lines() if str(x.get_label()).startswith("seed")]
    assert len(lines) == count == len({str(x.__dict__["_unscaled_dash_pattern"]) for x in lines})
    assert told_by_colour_alone(figure) == []


def test_lines_of_models_differ_in_dashes_and_markers() -> None:
    assert len({str(d) for d in DASHED.values()}) == len(set(MARKERS.values())) == len(COLOURS)


@pytest.mark.parametrize("table", ["LOOKS", "ROLE_LOOKS"])
def test_lines_of_the_interactive_page_differ_in_their_dashes(table: str) -> None:
    text = (Path(delivery.view.__path__[0]) / "assets" / "data.js").read_text(encoding="utf-8")
    rows = re.search(rf"const {table} = \[(.*?)\n\];", text, re.DOTALL)
    assert rows
    dashes = re.findall(r"dash: (\[.*?\])", rows[1])
    assert len(dashes) >= 4 and len(set(dashes)) == len(dashes)
