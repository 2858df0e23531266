"""Small good files of every kind, from which damaged ones are made."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from diagnosis import findings
from diagnosis.result import CONTENT, Diagnosis
from fitting.calibrate import FitOptions, calibrate
from fitting.report.run_folder import RESULT, SHIP, START, write_json
from fitting.settings import Settings
from mmg.network import Layers, Network
from residual.pipeline import train
from residual.settings import BlackBoxSettings, TrainSettings

GOOD = Path(__file__).with_name("samples")
"""Folder of good files: a sidecar, a site, captive tests, controls, an import map, and ``logs``, one of each format."""
GROUPS = "day\nrun_07_2020-11-12\nrun_08_31-Jul-2020\nsea 20201112_zigzag"
TEXTS = {
    "effect": (
        "current:x=0.02,y=-0.01",
        "wind_force:X=1.2,Y",
        "bank",
        "rudder_lag:T=0.5",
        "shallow_water:d_h=0.4,line",
    ),
    "maneuver": ("zigzag:-10/10", "turning:35", "crash-stop:0.6", "spiral:15/5", "pull-out:20", "random:7", "berthing"),
    "wind": ("1.5:60:gusty", "3:-90", "0:0"),
    "groups": (GROUPS,),
}
"""Texts of the command line, by reader."""
ROWS = 8
"""Of a trial: what is wrong with one shows in a few."""


def short_trial() -> Trial:
    """The first rows of a synthetic zigzag."""
    trial = demo_trials(1, dt=0.5)[0][0]
    return replace(trial, columns={name: np.round(values[:ROWS], 4) for name, values in trial.columns.items()})


def small_ship() -> str:
    """The text of a ship file that takes most coefficients from its force models."""
    ship = load_ship("esso_osaka_3m")
    lines = ["[ship]", 'name = "esso"', *(f"{key} = {value!r}" for key, value in ship.particulars.items()), "[model]"]
    lines += [f'{role} = "{name}"' for role, name in ship.components.items()]
    lines += ["[coefficients.X_0F]", "value = -0.02", "std = 0.002", "lower = -0.05", "upper = 0.0", 'prime = "mmg"']
    return "\n".join([*lines, 'source = "tank"', "[coefficients.Y_v]", "value = -0.3", "fixed = true", ""])


def write_tables(folder: Path) -> None:
    """trial/a.csv, trial/b.parquet, side/side.csv with its sidecar, and text files of their own in ``folder``."""
    trial = short_trial()
    shutil.copytree(GOOD, folder, dirs_exist_ok=True)
    (folder / "trial").mkdir()
    for path in (folder / "trial" / "a.csv", folder / "trial" / "b.parquet", folder / "side" / "side.csv"):
        write_trial(trial, path)
    (folder / "ship.toml").write_text(small_ship(), encoding="utf-8")


def write_runs(folder: Path) -> None:
    """Folders fit, iterate, training, black_box, diagnosis and hybrid in ``folder``, without figures, of a ship whose
    file is small."""
    ship = load_ship("esso_osaka_3m")
    runs = demo_trials(2, dt=0.5)[0][:2]
    few = ship.fixing([s for s in ship.symbols if s not in ("X_0F", "Y_v")])
    options = FitOptions(next_trial=False, instruments=())
    fit = calibrate(few, runs[:1], (), Settings(passes=1, max_iterations=2), options)
    replace(fit, objects=None).save(folder / "fit")
    small = {"width": 2, "seeds": 1, "epochs": 1}
    for name, settings in (("training", TrainSettings(**small)), ("black_box", BlackBoxSettings(**small))):
        train(ship, runs, (), settings).save(folder / name)
    shutil.copytree(folder / "fit", folder / "iterate")
    _write_diagnosis(folder / "diagnosis")
    (folder / "hybrid").mkdir()
    for place in ("fit", "iterate", "training", "training/hybrid", "black_box", "diagnosis", "hybrid"):
        for file in (SHIP, START):
            (folder / place / file).write_text(small_ship(), encoding="utf-8")
    (folder / "black_box" / SHIP).unlink()
    save_network(folder / "hybrid" / NETWORK, small_network(ship.features), ship)


def _write_diagnosis(folder: Path) -> None:
    """diagnosis.json and result.json of a diagnosis made by hand."""
    folder.mkdir()
    current = {"x": findings.EstimatedParameter(0.03, 0.002, "m/s")}
    found = Diagnosis(
        verdict="named", sentence="The gap is a current.", instruments=(), remainder=True, next_test="Stop.",
        effects=(findings.NamedEffect("current", current, 1e-12, 280.0, 0.3),),
        equivalence_class=("wave_drift",), warnings=("beware of the tide.",), not_screened={"bank": "no line is known"},
        candidates=(findings.RankedCandidate("current", 300.0, 1e-12, 280.0, True, 0.3, current),),
        where={"channels": {"surge": {"share": 0.5}}},
        noise=findings.RandomSizes((1.0, 2.0, 3.0), 4.0, (0.1,) * 6),
        held_out=findings.HeldOut(0.4, 0.2, 0.5, (0.3, 0.6), 12, {"test": (0.5, 0.2)}, horizons={"30 s": (0.4, 0.2)}),
        unnamed={"all": 20.0, "sway force": 15.0}, kinematics=("late by 0.7 s",),
        timings={"total": 1.0}, inputs=findings.DiagnosisInputs(({"name": "run"},)), ship=load_ship("esso_osaka_3m"),
    )  # fmt: skip
    write_json(folder / CONTENT, found.to_dict())
    write_json(folder / RESULT, {"schema_version": 1, "kind": "diagnosis", **vars(found.inputs), "figures": []})


def small_network(features: Sequence[str]) -> Network:
    """A network of one hidden layer with random weights, for a ship with these ``features``."""
    F, rng = len(features), np.random.default_rng(0)
    layers = Layers((rng.normal(size=(4, F)), rng.normal(size=(3, 4))), (rng.normal(size=4),))
    return Network(tuple(features), np.ones(F), (layers,), np.ones(3), -np.ones(F), np.ones(F))
