"""``mmg train``, what goes on into its folders, and a hybrid in every other verb."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from safetensors.numpy import load_file

import mmg_ident
import mmg_ident as mi
from cases.criteria.standard_runs import figures_of, simulated_trial
from cases.io.read import read_trial
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import reduced_ship
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import write_trial
from delivery.full_scale.result import result_of
from diagnosis import diagnose as diagnosis
from diagnosis.estimation.map_estimate import BrokenModelError
from diagnosis.inputs import told_of_predictions
from fitting.prediction.predict import outside_share, predict
from fitting.report.run_folder import read_result
from mmg.messages import Progress
from mmg.network import Layers
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.api import content_of
from mmg_ident.commands.main import main
from residual.result import page_of, read_training
from residual.settings import TrainSettings
from tests.fitting.prediction.test_adaptation import PAID, runs
from tests.support import hybrids
from tests.support.calibrated import small_result
from tests.support.commands import interrupted, refusal, shown
from tests.support.figures import unrendered
from tests.support.trial_files import write_trials

# ``mmg train`` and a hybrid in the other commands: run folder, decision, envelope, one clear line for bad input
QUICK = ["--seeds", "2", "--epochs", "12", "--width", "8", "--rate", "1e-2", "--penalty", "0.001", "--step", "1"]
LONG = [*QUICK[:2], "--epochs", "3000", "--step", "1"]


def training(folder: Path, out: Path, *more: str) -> list[str]:
    return ["train", "esso_osaka_3m", str(folder / "trials"), *more, "--out", str(out)]


def judged(folder: Path, out: Path) -> list[str]:
    """The training of the fixture ``folder``, into ``out``."""
    return training(folder, out, "--validate", str(folder / "held_out.csv"), *QUICK)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials of the ship that lacks a force, and the run folder of a training on them."""
    folder = tmp_path_factory.mktemp("train")
    write_trials(folder / "trials", hybrids.trials(hybrids.lacking(), 3, 400))
    write_trial(hybrids.trials(hybrids.lacking(), 1, 300, seed=7)[0], folder / "held_out.csv")
    assert main(judged(folder, folder / "run")) == 0
    return folder


@pytest.mark.slow
def test_a_hybrid_is_a_ship_with_the_calibrated_one_beside_it(folder: Path) -> None:
    ship, calibrated = load_ship(folder / "run"), load_ship(folder / "run" / "calibrated")
    assert calibrated.network is None and ship.without_network().coefficients == calibrated.coefficients
    assert ship.network is not None and len(ship.network.members) == 2
    bound = read_result(folder / "run")["bound"]
    np.testing.assert_allclose([bound[a] for a in ("du", "dv", "dr")], ship.network.bound)
    models = shown("score", "esso_osaka_3m", folder / "run", folder / "held_out.csv")["models"]
    assert models[str(folder / "run")]["window"] < models["esso_osaka_3m"]["window"]


@pytest.mark.slow
def test_prediction_says_which_share_lies_outside_the_envelope(folder: Path) -> None:
    trial = read_trial(folder / "held_out.csv")
    fast = trial.with_columns(n=3.0 * trial["n"])
    simulator = Simulator(load_ship(folder / "run"))
    known = outside_share(simulator, trial, predict(simulator, trial, 30.0, 30.0)[0])
    beyond = outside_share(simulator, fast, predict(simulator, fast, 30.0, 30.0)[0])
    assert known is not None and beyond is not None and known < 0.25 and beyond > 0.6
    bare = Simulator(load_ship("esso_osaka_3m"))
    assert outside_share(bare, trial, predict(bare, trial, 30.0, 30.0)[0]) is None
    (found,) = mi.predict(folder / "run", [fast])
    assert "outside_training" in {note.code for note in found.notes}


@pytest.fixture(scope="module")
def declined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials of the ship itself, on which nothing is left to learn, and the run folder of a training on them."""
    folder = tmp_path_factory.mktemp("declined")
    write_trials(folder / "trials", hybrids.trials(hybrids.ship(), 3, 300))
    for out, keep in (("run", "better"), ("always", "always")):
        assert main(training(folder, folder / out, *QUICK[:3], "2", "--step", "1", "--keep", keep)) == 0
    return folder


@pytest.mark.slow
def test_a_declined_residual_is_not_recommended_and_can_still_be_used(folder: Path, declined: Path) -> None:
    run = declined / "run"
    content = read_result(run)
    assert not content["kept"]
    assert (content["recommended"], content["other"]) == ("calibrated", "hybrid")
    assert not (run / "network.safetensors").exists() and load_ship(run).network is None
    assert load_ship(run / "hybrid").network is not None
    models = shown("score", run, run / "hybrid", folder / "held_out.csv")["models"]
    assert len({m["window"] for m in models.values()}) == 2
    always = read_result(declined / "always")
    assert always["kept"] and not always["decision"]["kept"]
    assert [m["code"] for m in always["messages"] if m["level"] == "notice"] == ["kept_always", "no_wind"]


KEYS = {
    "kind", "schema_version", "created", "command", "ship", "model", "settings", "seed", "seeds", "versions",
    "timings_s", "data", "validation_data", "per_seed", "sigma", "envelope", "outside", "scores", "figures", "warnings",
    "notices", "messages",
}  # fmt: skip
OF_A_HYBRID = {"kept", "recommended", "other", "decision", "bound", "output_scale", "residual_size", "calibration"}


@pytest.mark.slow
def test_the_keys_of_result_json_are_these(folder: Path, tmp_path: Path) -> None:
    content = read_result(folder / "run")
    assert set(content) == KEYS | OF_A_HYBRID and content["schema_version"] == 1
    assert set(content["per_seed"][0]) == {
        "seed", "status", "judged_by_part", "judged_window", "judged_restarts", "judged_runs", "stop_window",
        "training_windows", "learning_rate", "restarts", "seconds", "history",
    }  # fmt: skip
    assert set(content["decision"]) == {
        "kept", "words", "improvement", "spread", "restarts", "restarts_spread", "runs_error",
        "reason", "lowest", "highest", "groups", "past_s",
    }  # fmt: skip
    box = ("--model", "fnn", "--seeds", "1", "--epochs", "2", "--step", "1")
    assert main(training(folder, tmp_path / "box", *box)) == 0
    assert set(read_result(tmp_path / "box")) == KEYS | {"beside"}
    again = read_training(tmp_path / "box")
    assert again.to_dict() == read_result(tmp_path / "box") and again.black_box is not None


@pytest.mark.slow
def test_a_run_folder_is_read_as_the_result_that_was_written(folder: Path, tmp_path: Path) -> None:
    result = read_training(folder / "run")
    assert result.to_dict() == read_result(folder / "run")
    assert result.ship.network is not None and result.hybrid is not None
    table = result.to_pandas()
    assert list(table.index) == [0, 1] and table["window_after"].notna().all()
    assert "<table>" in result._repr_html_()
    result.save(tmp_path / "copy")
    assert load_ship(tmp_path / "copy").network is not None


@pytest.mark.slow
def test_the_command_and_the_function_leave_the_same_folder(folder: Path, tmp_path: Path) -> None:
    settings = TrainSettings(seeds=2, epochs=12, width=8, rate=1e-2, penalty=0.001, step=1.0)
    events: list[Progress] = []
    result = mi.train("esso_osaka_3m", folder / "trials", folder / "held_out.csv", settings, progress=events.append)
    result.save(tmp_path / "run")
    one, other = (read_result(run) for run in (folder / "run", tmp_path / "run"))
    timed = {"created", "command", "timings_s", "per_seed"}
    assert {k: v for k, v in one.items() if k not in timed} == {k: v for k, v in other.items() if k not in timed}
    assert {p.name for p in (folder / "run").iterdir()} - {"training"} == {p.name for p in (tmp_path / "run").iterdir()}
    assert {e.task for e in events} == {"seed 0", "seed 1", "seeds"} and max(e.step for e in events) == 12


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_weights_so_far(folder: Path, tmp_path: Path) -> None:
    code, words, _ = interrupted(training(folder, tmp_path / "run", *LONG), 15.0)
    content = read_result(tmp_path / "run")
    assert code == 130 and "seeds_stopped" in {row["code"] for row in content["messages"]}
    assert {row["status"] for row in content["per_seed"]} == {"stopped"}
    assert all(row["judged_window"]["after"] <= row["judged_window"]["before"] for row in content["per_seed"])
    assert [p.name for p in tmp_path.iterdir()] == ["run"] and "--resume" in words


@pytest.mark.parametrize("wait", [2.0, 6.5])
@pytest.mark.slow
def test_ctrl_c_in_the_first_seconds_leaves_no_process_and_no_traceback(
    wait: float, folder: Path, tmp_path: Path
) -> None:
    code, words, left = interrupted(training(folder, tmp_path / "run", *LONG, "--workers", "2"), wait)
    assert code == 130 and "interrupted" in words and not left
    assert "Traceback" not in words and "resource_tracker" not in words


def resumable(folder: Path, tmp_path: Path) -> tuple[Path, list[str]]:
    """A copy of the finished run from which a seed and the result are missing, as after an end without notice."""
    out = tmp_path / "run"
    shutil.copytree(folder / "run" / "training", out / "training")
    (out / "training" / "seed_1.json").unlink()
    return out, [*judged(folder, out), "--resume"]


@pytest.mark.slow
def test_resume_trains_what_is_missing_and_gives_the_same_weights(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, arguments = resumable(folder, tmp_path)
    assert main(arguments) == 0
    capsys.readouterr()
    one, other = (load_file(run / "network.safetensors") for run in (folder / "run", out))
    assert one.keys() == other.keys() and all((one[k] == other[k]).all() for k in one)
    before, after = (read_result(run)["per_seed"] for run in (folder / "run", out))
    assert all(a[k] == b[k] for a, b in zip(before, after, strict=True) for k in ("history", "judged_runs", "status"))
    assert main(arguments) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: [*a, "--epochs", "5"], "12"),
        (lambda a: [*a, "--model", "fnn"], "--model"),
        (lambda a: [a[0], "kvlcc2_l7", *a[2:]], "ship"),
        (lambda a: [*a[:2], a[4], *a[5:]], "trial"),
        (lambda a: [*a[:3], *a[5:]], "--validate"),
    ],
)
def test_resume_of_something_else_is_one_line(change: Any, words: str, folder: Path, tmp_path: Path) -> None:
    out, arguments = resumable(folder, tmp_path)
    assert words in refusal(*change(arguments))
    assert (out / "training" / "seed_0.json").exists() and not (out / "result.json").exists()


@pytest.mark.slow
def test_a_folder_without_a_training_is_not_resumed(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")  # empty: what a run leaves that was killed at once
    refusal(*training(folder, tmp_path, "--resume"))
    assert (tmp_path / "notes.txt").read_text() == "mine" and not (tmp_path / "result.json").exists()


@pytest.mark.slow
def test_a_time_limit_leaves_a_folder_to_resume(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    arguments = training(folder, out, *QUICK)
    assert main([*arguments, "--time-limit", "0.01"]) == 0
    assert "--resume" in capsys.readouterr().err
    assert {row["status"] for row in read_result(out)["per_seed"]} == {"stopped"}
    assert main([*arguments, "--resume"]) == 0
    assert {row["status"] for row in read_result(out)["per_seed"]} == {"finished"}


@pytest.mark.slow
def test_the_report_can_be_made_again_and_needs_no_figure(folder: Path) -> None:
    page = folder / "run" / "report.html"
    text = page.read_text()
    assert text.count("data:image/png;base64,") == 1
    page.unlink()
    assert main(["report", str(folder / "run"), "--no-imo"]) == 0 and page.read_text() == text
    # a figure that failed is none
    content = {**read_result(folder / "run"), "figures": []}
    bare = page_of([("run", folder / "run", content, load_ship(folder / "run"))])
    assert "<figure>" not in bare and "data:image" not in bare


def test_a_torch_that_cannot_be_imported_is_said_before_anything_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(mi.UserError, match="torch"):
        mi.train("esso_osaka_3m", "nowhere")


# What a calibration knows of predictions goes on into every folder made of its ship, and models are compared alike
KNOWN = ("coefficients", "correlation", "uncertainty", "bands", "adaptation", "campaigns")
"""Of a calibration with bands, a past that pays and values by campaign."""
CAMPAIGNS = {"values": {"2026-11-01": {"gyro.share": {"value": 0.1, "std": 0.01}}}}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration that knows that the past pays, in ``run``, trials, and trainings that begin at its ship."""
    root = tmp_path_factory.mktemp("past")
    with unrendered():
        small_result(3).save(root / "run")
        (root / "run" / "ship.toml").write_text(dump_ship(hidden_ship(), ""), encoding="utf-8")
        content = read_result(root / "run") | {"adaptation": PAID, "campaigns": CAMPAIGNS}
        (root / "run" / "result.json").write_text(json.dumps(content), encoding="utf-8")
        (root / "trials").mkdir()
        for k, trial in enumerate(runs(True)):
            write_trial(trial, root / "trials" / f"run{k}.csv")
        quick = ["--seeds", "1", "--epochs", "1", "--width", "4", "--rate", "1e-6", "--step", "1"]
        for out, more in (("declined", []), ("always", ["--keep", "always"])):
            given = [str(root / "run"), str(root / "trials"), *quick, *more]
            assert main(["train", *given, "--out", str(root / out)]) == 0
    return root


@pytest.mark.slow
@pytest.mark.parametrize("out", ["declined", "always"])
def test_a_training_has_what_its_calibration_knows_of_predictions(root: Path, out: str) -> None:
    before, after = read_result(root / "run"), read_result(root / out)
    assert {key: after.get(key) for key in KNOWN} == {key: before[key] for key in KNOWN}
    assert after["recommended"] == ("hybrid" if out == "always" else "calibrated")
    # decided and scored without a past, which is said
    assert after["decision"]["past_s"] == 0.0
    assert {part["past_s"] for pair in after["scores"].values() for part in pair.values()} == {0.0}
    saved = root / f"{out} saved"
    read_training(root / out).save(saved)
    assert {key: read_result(saved).get(key) for key in KNOWN} == {key: before[key] for key in KNOWN}


@pytest.mark.slow
def test_a_declined_folder_predicts_as_the_calibrated_one_to_the_digit(root: Path, tmp_path: Path) -> None:
    common = (root / "trials" / "run0.csv", "--window", "30", "--stride", "15", "--out")
    tables, pasts = {}, {}
    for name in ("run", "declined", "declined/hybrid", "always", "always/calibrated"):
        out = tmp_path / f"{name.replace('/', '_')}.csv"
        pasts[name] = shown("predict", root / name, *common, out)["past_s"]
        tables[name] = out.read_text()
    assert set(pasts.values()) == {30.0}
    assert tables["run"] == tables["declined"] == tables["always/calibrated"]
    assert tables["always"] == tables["declined/hybrid"]
    header = {table.splitlines()[0] for table in tables.values()}
    assert len(header) == 1 and "x_std" in header.pop(), "bands go along"


@pytest.mark.slow
def test_score_compares_models_with_as_much_past(root: Path) -> None:
    models = ("esso_osaka_3m", str(root / "run"), str(root / "declined" / "hybrid"))
    found = shown("score", *models, root / "trials" / "run0.csv")
    assert found["past_s"] == 30.0
    past = {name: score["past_s"] for name, score in found["models"].items()}
    assert past == {name: 0.0 for name in models} | {f"{name} --adapt 30": 30.0 for name in models}
    bare = shown("score", *models, root / "trials" / "run0.csv", "--adapt", "0")
    assert bare["past_s"] == 0.0 and set(bare["models"]) == set(models)


@pytest.mark.slow
def test_a_diagnosis_has_what_the_calibration_knows_of_predictions(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # in place of a fit that takes long: a diagnosis then says that nothing can be said
    monkeypatch.setattr(diagnosis, "prepare", Mock(side_effect=BrokenModelError("it explodes")))
    known = read_result(root / "run")
    for k, model in enumerate(("run", "always", "always/calibrated")):
        with unrendered():
            mmg_ident.diagnose(root / model, list(runs(True))).save(tmp_path / f"{k}")
        for content in (read_result(tmp_path / f"{k}"), content_of(tmp_path / f"{k}")):
            assert {key: content.get(key) for key in KNOWN} == {key: known[key] for key in KNOWN}
    quick = TrainSettings(seeds=1, epochs=1, width=4, step=1.0, penalty=0.3)
    assert mmg_ident.train(tmp_path / "0", list(runs(True)), settings=quick).details["adaptation"] == PAID
    memory = replace(small_result(3), adaptation=PAID)
    assert mmg_ident.diagnose(memory, list(runs(True))).inputs.of_predictions["adaptation"] == PAID
    for model in (memory, root / "run"):
        assert not mmg_ident.diagnose(model, list(runs(True)), without="wind").inputs.of_predictions


@pytest.mark.slow
def test_a_diagnosis_of_another_model_tells_nothing_of_its_predictions(root: Path) -> None:
    ship = load_ship(root / "run")
    assert told_of_predictions(ship, root / "run")["adaptation"] == PAID
    assert told_of_predictions(reduced_ship(ship, ["wind"]), root / "run") == {}
    assert told_of_predictions(ship, None) == told_of_predictions(ship, runs(True)) == {}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run", "declined", "always/calibrated"])
def test_a_scaled_ship_has_the_past_in_her_own_time(root: Path, name: str) -> None:
    scaled = mmg_ident.scale(result_of(root / name), 300.0)
    assert scaled.adaptation is not None and scaled.bands is not None
    assert scaled.adaptation["past_s"] == 300.0 and scaled.adaptation["worthwhile"]


# Every verb that takes a run folder takes that of a hybrid, or says in one line that it does not
ONE_EPOCH = ["--seeds", "2", "--epochs", "1", "--width", "4", "--step", "1", "--keep", "always"]


@pytest.fixture(scope="module")
def hybrid_runs(blank_figures: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials, a calibration, and a hybrid trained on it."""
    hybrid_runs = tmp_path_factory.mktemp("hybrid")
    small_result().save(hybrid_runs / "fit")
    write_trials(hybrid_runs / "trials", hybrids.trials(hybrids.lacking(), 2, 300))
    words = [
        "train",
        str(hybrid_runs / "fit"),
        str(hybrid_runs / "trials"),
        *ONE_EPOCH,
        "--out",
        str(hybrid_runs / "run"),
    ]
    assert main(words) == 0 and (hybrid_runs / "run" / "network.safetensors").exists()
    return hybrid_runs


VERBS = {
    "simulate": ["RUN", "--maneuver", "turning:20", "--wind", "1.5:60", "--duration", "20", "--out", "OUT.csv"],
    "simulate scattered": ["RUN", "--maneuver", "turning:20", "--scatter", "2", "--duration", "20"],
    "predict": ["RUN", "TRIALS", "--out", "OUT"],
    "predict by members": ["RUN", "TRIALS", "--members", "ts1", "--window", "30", "--out", "OUT"],
    "score": ["RUN", "TRIALS"],
    "imo": ["RUN", "--scatter", "0"],
    "card": ["RUN", "--scatter", "20", "--out", "OUT.html"],
    "scale": ["RUN", "--length", "100", "--out", "OUT"],
    "export": ["RUN", "--format", "c", "--out", "OUT"],
    "report": ["RUN", "--no-imo", "--out", "OUT.html"],
    "view": ["RUN", "--trials", "TRIALS", "--out", "OUT.html"],
    "check": ["TRIALS", "--ship", "RUN"],
    "ships": ["RUN"],
    "train": ["RUN", "TRIALS", *ONE_EPOCH, "--out", "OUT"],
    "compare": ["--ship", "RUN", "--train", "TRIALS/run0.csv", "--test", "TRIALS/run1.csv", "--models", "captive"],
    "fit": ["RUN", "TRIALS", "--only", "X_0F", "--measurement", "none", "--no-next-trial", "--out", "OUT"],
    "select": ["RUN", "--list"],
    "diagnose": ["RUN", "TRIALS", "--out", "OUT"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", VERBS)
def test_every_verb_takes_a_hybrid(
    name: str, hybrid_runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    places = {"RUN": str(hybrid_runs / "run"), "TRIALS": str(hybrid_runs / "trials"), "OUT": str(tmp_path / "out")}
    words = VERBS[name]
    for word, place in places.items():
        words = [text.replace(word, place) if text.startswith(word) else text for text in words]
    assert main([name.split()[0], *words]) == 0, capsys.readouterr().err
    if name == "fit":
        assert load_ship(tmp_path / "out").network is not None


@pytest.mark.slow
@pytest.mark.parametrize("maneuver", ["turning:20", "heading:20/1.5/4"])
def test_figures_are_those_of_each_member_of_the_ensemble(maneuver: str, hybrid_runs: Path) -> None:
    found = shown("simulate", hybrid_runs / "run", "--maneuver", maneuver, "--members")["members"]
    hybrid = mi.load_ship(hybrid_runs / "run")
    ships, plan = hybrid.members, parse_maneuver(maneuver, hybrid)
    each = [figures_of(simulated_trial(ship, plan), plan) for ship in ships]
    assert len(ships) == 2 and {*found} == {*each[0]}
    for name, row in found.items():
        values = [own[name] for own in each]
        assert row == pytest.approx(
            {"mean": np.mean(values), "std": np.std(values), "lowest": min(values), "highest": max(values), "count": 2}
        )
    refusal("simulate", hybrid_runs / "run", "--controls", hybrid_runs / "trials" / "run0.csv", "--members")
    refusal("simulate", hybrid_runs / "fit", "--maneuver", "turning:20", "--members")


@pytest.mark.slow
def test_a_prediction_by_members_has_no_past(hybrid_runs: Path) -> None:
    trial = hybrid_runs / "trials" / "run0.csv"
    (found,) = mi.predict(hybrid_runs / "run", trial, members="ts-infinity")
    assert found.past_s == 0.0 and found.table.shape[1] == 14 and {m.code for m in found.notes} >= {"spread_of_members"}
    for run, past in (("run", {"adapt": 30.0}), ("fit", {})):
        with pytest.raises(mi.UserError):
            mi.predict(hybrid_runs / run, trial, members="ts-infinity", **past)


@pytest.mark.slow
def test_a_plan_of_a_hybrid_moves_the_hybrid_with_the_noise_of_her_calibration(
    hybrid_runs: Path, tmp_path: Path
) -> None:
    words = ["--area", "60x25", "--time", "45", "--effort", "0.02", "--time-limit", "0.5"]
    content = shown("plan", hybrid_runs / "run", *words, "--out", tmp_path / "plan.csv")
    assert all(row["std_after"] <= row["std_before"] for row in content["wanted"].values())
    kept = mi.load_run(hybrid_runs / "run").to_dict()["calibration"]
    fit = mi.load_run(hybrid_runs / "fit").to_dict()
    assert kept["sigma"] == fit["sigma"] and kept["settings"] == fit["settings"]


def calm_ship_with_network(air: float) -> Ship:
    """A ship without a wind model whose network takes the air relative to the hull with the weight ``air``."""
    ship = hybrids.lacking()
    assert ship.network is not None
    member = ship.network.members[0]
    first = member.weights[0].copy()
    first[:, ship.features.index("a_y")] = air
    layers = Layers((first, *member.weights[1:]), member.biases)
    parts = {role: model for role, model in ship.components.items() if role != "wind"}
    return replace(ship, components=parts, network=replace(ship.network, members=(layers,)))


@pytest.mark.parametrize(("air", "codes"), [(0.0, {"no_wind_model"}), (0.1, set())])
def test_a_simulation_asks_ship_and_network_whether_they_feel_the_wind(air: float, codes: set[str]) -> None:
    trial = mi.simulate(calm_ship_with_network(air), "straight", wind="2:90", duration=20)
    assert {getattr(note, "code", "") for note in trial.notices} & {"no_wind_model"} == codes
    assert (np.abs(trial["v"]).max() > 1e-4) == bool(air)
