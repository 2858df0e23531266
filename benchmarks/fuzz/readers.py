"""Every reader of the product: what it reads a content from, and small good files of every kind to damage."""

from __future__ import annotations

import contextlib
import shutil
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.fuzz.damage import REPRODUCERS
from cases.checks import check
from cases.importing.import_logs import SUFFIXES, import_logs
from cases.importing.import_map import ImportMap, read_map
from cases.importing.log_columns import log_of
from cases.importing.table_files import read_text_log
from cases.io.campaigns import group_trials
from cases.io.read import read_controls, read_trial
from cases.io.site import read_site
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import freeing_effects, varying_effects, with_effects
from cases.shipfiles.network_file import NETWORK, save_network
from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.simulation.simulate import parse_wind, write_trial
from cases.trial import Trial
from diagnosis import findings
from diagnosis.result import CONTENT, Diagnosis, read_diagnosis
from fitting.calibrate import FitOptions, calibrate
from fitting.nlp.captive import read_captive
from fitting.report.run_folder import ITERATE, RESULT, SHIP, START, read_iterate, write_json
from fitting.result import read_fit
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.network import Layers, Network
from mmg.ship import Ship
from residual.papers.black_box import load_box
from residual.pipeline import train
from residual.result import read_training
from residual.settings import BlackBoxSettings, TrainSettings

LARGEST_SEED = 6000
"""Bytes of a reproducer that is damaged further."""


@dataclass(frozen=True)
class Reader:
    """One reader. read: what it does with a content; seeds: good contents, the smallest first, and harmful ones."""

    read: Callable[[bytes], object]
    seeds: tuple[bytes, ...]


def readers(folder: Path) -> dict[str, Reader]:
    """All readers by name, on good files that are made in ``folder``, which must not exist."""
    folder.mkdir()
    write_tables(folder)
    write_runs(folder)
    ship = load_ship("esso_osaka_3m")
    side, hybrid, box = folder / "side", folder / "hybrid", folder / "black_box"
    files: dict[str, tuple[Path, Callable[[], object]]] = {
        "trial": (folder / "trial" / "a.csv", lambda: check([read_trial(folder / "trial" / "a.csv")])),
        "controls": (folder / "controls.csv", lambda: read_controls(folder / "controls.csv")),
        "parquet": (folder / "trial" / "b.parquet", lambda: _table(folder / "trial" / "b.parquet")),
        "sidecar": (side / "trials.toml", lambda: read_trial(side / "side.csv")),
        "site": (folder / "site.toml", lambda: read_site([], ship, folder / "site.toml")),
        "ship": (folder / "ship.toml", lambda: load_ship(folder / "ship.toml")),
        "fit": (folder / "fit" / RESULT, lambda: read_fit(folder / "fit")),
        "training": (folder / "training" / RESULT, lambda: read_training(folder / "training")),
        "diagnosis": (folder / "diagnosis" / CONTENT, lambda: read_diagnosis(folder / "diagnosis")),
        "iterate": (folder / "iterate" / ITERATE, lambda: read_iterate(folder / "iterate")),
        "network": (hybrid / NETWORK, lambda: load_ship(hybrid)),
        "black_box": (box / NETWORK, lambda: load_box(box)),
        "captive": (folder / "captive.csv", lambda: read_captive(folder / "captive.csv")),
        "import_map": (folder / "import.toml", lambda: read_map(folder / "import.toml")),
    }
    found = {name: _of_file(name, path, read) for name, (path, read) in files.items()}
    found |= log_readers(folder / "raw")
    texts: dict[str, Callable[[str], object]] = {
        "effect": lambda text: _effect(text, ship),
        "maneuver": lambda text: parse_maneuver(text, ship, n=9.0, speed=0.4),
        "wind": parse_wind,
        "groups": _groups(),
    }
    seeds = {name: (*(text.encode() for text in TEXTS[name]), *_small(name)) for name in texts}
    return found | {name: _of_text(parse, seeds[name]) for name, parse in texts.items()}


def log_readers(folder: Path) -> dict[str, Reader]:
    """Those of raw logs, one of each format, on copies of the samples in ``folder``, which must not exist."""
    shutil.copytree(GOOD / "logs", folder)
    found = {path.stem: _of_log(path) for path in sorted(folder.iterdir()) if path.suffix in SUFFIXES}
    long = Path(shutil.copy(folder / "log.csv", folder / "long.csv"))
    return found | {"long_log": _of_file("long_log", long, lambda: _averaged(long))}


def _of_log(path: Path) -> Reader:
    """A reader of a raw log; of a workbook the sheet is damaged, and the archive around it is whole."""
    if path.suffix != ".xlsx":
        return _of_file(path.stem, path, lambda: _imported(path))
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    sheet = next(name for name in parts if "sheet1" in name)

    def read(content: bytes) -> object:
        with zipfile.ZipFile(path, "w") as archive:
            for name, part in {**parts, sheet: content}.items():
                archive.writestr(name, part)
        return _imported(path)

    return Reader(read, (parts[sheet],))


def _of_file(name: str, path: Path, read: Callable[[], object]) -> Reader:
    def written(content: bytes) -> object:
        path.write_bytes(content)
        return read()

    return Reader(written, (path.read_bytes(), *_small(name)))


def _small(name: str) -> list[bytes]:
    """The reproducers of a reader from which more are made; the others cost too much time."""
    return [content for content in REPRODUCERS.get(name, ()) if len(content) < LARGEST_SEED]


def _of_text(parse: Callable[[str], object], seeds: tuple[bytes, ...]) -> Reader:
    """A reader of a text of the command line, which holds no byte 0 and may be no UTF-8."""
    return Reader(lambda content: parse(content.replace(b"\0", b"").decode("utf-8", "surrogateescape")), seeds)


def _table(path: Path) -> None:
    """A file as inputs of a simulation, and as a trial with its checks. Raises UserError where it is no trial."""
    with contextlib.suppress(UserError):
        read_controls(path)
    check([read_trial(path)])


def _imported(path: Path) -> object:
    """The runs in a raw log, by the map of its name. Raises UserError, with its problems, where they cannot be
    written."""
    said = GOOD / "logs" / f"{path.stem}.toml"
    found = import_logs([path], read_map(said) if said.exists() else None)
    if found.problems:
        raise UserError("; ".join(found.problems))
    return found


def _averaged(path: Path) -> object:
    """A raw log as one that is longer than is kept."""
    with mock.patch("cases.io.text_table.MOST_KEPT", 10), mock.patch("cases.io.text_table.BLOCK", 3000):
        return log_of(read_text_log(path), ImportMap())


def _effect(text: str, ship: Ship) -> None:
    """A text as an effect that is switched on, freed, and freed by run. Raises UserError where none is possible."""
    with contextlib.suppress(UserError):
        with_effects(ship, [text])
    with contextlib.suppress(UserError):
        freeing_effects(ship, [text])
    varying_effects(ship, [text])


def _groups() -> Callable[[str], object]:
    """What groups trials: the first line says by what, each other one names a trial."""
    trial = short_trial()

    def grouped(text: str) -> object:
        by, *names = text.split("\n")
        trials = [replace(trial, name=name, path=Path(f"{name}.csv"), kind=name[:3]) for name in names[:20]]
        return group_trials(trials, by)

    return grouped


# Small good files of every kind, from which damaged ones are made
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
