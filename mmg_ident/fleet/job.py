"""What is done for one ship of a fleet, in whichever process: fit alone, or fit, judge, diagnose and write her folder.

A task holds paths, not trials: the files are read where the work is done. What a ship is done with lies in ``parts``,
under a key of all that it depends on, so that a run can be resumed and a changed ship alone is done again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.checks import check, ready
from cases.checks.report import CONTRADICTORY
from cases.io.campaigns import campaigns_of
from cases.io.files import file_hash
from cases.io.read import read_trials
from cases.io.sidecar import NAME as SIDECAR
from cases.shipfiles.ship_file import dump_ship
from cases.trial import Trial
from diagnosis import diagnose as diagnosing
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from fitting.calibrate import FitOptions
from fitting.nlp.grid import default_step
from fitting.report.parts import Store
from fitting.report.run_folder import plain, versions
from fitting.result import FitResult
from fitting.selection.sisters import SisterEvidence, SisterStart, with_whole_prior
from fitting.settings import Settings
from mmg.errors import Conflict, NotCalibrated, UserError
from mmg_ident.api import calibrate
from mmg_ident.fleet.plan import FleetTable, PlannedShip
from mmg_ident.fleet.rows import ship_row

SHIPS, DIAGNOSIS, PARTS = "ships", "diagnosis", "parts"
SITE = "site.toml"
COARSER = 2.0
"""Step of the diagnosis of a fleet, in that of ``mmg diagnose``: it costs half the time."""


@dataclass(frozen=True)
class FleetTask:
    """A ship to do. options: of the plan; folder: of the fleet; key: of all that the outcome depends on; command: that
    is stored; sister: what her sisters say, None for a ship without any and for a fit alone."""

    ship: PlannedShip
    options: FleetTable
    folder: Path
    key: str
    command: str = ""
    sister: SisterStart | None = None

    def store(self, stage: str) -> Store:
        """Where outcomes of a ``stage`` lie: "alone" or "done"."""
        return Store(self.folder / PARTS / stage, {})


@dataclass(frozen=True)
class ShipOutcome:
    """Of a task: name of the ship, and why she failed, "" where she did not."""

    name: str
    failure: str = ""


def key_of(ship: PlannedShip, options: FleetTable, more: Any = None) -> str:
    """Text that differs where anything differs that the outcome of a ``ship`` depends on.

    options: of the plan; more: plain values beside them.
    """
    listed = zip(ship.trials, ship.campaign, strict=True)
    beside = sorted({path for file in (*ship.trials, *ship.held_out) for path in _beside(file)})
    about = {
        "ship": dump_ship(ship.start),
        "name": ship.name,
        "trials": [[file.name, label, ship.hashes[str(file)]] for file, label in listed],
        "held_out": [[file.name, ship.hashes[str(file)]] for file in ship.held_out],
        "beside": [file_hash(path) for path in beside],
        "options": options.model_dump(),
        "more": more,
        "version": versions()["mmg-ident"],
    }  # fmt: skip
    return hashlib.sha256(json.dumps(plain(about), sort_keys=True).encode()).hexdigest()


def _beside(file: Path) -> list[Path]:
    """Sidecar and site file of a trial file."""
    return [path for name in (SIDECAR, SITE) if (path := file.parent / name).is_file()]


def fit_alone(task: FleetTask) -> ShipOutcome:
    """Calibrate the ship of a ``task`` by her own trials and keep what they say for her sisters; returns whether
    that was possible."""
    return _said(task, _fit_alone)


def finish_ship(task: FleetTask) -> ShipOutcome:
    """Calibrate, judge and diagnose the ship of a ``task``; write her run folder and her row; returns
    whether that was possible."""
    return _said(task, _finish_ship)


def _said(task: FleetTask, work: Any) -> ShipOutcome:
    """The outcome of ``work``: a ship that fails must not end the others."""
    try:
        work(task)
    except UserError as error:
        return ShipOutcome(task.ship.name, " ".join(str(error).split()))
    except Exception as error:
        return ShipOutcome(task.ship.name, f"{type(error).__name__}: {' '.join(str(error).split())[:200]}")
    return ShipOutcome(task.ship.name)


def _fit_alone(task: FleetTask) -> None:
    clock = SpentClock()
    train, held_out, left_out = trials_of(task)
    result = _calibrated(task, train, held_out)
    if not result.converged or result.calibration is None:
        raise NotCalibrated(f"not converged ({result.status}): {result.advice or 'see mmg fit'}")
    found = SisterEvidence.of(result.calibration)
    words = {
        "key": task.key,
        "symbols": list(found.symbols),
        "coefficients": plain(result.coefficients),
        "scores": plain(result.scores),
        "left_out": left_out,
        "timing": clock.spent(),
    }
    arrays = {name: getattr(found, name) for name in ("A", "b", "centre", "unit")}
    task.store("alone").save(task.ship.name, words, arrays)


def _finish_ship(task: FleetTask) -> None:
    clock = SpentClock()
    train, held_out, left_out = trials_of(task)
    result = _calibrated(task, train, held_out)
    folder = task.folder / SHIPS / task.ship.name
    result = result.save(folder, replace=folder.exists())
    diagnosis, failed = _diagnosed(task, result, train, held_out, folder)
    row = ship_row(task.ship, result, diagnosis, left_out)
    words = {"key": task.key, "row": row | {"diagnosis_failed": failed}, "timing": clock.spent()}
    task.store("done").save(task.ship.name, words)


def _calibrated(task: FleetTask, train: Sequence[Trial], held_out: Sequence[Trial]) -> FitResult:
    o, sister = task.options, task.sister
    settings = Settings(seed=o.seed, time_limit=o.time_limit, compiled=o.compiled, loss=o.loss)
    options = FitOptions(
        next_trial=False,
        instruments=tuple(o.measurement),
        start=sister.values if sister else {},
        prior_mean=sister.mean if sister else None,
        command=task.command,
        name=task.ship.name,
    )
    return calibrate(sister.ship if sister else task.ship.start, list(train), list(held_out), settings, options)


def _diagnosed(
    task: FleetTask, result: FitResult, train: Sequence[Trial], held_out: Sequence[Trial], folder: Path
) -> tuple[Diagnosis | None, str]:
    """The diagnosis of a calibrated ship, written into her run ``folder``, or why there is none."""
    if not task.options.diagnose or not result.converged:
        return None, "" if result.converged else "not diagnosed: the calibration has not converged"
    several = len({trial.meta.get("group") for trial in train}) > 1
    step = task.options.diagnosis_step or COARSER * default_step(train, result.ship.particulars["L"])
    options = DiagnosisOptions(step, task.options.seed, 1, False, task.command, "group" if several else None)
    try:
        ship = with_whole_prior(result.ship, task.sister.mean) if task.sister else result.ship
        found = diagnosing.diagnose(ship, train, held_out, None, options, folder)
    except (UserError, np.linalg.LinAlgError) as error:
        return None, f"not diagnosed: {error}"
    target = folder / DIAGNOSIS
    found.save(target, replace=target.exists())
    return found, ""


def trials_of(task: FleetTask) -> tuple[list[Trial], list[Trial], list[str]]:
    """The trials of the ship of a ``task`` to fit and those held out, and sentences on files that mmg check calls
    contradictory, which are left out. Raises UserError where none is left to fit."""
    ship = task.ship
    train = [
        replace(trial, meta={**trial.meta, "campaign": label}) if label else trial
        for trial, label in zip(read_trials(ship.trials), ship.campaign, strict=True)
    ]
    held_out = read_trials(ship.held_out) if ship.held_out else []
    left_out: list[str] = []
    if not task.options.unchecked:
        refuted = {}
        for report in check([*train, *held_out]):
            if report.verdict == CONTRADICTORY:
                refuted[report.path] = next(f.text for f in report.findings if f.level == CONTRADICTORY)
        left_out = [f"{Path(path).name} is left out: {text}" for path, text in refuted.items()]
        train, held_out = ([t for t in some if str(t.path or "") not in refuted] for some in (train, held_out))
        if not train:
            raise Conflict(f"mmg check calls all trials contradictory: {left_out[0]}")
    fitted, judged = ready(train, held_out, unchecked=task.options.unchecked)
    names = campaigns_of(fitted)
    grouped = []
    for trial, number in zip(fitted, names.number, strict=True):
        grouped.append(replace(trial, meta={**trial.meta, "group": names.names[number]}))
    return grouped, list(judged), left_out


class SpentClock:
    """Wall-clock and processor seconds since it was made, those of compilers among them."""

    def __init__(self) -> None:
        self._wall, self._processor = time.perf_counter(), self._used()

    @staticmethod
    def _used() -> float:
        try:
            import resource
        except ImportError:  # Windows
            return time.process_time()
        child = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time() + child.ru_utime + child.ru_stime

    def spent(self) -> dict[str, float]:
        """Seconds by name."""
        return {"wall_s": time.perf_counter() - self._wall, "processor_s": self._used() - self._processor}
