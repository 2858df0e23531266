"""The report: complete, self-contained, escaped, and honest about a run that did not converge."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from fitting.record import MessageRow
from fitting.report.run_folder import RESULT, read_result, write_json
from fitting.report.sections import change, plus_minus
from fitting.result import write_report
from mmg.errors import BadValue, Missing, NotWritable
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


def test_what_differs_between_campaigns_is_a_sentence_and_tables(
    tmp_path: Path,
) -> None:
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


def test_all_of_a_run_is_in_the_page(tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run", figures=True)
    page = Page(report(folder))
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


def test_the_page_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    text = report(run_folder(tmp_path / "run", figures=True))
    page = Page(text)
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


def test_a_run_that_did_not_converge_says_so_before_anything_else(tmp_path: Path) -> None:
    text = report(run_folder(tmp_path / "run", iterations=1))
    assert 'role="alert"' in text
    where = text.index("NOT CONVERGED")
    assert where < text.index("<table") and where < text.index("calibrated on")


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


def test_several_runs_stand_side_by_side(tmp_path: Path) -> None:
    folders = [run_folder(tmp_path / name, iterations) for name, iterations in (("first", 100), ("second", 1))]
    text = report(*folders)
    assert text.index("Comparison of 2") < text.index('id="run1"') < text.index('id="run2"')
    head = text[: text.index('id="run1"')]
    assert all(symbol in head for symbol in FREE) and "NOT CONVERGED" in head
    content = read_result(folders[1])
    content["scores"]["validation"]["after"]["sigma"]["u"] = 1.0
    write_json(folders[1] / RESULT, content)


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
