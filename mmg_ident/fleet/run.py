"""A fleet from its plan to its table: sisters alone, what they share, every ship, and what was found of all.

Ships are independent tasks of ``fitting.parallel``; what one of them gives does not depend on who does it. Finished
ones are kept as they finish, so that a run that was interrupted goes on with the same values.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fitting.parallel import run_all
from fitting.report.run_folder import plain, versions
from fitting.selection.sisters import SisterEvidence, SisterWidths, sister_start, sister_widths
from mmg.errors import NotWritable
from mmg.progress import LOGGER, OnProgress, Progress
from mmg_ident.fleet.job import PARTS, FleetTask, ShipOutcome, finish_ship, fit_alone, key_of
from mmg_ident.fleet.plan import FleetPlan, PlannedShip


@dataclass(frozen=True)
class SisterGroup:
    """A group of sisters: its name, the ships whose fits told of each other, and what these said."""

    name: str
    ships: tuple[str, ...]
    widths: SisterWidths


@dataclass(frozen=True)
class Fleet:
    """What was found of a fleet. name; rows: of each ship, in the order of the plan (``mmg_ident.fleet.rows``); groups:
    of sisters; timing: seconds by ship and stage; seconds: of this run; made: ships that it did; command."""

    name: str
    rows: tuple[Mapping[str, Any], ...]
    groups: tuple[SisterGroup, ...] = ()
    timing: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    seconds: float = 0.0
    made: tuple[str, ...] = ()
    command: str = ""

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the ships that have no calibration that can be used."""
        return tuple(row["name"] for row in self.rows if row["status"] != "done")

    def to_dict(self) -> dict[str, Any]:
        """The content of fleet.json."""
        return plain({
            "kind": "fleet",
            "schema_version": 1,
            "name": self.name,
            "command": self.command,
            "ships": [{key: value for key, value in row.items() if key != "coefficients"} for row in self.rows],
            "sisters": {group.name: group_dict(group) for group in self.groups},
            "failed": self.failed,
            "timings_s": {"this_run": self.seconds, "ships": self.timing},
            "versions": versions(),
        })  # fmt: skip


def group_dict(group: SisterGroup) -> dict[str, Any]:
    """Plain values of a ``group`` of sisters: widths in units of the prior, by coefficient and for all, and each sister
    against the mean."""
    w = group.widths
    return {
        "ships": group.ships,
        "common_width": w.common,
        "common_width_90": w.common_90,
        "coefficients": {
            s: {"mean": m, "mean_std": e, "width": t, "width_of_prior": share}
            for s, m, e, t, share in zip(
                w.symbols, w.centre + w.unit * w.mean, w.unit * np.sqrt(np.diag(w.mean_covariance)),
                w.unit * w.width, w.width, strict=True,
            )
        },
        "from_the_others": {
            name: {"p_alike": p, "standard_errors": dict(zip(w.symbols, z.tolist(), strict=True))}
            for name, p, z in zip(group.ships, w.p_alike.tolist(), w.from_others, strict=True)
        },
    }  # fmt: skip


def run_fleet(
    plan: FleetPlan, out: Path, workers: int = 1, command: str = "", progress: OnProgress | None = None
) -> Fleet:
    """Fit, judge, diagnose and compare the ships of ``plan``; their run folders and parts go to the folder ``out``.

    What lies there of the same ships, files and options is kept and not done again. workers: processes, where no other
    executor is in force; command: that is stored; progress: told of each ship. Returns the rows of all; a ship that
    fails has one that says why. Raises UserError where nothing can be written.
    """
    began, errors, made = time.perf_counter(), dict[str, str](), list[str]()
    for stage in ("alone", "done"):
        try:
            (out / PARTS / stage).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NotWritable(f"{out}: cannot be written ({error.strerror}); choose another --out") from None
    said = _Said(errors, made, progress)
    out = out.absolute()
    alone = [_task(plan, ship, out, command) for ship in plan.ships if ship.sisters]
    said.all(fit_alone, [task for task in alone if not _kept(task, "alone")], workers, "alone")
    groups = _groups(plan, [task for task in alone if task.ship.name not in errors])
    tasks = [_with_sisters(_task(plan, s, out, command), groups) for s in plan.ships if s.name not in errors]
    said.all(finish_ship, [task for task in tasks if not _kept(task, "done")], workers, "fleet")
    rows, timing = [], {}
    found = {task.ship.name: _kept(task, "done") for task in tasks}
    sisters = {task.ship.name: task.store("alone").load(task.ship.name) for task in alone}
    for ship in plan.ships:
        words = found.get(ship.name)
        if words is None:
            rows.append(failed_row(ship, errors.get(ship.name, "")))
            continue
        own = sisters.get(ship.name)
        rows.append(_with_alone(words["row"], own[0] if own else None, groups))
        timing[ship.name] = words["timing"] | ({"alone": own[0]["timing"]} if own else {})
    seconds = time.perf_counter() - began
    return Fleet(plan.options.name, tuple(rows), tuple(groups.values()), timing, seconds, tuple(made), command)


class _Said:
    """Ships that failed and that were made, said as they finish."""

    def __init__(self, errors: dict[str, str], made: list[str], progress: OnProgress | None) -> None:
        self.errors, self.made, self.progress = errors, made, progress

    def all(
        self, work: Callable[[FleetTask], ShipOutcome], tasks: Sequence[FleetTask], workers: int, stage: str
    ) -> None:
        count = [0]

        def each(outcome: ShipOutcome) -> None:
            count[0] += 1
            if outcome.failure:
                self.errors[outcome.name] = outcome.failure
                LOGGER.warning("%s: failed: %s", outcome.name, outcome.failure)
            else:
                words = "fitted alone" if stage == "alone" else "done"
                LOGGER.info("%s: %s (%d of %d)", outcome.name, words, count[0], len(tasks))
            if stage != "alone":
                self.made.append(outcome.name)
            if self.progress:
                self.progress(Progress("sisters alone" if stage == "alone" else "ships", count[0], len(tasks)))

        run_all(work, tasks, workers, each)


def _task(plan: FleetPlan, ship: PlannedShip, out: Path, command: str) -> FleetTask:
    """The task of fitting a ``ship`` alone, or with the others of a fleet where she has no sisters."""
    options = plan.options.model_copy(update={"name": ""})
    return FleetTask(ship, options, out, key_of(ship, options), command)


def _kept(task: FleetTask, stage: str) -> dict[str, Any] | None:
    """The words of a part that was finished from the same, None where there is none."""
    found = task.store(stage).load(task.ship.name)
    return found[0] if found and found[0].get("key") == task.key else None


def _groups(plan: FleetPlan, tasks: Sequence[FleetTask]) -> dict[str, SisterGroup]:
    """What sisters say of each other, by group, from those that were fitted alone; two are needed."""
    groups = {}
    for group in plan.sisters:
        told: dict[str, SisterEvidence] = {}
        for task in tasks:
            found = task.store("alone").load(task.ship.name) if task.ship.sisters == group else None
            if found:
                words, arrays = found
                parts = (arrays[key] for key in ("centre", "unit", "A", "b"))
                told[task.ship.name] = SisterEvidence(tuple(words["symbols"]), *parts)
        if len(told) > 1:
            groups[group] = SisterGroup(group, tuple(told), sister_widths(list(told.values())))
            common = groups[group].widths.common
            LOGGER.info("sisters %s: %d ships differ by %.2g of the prior's std", group, len(told), common)
    return groups


def _with_sisters(task: FleetTask, groups: Mapping[str, SisterGroup]) -> FleetTask:
    """The task of a ship with what her sisters say of her, as it is where there are none."""
    group, name = groups.get(task.ship.sisters), task.ship.name
    if group is None:
        return task
    w, number = group.widths, group.ships.index(name)
    sister = sister_start(task.ship.start, w, group.ships, number)
    more = {"mean": w.mean, "covariance": w.mean_covariance, "width": w.used_width, "values": sister.values}
    key = key_of(task.ship, task.options, more)
    return FleetTask(task.ship, task.options, task.folder, key, task.command, sister)


def _with_alone(row: Mapping[str, Any], alone: Mapping[str, Any] | None, groups: Mapping[str, SisterGroup]) -> dict:
    """The ``row`` of a ship with what her fit alone and her sisters say beside it."""
    group = groups.get(row["sisters"])
    if group is None or alone is None:
        return dict(row)
    w, k = group.widths, group.ships.index(row["name"])
    coefficients = {s: dict(c) for s, c in row["coefficients"].items()}
    place = {s: i for i, s in enumerate(w.symbols)}
    for s, c in coefficients.items():
        if s in place:
            i = place[s]
            c["alone"], c["alone_std"] = alone["coefficients"][s]["value"], alone["coefficients"][s]["std"]
            c["sister_mean"] = float(w.centre[i] + w.unit[i] * w.mean[i])
            c["sister_width"] = float(w.unit[i] * w.width[i])
            c["from_others"] = float(w.from_others[k, i])
    away = {s: abs(float(w.from_others[k, i])) for s, i in place.items()}
    moved = sorted((s for s in place if away[s] > ALPHA), key=lambda s: -away[s])
    errors = {
        name: {"alone": alone["scores"][key]["after"]["window"]}
        for name, key in (("held_out", "validation"), ("training", "training"))
        if key in alone["scores"]
    }
    scores = {name: value | errors.get(name, {}) for name, value in row["scores"].items()}
    used = (w.estimate[k] - w.mean) / w.used_width
    return dict(row) | {
        "coefficients": coefficients,
        "scores": scores,
        "p_alike": float(w.p_alike[k]),
        "widths_from_mean": float(np.sqrt(np.mean(used**2))),
        "moved_against_sisters": moved,
    }


ALPHA = 3.0
"""Standard errors from the mean of her sisters from which a coefficient is said to differ."""


def failed_row(ship: PlannedShip, reason: str) -> dict[str, Any]:
    """The row of a ``ship`` that could not be done, for a ``reason``."""
    return {
        "name": ship.name, "sisters": ship.sisters, "status": "failed", "reason": reason, "start": ship.start.title,
        "length": ship.start.particulars["L"], "trials": len(ship.trials), "held_out": len(ship.held_out),
        "seconds_used": 0.0, "loss": "", "weight": None, "campaigns": [], "scores": {}, "coefficients": {},
        "moved": [], "instruments": [], "drifted": [], "warnings": [], "verdict": "", "sentence": "", "effects": [],
        "diagnosis_failed": "",
    }  # fmt: skip
