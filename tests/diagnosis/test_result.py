"""The folder of a diagnosis has exactly its keys, and what is read from it is what was written."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from cases.shipfiles.ship_file import dump_ship
from diagnosis.findings import Between, GroupDifference, GroupParameter, GroupValue
from diagnosis.report.page import build_report, figures_for
from diagnosis.result import Diagnosis, read_diagnosis
from fitting.report.plot_style import png_of
from fitting.report.run_folder import SCHEMA_VERSION
from mmg.errors import Missing, UserError
from mmg.messages import Message
from tests.diagnosis.report.test_report import case

pytestmark = pytest.mark.usefixtures("blank_figures")
KEYS = {
    "schema_version", "verdict", "effects", "equivalence_class", "remainder", "candidates", "where", "held_out",
    "next_test", "warnings", "messages", "sentence", "kinematics", "instruments", "not_screened", "unnamed", "noise",
    "unexplained_force", "budget", "timings", "between",
}  # fmt: skip
RESULT_KEYS = {
    "schema_version", "kind", "command", "seed", "versions", "data", "test", "figures", "warnings", "timings_s",
    "complete",
}  # fmt: skip
LATE = GroupParameter("s", "lag of the logged turn rate", {
    "2020-07-31": GroupValue(0.01, 0.02, -0.9, 0.05), "2020-11-12": GroupValue(0.91, 0.04, 0.9, float("inf")),
})  # fmt: skip
GYRO = GroupDifference(
    "gyro", "instrument", "kinematics", "2020-11-12", {"T": LATE}, 400.0, 1, 1e-80, 190.0, ("r_bias",)
)
BETWEEN = Between(
    "day", {"2020-07-31": ("run <0>",), "2020-11-12": ("run 2", "run 3")}, "named", "The days differ in gyro.",
    (GYRO,), (GYRO, replace(GYRO, name="X_0F", nature="ship", source="dynamics")), False, ("one run only",),
)  # fmt: skip


def full() -> Diagnosis:
    """A diagnosis with everything in it, a number that is not finite included."""
    d = case("named")
    second = replace(d.effects[0], p_value=float("nan"))
    warnings = (Message("beware of the <tide>.", "tide"),)
    return replace(d, effects=(*d.effects, second), warnings=warnings, between=BETWEEN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "gap"
    full().save(folder)
    return folder


def keys_of(rows: Any) -> set[str]:
    return {key for row in rows for key in row}


def test_the_files_have_exactly_their_keys(folder: Path) -> None:
    content, result = (json.loads((folder / name).read_text()) for name in ("diagnosis.json", "result.json"))
    assert set(content) == KEYS and set(result) == RESULT_KEYS
    assert content["schema_version"] == result["schema_version"] == SCHEMA_VERSION and result["kind"] == "diagnosis"
    assert keys_of(content["effects"]) == {"name", "parameters", "p_value", "delta_bic", "absorbed_share", "evidence"}
    assert set(content["effects"][0]["parameters"]["x"]) == {"value", "std", "unit"}
    assert keys_of(content["candidates"]) == {
        "name", "score", "p_value", "delta_bic", "excited", "absorbed_share", "parameters", "visible_from",
        "evidence",
    }  # fmt: skip
    assert set(content["unexplained_force"]) == {"evidence", "channels", "follows", "times", "advice"}
    assert set(content["where"]) == {"channels", "phases", "regions", "bands", "runs", "earth", "variables"}
    assert set(content["held_out"]) == {
        "mse_before", "mse_after", "reduction", "interval_90", "windows", "by_run", "metric", "horizons",
    }  # fmt: skip
    assert keys_of(content["held_out"]["by_run"].values()) == {"before", "after"}
    assert set(content["noise"]) == {"force_N_N_Nm", "force_memory_s", "white", "gust", "gust_memory_s"}
    assert {"all", "sway force"} <= set(content["unnamed"])
    assert set(content["between"]) == {f.name for f in fields(Between)}
    assert keys_of(content["between"]["differences"]) == {f.name for f in fields(GroupDifference)}
    assert content["between"]["differences"][0]["parameters"]["T"]["groups"]["2020-11-12"]["difference_std"] is None
    (words,) = result["warnings"]
    assert content["messages"] == [{"level": "warning", "code": "tide", "text": words}]
    assert content["warnings"] == [words] and "<tide>" in words


def test_what_is_read_is_what_was_written(folder: Path, tmp_path: Path) -> None:
    found = read_diagnosis(folder)
    on_disk = json.loads((folder / "diagnosis.json").read_text())
    assert found.to_dict() == on_disk == full().to_dict()
    assert on_disk["effects"][1]["p_value"] is None
    assert found.held_out == full().held_out and found.inputs == full().inputs
    assert found.warnings == full().warnings and found.warnings[0].code == "tide"  # type: ignore[attr-defined]
    assert dump_ship(found.ship) == dump_ship(full().ship)
    assert found.null is found.final is found.data is found.before is None
    found.save(tmp_path / "again")
    assert read_diagnosis(tmp_path / "again").to_dict() == on_disk
    assert {name for name, *_ in figures_for(found)} == {"where_in_state"}


def test_the_page_compares_the_groups_where_that_was_asked(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    part = page[page.index('<h2 id="between">') : page.index('id="how"')]
    assert "run &lt;0&gt;" in part and part.count("0.910 ± 0.040") == 2 and part.count('<tr class="named">') == 1
    assert "1e-80" in part
    assert 'id="between"' not in build_report(case("named"), Path("nowhere"), [])


def test_a_notebook_shows_the_sentence_and_the_candidates() -> None:
    d = full()
    table, html = d.to_pandas(), d._repr_html_()
    assert list(table.index) == [c.name for c in d.candidates]
    assert list(table["role"]) == ["named", "same class", "", ""] and table.loc["current", "delta_bic"] == 280.0
    assert "propeller_side_force" in html


@pytest.mark.slow
def test_a_figure_that_fails_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(d: Diagnosis) -> None:
        raise ValueError("no such colour")

    monkeypatch.setattr("fitting.report.plot_style.png_of", png_of)  # figures are drawn here
    monkeypatch.setattr("diagnosis.report.page.state_figure", broken)
    full().save(tmp_path / "gap")
    assert read_diagnosis(tmp_path / "gap").verdict == "named"
    result = json.loads((tmp_path / "gap" / "result.json").read_text())
    assert any("where_in_state" in line for line in result["warnings"])
    assert "figures/where_in_state.png" not in [row["file"] for row in result["figures"]] and result["figures"]
    assert (tmp_path / "gap" / "report.html").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"verdict": "perhaps"}, "diagnosis.json"),
        ({"schema_version": 2}, "diagnosis.json: schema_version: .* 1"),
        ({"remainder": "maybe", "next_test": 3}, r"remainder: .*; next_test: "),
        ({"candidates": [{"name": "tow"}]}, "candidates.0.score"),
        ({"messages": [{"level": "warning", "text": "beware"}]}, "messages.0"),
        ({"messages": [1]}, "messages.0"),
        ("{", r"diagnosis\.json"),
        ("[" * 200_000, r"diagnosis\.json"),
        ("", r"diagnosis\.json"),
    ],
)
def test_what_is_no_diagnosis_is_named_with_its_file_and_key(
    change: dict[str, Any] | str, words: str, folder: Path, tmp_path: Path
) -> None:
    text = change if isinstance(change, str) else json.dumps(full().to_dict() | change)
    with pytest.raises(Missing):
        read_diagnosis(tmp_path)
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(UserError, match=words):
        read_diagnosis(tmp_path)
