"""What the work of the tool takes on this machine, by the clock and in processor seconds of all its processes.

Run from the repository root, with the records in place: python -m benchmarks.timings [ROW ...] [--repeats 3] [--record]
Rows (default all): see ROWS. The median of so many repetitions is taken, all code being compiled before but for "cold".
Times of machines and hours differ up to three-fold: compare in one run.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.record import Figure, parser_of, report
from cases.io import published_splits as splits

ROOT = Path(__file__).parents[1]
SHIP = "esso_osaka_3m"


@dataclass
class Bench:
    """Where the work is done. folder: scratch, with the cache of compiled code; run: the last run folder of a fit."""

    folder: Path
    run: Path = field(default_factory=Path)
    count: int = 0

    def new(self, name: str) -> Path:
        """A path in the scratch folder that does not exist."""
        self.count += 1
        return self.folder / f"{name}-{self.count}"

    def mmg(self, *arguments: str, **environment: str) -> tuple[float, float]:
        """Seconds by the clock and of the processors of the command with these ``arguments``. Raises RuntimeError where
        it fails."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        given = {**os.environ, "MMG_CACHE": str(self.folder / "cache"), **environment}
        given.pop("PYTHONDONTWRITEBYTECODE", None)  # who uses the tool has the bytecode of its modules
        done = subprocess.run(
            [sys.executable, "-m", "mmg_ident", *arguments], env=given, cwd=ROOT, capture_output=True, text=True
        )
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(f"{' '.join(arguments[:5])} ... ended with {done.returncode}: {done.stderr[-2000:]}")
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def fit(self, names: Sequence[str], *options: str, **environment: str) -> tuple[float, float]:
        """`mmg fit` of the records ``names``."""
        self.run = self.new("fit")
        return self.mmg("fit", SHIP, *_files(names), "--out", str(self.run), *options, **environment)

    def fitted(self) -> str:
        """A run folder of Train-TZRB."""
        if not (self.run / "result.json").exists():
            self.fit(splits.TRAIN_TZRB)
        return str(self.run)


def _files(names: Sequence[str]) -> list[str]:
    return [str(path) for path in splits.find(names)]


def diagnose(bench: Bench) -> tuple[float, float]:
    """`mmg diagnose` of the records of Train-TZRB with the hold-outs as test."""
    test = _files(splits.DEVELOPMENT_HOLDOUT)
    words = ["diagnose", bench.fitted(), *_files(splits.TRAIN_TZRB), "--test", *test]
    return bench.mmg(*words, "--out", str(bench.new("diagnosis")))


def predict(bench: Bench) -> tuple[float, float]:
    """`mmg predict` of one record by a run folder."""
    out, (file,) = bench.new("predicted").with_suffix(".csv"), _files(splits.DEVELOPMENT_HOLDOUT[:1])
    return bench.mmg("predict", bench.fitted(), file, "--window", "30", "--out", str(out))


ROWS: dict[str, tuple[str, Callable[[Bench], tuple[float, float]]]] = {
    "fit": ("`mmg fit` of 8 records, 2,530 s", lambda bench: bench.fit(splits.TRAIN_TZRB)),
    "fit_plus": ("`mmg fit` of 35 records, 13,460 s", lambda bench: bench.fit(splits.TRAIN_TZRB_PLUS)),
    "fit_cold": ("`mmg fit` of 8 records, all code compiled anew",
                 lambda bench: bench.fit(splits.TRAIN_TZRB, MMG_CACHE=str(bench.new("cache")))),
    "fit_portable": ("`mmg fit` of 8 records without a C compiler",
                     lambda bench: bench.fit(splits.TRAIN_TZRB, MMG_CC="none")),
    "diagnose": ("`mmg diagnose` of 8 records with test trials", diagnose),
    "predict": ("`mmg predict` of one record by a run folder", predict),
    "check": ("`mmg check` of 8 records", lambda bench: bench.mmg("check", *_files(splits.TRAIN_TZRB))),
    "demo": ("`mmg demo`", lambda bench: bench.mmg("demo", "--out", str(bench.new("demo")))),
    "help": ("`mmg --help`", lambda bench: bench.mmg("--help")),
    "bootstrap": ("`mmg fit` of 8 records with 100 refits of a bootstrap, two processes",
                  lambda bench: bench.fit(splits.TRAIN_TZRB, "--bootstrap", "100", "--workers", "2")),
}  # fmt: skip
"""Row -> words, and what measures it: seconds by the clock and of the processors."""


def main() -> None:
    """Measure, print and, if asked, record."""
    parser = parser_of("timings", __doc__)
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    if unknown := set(given.rows) - set(ROWS):
        parser.error(f"no such row: {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(Path(scratch))
        bench.fit(splits.TRAIN_TZRB)  # compiles what most rows need
        for name in given.rows or ROWS:
            words, work = ROWS[name]
            runs = sorted(work(bench) for _ in range(given.repeats))
            wall, processor = runs[(len(runs) - 1) // 2]
            made = {
                f"{name}_wall": Figure(words, wall, "s"),
                f"{name}_processor": Figure(f"{words}, processor", processor, "s"),
            }
            report(made, f"timings {name}", given.record)


if __name__ == "__main__":
    main()
