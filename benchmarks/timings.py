"""What the work of the tool takes on this machine, by the clock and in processor seconds of all its processes.

Run from the repository root, with the records in place: python -m benchmarks.timings [ROW ...] [--repeats 3] [--record]
Rows (default all): see ROWS. The median of so many repetitions is taken, all code being compiled before but for "cold".
Times of machines and hours differ up to three-fold: compare in one run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.record import Figure, keep
from cases import published_splits as splits

ROOT = Path(__file__).parents[1]
SHIP = "esso_osaka_3m"
REPLICATES, TURNINGS, POINTS = 100, 10_000, 8192
"""Of a bootstrap; simulated side by side; states of a right-hand side."""


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

    def python(self, *arguments: str, **environment: str) -> tuple[float, float, str]:
        """Seconds by the clock and of the processors of a process of Python, and what it wrote. Raises RuntimeError
        where it fails."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        given = {**os.environ, "MMG_CACHE": str(self.folder / "cache"), **environment}
        given.pop("PYTHONDONTWRITEBYTECODE", None)  # who uses the tool has the bytecode of its modules
        done = subprocess.run([sys.executable, *arguments], env=given, cwd=ROOT, capture_output=True, text=True)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(f"{' '.join(arguments[:5])} ... ended with {done.returncode}: {done.stderr[-2000:]}")
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout

    def mmg(self, *arguments: str, **environment: str) -> tuple[float, float]:
        """Seconds by the clock and of the processors of the command with these ``arguments``."""
        return self.python("-m", "mmg_ident", *arguments, **environment)[:2]

    def inside(self, function: str, *arguments: str) -> tuple[float, float]:
        """What a ``function`` of this module measures in a process of its own."""
        code = f"import json, sys; from benchmarks import timings; print(json.dumps(timings.{function}(*sys.argv[1:])))"
        wall, processor = json.loads(self.python("-c", code, *arguments)[2].splitlines()[-1])
        return wall, processor

    def fit(self, names: Sequence[str], **environment: str) -> tuple[float, float]:
        """`mmg fit` of the records ``names``."""
        self.run = self.new("fit")
        return self.mmg("fit", SHIP, *_files(names), "--out", str(self.run), **environment)

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


def best_of(count: int, work: Callable[[], object]) -> tuple[float, float]:
    """Shortest of ``count`` runs of some ``work`` in this process, by the clock and the processor [s]."""
    times = []
    for _ in range(count):
        began = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return min(times)


def bootstrap() -> tuple[float, float]:
    """Refits of Train-TZRB to runs drawn with replacement, on two processes, whose time alone is not counted."""
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from fitting.calibration import estimate_coefficients
    from fitting.uncertainty import bootstrap as refits

    found = estimate_coefficients(load_ship(SHIP), read_trials(splits.find(splits.TRAIN_TZRB)))
    x = found.solution.x
    return best_of(1, lambda: refits.bootstrap(found.information, REPLICATES, 0, found.problem, x, 2))


def blind(folder: str) -> tuple[float, float]:
    """Median of the cases of the blind benchmark in ``folder``, the first of which is solved once before it counts."""
    from benchmarks.blind.solve import answered, cases_of

    cases = cases_of(Path(folder))
    answered(cases[0])
    return sorted(best_of(1, lambda case=case: answered(case)) for case in cases)[len(cases) // 2]  # type: ignore[misc]


def right_hand_side() -> tuple[float, float]:
    """One right-hand side among many in one call, one thread."""
    from cases.shipfiles.ship_file import load_ship
    from mmg.rollout import Simulator

    rng = np.random.default_rng(0)
    state = rng.normal(size=(6, POINTS)) * np.array([[1], [1], [1], [0.3], [0.1], [0.05]])
    controls = np.vstack([rng.uniform(-15, 15, POINTS), 0.3 * rng.normal(size=POINTS), rng.normal(size=(2, POINTS))])
    simulator = Simulator(load_ship(SHIP))
    wall, processor = best_of(200, lambda: simulator.rates(state, controls))
    return wall / POINTS, processor / POINTS


def turnings() -> tuple[float, float]:
    """Turnings of KVLCC2 with coefficients scattered by 5 %, on two threads."""
    from benchmarks.open_comparisons.turning import SPREAD, STEP, maneuver, scattered
    from cases.simulation.simulate_batch import simulate_batch
    from mmg.rollout import Simulator

    ship, theta = scattered(TURNINGS, SPREAD)
    simulator, plan = Simulator(ship), maneuver(ship)
    return best_of(7, lambda: simulate_batch(simulator, plan, theta, STEP, threads=2))


def blind_cases(bench: Bench) -> tuple[float, float]:
    """Three blind cases of seven runs."""
    folder = bench.new("blind")
    options = ["--cases", "3", "--seed", "20", "--kind", "mix", "--set", "mixed"]
    bench.python("-m", "benchmarks.blind.generator", str(folder), *options)
    return bench.inside("blind", str(folder))


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
    "bootstrap": (f"{REPLICATES} refits of a bootstrap of 8 records, two processes",
                  lambda bench: bench.inside("bootstrap")),
    "blind": ("diagnosis of a blind case of 7 runs, one core, median", blind_cases),
    "rhs": ("a right-hand side of the 3 m ship, in a batch", lambda bench: bench.inside("right_hand_side")),
    "turnings": (f"{TURNINGS:,} turnings of KVLCC2, two threads", lambda bench: bench.inside("turnings")),
}  # fmt: skip
"""Row -> words, and what measures it: seconds by the clock and of the processors."""


def main() -> None:
    """Measure, print and, if asked, record."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.timings", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="keep the figures in record.json")
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
            unit, factor = ("ns", 1e9) if name == "rhs" else ("s", 1.0)
            print(f"{words}: {factor * wall:.3g} {unit}, {factor * processor:.3g} of processor", flush=True)
            made = {f"{name}_wall": Figure(words, factor * wall, unit)}
            if name != "bootstrap":  # whose processes are not those of one call
                made[f"{name}_processor"] = Figure(f"{words}, processor", factor * processor, unit)
            if given.record:
                keep(made, f"python -m benchmarks.timings {name}")


if __name__ == "__main__":
    main()
