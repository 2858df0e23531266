"""Which logs belong to one run: those that a person says, or those of one folder and time that complete each other."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cases.importing.import_map import ImportMap
from cases.importing.log_columns import Log
from mmg.errors import Conflict

OVERLAP = 0.5
"""Least share of the shorter of two logs in which both run."""
HEADING, WHERE, ROTATION = (
    {"psi"},
    {"x", "latitude", "sog", "u"},
    {"n", "n_2", "n_bow", "n_stern", "n_azimuth", "delta"},
)


def grouped(logs: Sequence[Log], chosen: ImportMap) -> list[list[Log]]:
    """The ``logs`` of each run, in the order of their first files.

    chosen: the map. Logs of one run are those with the same ``run`` in it. Others are joined where they lie in one
    folder, their clocks are absolute and overlap, and one that is not complete by itself adds what the others lack.
    Raises UserError for logs of several ships in one run.
    """
    runs: list[list[Log]] = []
    for log in logs:
        name = chosen.of(log.table.path).run
        for run in runs:
            other = chosen.of(run[0].table.path).run
            same = bool(name) and name == other
            if same or (not name and not other and not chosen.separate and _completes(log, run)):
                run.append(log)
                break
        else:
            runs.append([log])
    for run in runs:
        ships = sorted({log.ship for log in run if log.ship})
        if len(ships) > 1:
            names = " and ".join(log.name for log in run)
            raise Conflict(
                f"{names}: logs of several ships ({', '.join(ships[:3])}) at the same time; import each ship alone"
            )
    return runs


def complete(quantities: set[str]) -> bool:
    """Whether a run can be made of these ``quantities``: heading, motion and an actuator."""
    return bool(quantities & HEADING) and bool(quantities & WHERE) and bool(quantities & ROTATION)


def run_name(run: Sequence[Log], chosen: ImportMap) -> str:
    """The name of a ``run``: that of the map ``chosen``, the stem of its file, or what the stems of its files have in
    common."""
    named = chosen.of(run[0].table.path).run
    if named:
        return named
    stems = [log.table.path.stem for log in run]
    if len(set(stems)) == 1:
        sheet = re.search(r"sheet '(.*)'$", run[0].name)
        return f"{stems[0]}_{sheet[1]}" if sheet and len(run) == 1 else stems[0]
    least, most = min(stems), max(stems)
    same = next((i for i, (a, b) in enumerate(zip(least, most, strict=False)) if a != b), len(least))
    return least[:same].rstrip("_- .") or stems[0]


def _completes(log: Log, run: Sequence[Log]) -> bool:
    """Whether ``log`` completes the logs of a ``run``, at the same time."""
    if not log.absolute or not all(other.absolute for other in run):
        return False
    if log.table.path.parent != run[0].table.path.parent:
        return False
    own, theirs = set(log.columns), set().union(*(other.columns for other in run))
    if complete(own) or not own - theirs or (complete(theirs) and own & theirs):
        return False
    a, b = max(other.t[0] for other in run), min(other.t[-1] for other in run)
    both = min(b, log.t[-1]) - max(a, log.t[0])
    return bool(both > OVERLAP * min(b - a, log.t[-1] - log.t[0]))
