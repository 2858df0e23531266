"""mmg fit refuses what mmg check calls contradictory, and fits it when told to; mmg train says at once what is too
short."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main

WORDS = ["--only", "X_0F", "--no-next-trial", "--measurement", "none", "--window", "10", "--max-iterations", "1"]


def test_a_rudder_of_the_other_sign_is_refused_unless_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    path = tmp_path / "other_sign.csv"
    write_trial(replace(trial, columns={**trial.columns, "delta": -trial["delta"]}), path)
    command = ["fit", "esso_osaka_3m", str(path), *WORDS, "--out", str(tmp_path / "run")]
    assert main(command) == 2 and not (tmp_path / "run").exists()
    line = capsys.readouterr().err.strip()
    assert "\n" not in line and "contradictory" in line and "--unchecked" in line and str(path) in line
    assert main([*command, "--unchecked"]) == 1  # a single iteration does not suffice
    assert (tmp_path / "run" / "result.json").exists()


@pytest.mark.parametrize("verb", ["train", "diagnose"])
def test_what_is_contradictory_is_neither_trained_on_nor_diagnosed(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    path = tmp_path / "other_sign.csv"
    write_trial(replace(trial, columns={**trial.columns, "delta": -trial["delta"]}), path)
    assert main([verb, "esso_osaka_3m", str(path), "--out", str(tmp_path / "run")]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line and "rudder is positive to port" in line and not (tmp_path / "run").exists()
    assert main(["imo", str(path), "--length", "3"]) == 2
    assert "rudder is positive to port" in capsys.readouterr().err


def test_a_score_that_is_no_number_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    short = {name: column[:40] for name, column in trial.columns.items()}
    write_trial(replace(trial, columns=short), tmp_path / "short.csv")
    assert main(["score", "esso_osaka_3m", str(tmp_path / "short.csv")]) == 2
    assert "no whole window of 30 s" in capsys.readouterr().err


def test_too_little_to_train_on_is_said_without_loading_torch(tmp_path: Path) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    write_trial(
        replace(trial, columns={name: column[:20] for name, column in trial.columns.items()}), tmp_path / "s.csv"
    )
    program = (
        "import sys; from mmg_ident.commands.main import main; "
        f"code = main(['train', 'esso_osaka_3m', r'{tmp_path / 's.csv'}', '--out', r'{tmp_path / 'run'}']); "
        "assert 'torch' not in sys.modules; sys.exit(code)"
    )
    made = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert made.returncode == 2 and "too little data for a residual" in made.stderr, made.stderr
    assert not (tmp_path / "run").exists()
