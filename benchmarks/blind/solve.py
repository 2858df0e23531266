"""Answers of the diagnosis to blind cases, kept as one JSON file per case.

Nothing here reads a key or what is sealed: a case is its folders ``train`` and ``test`` and perhaps ``site.toml``.
"""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from cases.io.read import read_trials
from cases.io.site import read_site
from cases.shipfiles.ship_file import load_ship
from diagnosis.diagnose import DiagnosisOptions, diagnose
from fitting.parallel import run_all
from mmg.errors import UserError
from mmg.ship import Ship

PRIOR, LEAST = 0.08, 1e-5
"""Prior standard deviation of the ship's coefficients: this share of their value, at least ``LEAST``."""
ROOT = Path(__file__).parents[2]
SOURCES = ("diagnosis", "mmg", "cases", "fitting")
"""Packages that the answers are made by."""


@dataclass(frozen=True)
class Task:
    """A case to solve: its folder, the file of its answer, the state of the code."""

    case: Path
    answer: Path
    code: str


def ship_of(case: Path) -> str:
    """The ship file of a case's benchmark, which is no secret."""
    return str(json.loads((case.parent / "ship.json").read_text(encoding="utf-8"))["ship"])


@cache
def blind_ship(name: str = "esso_osaka_3m") -> Ship:
    """The ship as the diagnosis gets it: nominal coefficients, each known to 8 %."""
    ship = load_ship(name)
    rows = {s: ship.coefficients[s] for s in ship.free}
    return ship.with_coefficients({s: c.with_(std=max(PRIOR * abs(c.value), LEAST)) for s, c in rows.items()})


@cache
def code_version() -> str:
    """Twelve hex digits that change with any source file of the packages the answers are made by."""
    digest = hashlib.sha256()
    for package in SOURCES:
        for path in sorted((ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def cases_of(folder: Path) -> list[Path]:
    """The case folders of a benchmark, in order."""
    return sorted(p for p in folder.glob("case_*") if p.is_dir())


def solve(
    folder: Path, answers: Path, workers: int = 1, say: Callable[[str], None] = lambda words: None
) -> dict[str, dict[str, Any]]:
    """The answers to all cases of a benchmark folder, by case; those already in ``answers`` are not solved again.

    A case that failed counts as answered; delete its file to have it tried again.
    """
    answers.mkdir(parents=True, exist_ok=True)
    there = answers.absolute()  # a worker of a cluster began elsewhere
    tasks = [Task(case, there / f"{case.name}.json", code_version()) for case in cases_of(folder.absolute())]
    todo = [task for task in tasks if not task.answer.exists()]
    say(f"{folder.name}: {len(todo)} of {len(tasks)} cases to solve")
    run_all(solve_case, todo, workers, each=say)
    return {task.case.name: json.loads(task.answer.read_text(encoding="utf-8")) for task in tasks}


def solve_case(task: Task) -> str:
    """Solve one case and write its answer, complete or not at all; returns a line about it."""
    began = time.perf_counter()
    try:
        answer = answered(task.case)
    except Exception as error:  # any failure is a wrong answer, and the others go on
        answer = {"error": f"{type(error).__name__}: {error}"}
        if not isinstance(error, UserError):
            answer["traceback"] = traceback.format_exc()
    answer |= {"seconds": time.perf_counter() - began, "code": task.code}
    part = task.answer.with_suffix(".part")
    part.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    part.replace(task.answer)
    words = answer.get("error") or ", ".join([answer["verdict"], *(e["name"] for e in answer["effects"])])
    return f"{task.case.name}: {words} ({answer['seconds']:.0f} s)"


def answered(case: Path) -> dict[str, Any]:
    """What ``diagnosis.json`` would hold for a case."""
    ship = blind_ship(ship_of(case))
    site = read_site([case], ship)
    train, test = read_trials(case / "train"), read_trials(case / "test")
    return diagnose(ship, train, test, site, DiagnosisOptions(learn=False)).to_dict()
