"""The blind benchmark's runner and score: hand-made answers give hand-computed rates, and a changed key is refused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blind import __main__ as blind
from benchmarks.blind import solve as solving
from benchmarks.blind.rows import Refused, Row, closure, covered, rows_of
from benchmarks.blind.score import figures, interval, measures, misses, scored
from benchmarks.blind.solve import solve

Parameters = Mapping[str, Mapping[str, float]]
TOW = {"tow": {"X": 0.1, "Y": 0.0, "N": 0.0}}
DRAFT = {"draft": {"share": 0.2}}


def answer(verdict: str, *names: str, first: str = "", same: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """An answer that names effects; ``first``: the candidate that leads the ranking where nothing is named."""
    order = list(dict.fromkeys([n for n in (*names, first, "tow", "draft", "bank", "current") if n]))
    gains = [20.0, 15.0, 13.0, None]
    held = {"mse_before": 3.0, "mse_after": 1.5}
    parameters = more.pop("parameters", {})
    return {
        "verdict": verdict,
        "effects": [{"name": n, "parameters": parameters.get(n, {})} for n in names],
        "equivalence_class": list(same),
        "remainder": False,
        "candidates": [{"name": n, "delta_bic": g} for n, g in zip(order, gains, strict=True)],
        "held_out": held,
        "seconds": 2.0,
        "code": "abc",
    } | more


def row(kind: str, truth: Parameters, given: dict[str, Any], strength: str = "weak", floor: float = 1.0) -> Row:
    label = " + ".join(truth) or kind
    return Row(f"{kind}_{len(given)}", kind, label, "" if kind == "null" else strength, truth, given, floor)


def rows() -> list[Row]:
    failed = {"error": "UserError: no", "seconds": 9.0, "code": "abc"}
    return [
        row("library", TOW, answer("named", "tow", same=("bank",))),  # right
        row("library", TOW, answer("named", "draft", same=("tow",)), "strong"),  # wrong name, truth in the class
        row("library", DRAFT, answer("none", first="tow")),  # missed; second candidate, 5 behind the best
        row("library", DRAFT, failed),
        row("null", {}, answer("none")),
        row("null", {}, answer("unknown")),
        row("null", {}, answer("named", "bank")),
        row("foreign", {}, answer("unknown")),
        row("foreign", {}, answer("named", "tow", remainder=True), "strong"),
        row("foreign", {}, answer("named", "tow"), "strong"),
        row("foreign", {}, answer("none"), floor=2.9),  # absorbed: 3.0 / 2.9 < 1.1
        row("pair", TOW | DRAFT, answer("named", "tow", "draft")),
        row("pair", TOW | DRAFT, answer("named", "tow", "draft", "bank")),
        row("pair", TOW | DRAFT, answer("named", "tow")),
        row("misfit", TOW, answer("named", "tow", remainder=True)),
    ]


def counts(lines: list[list[str]], label: str) -> tuple[str, ...]:
    """The counts of a line: weak, medium, strong, all."""
    found = next(line for line in lines if line[0] == label)
    return tuple(words.split(" ")[-1] for words in found[1:])


@pytest.mark.parametrize(
    ("label", "weak", "strong", "every"),
    [
        ("library: first candidate right (top-1)", "1/3", "0/1", "1/4"),
        ("library: verdict named", "1/3", "1/1", "2/4"),
        ("library: named, and the right one first", "1/3", "0/1", "1/4"),
        ("library: truth in the equivalence class", "2/3", "1/1", "3/4"),
        ("null: false alarm", "", "", "2/3"),
        ("null: of these, named", "", "", "1/3"),
        ("null: of these, unknown", "", "", "1/3"),
        ("foreign: unknown, or named with a remainder", "1/2", "1/2", "2/4"),
        ("foreign: none", "1/2", "0/2", "1/4"),
        ("foreign: named with nothing left over", "0/2", "1/2", "1/4"),
        ("pair: both named, nothing else", "1/3", "", "1/3"),
        ("pair: both named", "2/3", "", "2/3"),
        ("misfit: its effect named first", "1/1", "", "1/1"),
        ("all: wrong name, with nothing left over", "0/9", "2/3", "3/15"),
        ("all: any name that is not there, also behind a right one", "1/9", "3/3", "5/15"),
        ("all: answered as it should be", "4/9", "1/3", "6/15"),
        ("all: failed", "1/9", "0/3", "1/15"),
    ],
)
def test_rates_are_those_computed_by_hand(label: str, weak: str, strong: str, every: str) -> None:
    assert counts(measures(rows()), label) == (weak, "", strong, every)


def test_sizes_of_classes() -> None:
    line = next(x for x in measures(rows()) if x[0] == "library: size of the class, mean")
    assert line[-1] == "1.50"  # 2 (tow, bank), 2 (draft, tow), 2 (20 and 15, not 13), 0 (failed)


def test_intervals_are_those_of_the_tables() -> None:
    assert interval(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert interval(9, 10) == pytest.approx((0.5550, 0.9975), abs=1e-4)


def test_intervals_of_sizes_are_counted() -> None:
    found = {"tow": {s: {"value": v, "std": 0.01} for s, v in (("X", 0.1), ("Y", 0.03), ("N", 0.04))}}
    assert covered([row("library", TOW, answer("named", "tow", parameters=found))]) == (1, 3)
    assert covered([row("library", TOW, answer("none"))]) == (0, 0)


def test_closure_counts_only_what_is_named() -> None:
    right, silent = rows()[0], rows()[2]
    assert closure(right) == pytest.approx(0.75)  # (3 - 1.5) / (3 - 1)
    assert closure(silent) == 0.0
    assert closure(row("library", TOW, answer("named", "tow"), floor=2.9)) is None


def test_figures_count_what_each_kind_is_to_be_answered() -> None:
    made = {name: (figure.value, figure.of) for name, figure in figures(rows(), "basin").items()}
    assert made["blind_null_basin"] == (1, 3) and made["blind_foreign_basin"] == (2, 4)
    assert made["blind_library_weak_basin"] == (1, 3) and made["blind_library_strong_basin"] == (0, 1)
    assert made["blind_pair_basin"] == (1, 3) and made["blind_wrong_basin"] == (3, 15)


def test_misses_are_listed_with_their_first_candidates() -> None:
    text = "\n".join(misses(rows()))
    assert text.count("\n") + 1 == 2 + 9
    assert "| library | draft | weak | none | tow > draft > bank |" in text
    assert "seconds per case: median 2, most 9" in scored(rows())[0]


# Files


def sealed_folder(folder: Path) -> str:
    """A benchmark of two cases with one empty trial each; returns the hash of its key."""
    entries = []
    for i, (kind, effects) in enumerate([("library", [("tow", TOW["tow"])]), ("null", [])]):
        name = f"case_{i:04d}"
        files = {"train/a.csv": folder / name / "train" / "a.csv", "sealed": folder / "sealed" / f"{name}.json"}
        for path in files.values():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"floor": 1.0}))
        hashes = {k: hashlib.sha256(p.read_bytes()).hexdigest() for k, p in files.items()}
        listed = [{"name": n, "strength": "weak", "parameters": p} for n, p in effects]
        entries.append({"case": name, "kind": kind, "effects": listed, "sha256": hashes})
    content = json.dumps({"cases": entries}).encode()
    (folder / "key.json").write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def test_a_key_is_read_only_as_it_was_sealed(tmp_path: Path) -> None:
    digest = sealed_folder(tmp_path)
    answers = {"case_0000": answer("named", "tow"), "case_0001": answer("none")}
    assert [(r.kind, r.strength, list(r.truth)) for r in rows_of(tmp_path, digest, answers)] == [
        ("library", "weak", ["tow"]),
        ("null", "", []),
    ]
    with pytest.raises(Refused, match="case_0001"):
        rows_of(tmp_path, digest, {"case_0000": answer("none")})
    trial = tmp_path / "case_0000" / "train" / "a.csv"
    trial.write_text("another")
    with pytest.raises(Refused, match=r"a\.csv"):
        rows_of(tmp_path, digest, answers)
    (tmp_path / "key.json").write_text((tmp_path / "key.json").read_text() + " ")
    with pytest.raises(Refused):
        rows_of(tmp_path, digest, answers)


def test_solving_goes_on_where_it_stopped_and_needs_no_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases, answers = tmp_path / "cases", tmp_path / "answers"
    for i in range(3):
        (cases / f"case_{i:04d}").mkdir(parents=True)
    answers.mkdir()
    (answers / "case_0001.json").write_text('{"verdict": "kept"}')
    asked: list[str] = []

    def answered(case: Path) -> dict[str, Any]:
        asked.append(case.name)
        if case.name == "case_0002":
            raise ValueError("no such luck")
        return answer("none")

    monkeypatch.setattr(solving, "answered", answered)
    found = solve(cases, answers)
    assert asked == ["case_0000", "case_0002"]
    assert found["case_0001"] == {"verdict": "kept"}
    assert found["case_0002"]["error"] == "ValueError: no such luck"
    assert solve(cases, answers) == found
    assert asked == ["case_0000", "case_0002"]


@pytest.mark.slow
def test_the_whole_run_on_two_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(solving, "answered", lambda case: answer("none"))
    arguments = ["--cases", "2", "--seed", "910", "--workers", "1", "--kinds", "null", "--out", str(tmp_path)]
    assert blind.main(arguments) == 0
    said = capsys.readouterr().out
    assert said.index("SHA-256 of the key") < said.index("case_0000: none")
    assert "| null: false alarm |  |  |  | 0 [0, 84] 0/2 |" in said
    folder = tmp_path / "cases" / "null_mixed"
    assert blind.main([*arguments, "--cases", "3"]) == 2
    assert "holds 2 cases of seed 910" in capsys.readouterr().err
    (folder / "key.json").write_text("{}")
    assert blind.main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1
