"""Bad input of every verb, and ships and trials that do not belong together: exit code 2, one line, nothing written."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mmg_ident as mi
from cases.inputs import assumed, model_inputs
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from mmg.errors import UserError
from mmg_ident.commands.main import main
from tests.support.actuator_ships import true_ship
from tests.support.calibrated import FREE, small_result
from tests.support.commands import printed, refusal
from tests.support.diagnosis_cases import FEW, SHIP
from tests.support.records import sailed, write_log
from tests.support.synthetic_runs import coarse_runs
from tests.support.trial_files import motion_columns, write_csv, write_trials

# Bad input of every verb: exit code 2, one line that names what is wrong, and nothing written
pytestmark = pytest.mark.usefixtures("blank_figures")

INPUTS = "t [s],n [rps],delta [rad]\n{},10,0\n{},{},0\n"
LONG = f"'{'n, ' * 2000}'"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ships, trials, inputs, a log, a run and a folder of somebody else, by names that the commands below use."""
    place = tmp_path_factory.mktemp("bad")
    esso = dump_ship(load_ship("esso_osaka_3m"))
    ships = {
        "few": dump_ship(FEW),
        "fixed": dump_ship(SHIP.fixing(list(SHIP.symbols))),
        "unknown": esso.replace("[coefficients.Y_v]", "[coefficients.Y_vvvv]"),
        "reversed": esso.replace("lower = 0.04203\nupper = 0.05137", "lower = 0.06\nupper = 0.05"),
        "broken": "ship = ",
    }
    for name, text in ships.items():
        (place / f"{name}.toml").write_text(text, encoding="utf-8")
    for name, rows in {"inputs": (0, 1, 10), "words": (0, 1, "full ahead"), "backwards": (1, 0, 10)}.items():
        (place / f"{name}.csv").write_text(INPUTS.format(*rows))
    (place / "nothing.csv").write_text("t [s],speed [kn]\n0,10\n1,10\n")
    good = motion_columns(60.0)
    path = write_csv(place / "furlong.csv", good, rows=None)
    path.write_text(path.read_text().replace("u [m/s]", "u [furlong/fortnight]"))
    write_trials(place / "trials", trials := coarse_runs()[0][:2])
    trial = trials[-1]
    write_trial(replace(trial, columns={k: v[:20] for k, v in trial.columns.items()}), place / "short.csv")
    small_result().save(place / "run")
    (place / "taken").mkdir()
    (place / "taken" / "precious.txt").write_text("mine")
    write_log(place / "log", {**(log := sailed(0.5)), "delta": 57.3 * log["delta"]}, 1)  # degrees that are called rad
    (place / "empty").mkdir()
    return place


BAD = {
    "fit esso_osaka_3m trials": [
        "--window -3", "--fix Z_z | Z_z", "--without sails", "--sigma 1,2", "--loss absolute", "--run-weight 0",
        "--run-weight 0.5 --sigma 1,1,1,1,1,1 | --sigma", "--captive nowhere.csv | nowhere", "--captive-sigma 1,1,1",
        "--no-such-option", "--validate --out new | --validate",
        "--per-run tide | tide", "--per-run current:z | 'z'", "--per-run current:x=9 | x=9",
        "--per-run current --per-run current:x | current", "--per-run current --with current | current",
        "--with disturbance | disturbance", "--per-run rudder_lag | rudder_lag",
        "--name ../x | --name", "--name a/b | --name", "--out taken", "--out nothing.csv/run |",
    ],
    "fit": [
        "nobody trials", "unknown.toml trials | Y_vvvv", "reversed.toml trials | below", "broken.toml trials | TOML",
        "esso_osaka_3m furlong.csv | furlong", "esso_osaka_3m empty | empty",
    ],
    "select esso_osaka_3m trials": [
        "--objective luck", "--optimizer cmaes | --optimizer is gone", "--seeds 2", "--objective paper --seeds 0",
        "--workers 0 | --workers 0",
    ],
    "predict esso_osaka_3m short.csv": ["--window 500 --stride 10 | --window", "--window nan"],
    "train esso_osaka_3m trials": [
        "--keep never", "--model oracle", "--seeds 0", "--rate -1", "--penalty -1", "--time-limit 0", "--out taken",
        "--model fnn --memory 3", "--layers 3", "--model fnn --loss huber", "--model rnn --augment sli3 | sli3",
        "--model rnn --memory 0", "--model rnn --initial -1",
    ],
    "compare --train trials --test short.csv": [
        "--models captive,oracle | oracle", "--fractions 0,1", "--fractions all", "--seeds 0", "--time-limit 0",
        "--ship nothing | nothing",
    ],
    "compare": ["--train nowhere --test short.csv | nowhere", "--train short.csv --test short.csv |"],
    "train": ["esso_osaka_3m short.csv | 10 s", "nobody trials"],
    "gap few.toml trials": [" | test", "--test missing.csv | missing.csv"],
    "diagnose few.toml trials": [
        "--without sails", "--without hull", "--step 0", "--workers 0", "--site no_site.toml | no_site",
        "--site few.toml | section", "--between weather", "--between day", "--between folder | group",
        "--test no_test.csv | no_test", "--time-limit -1", "--out taken",
    ],
    "diagnose": [
        "few.toml nowhere.csv | nowhere", "nobody trials", "trials trials | no such ship", "no_ship.toml trials",
        "few.toml short.csv | 10", "fixed.toml trials | every coefficient is fixed", "few.toml | TRIAL",
    ],
    "plan run --area 60x25 --time 60": [
        "--area 2x1", "--area sixty | length x width", "--coefficients Y_vvv | Y_vvv", "--coefficients A_1 | A_1",
        "--figures beauty | beauty", "--coefficients Y_v --figures advance", "--time 1", "--speed-limit 90",
        "--rudder-limit 90", "--time-limit 0", "--effort 0",
    ],
    "scale": [
        "mariner --length 5 | --froude-only", "nobody --length 5 | nobody", "kvlcc2_l7 --length -3",
        "kvlcc2_l7 --length 320 --form-factor 7", "kvlcc2_l7 --length 320 --name ../x | name",
        "kvlcc2_l7 --length 320 --out taken",
    ],
    "months": [
        "absent --ship esso_osaka_3m | absent", "empty --ship esso_osaka_3m | .parquet",
        "empty --ship esso_osaka_3m --windows 0", "empty --ship esso_osaka_3m --time-limit -1",
        "log --ship esso_osaka_3m | rad",
    ],
}  # fmt: skip
"""A command -> its faults, each as options | what the line names, by default the last option or else the first word.
Where a command writes, --out is new unless they name another."""
PLAIN = {
    "select": [
        "esso_osaka_3m | trials", "esso_osaka_3m --terms sm9 | 'sm9'", "esso_osaka_3m --write sm1-order1 | --out",
        "vectwin_3m --list --actuators 'n, delta_port' | 1 of 2", "vectwin_3m --list --actuators 'n, sail' | 'sail'",
        "vectwin_3m --list --order 0 | order 0", "vectwin_3m --list --order 40 | monomials",
        "esso_osaka_3m --list --order 99999999 | 27131", "esso_osaka_3m --terms '' | ''",
        f"vectwin_3m --list --actuators {LONG} | 2000", f"vectwin_3m --list --actuators {'q' * 2000} | qqq ...",
        "vectwin_3m --list --duplicates some | 'some'",
    ],
    "simulate esso_osaka_3m": [
        " | either", "--maneuver straight --controls a.csv | either", "--maneuver pirouette | unknown manoeuvre",
        "--maneuver zigzag:20 | rudder/heading", "--maneuver straight --wind gale | speed:direction",
        "--maneuver straight --wind 500:10 | 500 m/s", "--maneuver turning:35 --rudder-rate -1 | = -1 deg/s",
        "--maneuver straight --effect current:x=0.01,x=0.02 | x", "--maneuver straight --dt 0 | dt",
        "--maneuver straight --duration -5 | duration", "--maneuver straight --seed -1 | seed",
        "--maneuver straight --out run.xlsx | .csv", "--maneuver straight --out missing_folder/run.csv | folder",
        "--controls missing.csv | missing.csv", "--controls words.csv | not a number",
        "--controls nothing.csv | missing column",
        "--controls backwards.csv | row 2", "--controls inputs.csv --speed 1 | --speed",
        "--maneuver straight --out inputs.csv | exists", "--maneuver zigzag:20/20 --scatter 8 --noise | --noise",
    ],
    "ships": ["titanic", "--new |"],
    "score": ["trials |", "esso_osaka_3m |", "esso_osaka_3m short.csv | 30", "esso_osaka_3m short.csv --adapt -5"],
    "imo": [
        "esso_osaka_3m esso_osaka_3m | one ship", "missing.csv --length 3 | missing.csv", "missing.csv | --length",
        "esso_osaka_3m --length 3", "inputs.csv --length 3 --speed 1", "esso_osaka_3m --speed -1 | --speed -1",
        "esso_osaka_3m --plot figure.doc | .png", "esso_osaka_3m --maneuver pirouette | unknown manoeuvre",
        "esso_osaka_3m --maneuver straight | straight", "inputs.csv --length -3",
    ],
    "demo": ["--out taken", "--out nothing.csv/demo |"],
    "nonsense": [" |"],
}  # fmt: skip
"""The same of verbs that write nothing unless they are told where."""
CASES = [(verb, fault) for some in (BAD, PLAIN) for verb in some for fault in some[verb]]


@pytest.mark.slow
@pytest.mark.parametrize(("command", "fault"), CASES, ids=[" ".join(case)[:70] for case in CASES])
def test_bad_input_is_one_line_and_writes_nothing(
    command: str, fault: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    text, mark, said = fault.partition(" |")
    words = [*command.split(), *(own := shlex.split(text))]
    out = ["--out", "new.csv"] if command in BAD and "--out" not in words else []
    before = sorted(place.rglob("*"))
    told = refusal(*words, *out)
    named = said.strip() if mark else [*own[:1], *(word for word in own if word.startswith("--"))][-1]
    assert named in told and len(told) < 700
    assert sorted(place.rglob("*")) == before


# A ship and trials that do not belong together by their actuators: refused by every verb that reads both
PODS = true_ship("pods")


@pytest.fixture(scope="module")
def trial() -> Trial:
    """A zigzag of the ESSO OSAKA, steered by her rudder."""
    return coarse_runs()[0][0]


@pytest.mark.parametrize("verb", ["score", "predict", "fit", "train", "diagnose", "simulate", "imo"])
def test_a_ship_none_of_whose_propulsors_is_in_the_file_is_refused(verb: str, trial: Trial, tmp_path: Path) -> None:
    ship, file, out = tmp_path / "pods.toml", tmp_path / "run.csv", tmp_path / "out"
    ship.write_text(dump_ship(PODS), encoding="utf-8")
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
        mi.score(PODS, [trial.with_columns(**still, **pods)])


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
