"""``mmg fit`` with a robust loss and captive points, from files to result.json and report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cases.simulation.demo_trials import hidden_ship
from cases.simulation.simulate import write_trial
from mmg_ident.commands.main import main
from tests.fitting.nlp.test_captive import points, write
from tests.support.synthetic_runs import runs

UNITS = "u [m/s],v [m/s],r [rad/s],n [rps],delta [deg],X [N],Y [N],N [N m]"
FREE = "Y_v,N_v,N_r,k_0"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 80 s of three training trials with positions, and captive points of the same ship."""
    folder = tmp_path_factory.mktemp("options")
    (folder / "train").mkdir()
    for trial in runs()[0][:3]:
        part = replace(trial, columns={name: values[:801] for name, values in trial.columns.items()})
        write_trial(part, folder / "train" / f"{trial.name}.csv")
    write(folder / "tank.csv", UNITS, points(hidden_ship(), 1.0))
    return folder


@pytest.mark.slow
def test_captive_points_and_a_robust_loss_go_into_the_run(folder: Path) -> None:
    arguments = ["fit", "esso_osaka_3m", str(folder / "train"), "--only", FREE, "--out", str(folder / "run"),
                 "--captive", str(folder / "tank.csv"), "--captive-sigma", "0.5,0.5,0.3", "--loss", "student",
                 "--starts", "2", "--no-next-trial"]  # fmt: skip
    assert main(arguments) == 0
    result = json.loads((folder / "run" / "result.json").read_text())
    assert result["settings"]["loss"] == "student" and 1 <= result["condition_number"] < 1e12
    assert len(result["starts"]) == 2 and result["starts"][1]["apart"] == {}
