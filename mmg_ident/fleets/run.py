"""A fleet from its plan to its rows: sisters alone, what they share, then every ship.

Ships are independent tasks of ``fitting.parallel``; what one of them gives does not depend on who does it. A task holds
paths, not trials: the files are read where the work is done. What a ship is done with lies in ``parts``, under a key of
all that it depends on, so that a run can be resumed and a changed ship alone is done again.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.checks.report import CONTRADICTORY
from cases.io.files import file_hash
from cases.io.read import read_trials
from cases.io.sidecar import NAME as SIDECAR
from cases.io.site import NAME as SITE
from cases.shipfiles.ship_file import dump_ship
from cases.trial import Trial
from cases.trial_set import TrialSet, ready
from diagnosis import diagnose as diagnosing
from diagnosis.inputs import DiagnosisOptions
from diagnosis.result import Diagnosis
from fitting.calibrate import FitOptions
from fitting.nlp.windows import default_step
from fitting.parallel import run_all
from fitting.report.run_folder import Store, plain, versions
from fitting.result import FitResult
from fitting.selection import sisters
from fitting.selection.sisters import SisterStart
from fitting.settings import Settings
from mmg.errors import Conflict, NotCalibrated, UserError, writing
from mmg.messages import LOGGER, OnProgress, Progress
from mmg_ident.api import calibrate
from mmg_ident.fleets.plan import FleetPlan, FleetTable, PlannedShip
from mmg_ident.fleets.rows import DIAGNOSIS, SHIPS, Fleet, SisterGroup, failed_row, ship_row

PARTS = "parts"  # Folder of finished parts in that of a fleet
ALONE, DONE = "alone", "done"  # Stages: sisters by their own trials, and every ship
COARSER = 2.0  # Step of the diagnosis of a fleet, in that of ``mmg diagnose``: it costs half the time. Set by hand.


@dataclass(frozen=True)
class FleetTask:
    """A ship to do. options: of the plan; folder: of the fleet; command: that is stored; sisters: what they say of each
    other, None for a ship without any and for a fit alone."""

    ship: PlannedShip
    options: FleetTable
    folder: Path
    command: str = ""
    sisters: SisterGroup | None = None

    def store(self, stage: str) -> Store:
        """Where outcomes of a ``stage`` lie."""
        return Store(self.folder / PARTS / stage, {})

    def kept(self, stage: str) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """Words and arrays of a part that was finished from the same, None where there is none."""
        part = self.store(stage).load(self.ship.name)
        return part if part and part[0].get("key") == self.key else None  # else the plan or a file has changed

    @property
    def sister(self) -> SisterStart | None:
        """What her sisters say of the ship, None where they say nothing."""
        if (group := self.sisters) is None:
            return None
        number = group.ships.index(self.ship.name)
        return sisters.sister_start(self.ship.start, group.widths, group.ships, number)

    @property
    def key(self) -> str:
        """Text that differs where anything differs that the outcome depends on."""
        ship, group = self.ship, self.sisters
        files = [*ship.trials, *ship.held_out]
        sidecars = sorted({path for f in files for path in (f.parent / SIDECAR, f.parent / SITE) if path.is_file()})
        about = {
            "ship": dump_ship(ship.start),
            "name": ship.name,
            "trials": [[file.name, label, ship.hashes[file]] for file, label in ship.trials.items()],
            "held_out": [[file.name, ship.hashes[file]] for file in ship.held_out],
            "beside": [file_hash(path) for path in sidecars],
            "options": self.options.model_dump(exclude={"name"}),  # of the fleet, on which nothing depends
            "sisters": group and (group.ships, vars(group.widths)),
            "version": versions()["mmg-ident"],
        }
        return hashlib.sha256(json.dumps(plain(about), sort_keys=True).encode()).hexdigest()


def run_fleet(
    plan: FleetPlan, out: Path, workers: int = 1, command: str = "", progress: OnProgress | None = None
) -> Fleet:
    """Fit, judge, diagnose and compare the ships of ``plan``; their run folders and parts go to the folder ``out``.

    What lies there of the same ships, files and options is kept and not done again. workers: processes, where no other
    executor is in force; command: that is stored; progress: told of each ship. Returns the rows of all; a ship that
    fails has one that says why. Raises UserError where nothing can be written.
    """
    with writing(out):
        for stage in (ALONE, DONE):
            (out / PARTS / stage).mkdir(parents=True, exist_ok=True)
    tasks = [FleetTask(ship, plan.options, out.absolute(), command) for ship in plan.ships]
    # sisters alone come first: what all of them say together is part of what each is then fitted with
    alone = [task for task in tasks if task.ship.sisters]
    failures = _do(fit_alone, alone, ALONE, workers, progress)
    groups = _groups(plan, [task for task in alone if task.ship.name not in failures])
    tasks = [replace(t, sisters=groups.get(t.ship.sisters)) for t in tasks if t.ship.name not in failures]
    failures |= _do(finish_ship, tasks, DONE, workers, progress)
    # read back from the parts: rows of this run and of an earlier one come the same way
    parts = {task.ship.name: part[0] for task in tasks if (part := task.kept(DONE))}
    rows = [parts[s.name]["row"] if s.name in parts else failed_row(s, failures.get(s.name, "")) for s in plan.ships]
    return Fleet(plan.options.name, tuple(rows), tuple(groups.values()), command)


def _do(
    work: Callable[[FleetTask], tuple[str, str]],
    tasks: Sequence[FleetTask],
    stage: str,
    workers: int,
    progress: OnProgress | None,
) -> dict[str, str]:
    """Do those of the ``tasks`` of a ``stage`` that are not kept, and say so; returns ship -> why she failed."""
    tasks = [task for task in tasks if not task.kept(stage)]
    failures, done = dict[str, str](), list[str]()

    def each(outcome: tuple[str, str]) -> None:
        name, failure = outcome
        done.append(name)
        if failure:
            failures[name] = failure
            LOGGER.warning("%s: failed: %s", name, failure)
        else:
            words = "fitted alone" if stage == ALONE else "done"
            LOGGER.info("%s: %s (%d of %d)", name, words, len(done), len(tasks))
        if progress:
            progress(Progress("sisters alone" if stage == ALONE else "ships", len(done), len(tasks)))

    run_all(work, tasks, workers, each)
    return failures


def _groups(plan: FleetPlan, tasks: Sequence[FleetTask]) -> dict[str, SisterGroup]:
    """What sisters say of each other, by group, from those that were fitted alone; two are needed."""
    groups = {}
    for name in plan.sisters:
        evidence: dict[str, sisters.SisterEvidence] = {}
        for task in tasks:
            if task.ship.sisters == name and (part := task.kept(ALONE)):
                words, arrays = part
                evidence[task.ship.name] = sisters.SisterEvidence(tuple(words["symbols"]), **arrays)
        if len(evidence) > 1:
            groups[name] = SisterGroup(name, tuple(evidence), sisters.sister_widths(list(evidence.values())))
            common = groups[name].widths.common
            LOGGER.info("sisters %s: %d ships differ by %.2g of the prior's std", name, len(evidence), common)
    return groups


def _reported(work: Callable[[FleetTask], None]) -> Callable[[FleetTask], tuple[str, str]]:
    """``work`` that gives the name of the ship and why it failed, "" where it did not: it must not end the others."""

    @functools.wraps(work)
    def reported(task: FleetTask) -> tuple[str, str]:
        try:
            work(task)
        except UserError as error:
            return task.ship.name, " ".join(str(error).split())
        except Exception as error:  # of a library: its message, which may be a page, is cut for the table
            return task.ship.name, f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        return task.ship.name, ""

    return reported


@_reported
def fit_alone(task: FleetTask) -> None:
    """Calibrate the ship of a ``task`` by her own trials and keep what they say for her sisters. Raises UserError where
    that is not possible."""
    result = _calibrated(task, *trials_of(task)[:2])
    if not result.converged or result.calibration is None:
        raise NotCalibrated(f"not converged ({result.status}): {result.advice or 'see mmg fit'}")
    evidence = sisters.SisterEvidence.of(result.calibration)
    words = {"key": task.key, "symbols": list(evidence.symbols), "scores": plain(result.scores)}
    arrays = {name: getattr(evidence, name) for name in ("A", "b", "centre", "unit")}
    task.store(ALONE).save(task.ship.name, words, arrays)


@_reported
def finish_ship(task: FleetTask) -> None:
    """Calibrate, judge and diagnose the ship of a ``task``; write her run folder and her row."""
    train, held_out, left_out = trials_of(task)
    result = _calibrated(task, train, held_out)
    folder = task.folder / SHIPS / task.ship.name
    result = result.save(folder, replace=folder.exists())
    diagnosis, failed = _diagnosed(task, result, train, held_out, folder)
    alone = replace(task, sisters=None).kept(ALONE) if task.sisters else None
    row = ship_row(task.ship, result, diagnosis, left_out, alone[0] if alone else None)
    words = {"key": task.key, "row": row | {"diagnosis_failed": failed}}
    task.store(DONE).save(task.ship.name, words)  # last: what is stored here is not done again


def _calibrated(task: FleetTask, train: Sequence[Trial], held_out: Sequence[Trial]) -> FitResult:
    """The calibration of a ship; a sister begins at what all fits say of her, under the prior that the group shares."""
    o, sister, start = task.options, task.sister, task.ship.start
    settings = Settings(seed=o.seed, time_limit=o.time_limit, loss=o.loss)
    options = FitOptions(next_trial=False, command=task.command, name=task.ship.name)
    if sister:
        start = sister.ship
        options = replace(options, start=sister.values, prior_mean=sister.mean)
    return calibrate(start, list(train), list(held_out), settings, options)


def _diagnosed(
    task: FleetTask, result: FitResult, train: Sequence[Trial], held_out: Sequence[Trial], folder: Path
) -> tuple[Diagnosis | None, str]:
    """The diagnosis of a calibrated ship, written into her run ``folder``, or why there is none."""
    if not task.options.diagnose or not result.converged:
        return None, "" if result.converged else "not diagnosed: the calibration has not converged"
    several = len({trial.meta.get("group") for trial in train}) > 1  # campaigns, between which she may have drifted
    step = COARSER * default_step(train, result.ship.particulars["L"])
    options = DiagnosisOptions(step, task.options.seed, command=task.command, between="group" if several else None)
    try:
        sister = task.sister
        ship = sisters.with_whole_prior(result.ship, sister.mean) if sister else result.ship
        diagnosis = diagnosing.diagnose(ship, train, held_out, None, options, folder)
    except (UserError, np.linalg.LinAlgError) as error:  # the calibration stands without it
        return None, f"not diagnosed: {error}"
    target = folder / DIAGNOSIS
    diagnosis.save(target, replace=target.exists())
    return diagnosis, ""


def trials_of(task: FleetTask) -> tuple[list[Trial], list[Trial], list[str]]:
    """The trials of the ship of a ``task`` to fit and those held out, and sentences on files that mmg check calls
    contradictory, which are left out. Raises UserError where none is left to fit."""
    ship = task.ship
    train = [
        replace(trial, meta={**trial.meta, "campaign": label}) if label else trial
        for trial, label in zip(read_trials(ship.trials), ship.trials.values(), strict=True)
    ]
    held_out = read_trials(ship.held_out) if ship.held_out else []
    left_out: list[str] = []
    if not task.options.unchecked:
        refuted = {}
        for report in TrialSet((*train, *held_out)).reports:
            if report.verdict == CONTRADICTORY:
                refuted[report.path] = next(f.text for f in report.findings if f.level == CONTRADICTORY)
        left_out = [f"{Path(path).name} is left out: {text}" for path, text in refuted.items()]
        # of many ships' files a few may be wrong: they are left out, where mmg fit would refuse all
        train, held_out = ([t for t in some if str(t.path or "") not in refuted] for some in (train, held_out))
        if not train:
            raise Conflict(f"mmg check calls all trials contradictory: {left_out[0]}")
    fitted, judged = ready(train, held_out, unchecked=task.options.unchecked)
    campaigns = fitted.campaigns  # as the calibration splits them; the diagnosis compares the same groups
    grouped = [
        replace(trial, meta={**trial.meta, "group": campaigns.names[number]})
        for trial, number in zip(fitted, campaigns.number, strict=True)
    ]
    return grouped, list(judged), left_out
