"""Command line: python -m benchmarks.ablation [fits] [diagnoses] [table] [--rows NAME ...] [--work FOLDER]."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.ablation import diagnoses, fits
from benchmarks.ablation.table import write_table
from benchmarks.measured import Record

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


def measure_fits(record: Record, work: Path, names: Sequence[str], workers: int) -> None:
    """Measures the switches ``names``, all where none is named, on all folds."""
    tasks = [
        ({"row": switch.name, "ground": fold.ground, "fold": fold.name}, (work, switch.name, number))
        for switch in fits.SWITCHES
        for number, fold in enumerate(grounds(work))
        if fits.is_for(switch, fold) and (not names or switch.name in names)
    ]
    record.measure(fit_task, tasks, workers)


def measure_diagnoses(record: Record, work: Path, most: int | None, workers: int) -> None:
    """Answers the first ``most`` cases, all for None."""
    tasks = [
        ({"world": case.world, "kind": case.kind, "case": case.folder.name}, (work, number))
        for number, case in enumerate(cases(work)[:most])
    ]
    record.measure(diagnosis_task, tasks, workers)


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
        measure_fits(records[0], given.work, given.rows, given.workers)
    if "diagnoses" in given.what:
        measure_diagnoses(records[1], given.work, given.cases, given.workers)
    if "table" in given.what:
        write_table(*records)


if __name__ == "__main__":
    main()
