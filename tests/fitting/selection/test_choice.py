"""mmg select --objective paper: a run folder like any other, with learning curves; wrong options in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import write_trial
from fitting.selection import learning
from fitting.selection.candidates import candidate
from mmg_ident.commands.main import main
from tests.fitting.selection.paper_problems import ESSO, harbour


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    found = []
    for number, run in enumerate(harbour()):
        path = tmp_path / f"h{number}.csv"
        write_trial(run, path)
        found.append(str(path))
    return found


@pytest.mark.slow
def test_a_chosen_polynomial_has_a_run_folder_with_its_learning_curves(
    tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "SPARSITIES", (1e-1, 1e-2))
    out = tmp_path / "run"
    wanted = ["--objective", "paper", "--only", "sm1-order1", "--out", str(out), "--seeds", "2"]
    assert main(["select", "esso_osaka_3m", *files[:2], "--validate", files[2], *wanted]) in (0, 1)
    assert "objective" in capsys.readouterr().out
    content = json.loads((out / "selection.json").read_text())
    rows = content["learned"]
    assert {(row["name"], row["seed"]) for row in rows} == {("sm1-order1", 0), ("sm1-order1", 1)}
    lines = (out / "learning.csv").read_text().splitlines()
    assert len(lines) > 5 and lines[0].startswith("candidate,seed,evaluations,seconds,objective")
    assert (out / "learning.csv").stat().st_size > 100
    chosen = load_ship(out)
    assert content["chosen"] == "sm1-order1"
    best = min(rows, key=lambda row: row["validation"])
    assert len(chosen.monomials) == len(candidate(ESSO, "sm1-order1").ship.monomials) - best["terms_left_out"]
    assert sorted(path.stem for path in (out / "learned").glob("sm1*.json")) == ["sm1-order1_seed0", "sm1-order1_seed1"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--objective", "luck"], "--objective"),
        (["--optimizer", "cmaes"], "--optimizer is gone"),
        (["--seeds", "2"], "--seeds"),
        (["--objective", "paper", "--seeds", "0"], "--seeds"),
        (["--workers", "0"], "--workers 0"),
    ],
)
def test_wrong_options_are_one_line(
    options: list[str], told: str, tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["select", "esso_osaka_3m", *files, "--out", str(tmp_path / "run"), *options]) == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.glob("run*"))


def test_a_candidate_that_needs_more_samples_or_astern_motion_is_refused_with_counts(
    tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = ["--objective", "paper", "--only", "sm4-order3", "--out", str(tmp_path / "run")]
    assert main(["select", "esso_osaka_3m", files[0], "--validate", files[2], *wanted]) == 2
    error = capsys.readouterr().err
    assert "unknowns" in error and "221 samples" in error
