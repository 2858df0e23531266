"""Every verb that takes a run folder takes that of a hybrid, or says in one line that it does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mmg_ident as mi
from cases.criteria.standard_runs import figures_of, simulated_trial
from cases.maneuvers.definitions import parse_maneuver
from mmg.network import Layers
from mmg.ship import Ship
from mmg_ident.commands.main import main
from tests.support import hybrids
from tests.support.calibrated import small_result
from tests.support.commands import refusal, shown
from tests.support.trial_files import write_trials

pytestmark = pytest.mark.usefixtures("blank_figures")

QUICK = ["--seeds", "2", "--epochs", "1", "--width", "4", "--step", "1", "--keep", "always"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trials, a calibration, and a hybrid trained on it."""
    folder = tmp_path_factory.mktemp("hybrid")
    small_result().save(folder / "fit")
    write_trials(folder / "trials", hybrids.trials(hybrids.lacking(), 2, 300))
    words = ["train", str(folder / "fit"), str(folder / "trials"), *QUICK, "--out", str(folder / "run")]
    assert main(words) == 0 and (folder / "run" / "network.safetensors").exists()
    return folder


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
    "train": ["RUN", "TRIALS", *QUICK, "--out", "OUT"],
    "compare": ["--ship", "RUN", "--train", "TRIALS/run0.csv", "--test", "TRIALS/run1.csv", "--models", "captive"],
    "fit": ["RUN", "TRIALS", "--only", "X_0F", "--measurement", "none", "--no-next-trial", "--out", "OUT"],
    "select": ["RUN", "--list"],
    "diagnose": ["RUN", "TRIALS", "--out", "OUT"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", VERBS)
def test_every_verb_takes_a_hybrid(name: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = {"RUN": str(folder / "run"), "TRIALS": str(folder / "trials"), "OUT": str(tmp_path / "out")}
    words = VERBS[name]
    for word, place in places.items():
        words = [text.replace(word, place) if text.startswith(word) else text for text in words]
    assert main([name.split()[0], *words]) == 0, capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("maneuver", ["turning:20", "heading:20/1.5/4"])
def test_figures_are_those_of_each_member_of_the_ensemble(maneuver: str, folder: Path) -> None:
    found = shown("simulate", folder / "run", "--maneuver", maneuver, "--members")["members"]
    hybrid = mi.load_ship(folder / "run")
    ships, plan = hybrid.members, parse_maneuver(maneuver, hybrid)
    each = [figures_of(simulated_trial(ship, plan), plan) for ship in ships]
    assert len(ships) == 2 and {*found} == {*each[0]}
    for name, row in found.items():
        values = [own[name] for own in each]
        assert row == pytest.approx(
            {"mean": np.mean(values), "std": np.std(values), "lowest": min(values), "highest": max(values), "count": 2}
        )
    refusal("simulate", folder / "run", "--controls", folder / "trials" / "run0.csv", "--members")
    refusal("simulate", folder / "fit", "--maneuver", "turning:20", "--members")


@pytest.mark.slow
def test_a_prediction_by_members_has_no_past(folder: Path) -> None:
    trial = folder / "trials" / "run0.csv"
    (found,) = mi.predict(folder / "run", trial, members="ts-infinity")
    assert found.past_s == 0.0 and found.table.shape[1] == 14 and {m.code for m in found.notes} >= {"spread_of_members"}
    for run, past in (("run", {"adapt": 30.0}), ("fit", {})):
        with pytest.raises(mi.UserError):
            mi.predict(folder / run, trial, members="ts-infinity", **past)


@pytest.mark.slow
def test_a_plan_of_a_hybrid_moves_the_hybrid_with_the_noise_of_her_calibration(folder: Path, tmp_path: Path) -> None:
    words = ["--area", "60x25", "--time", "45", "--effort", "0.02", "--time-limit", "0.5"]
    content = shown("plan", folder / "run", *words, "--out", tmp_path / "plan.csv")
    assert all(row["std_after"] <= row["std_before"] for row in content["wanted"].values())
    kept = mi.load_run(folder / "run").to_dict()["calibration"]
    fit = mi.load_run(folder / "fit").to_dict()
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
