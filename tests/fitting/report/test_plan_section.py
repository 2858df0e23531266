"""The section of a report on the planned trial: what it shows, and that a plan that cannot be read is left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting.report.plan_section import FOLDER, PLAN, in_words, plan_section
from fitting.result import write_report
from tests.support.calibrated import small_result

CONTENT: dict[str, Any] = {
    "title": "first",
    "time_s": 180.0,
    "area_m": {"length": 60.0, "width": 25.0, "margin": 0.25},
    "start": {"x_m": 40.0, "y_m": 10.0, "heading_deg": 150.0, "speed_m_s": 0.38, "n_rps": 7.0},
    "orders": [{"t_s": 0.0, "n_rps": 3.5, "delta_deg": -4.0}, {"t_s": 19.0, "n_rps": 10.5, "delta_deg": 35.0}],
    "wanted": {
        "Y_v": {"std_before": 0.07, "std_after": 0.035, "left": 0.5, "unit": "-"},
        "first_overshoot_20": {"std_before": 0.0174533, "std_after": 0.00174533, "left": 0.1, "unit": "rad"},
    },
    "mean_log_variance": -2.0,
    "library": [{"name": "turning:35", "mean_log_variance": -1.0, "stays_inside": False}],
    "best_two_of_the_library": {"library": {"names": ["turning:35", "crash-stop"], "mean_log_variance": -1.5}},
    "assumed": ["calm air"],
    "notes": [],
    "file": "next.csv",
}


def kept(folder: Path, content: Any) -> Path:
    """A folder with a planned trial of this content."""
    (folder / FOLDER).mkdir(parents=True)
    (folder / FOLDER / PLAN).write_text(json.dumps(content))
    return folder


def test_the_section_says_what_is_known_better_and_what_the_library_would_do(tmp_path: Path) -> None:
    found = plan_section(kept(tmp_path, CONTENT))
    assert found is not None and found["image"] is None
    assert found["wanted"] == [("first_overshoot_20 [deg]", "1", "0.1", "10%"), ("Y_v", "0.07", "0.035", "50%")]
    assert found["library"][1] == ("turning:35", "-1.00", "61%", "no") and found["library"][0][1] == "-2.00"
    assert "next.csv" in found["lead"][0] and "47% (turning:35" in found["lead"][1]
    assert found["orders"][1] == ("19.0", "10.50", "35")
    assert any("first_overshoot_20 [deg]" in line for line in in_words(CONTENT, "next.csv"))


@pytest.mark.parametrize("damage", [{"start": None}, {"orders": 3}, {"wanted": []}, {"mean_log_variance": "x"}])
def test_a_plan_that_cannot_be_read_is_left_out(tmp_path: Path, damage: dict[str, Any]) -> None:
    assert plan_section(kept(tmp_path, CONTENT | damage)) is None
    assert plan_section(tmp_path / "nowhere") is None


@pytest.mark.usefixtures("blank_figures")
def test_the_report_shows_the_plan_of_its_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    replace(small_result(), objects=None).save(run)
    assert "turning:35" not in write_report([run], tmp_path / "a.html", imo=False)
    text = write_report([kept(run, CONTENT)], tmp_path / "b.html", imo=False)
    assert "turning:35" in text and CONTENT["assumed"][0] in text
