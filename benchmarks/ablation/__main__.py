"""Command line: python -m benchmarks.ablation [fits] [diagnoses] [table] [--rows NAME ...] [--work FOLDER]."""

from __future__ import annotations

import argparse
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.ablation import diagnoses, fits
from benchmarks.ablation.table import write_table
from benchmarks.measured import Record, Task

WORK = Path(tempfile.gettempdir()) / "mmg_ablation"
grounds = cache(fits.grounds)
cases = cache(diagnoses.cases)


def fit_task(work: Path, name: str, number: int) -> dict[str, Any]:
    """What is measured of the switch ``name`` on the fold ``number``."""
    return fits.measured(next(s for s in fits.SWITCHES if s.name == name), grounds(work)[number])


def diagnosis_task(work: Path, number: int) -> dict[str, Any]:
    """The answers to the case ``number``, of some also those without rules that change all fits."""
    rare = () if number % diagnoses.SOME else diagnoses.RARE
    return diagnoses.answers(cases(work)[number], diagnoses.RULES + rare)


def main() -> None:
    """Measure what is asked for, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation", description=__doc__)
    parser.add_argument("what", nargs="*", default=["fits", "diagnoses", "table"], help="default: all")
    parser.add_argument("--rows", nargs="+", default=[], help="switches of the fits to measure; default all")
    parser.add_argument("--cases", type=int, help="most cases to diagnose; default all")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, default=WORK, help="folder of generated cases and of the record")
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    records = Record(given.work / "fits.jsonl"), Record(given.work / "diagnoses.jsonl")
    if "fits" in given.what:
        tasks: list[Task] = [
            ({"row": switch.name, "ground": fold.ground, "fold": fold.name}, (given.work, switch.name, number))
            for switch in fits.SWITCHES
            if not given.rows or switch.name in given.rows
            for number, fold in enumerate(grounds(given.work))
        ]
        records[0].measure(fit_task, tasks, given.workers)
    if "diagnoses" in given.what:
        chosen = enumerate(cases(given.work)[: given.cases])
        places = [({"world": c.world, "kind": c.kind, "case": c.folder.name}, (given.work, k)) for k, c in chosen]
        records[1].measure(diagnosis_task, places, given.workers)
    if "table" in given.what:
        write_table(*records)


if __name__ == "__main__":
    main()
