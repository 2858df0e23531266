"""The blind benchmark: what an answer got right, and keys that are read only as they were sealed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchmarks import measured
from benchmarks.blind import __main__ as blind
from benchmarks.blind.cases import Case, answer, dealt, folders, opened
from benchmarks.blind.score import Pair, figures, misses, scored
from benchmarks.measured import Record
from mmg.errors import UserError

Parameters = Mapping[str, Mapping[str, float]]
TOW = {"tow": {"X": 0.1, "Y": 0.0, "N": 0.0}}
DRAFT = {"draft": {"share": 0.2}}


def row(verdict: str, *names: str, left: bool = False, first: str = "") -> dict[str, Any]:
    """A row of the record; ``first``: the candidate that leads the ranking where nothing is named."""
    order = list(dict.fromkeys([n for n in (*names, first, "tow", "draft", "bank", "current") if n]))
    evidence = {"candidates": [[n, 20.0, 0.1, 1.0] for n in order]}
    return {"answer": [verdict, list(names), left], "evidence": evidence, "processor": 2.0}


def pair(kind: str, truth: Parameters, given: dict[str, Any], strength: str = "weak") -> Pair:
    hidden, strength = {name: dict(values) for name, values in truth.items()}, "" if kind == "null" else strength
    return Case("pond", kind, Path("case_0000"), hidden, " + ".join(truth) or kind, strength), given


def pairs() -> list[Pair]:
    failed = {"answer": ["error", [], False], "evidence": {"error": "UserError: no"}, "processor": 9.0}
    return [
        pair("library", TOW, row("named", "tow")),  # right
        pair("library", TOW, row("named", "draft"), "strong"),  # wrong name
        pair("library", DRAFT, row("none", first="tow")),
        pair("library", DRAFT, failed),
        pair("null", {}, row("none")),
        pair("null", {}, row("unknown")),
        pair("null", {}, row("named", "bank")),
        pair("strangers", {}, row("unknown")),
        pair("strangers", {}, row("named", "tow", left=True), "strong"),
        pair("strangers", {}, row("named", "tow"), "strong"),
        pair("strangers", {}, row("none")),
        pair("pair", TOW | DRAFT, row("named", "tow", "draft")),
        pair("pair", TOW | DRAFT, row("named", "tow", "draft", "bank")),
        pair("pair", TOW | DRAFT, row("named", "tow")),
    ]


def test_figures_are_those_counted_by_hand() -> None:
    made = {name: (figure.value, figure.of) for name, figure in figures(pairs(), "basin").items()}
    assert made == {
        "blind_null_basin": (1, 3), "blind_foreign_basin": (2, 4), "blind_pair_basin": (1, 3),
        "blind_library_weak_basin": (1, 3), "blind_library_strong_basin": (0, 1),
        "blind_wrong_basin": (3, 14),
    }  # fmt: skip


def test_misses_are_listed_with_their_first_candidates() -> None:
    lines = misses(pairs())
    assert len(lines) == 2 + 9 and "| failed | 1 of 14 |" in scored(pairs(), "basin")
    assert any("| library | draft | weak | none | tow > draft > bank |" in line for line in lines)
    assert "median 2, most 9" in scored(pairs(), "basin")[0]


@pytest.mark.slow
def test_a_key_is_read_only_as_it_was_sealed(tmp_path: Path) -> None:
    folder = tmp_path / "cases"
    digest = dealt(folder, "pond", "library", 1, 11)
    assert dealt(folder, "pond", "library", 1, 11) == digest
    (case,) = opened(folder, digest)
    assert case.kind == "library" and case.label in case.truth
    trial = next((case.folder / "train").iterdir())
    before = trial.read_bytes()
    trial.write_text("another")
    with pytest.raises(UserError, match=trial.name):
        opened(folder, digest)
    trial.write_bytes(before)
    (folder / "key.json").write_text((folder / "key.json").read_text() + " ")
    with pytest.raises(UserError, match=r"key\.json"):
        opened(folder, digest)


def test_a_case_that_fails_is_an_answer() -> None:
    def ask() -> Any:
        raise ValueError("singular")

    assert answer(ask) == ("error", [], False, {"error": "ValueError: singular"})


def test_a_record_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measured, "code_version", lambda: "abc")
    record, asked = Record(tmp_path / "answers.jsonl"), []

    def work(case: str) -> dict[str, Any]:
        asked.append(case)
        return row("none")

    tasks = [({"case": name}, (name,)) for name in ("a", "b")]
    record.measure(work, tasks[:1], 1)
    Record(record.path).measure(work, tasks, 1)
    assert asked == ["a", "b"] and len(Record(record.path).of(code="abc")) == 2


@pytest.mark.longest
@pytest.mark.slow
def test_the_whole_run_on_two_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(blind, "answered", lambda case: row("none"))
    arguments = ["--cases", "2", "--seed", "910", "--workers", "1", "--kinds", "null", "--out", str(tmp_path)]
    assert blind.main(arguments) == 0
    said = capsys.readouterr().out
    assert said.index("SHA-256") < said.index("case_0000, none")
    assert "none | 2 of 2 |" in said
    (folder,) = (path for path in tmp_path.iterdir() if path.is_dir())
    next((folders(folder)[0] / "train").iterdir()).write_text("another")
    assert blind.main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert json.loads((folder / "key.json").read_text())["kind"] == "null"
