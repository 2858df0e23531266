"""What a calibration knows of predictions goes on into every folder made of its ship, and models are compared alike."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

import mmg_ident
from cases.shipfiles.model_changes import reduced_ship
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import write_trial
from delivery.full_scale.result import result_of
from diagnosis import diagnose as diagnosis
from diagnosis.estimation.map_estimate import BrokenModelError
from diagnosis.inputs import told_of_predictions
from fitting.report.run_folder import read_result
from mmg_ident.api import content_of
from mmg_ident.commands.main import main
from residual.result import read_training
from residual.settings import TrainSettings
from tests.fitting.prediction.test_adaptation import PAID, runs
from tests.support.calibrated import small_result
from tests.support.commands import shown
from tests.support.figures import unrendered

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
    monkeypatch.setattr(diagnosis, "prepare_with_sensors", Mock(side_effect=BrokenModelError("it explodes")))
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
