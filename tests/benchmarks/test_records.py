"""What benchmarks record, the pages of it, and the switches that the ablation measures."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import pytest

from benchmarks import pages, record
from benchmarks.ablation import switches
from benchmarks.ablation.diagnoses import RARE, REMEMBERED, RULES, TOLD_ONLY
from benchmarks.ablation.fits import SWITCHES, change
from benchmarks.ablation.switches import Memo, Switch, place_of, replaced
from benchmarks.literature import FIGURES, SHIPS
from benchmarks.record import Figure, keep, kept
from cases.criteria.imo import REFERENCES
from fitting.calibrate import FitOptions
from fitting.settings import Settings


# README.md and RESULTS.md are those of the record, whose figures are of this minor version of the package
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


# The judge names switches that exist, and replays decisions without changing them
EVERY = (*SWITCHES, *RULES, *RARE)


@pytest.mark.parametrize("switch", EVERY, ids=lambda s: s.name)
def test_a_switch_names_what_exists(switch: Switch) -> None:
    """A row whose mechanism is deleted leaves the harness."""
    for target in switch.replaced:
        place_of(target)
    assert set(switch.settings) <= {f.name for f in fields(Settings)}
    assert set(switch.options) <= {f.name for f in fields(FitOptions)}
    assert set(switch.inside) <= {target.rpartition(":")[2].rpartition(".")[2] for target in REMEMBERED}


def test_what_is_remembered_exists() -> None:
    """Functions that take time, and what is told beside the answer."""
    for target in (*REMEMBERED, *TOLD_ONLY):
        place_of(target)


def test_names_of_rows_are_unique() -> None:
    """Each row of a table has its own."""
    for some in (SWITCHES, (*RULES, *RARE)):
        assert len({s.name for s in some}) == len(some)


def test_a_name_is_replaced_wherever_it_was_imported_and_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in modules that took it by its name."""
    from diagnosis import diagnose
    from diagnosis.judgement import verdict

    monkeypatch.setattr(switches, "modules", lambda: (verdict, diagnose))  # to import all takes seconds
    before = diagnose.limits
    with replaced({"diagnosis.judgement.verdict:limits": len}):
        assert diagnose.limits is len and verdict.limits is len
    assert diagnose.limits is before and verdict.limits is before


@dataclass(frozen=True)
class Pair:
    """Two arrays."""

    a: np.ndarray
    b: np.ndarray


def test_a_memo_tells_contents_apart() -> None:
    """Equal contents have one digest, others another."""
    memo, one = Memo(), Pair(np.arange(3), np.ones(2))
    assert memo.mark(one) == memo.mark(Pair(np.arange(3), np.ones(2)))
    assert memo.mark(one) != memo.mark(Pair(np.arange(3), np.zeros(2)))
    assert memo.mark([1, {"a": 2}]) != memo.mark([1, {"a": 3}])


def test_a_change_has_the_jackknife_error_of_its_files() -> None:
    """Three files of which each is a tenth worse: +10 % without error."""
    before = {n: {n: [v, None]} for n, v in zip("abc", (1.0, 2.0, 3.0), strict=True)}
    after = {n: {n: [1.1 * f[n][0], None]} for n, f in before.items()}
    assert change(before, after, 0) == pytest.approx((2.0, 0.1, 0.0))
    assert np.isnan(change(before, after, 1)[0])
