"""What could be seen of a hidden effect by somebody who knows it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.generator.cases import Case, run
from benchmarks.blind.generator.deal import LIBRARY, Hand
from benchmarks.blind.generator.world import WORLDS
from benchmarks.blind.generator.write import generate
from benchmarks.blind.oracle import main, missing_rates, visible

BASIN = WORLDS["basin"]


def made(*effects: tuple[str, str]) -> np.ndarray:
    """What the ``effects`` (name, strength) add to the accelerations of a case."""
    own = tuple((next(f for f in LIBRARY if f.name == name), strength) for name, strength in effects)
    case = Case.prepared(Hand("library" if own else "null", own), "mixed", np.random.SeedSequence(3), BASIN)
    return missing_rates(run([case]), BASIN)


def test_nothing_is_missing_without_effects_and_an_instrument_pushes_nothing() -> None:
    def push(*effects: tuple[str, str]) -> np.ndarray:
        return np.sqrt((made(*effects) ** 2).mean(axis=(0, 2)))

    nothing = push()  # between two samples the rudder is not quite where a straight line has it
    tow = push(("tow", "strong"))
    assert (push(("gnss_delay", "strong")) < 3 * nothing + 1e-9).all()
    assert tow.max() > 20 * nothing.max()


def test_a_strong_force_is_visible_and_its_row_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, seed = "library_mixed", 13  # a bank, strong
    generate(tmp_path / "cases" / name, 1, seed, "library", "mixed", BASIN)
    notes = {name: {"cases": 1, "seed": seed, "world": "basin", "sha256": ""}}
    (tmp_path / "made.json").write_text(json.dumps(notes), encoding="utf-8")
    (tmp_path / "answers" / name).mkdir(parents=True)
    answer = {"verdict": "named", "effects": [{"name": "tow"}]}
    (tmp_path / "answers" / name / "case_0000.json").write_text(json.dumps(answer), encoding="utf-8")
    (found,) = visible(tmp_path, name)
    assert (found.effect, found.strength) == ("bank", "strong")
    assert found.before >= found.expected > 10 and found.z > 2
    assert main([str(tmp_path), "--strength", "no such"]) == 0 and found.case not in capsys.readouterr().out


def test_ships_of_another_length_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    notes = {"null_mixed": {"cases": 1, "seed": 1, "world": "sea", "sha256": ""}}
    (tmp_path / "made.json").write_text(json.dumps(notes), encoding="utf-8")
    assert main([str(tmp_path)]) == 2 and "sea" in capsys.readouterr().err
