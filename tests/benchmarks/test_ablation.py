"""The judge names switches that exist, and replays decisions without changing them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pytest

from benchmarks.ablation import switches, yard_figures
from benchmarks.ablation.diagnoses import RARE, REMEMBERED, RULES, TOLD_ONLY
from benchmarks.ablation.fits import SWITCHES, change
from benchmarks.ablation.switches import Memo, Switch, place_of, replaced
from benchmarks.ablation.table import is_right, two_numbers
from fitting.calibrate import FitOptions
from fitting.settings import Settings

EVERY = (*SWITCHES, *RULES, *RARE, *yard_figures.SWITCHES)


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
    for some in (SWITCHES, (*RULES, *RARE), yard_figures.SWITCHES):
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


def test_two_numbers_answer_a_diagnosis() -> None:
    """Gain in BIC, then log Bayes factor."""
    evidence = {
        "candidates": [["tow", 7.0, 0.1, 1.0], ["current", 9.0, 0.1, 1.0]],
        "unnamed": {"all": 1.0, "x": 13.0},
    }
    assert two_numbers(evidence) == ("named", ["current"], False)
    assert two_numbers({**evidence, "candidates": []})[0] == "unknown"
    assert is_right("library", ("current",), two_numbers(evidence)) and not is_right("null", (), two_numbers(evidence))
