"""README.md and RESULTS.md are those of the record, whose figures are of this minor version of the package."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path

import pytest

from benchmarks import pages, record
from benchmarks.literature import FIGURES, SHIPS
from benchmarks.record import Figure, keep, kept
from cases.criteria.imo import REFERENCES


def test_no_page_is_edited_by_hand() -> None:
    for path, text in pages.pages(kept()).items():
        assert path.read_text(encoding="utf-8") == text, f"python -m benchmarks.pages writes {path.name}"


def test_figures_of_the_readme_are_there_and_of_this_minor_version() -> None:
    known = kept()
    assert {name for _, template in pages.ROWS.items() for name in pages.anchors(template)} <= set(known)
    assert pages.old(known) == []


def test_every_command_of_the_record_is_a_benchmark() -> None:
    for row in kept().values():
        module = row["command"].split()[2].replace(".", "/")
        assert any((pages.ROOT / f"{module}{end}").exists() for end in (".py", "/__main__.py")), row["command"]


def test_a_figure_is_kept_with_where_it_comes_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "RECORD", tmp_path / "record.json")
    keep({"b": Figure("a share", 0.5, "%", 0.01)}, "python -m benchmarks.one")
    keep({"a": Figure("a count", 3, of=4)}, "python -m benchmarks.two")
    found = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    assert list(found) == ["a", "b"]
    assert found["b"].items() >= {k: v for k, v in asdict(Figure("a share", 0.5, "%", 0.01)).items() if v}.items()
    assert set(found["a"]) == {"what", "value", "of", "command", "date", "machine", "version"} | {"commit"} & set(
        found["a"]
    )


@pytest.mark.parametrize(
    ("figure", "words"),
    [
        ({"value": 3, "of": 4}, "3 of 4"),
        ({"value": 0.9354, "unit": "%", "error": 0.007}, "93.5 ± 0.7 %"),
        ({"value": 0.0999, "error": 0.017}, "0.0999 ± 0.0170"),
        ({"value": 12345.6, "unit": "s"}, "12,346 s"),
        ({"value": 6.877, "unit": "s"}, "6.88 s"),
    ],
)
def test_values_are_shown_with_their_error_and_unit(figure: dict, words: str) -> None:
    assert pages.shown(figure) == words


# Ships of the literature: figures of their sources
def test_the_tanker_turns_tighter_than_starting_ships_used_to() -> None:
    """Tactical diameter at 35 degrees 3.1 L; the first starting ship had 4.3."""
    found = next(ship.figures for ship in SHIPS if ship.name == "Esso tanker 190 000 tdw")
    assert found["turning:35", "tactical_diameter"] == pytest.approx(3.13, abs=0.06) and set(found) == set(FIGURES)


def test_measured_figures_precede_those_of_models() -> None:
    kvlcc2 = SHIPS[0]
    known = REFERENCES["kvlcc2_l7"]
    both = 0.5 * (known["turning:35", "advance"] + known["turning:-35", "advance"])
    assert kvlcc2.figures["turning:35", "advance"] == pytest.approx(both, rel=1e-5)
    assert all(set(ship.figures) <= set(FIGURES) for ship in SHIPS)
    assert all(ship.source and math.isfinite(ship.speed) for ship in SHIPS)
