"""A ship and trials that do not belong together by their actuators: refused by every verb that reads both."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mmg_ident as mi
from cases.inputs import assumed, model_inputs
from cases.shipfiles.ship_file import dump_ship, load_ship, parse_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import UserError
from mmg_ident.commands.main import main
from tests.cases.shipfiles.test_new_ship import AZIMUTH
from tests.support.calibrated import FREE
from tests.support.commands import printed, refusal
from tests.support.synthetic_runs import coarse_runs

pytestmark = pytest.mark.usefixtures("blank_figures")

PODS = AZIMUTH.replace("y_az = 0.0", "y_az = 0.1\nx_az_2 = -1.4\ny_az_2 = -0.1")


@pytest.fixture(scope="module")
def trial() -> Trial:
    """A zigzag of the ESSO OSAKA, steered by her rudder."""
    return coarse_runs()[0][0]


@pytest.mark.parametrize("verb", ["score", "predict", "fit", "train", "diagnose", "simulate", "imo"])
def test_a_ship_none_of_whose_propulsors_is_in_the_file_is_refused(verb: str, trial: Trial, tmp_path: Path) -> None:
    ship, file, out = tmp_path / "pods.toml", tmp_path / "run.csv", tmp_path / "out"
    ship.write_text(dump_ship(parse_ship(PODS)), encoding="utf-8")
    write_trial(trial, file)
    words: dict[str, list[object]] = {
        "score": [ship, file],
        "simulate": [ship, "--controls", file, "--out", tmp_path / "out.csv"],
        "imo": [file, "--ship", ship],
    }
    line = refusal(verb, *words.get(verb, [ship, file, "--out", out]))
    assert "n_azimuth" in line and "n, delta" in line and not out.exists()


def test_a_run_without_a_window_has_nothing_to_score_and_tables_are_whole(trial: Trial, tmp_path: Path) -> None:
    gaps = np.where(np.arange(len(trial)) % 20 == 7, np.nan, trial["u"])
    write_trial(trial, tmp_path / "whole.csv")
    write_trial(trial.with_columns(u=gaps), tmp_path / "gaps.csv")
    lines = printed("score", "esso_osaka_3m", "esso_osaka_3m", *sorted(tmp_path.glob("*.csv"))).splitlines()
    assert sum(line.split() == ["gaps", "nothing", "to", "score", "0"] for line in lines) == 1
    assert sum(line.split() == ["gaps:", "nothing", "to", "score"] for line in lines) == 1
    assert not any("diverges" in line for line in lines)
    tables = [line for line in lines if line and not line.startswith(("note:", "sigma from"))]
    assert max(map(len, tables)) <= 80


@pytest.mark.parametrize("idle", ["n", "delta"])
def test_a_propeller_or_rudder_that_moves_and_that_nobody_uses_is_refused(idle: str, trial: Trial) -> None:
    still = {name: np.zeros(len(trial)) for name in ("n", "delta") if name != idle}
    pods = {"n_azimuth": np.full(len(trial), 5.0), "azimuth": np.zeros(len(trial))}
    with pytest.raises(UserError, match=f"{idle} reaches"):
        mi.score(parse_ship(PODS), [trial.with_columns(**still, **pods)])


def test_rudders_that_another_column_stands_for_are_used(trial: Trial) -> None:
    twin = ("n", "delta_port", "delta_starboard", "wind_north", "wind_east")
    assert {note.code for note in model_inputs(trial, twin).notices} == {"stand_in"}
    own = trial.with_columns(delta_port=trial["delta"], delta_starboard=trial["delta"])
    model_inputs(own, twin)
    assert {note.code for note in model_inputs(own).notices} == {"input_ignored"}


def test_every_function_says_what_a_fit_says_of_the_inputs(trial: Trial) -> None:
    ship = load_ship("esso_osaka_3m")
    calm = {name: values for name, values in trial.columns.items() if not name.startswith("wind")}
    trial = replace(trial, columns={**calm, "pitch": np.full(len(trial), 0.3)})
    wanted = {note.code for note in assumed([trial], ship.inputs)}
    assert wanted == {"input_ignored", "no_wind"}
    assert wanted <= {getattr(note, "code", "") for note in mi.score(ship, [trial]).notes}
    assert wanted <= {note.code for note in mi.predict(ship, [trial])[0].notes}


# mmg fit refuses what mmg check calls contradictory, and fits it when told to; mmg train says at once what is too
WORDS = ["--only", ",".join(FREE), "--no-next-trial", "--measurement", "none", "--estimator", "windows"]
WORDS += ["--window", "10", "--max-iterations", "1"]


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["fit", "train", "diagnose", "score", "predict", "imo", "select", "compare"])
def test_every_command_on_trials_refuses_what_is_contradictory_and_goes_on_when_told_to(
    verb: str, tmp_path: Path
) -> None:
    """A rudder of the other sign."""
    trials = coarse_runs()[0][:2]
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
    line = refusal(verb, *words)
    assert "--unchecked" in line and paths[0] in line and not (tmp_path / "out").exists()
    if verb not in ("select", "train", "diagnose"):  # they would take long; that the option is there is enough
        assert main([verb, *words, "--unchecked"]) == (1 if verb == "fit" else 0)  # one iteration does not suffice


@pytest.mark.slow
def test_a_ship_that_diverges_has_no_scores_and_no_predictions(
    trial: Trial, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
