"""A ship judged by the standard in one call: rows, document and table agree."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cases.criteria.imo import imo_figures, imo_figures_of_trials
from cases.shipfiles.ship_file import load_ship
from mmg.errors import UnknownName, UserError
from mmg.messages import has_code
from mmg.ship import CalibrationMark


def test_a_simulated_ship_and_her_own_runs_read_as_measured_get_one_verdict_each() -> None:
    ship = load_ship("kvlcc2_full")
    found = imo_figures(ship)
    data = found.to_dict()
    assert data["verdict"] == found.verdict and len(data["rows"]) == len(found.rows) == len(found.to_pandas())
    assert {run["name"] for run in data["runs"]} >= {"turning:35", "zigzag:10/10", "crash-stop"}
    assert has_code(found.notices, "reference_values") and has_code(found.notices, "not_checked")
    measured = imo_figures_of_trials([found.runs[0].trial], ship)
    advance = {row.figure: row.value for row in measured.rows}["advance"]
    assert advance == pytest.approx({row.figure: row.value for row in found.rows}["advance"], rel=0.02)


def test_what_cannot_be_judged_is_refused() -> None:
    ship = load_ship("kvlcc2_full")
    with pytest.raises(UnknownName):
        imo_figures(ship, maneuvers=["straight"])
    with pytest.raises(UserError, match="length"):
        imo_figures_of_trials([])


def test_a_calibration_is_named_and_keeps_the_published_values_of_the_ship_it_began_from() -> None:
    ship = load_ship("kvlcc2_full")
    mark = CalibrationMark("sea trial 3", "2026-01-02", "ab12", "kvlcc2_full")
    found = imo_figures(replace(ship, name="our tanker", mark=mark))
    content = found.to_dict()
    assert content["ship"] == "our tanker" and content["calibration"] == {
        "name": "sea trial 3", "date": "2026-01-02", "data": "ab12", "start": "kvlcc2_full",
    }  # fmt: skip
    plain = imo_figures(ship)
    known = {(row.run, row.figure): row.reference for row in plain.rows}
    assert {(row.run, row.figure): row.reference for row in found.rows} == known and any(known.values())
    assert plain.to_dict()["calibration"] is None
