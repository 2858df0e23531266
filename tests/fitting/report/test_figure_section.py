"""The section of a report on figures with intervals: its rows, its sentences, its figures, and when there is none."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest

import fitting.report.delivered as module
from cases.criteria.assessment import imo_figures
from fitting.prediction.bands import correlation_in
from fitting.prediction.figure_intervals import with_intervals
from fitting.report.delivered import Delivered, FigureSection, delivery_sections, figure_section, standard_figures
from tests.support.calibrated import small_result


@pytest.fixture(scope="module")
def section() -> FigureSection:
    fit = small_result()
    found = imo_figures(fit.ship)
    kept = ("turning:35", "zigzag:10/10")
    few = replace(
        found,
        rows=tuple(row for row in found.rows if row.run in kept),
        runs=tuple(run for run in found.runs if run.name in kept),
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(module, "DRAWS", 20)
        patched.setattr(module, "imo_figures", lambda ship: few)
        made = figure_section(standard_figures(fit.to_dict(), fit.ship))
    assert made is not None
    expected = with_intervals(few, fit.ship, fit.to_dict(), 20).assessment
    row = next(row for row in expected.rows if row.figure == "advance")
    low, high = row.interval_90 or (np.nan, np.nan)
    cells = next(cells for cells in made.rows if cells["figure"].startswith("advance"))
    upper = f"{high:.2f}" if np.isfinite(high) else "never"
    assert cells["interval"] == f"{low:.2f} to {upper}" and cells["value"] == f"{row.value:.2f}"
    assert cells["chance"] == f"{100 * (row.probability or 0):.0f} %"
    return made


def test_the_page_gets_rows_pictures_and_sentences(section: FigureSection) -> None:
    assert {row["run"] for row in section.rows} == {"turning:35", "zigzag:10/10"}
    assert base64.b64decode(section.image["image"].partition("base64,")[2]).startswith(b"\x89PNG")
    assert section.image["name"] == "maneuvers" and section.image["width"] > 600
    outside = {row["run"] for row in section.rows if row["inside"] == "no"}
    assert outside == {words.rpartition(": ")[0].partition(": ")[0] for words in section.outside}
    fit = small_result()
    assert delivery_sections(fit.to_dict(), fit.ship, Delivered(figures=section))["intervals"] is section


@pytest.mark.parametrize("damage", ["none", "number"])
def test_a_run_without_covariance_has_no_draws(damage: str) -> None:
    content = dict(small_result().to_dict())
    matrix = [list(row) for row in content["correlation"]["matrix"]]
    matrix[0][1] = None
    content["correlation"] = None if damage == "none" else {**content["correlation"], "matrix": matrix}
    assert correlation_in(content) is None
