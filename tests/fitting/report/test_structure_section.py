"""How a structure was chosen, on the page, from a file that may be damaged."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fitting.report.sections import structure_section

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
