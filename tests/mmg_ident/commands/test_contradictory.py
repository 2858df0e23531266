"""mmg fit refuses what mmg check calls contradictory, and fits it when told to; mmg train says at once what is too
short."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main

WORDS = ["--only", "X_0F", "--no-next-trial", "--measurement", "none", "--window", "10", "--max-iterations", "1"]


@pytest.mark.parametrize("verb", ["fit", "train", "diagnose", "score", "predict", "imo", "select", "compare"])
def test_every_command_on_trials_refuses_what_is_contradictory_and_goes_on_when_told_to(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rudder of the other sign."""
    trials = demo_trials(3, dt=0.5)[0][:2]
    paths = [str(tmp_path / f"{trial.name}.csv") for trial in trials]
    for trial, path in zip(trials, paths, strict=True):
        write_trial(replace(trial, columns={**trial.columns, "delta": -trial["delta"]}), Path(path))
    out = ["--out", str(tmp_path / "out")]
    words = {
        "fit": ["esso_osaka_3m", paths[0], *WORDS, *out],
        "score": ["esso_osaka_3m", *paths],
        "imo": [*paths, "--length", "3"],
        "select": ["esso_osaka_3m", *paths, "--only", "sm2-order1", *out],
        "compare": ["--train", paths[0], "--test", paths[1], "--models", "captive", *out],
    }.get(verb, ["esso_osaka_3m", *paths, *out])
    assert main([verb, *words]) == 2 and not (tmp_path / "out").exists()
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert "--unchecked" in line and paths[0] in line
    if verb not in ("select", "train", "diagnose"):  # they would take long; that the option is there is enough
        assert main([verb, *words, "--unchecked"]) == (1 if verb == "fit" else 0)  # one iteration does not suffice


def test_a_ship_that_diverges_has_no_scores_and_no_predictions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    write_trial(trial, tmp_path / "run.csv")
    ship = load_ship("esso_osaka_3m").with_values({"X_0F": 2.0, "Y_v": 3.0, "N_r": 1.0})
    (tmp_path / "bad.toml").write_text(dump_ship(ship))
    bad, run = str(tmp_path / "bad.toml"), str(tmp_path / "run.csv")
    assert main(["score", bad, "esso_osaka_3m", run]) == 2
    said = capsys.readouterr()
    assert "nan" not in said.out and "diverges" in said.out
    assert main(["predict", bad, run, "--out", str(tmp_path / "p.csv")]) == 2
    assert not (tmp_path / "p.csv").exists()
    assert main(["fit", bad, run, *WORDS, "--max-iterations", "0", "--out", str(tmp_path / "fit")]) == 2
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    assert "diverges" in page and not re.search(r"(?i)>\s*nan\s*<", page)
    assert main(["compare", "--ship", bad, "--train", run, "--test", run, "--models", "captive"]) == 2


@pytest.mark.slow
def test_doubts_and_what_is_left_out_are_in_the_pages(tmp_path: Path) -> None:
    trial = demo_trials(3)[0][0]
    rows = (trial.t > 50) & (trial.t < 56)
    broken = trial.with_columns(psi=trial["psi"] + np.where(rows, 0.3, 0.0))
    write_trial(broken, tmp_path / "run.csv")
    main(["fit", "esso_osaka_3m", str(tmp_path / "run.csv"), *WORDS, "--out", str(tmp_path / "fit")])
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    where = html.escape(f"{tmp_path / 'trials.toml'}")
    assert str(where) in page


def test_a_record_without_a_whole_restart_is_scored_over_30_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = demo_trials(3, dt=0.5)[0][0]
    lost = (trial.t % 45.0 > 44.0) | (trial.t > trial.t[-1] - 2.0)
    write_trial(trial.with_columns(delta=np.where(lost, np.nan, trial["delta"])), tmp_path / "run.csv")
    assert main(["score", "esso_osaka_3m", str(tmp_path / "run.csv")]) == 0
    said = capsys.readouterr()
    assert "diverges" not in said.out + said.err and "nan" not in said.out
    assert "100" in said.out
