"""The report: complete, self-contained, escaped, and honest about a run that did not converge."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import fitting.report.imo_form as module
from cases.criteria import imo
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from fitting.prediction.bands import correlation_in
from fitting.record import MessageRow
from fitting.report.imo_form import drawn_maneuvers, standard_figures
from fitting.report.plan_section import FOLDER, PLAN, in_words, plan_section
from fitting.report.run_folder import RESULT, read_result, write_json
from fitting.report.sections import change, plus_minus, structure_section
from fitting.report.use import Delivered, delivery_sections
from fitting.result import read_fit, write_report
from mmg.errors import BadValue, Missing, NotWritable, UserError
from mmg.messages import has_code
from mmg_ident.commands.main import main
from tests.support.calibrated import FREE, small_result

pytestmark = pytest.mark.usefixtures("blank_figures")
EVIL = '<script>alert("x")</script>'


def run_folder(folder: Path, iterations: int = 100, figures: bool = False, name: str = "", **extra: object) -> Path:
    """A run folder of the small calibration, with or without figures, ``extra`` attributes changed."""
    result = small_result(iterations)
    result = replace(result, **extra) if figures else replace(result, objects=None, **extra)  # type: ignore[arg-type]
    if name:
        result = replace(result, ship_name=name, ship=replace(result.ship, name=name.replace("/", "_")))
    result.save(folder)
    return folder


def report(*folders: Path) -> str:
    """The page that mmg report writes on run folders."""
    out = folders[0].parent / "page.html"
    assert write_report(folders, out, imo=False) == out.read_text()
    return out.read_text()


class Page(HTMLParser):
    """Tags, what they load, and the text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append(tag)
        self.loads += [value for key, value in attrs if key in ("src", "href", "srcset", "data", "action") and value]

    def handle_data(self, data: str) -> None:
        self.words += data + " "


@pytest.mark.slow
def test_what_differs_between_campaigns_is_a_sentence_and_tables(tmp_path: Path) -> None:
    row = {"value": 0.9, "std": 0.08, "unit": "s", "prior_value": 0.3, "prior_std": 0.4}
    content = {
        "runs": {"2020-07-31": 2, EVIL: 2},
        "tried": [],
        "values": {"2020-07-31": {"gyro.T": row}, EVIL: {"gyro.T": row | {"value": 0.0}}},
        "left_out": {"without": 0.1393, "with": 0.1273, "error": 0.1},
        "sentences": [f"the lag of the turn rate differs, from 0 s (2020-07-31) to 0.9 s ({EVIL})"],
    }
    words = Page(text := report(run_folder(tmp_path / "differ", campaigns=content))).words
    assert EVIL not in text
    for part in ("0.1393", "0.1273", "gyro.T [s]", plus_minus(0.9, 0.08)):
        assert part in words, part
    alike = content | {"values": None, "left_out": None, "sentences": []}
    words = Page(report(run_folder(tmp_path / "alike", campaigns=alike))).words
    assert "2020-07-31: 2 runs" in words


@pytest.mark.slow
def test_all_of_a_run_is_in_the_page(tmp_path: Path) -> None:
    """And the page loads nothing from elsewhere."""
    folder = run_folder(tmp_path / "run", figures=True)
    page = Page(text := report(folder))
    content = read_result(folder)
    for symbol in FREE:
        assert re.search(rf"\b{symbol}\b", page.words), symbol
    for symbol in content["fixed"]:
        assert f"{symbol} = " in page.words, symbol
    for row in content["data"] + content["validation_data"]:
        assert row["name"] in page.words
    assert page.tags.count("img") == len(content["figures"]) >= 2
    for heading in ("Ship particulars", "Mathematical model", "Trial data", "Causes of error", "Sensitivity"):
        assert heading in page.words
    assert "a.csv --out" in page.words
    assert "NOT CONVERGED" not in page.words
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in page.loads)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert "url(" not in text and "@import" not in text


def test_words_from_files_are_escaped(tmp_path: Path) -> None:
    messages = tuple(MessageRow(level, "evil", EVIL) for level in ("warning", "notice"))
    folder = run_folder(tmp_path / "run", name=EVIL, command=EVIL, messages=messages)
    content = read_result(folder)
    content["figures"] = [{"file": "../../etc/passwd", "title": EVIL, "caption": EVIL}]
    content["coefficients"][EVIL] = content["coefficients"]["Y_v"]
    content["coefficients"]["Y_v"]["description"] = EVIL
    write_json(folder / RESULT, content)
    text = report(folder, folder)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "root:" not in text


def test_a_run_without_validation_scores_or_positions_still_makes_a_report(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    content = read_result(folder)
    del content["scores"]["validation"]
    write_json(folder / RESULT, content)
    assert content["validation_data"][0]["name"] in report(folder)
    content["scores"] = {}
    content["coefficients"]["Y_v"] |= {"std": None, "prior_share": None}
    write_json(folder / RESULT, content)
    assert "No scores" in report(folder)


def test_public_data_are_cited_only_when_used(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    assert "Wakita, K." not in report(folder)
    content = read_result(folder)
    content["data"][0]["name"] = "turn_cut_14-Sep-2020_15_58_08"
    write_json(folder / RESULT, content)
    text = report(folder)
    assert "Wakita, K." in text and "Miyauchi, Y." in text and "CC BY-NC-SA 4.0" in text


@pytest.mark.slow
def test_several_runs_stand_side_by_side(tmp_path: Path) -> None:
    """And the one that did not converge says so before anything else."""
    folders = [run_folder(tmp_path / name, iterations) for name, iterations in (("first", 100), ("second", 1))]
    text = report(*folders)
    assert text.index("Comparison of 2") < text.index('id="run1"') < text.index('id="run2"')
    head = text[: text.index('id="run1"')]
    assert all(symbol in head for symbol in FREE) and "NOT CONVERGED" in head
    text = report(folders[1])
    assert 'role="alert"' in text
    where = text.index("NOT CONVERGED")
    assert where < text.index("<table") and where < text.index("calibrated on")


@pytest.mark.slow
def test_the_command_writes_into_the_run_and_replaces_only_its_own_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = run_folder(tmp_path / "run")
    assert main(["report", str(folder), "--no-imo"]) == 0
    assert main(["report", str(folder), "--no-imo"]) == 0
    assert (folder / "report.html").stat().st_size > 10_000
    other = tmp_path / "kept.html"
    other.write_text("precious")
    assert main(["report", str(folder), "--out", str(other)]) == 2
    assert other.read_text() == "precious"
    monkeypatch.chdir(tmp_path)
    second = run_folder(tmp_path / "run2")
    assert main(["report", str(folder), str(second), "--no-imo"]) == 0
    assert (tmp_path / "report.html").exists()
    assert main(["report", str(tmp_path / "nowhere")]) == 2
    assert not list(tmp_path.rglob("*.part"))


def test_a_folder_that_is_no_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Missing):
        report(tmp_path)
    write_json(tmp_path / RESULT, {"kind": "diagnosis"})
    with pytest.raises(BadValue):
        report(tmp_path)


def test_a_report_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    (tmp_path / "file").write_text("")
    with pytest.raises(NotWritable):
        write_report([folder], tmp_path / "file" / "report.html", imo=False)


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (-0.44137, 0.0484, "−0.441 ± 0.048"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (1234.5, 67.0, "1234 ± 67"),
        (12345.0, 670.0, "12345 ± 670"),
        (2.3e-9, 1.1e-10, "(2.30 ± 0.11)e−9"),
        (0.1, None, "0.1"),
        (None, 0.1, "–"),
    ],
)
def test_numbers_keep_two_figures_of_their_uncertainty(value: float, std: float, words: str) -> None:
    assert plus_minus(value, std) == words


def test_change_is_put_in_words() -> None:
    assert change(3.0, 1.0).startswith("fell ") and "(3 times" in change(3.0, 1.0)
    assert change(1.0, 3.0).startswith("ROSE ")
    assert change(1.0, 1.004) == change(1.0, 0.997) and "diverges" in change(1.0, None)


# The figure of the standard manoeuvres with drawn trials, and that there are no draws without a covariance
@pytest.mark.slow
def test_the_page_gets_a_picture_of_what_was_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = small_result()
    monkeypatch.setattr(module, "DRAWS", 20)
    monkeypatch.setattr(imo, "STANDARD", ("turning:35", "zigzag:10/10"))
    image = drawn_maneuvers(standard_figures(fit.to_dict(), fit.ship))
    assert image is not None and image["name"] == "maneuvers"
    assert base64.b64decode(image["image"].partition("base64,")[2]).startswith(b"\x89PNG")
    known = Delivered(figure=image)
    assert delivery_sections(fit.to_dict(), fit.ship, known)["known"] is known


@pytest.mark.parametrize("correlation", [None, {"symbols": ["a", "b"], "matrix": [[1.0, None], [0.5, 1.0]]}])
def test_a_run_without_covariance_has_no_draws(correlation: dict | None) -> None:
    assert correlation_in({"correlation": correlation}) is None


# The section of a report on the planned trial: what it shows, and that a plan that cannot be read is left out
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


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_the_report_shows_the_plan_of_its_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    replace(small_result(), objects=None).save(run)
    assert "turning:35" not in write_report([run], tmp_path / "a.html", imo=False)
    text = write_report([kept(run, CONTENT)], tmp_path / "b.html", imo=False)
    assert "turning:35" in text and CONTENT["assumed"][0] in text


# How a structure was chosen, on the page, from a file that may be damaged
ROW = {"words": "order 1", "unknowns": 20, "training": 0.2, "stable": 0, "sequences": 0, "left_out": ""}
GOOD = {
    "chosen": "b",
    "candidates": [
        {**ROW, "name": "a", "validation": None},
        {**ROW, "name": "b", "validation": 0.1},
        {**ROW, "name": "c", "validation": 0.05, "left_out": "too few samples"},
    ],
    "test": {"as given": 0.4, "chosen": None},
    "stability": {"sequences": 1000, "diverged": 0, "speed": 0.2},
}


def test_the_best_comes_first_and_what_was_not_tried_last(tmp_path: Path) -> None:
    assert structure_section(tmp_path) is None
    (tmp_path / "selection.json").write_text(json.dumps(GOOD))
    found = structure_section(tmp_path)
    assert found is not None and [row["name"] for row in found["rows"]] == ["b", "a", "c"]
    assert found["test"] == [("as given", 0.4), ("chosen", None)]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"chosen": 3}', json.dumps(GOOD | {"stability": None}), "\x00"])
def test_a_damaged_file_leaves_the_page_without_it(text: str, tmp_path: Path) -> None:
    (tmp_path / "selection.json").write_text(text)
    assert structure_section(tmp_path) is None


# Run folders of earlier releases, with other names, and with what is gone


def test_a_run_of_an_earlier_release_is_read_with_present_names(tmp_path: Path) -> None:
    """Else the errors of its coefficients would not find the ship's, and its prediction bands would be too narrow."""
    old = {
        "kind": "fit",
        "coefficients": {"velocity_lag.tau": {"std": 0.1}, "Y_v": {"std": 0.2}},
        "correlation": {"symbols": ["Y_v", "velocity_lag.tau"], "matrix": [[1.0, 0.5], [0.5, 1.0]]},
        "settings": {"words": "the velocity_lag. stays"},
    }
    (tmp_path / "result.json").write_text(json.dumps(old), encoding="utf-8")
    found = read_result(tmp_path)
    assert list(found["coefficients"]) == ["velocity_filter.tau", "Y_v"] and found["settings"] == old["settings"]
    assert found["correlation"]["symbols"] == ["Y_v", "velocity_filter.tau"]


def test_a_run_whose_loss_was_still_to_be_chosen_is_read(tmp_path: Path) -> None:
    """Earlier versions left loss and weight open, said how they were chosen, and could choose the model."""
    small_result().save(tmp_path / "run")
    file = tmp_path / "run" / "result.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    content |= {"weighting": {"loss": "student", "tried": []}, "auto": [{"varied": "start"}]}
    content["settings"] |= {"loss": None, "weight": None, "horizon": 40.0}
    file.write_text(json.dumps(content), encoding="utf-8")
    settings = read_fit(tmp_path / "run").settings
    assert settings.loss == "gaussian" and settings.weight == 1.0


def test_a_ship_with_random_forces_is_read_without_them() -> None:
    text = dump_ship(load_ship("esso_osaka_3m").with_effect("tow"))
    ship = parse_ship(text.replace('effects = ["tow"]', 'effects = ["tow", "disturbance"]') + (
        '\n[coefficients."disturbance.X"]\nvalue = 0.3\nfixed = true\nunit = "N"\n'
    ))  # fmt: skip
    assert ship.effects == ("tow",) and has_code(ship.notices, "effect_gone")
    with pytest.raises(UserError, match="disturbance"):
        freeing_effects(ship, ["disturbance"])
