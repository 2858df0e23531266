"""The manoeuvres of a long record as trials: each from its straight approach to its end, none over another one.

What is a manoeuvre, and what was ordered in it, is said by ``cases.criteria.measured_maneuvers``; where the ship was
manoeuvred otherwise, by ``cases.operation.log``, as for months of operation. No part goes on over a gap in which she
sails her length."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.criteria.measured_maneuvers import Execute, find_maneuvers, length_by_turns, ship_time, steering
from cases.io.groups import day_of
from cases.io.leave_out import Span, inside, spans_left_out
from cases.io.sidecar import NAME as SIDECAR
from cases.io.sidecar import SidecarEntry, sidecar_entry
from cases.operation.log import GAP, WINDOW, cut_log, stretches
from cases.simulation.simulate import write_trial
from cases.trial import Trial
from cases.trial_set import TrialSet
from mmg.errors import Missing, UserError

AT_REST, UNDER_WAY = 0.1, 0.9
"""Shares of her highest speed below which a ship lies at rest, and above which she has accelerated."""


@dataclass(frozen=True)
class CutTrial:
    """A ``trial`` cut out of a record, on its clock. order: "10/10", "-35", "" for what has none; order_s: when it was
    given [s]; exclude: what the record's sidecar leaves out of it, None where that says nothing; remarks: in words."""

    trial: Trial
    order: str
    order_s: float
    exclude: tuple[Span, ...] | None
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """What ``mmg cut --json`` prints of it."""
        names = {"name": self.trial.name, "file": f"{self.trial.name}.csv", "kind": self.trial.kind}
        times = {"begin_s": float(self.trial.t[0]), "order_s": self.order_s, "end_s": float(self.trial.t[-1])}
        return {**names, "order": self.order, **times, "remarks": list(self.remarks)}


def cut_record(record: Trial, length: float | None = None, rest: bool = False, prefix: str = "") -> list[CutTrial]:
    """The manoeuvres in a ``record`` as trials, in the order of time.

    length: of the ship [m], None takes it from her turn rates; rest: also where she was manoeuvred otherwise, as trials
    of kind ""; prefix: of their names. What is broken is bridged in looking for manoeuvres; the trials have all rows.
    Raises UserError where there is none.
    """
    (sound,) = TrialSet((replace(record, kind=""),)).sound
    length = length or length_by_turns(sound)
    unit, found, why = ship_time(sound, length), list[tuple[float, float, Execute]](), ""
    for first, end in stretches(np.zeros(len(sound)), np.diff(sound.t) > max(unit, GAP * sound.dt)):
        piece, zero, last = _rows(sound, slice(first, end)), float(sound.t[first]), float(sound.t[first])
        executes: tuple[Execute, ...] = ()
        try:
            executes = find_maneuvers(piece, length)
        except UserError as error:
            why = why or str(error)
        several = sorted([*executes, *_accelerations(piece, executes)], key=lambda e: e.order_time)
        orders = [zero + execute.order_time for execute in several]
        for execute, order, after in zip(several, orders, [*orders[1:], math.inf], strict=False):
            stop = min(zero + execute.end, after - sound.dt)
            found.append((max(order - WINDOW * unit, last), stop, replace(execute, order_time=order)))
            last = stop + 0.5 * sound.dt
    parts = [_part(record, begin, end, execute) for begin, end, execute in found]
    spans: list[Span] = []
    for window in cut_log([sound.columns], length).windows if rest else ():
        if window.manoeuvring and all(window.end < begin or window.begin > end for begin, end, _ in found):
            joined = spans.pop()[0] if spans and window.begin - spans[-1][1] < GAP * sound.dt else window.begin
            spans.append((joined, window.end))
    parts += [_part(record, begin, end) for begin, end in spans]
    if not parts:
        raise Missing(why or f"{record.name}: no manoeuvre found")
    parts.sort(key=lambda part: float(part.trial.t[0]))
    return [_named(part, f"{prefix}{number:02d}") for number, part in enumerate(parts, 1)]


def _rows(trial: Trial, rows: slice | np.ndarray) -> Trial:
    columns = {name: values[rows] for name, values in trial.columns.items()}
    return replace(trial, columns=columns, whole=None, meta={**trial.meta, "bridged": ""})


def _part(record: Trial, begin: float, end: float, execute: Execute | None = None) -> CutTrial:
    """The rows of the ``record`` from ``begin`` to ``end`` [s]."""
    whole = record.whole or record
    trial = replace(_rows(whole, inside(whole, [(begin, end)])), kind=execute.kind if execute else "")
    left_out = tuple((max(a, begin), min(b, end)) for a, b in spans_left_out(record) if a < end and b > begin)
    exclude = left_out if "left_out" in record.meta else None
    if execute is None:
        return CutTrial(trial, "", begin, exclude, ())
    return CutTrial(trial, execute.order, execute.order_time, exclude, (*execute.notes, *execute.caveats))


def _named(part: CutTrial, number: str) -> CutTrial:
    words = [number, part.trial.kind or "rest", *part.order.split("/")]
    return replace(part, trial=replace(part.trial, name="_".join(filter(None, words))))


def _accelerations(trial: Trial, others: Sequence[Execute]) -> list[Execute]:
    """Where the ship of a ``trial`` gathers way from rest, but for what belongs to ``others``."""
    t, u, n = trial.t - trial.t[0], np.nan_to_num(trial["u"]), np.nan_to_num(steering(trial)[1])
    fast, ahead, found = float(u.max()), n > 0.05 * float(n.max()), []
    moves = (u > AT_REST * fast).astype(int)
    for start in np.flatnonzero(np.diff(moves) > 0) + 1 if fast > 0 else ():
        later = np.flatnonzero(moves[start:] == 0)
        end = start + (int(later[0]) if len(later) else len(u) - start)
        under_way = np.flatnonzero(u[start:end] >= UNDER_WAY * fast)
        if not len(under_way) or not ahead[start]:
            continue
        order = int(np.flatnonzero(~ahead[:start])[-1]) if not ahead[:start].all() else 0
        a, b = float(t[order]), float(t[start + under_way[0]])
        if all(b < other.order_time or a > other.end for other in others):
            found.append(Execute("acceleration", a, 0.0, (), b, 0.0, math.nan, ()))
    return found


CONVERTED = {"columns", "units", "sign", "rudder_positive", "wind_direction", "velocity_frame", "heading_from", "lag",
             "sentinels", "reference_point", "name"}  # fmt: skip
"""Keys of a sidecar that say how a file is converted: the trials are canonical."""


def write_cut(parts: Sequence[CutTrial], folder: Path) -> None:
    """Write ``parts`` into an existing ``folder``, each as a canonical file, and what the sidecars of their records say
    of them as ``trials.toml``. Raises UserError where that is not possible."""
    import tomlkit

    files: dict[str, dict[str, Any]] = {}
    for part in parts:
        trial = part.trial
        said = SidecarEntry() if trial.path is None else sidecar_entry(trial.path)
        entry = {**said.model_dump(exclude_unset=True, exclude=CONVERTED), "kind": trial.kind, "day": day_of(trial)}
        entry |= {} if part.exclude is None else {"exclude": [list(span) for span in part.exclude]}
        files[f"{trial.name}.csv"] = {key: value for key, value in entry.items() if value or key == "exclude"}
        in_file = json.loads(trial.meta.get("labels", "{}")) or trial.columns  # the rest is derived on reading again
        logged = {name: values for name, values in trial.columns.items() if name in in_file}
        write_trial(replace(trial, columns=logged), folder / f"{trial.name}.csv")
    words = "# Written by mmg cut; the files are canonical (SI, radians)\n"
    (folder / SIDECAR).write_text(words + tomlkit.dumps({"files": files}), encoding="utf-8")
