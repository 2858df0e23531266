"""What the work of the tool takes on this machine, by the clock and in processor seconds of all its processes.

Run from the repository root, with the records in place: python -m benchmarks.timings [ROW ...] [--repeats 3] [--record]
Rows (default all): see timings.toml. The median of so many repetitions is taken, all code being compiled before but for
"fit_cold". Times of machines and hours differ up to three-fold: compare in one run.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from itertools import count
from pathlib import Path
from typing import Any

from benchmarks.record import Figure, parser_of, report
from benchmarks.toml import tables
from cases.io import published_splits as splits

ROOT = Path(__file__).parents[1]
ROWS: dict[str, dict[str, Any]] = tables(Path(__file__).with_suffix(".toml"))
"""Row -> what it is in words, command, and perhaps environment."""
RECORDS = {"TRAIN": splits.TRAIN_TZRB, "PLUS": splits.TRAIN_TZRB_PLUS, "HELD": splits.DEVELOPMENT_HOLDOUT,
           "ONE": splits.DEVELOPMENT_HOLDOUT[:1]}  # fmt: skip
NUMBERS = count()
"""Of the paths in the scratch folder."""


def words(folder: Path, text: str) -> Iterator[str]:
    """The words of a ``text`` of timings.toml; folder: scratch."""
    for word in text.split():
        if word in RECORDS:
            yield from map(str, splits.find(RECORDS[word]))
        elif word.startswith("NEW"):
            yield str(folder / word.replace("NEW", f"new-{next(NUMBERS)}"))
        else:
            yield str(folder / "fit") if word == "FIT" else word


def seconds(folder: Path, command: str, environment: Mapping[str, str]) -> tuple[float, float]:
    """By the clock and of the processors of a ``command`` of timings.toml. Raises RuntimeError where it fails."""
    arguments = list(words(folder, command))
    more = {name: next(words(folder, value)) for name, value in environment.items()}
    given = {**os.environ, "MMG_CACHE": str(folder / "cache"), **more}
    given.pop("PYTHONDONTWRITEBYTECODE", None)  # who uses the tool has the bytecode of its modules
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    line = [sys.executable, "-m", "mmg_ident", *arguments]
    done = subprocess.run(line, env=given, cwd=ROOT, capture_output=True, text=True)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments[:5])} ... ended with {done.returncode}: {done.stderr[-2000:]}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, print and, if asked, record."""
    parser = parser_of("timings", __doc__)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    if unknown := set(given.rows) - set(ROWS):
        parser.error(f"no such row: {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        seconds(folder, "fit esso_osaka_3m TRAIN --out FIT", {})  # compiles what most rows need
        for name in given.rows or ROWS:
            what, command = ROWS[name]["what"], ROWS[name]["command"]
            runs = sorted(seconds(folder, command, ROWS[name].get("environment", {})) for _ in range(given.repeats))
            wall, processor = runs[(len(runs) - 1) // 2]
            made = {f"{name}_wall": Figure(what, wall, "s"),
                    f"{name}_processor": Figure(f"{what}, processor", processor, "s")}  # fmt: skip
            report(made, f"timings {name}", given.record)


if __name__ == "__main__":
    main()
