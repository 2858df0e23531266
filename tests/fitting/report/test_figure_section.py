"""The figure of the standard manoeuvres with drawn trials, and that there are no draws without a covariance."""

from __future__ import annotations

import base64
from dataclasses import replace

import pytest

import fitting.report.imo_form as module
from cases.criteria.imo import imo_figures
from fitting.prediction.bands import correlation_in
from fitting.report.imo_form import drawn_maneuvers, standard_figures
from fitting.report.use import Delivered, delivery_sections
from tests.support.calibrated import small_result


def test_the_page_gets_a_picture_of_what_was_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = small_result()
    found = imo_figures(fit.ship)
    kept = ("turning:35", "zigzag:10/10")
    few = replace(
        found,
        rows=tuple(row for row in found.rows if row.run in kept),
        runs=tuple(run for run in found.runs if run.name in kept),
    )
    monkeypatch.setattr(module, "DRAWS", 20)
    monkeypatch.setattr(module, "imo_figures", lambda ship: few)
    image = drawn_maneuvers(standard_figures(fit.to_dict(), fit.ship))
    assert image is not None and image["name"] == "maneuvers"
    assert base64.b64decode(image["image"].partition("base64,")[2]).startswith(b"\x89PNG")
    known = Delivered(figure=image)
    assert delivery_sections(fit.to_dict(), fit.ship, known)["known"] is known


@pytest.mark.parametrize("damage", ["none", "number"])
def test_a_run_without_covariance_has_no_draws(damage: str) -> None:
    content = dict(small_result().to_dict())
    matrix = [list(row) for row in content["correlation"]["matrix"]]
    matrix[0][1] = None
    content["correlation"] = None if damage == "none" else {**content["correlation"], "matrix": matrix}
    assert correlation_in(content) is None
