"""The pieces of work that are timed, each a function of a ``Bench`` that returns a ``Timed``."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from cases import published_splits as splits

ROOT = Path(__file__).parents[2]
SHIP = "esso_osaka_3m"
REPLICATES, TURNINGS, POINTS, CASES = 100, 10_000, 8192, 3


@dataclass(frozen=True)
class Timed:
    """What a piece of work took.

    value: median of ``runs`` repetitions; processor: seconds of all its processes and threads in the median one, None
    where they are not counted; note: what else is to be known; phases: phase of a fit -> seconds.
    """

    value: float
    runs: int = 1
    processor: float | None = None
    note: str = ""
    phases: dict[str, float] = field(default_factory=dict)


@dataclass
class Bench:
    """Where the work is done. folder: scratch; repeats: of each piece; cache: of compiled code, warm after the first
    use; fits: the last run folder of each split."""

    folder: Path
    repeats: int
    cache: Path
    fits: dict[str, Path] = field(default_factory=dict)
    known: dict[str, Timed] = field(default_factory=dict)
    count: int = 0

    def new(self, name: str) -> Path:
        """A path in the scratch folder that does not exist."""
        self.count += 1
        return self.folder / f"{name}-{self.count}"

    def process(self, arguments: Sequence[str], **environment: str) -> tuple[float, float, str]:
        """Seconds by the clock and of the processors of a process of Python with these arguments and what it wrote.
        Raises RuntimeError where it fails."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        given = {**os.environ, "MMG_CACHE": str(self.cache), **environment}
        given.pop("PYTHONDONTWRITEBYTECODE", None)  # who uses the tool has the bytecode of its modules
        done = subprocess.run([sys.executable, *arguments], env=given, cwd=ROOT, capture_output=True, text=True)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(f"{' '.join(arguments[:5])} ... ended with {done.returncode}: {done.stderr[-2000:]}")
        return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout

    def mmg(self, *arguments: str, **environment: str) -> tuple[float, float, str]:
        """As ``process``, of the command with these ``arguments``."""
        return self.process(["-m", "mmg_ident", *arguments], **environment)

    def median(self, work: Callable[[], Timed], repeats: int | None = None) -> Timed:
        """The one of median value of several runs of ``work``."""
        runs = sorted((work() for _ in range(repeats or self.repeats)), key=lambda timed: timed.value)
        middle = runs[(len(runs) - 1) // 2]
        return replace(middle, value=statistics.median(r.value for r in runs), runs=len(runs))


def _fit(bench: Bench, names: Sequence[str], *options: str, **environment: str) -> tuple[Timed, Path]:
    out = bench.new("fit")
    files = [str(path) for path in splits.find(names)]
    wall, processor, _ = bench.mmg("fit", SHIP, *files, "--out", str(out), *options, **environment)
    content = json.loads((out / "result.json").read_text(encoding="utf-8"))
    words = f"{content['status']}, objective {content['objective']:.6f}, {content['seconds_used']:.0f} s of data"
    return Timed(wall, 1, processor, words, _phases(content["timings_s"], wall)), out


def _phases(timings: dict[str, float], wall: float) -> dict[str, float]:
    """Phases of a fit that do not overlap, by the timings of its result.json; the rest of ``wall`` [s] is "other"."""
    known = {name: seconds for name, seconds in timings.items() if name not in ("total", "wall", "identifiability")}
    if "values_by_campaign" in known:  # the same as campaigns, by another name
        known.pop("campaigns", None)
    known["estimate, beside solve and prepare"] = max(
        timings.get("total", 0.0) - known.get("solve", 0.0) - known.get("prepare", 0.0), 0.0
    )
    return known | {"start, page and other": max(wall - sum(known.values()), 0.0)}


def fit(bench: Bench) -> Timed:
    """`mmg fit` of Train-TZRB, whole command, warm."""
    if not bench.fits:
        _warm(bench)

    def once() -> Timed:
        timed, bench.fits["TZRB"] = _fit(bench, splits.TRAIN_TZRB)
        return timed

    return bench.median(once)


def _warm(bench: Bench) -> None:
    """Compile what a fit needs, once."""
    _, bench.fits["TZRB"] = _fit(bench, splits.TRAIN_TZRB)


def fit_plus(bench: Bench) -> Timed:
    """`mmg fit` of Train-TZRB+, whole command, warm."""
    if not bench.fits:
        _warm(bench)
    return bench.median(lambda: _fit(bench, splits.TRAIN_TZRB_PLUS)[0])


def cold(bench: Bench) -> Timed:
    """`mmg fit` of Train-TZRB with an empty code cache: seconds more than warm."""
    warm = bench.known.get("fit") or fit(bench)

    def once() -> Timed:
        timed, _ = _fit(bench, splits.TRAIN_TZRB, MMG_CACHE=str(bench.new("cache")))
        return replace(timed, value=timed.value - warm.value, note=f"{timed.value:.1f} s whole", phases={})

    return bench.median(once)


def no_compiler(bench: Bench) -> Timed:
    """`mmg fit` of Train-TZRB without a compiler, whole command."""
    return bench.median(lambda: replace(_fit(bench, splits.TRAIN_TZRB, MMG_CC="none")[0], phases={}), 1)


def diagnose(bench: Bench) -> Timed:
    """`mmg diagnose` of the eight records of Train-TZRB with the development hold-outs as test."""
    if not bench.fits:
        _warm(bench)
    files, test = ([str(p) for p in splits.find(n)] for n in (splits.TRAIN_TZRB, splits.DEVELOPMENT_HOLDOUT))

    def once() -> Timed:
        given = ["diagnose", str(bench.fits["TZRB"]), *files, "--test", *test, "--out", str(bench.new("diagnosis"))]
        wall, processor, out = bench.mmg(*given, "--json")
        found = json.loads(out)
        named = ", ".join(effect["name"] for effect in found["effects"])
        return Timed(wall, 1, processor, f"{found['verdict']} {named}".strip())

    return _second(bench, once)


def _second(bench: Bench, once: Callable[[], Timed]) -> Timed:
    """A run of ``once`` with all code compiled: the second, where there are repetitions."""
    if bench.repeats > 1:
        once()
    return once()


def predict(bench: Bench) -> Timed:
    """`mmg predict` of one file with the library ship."""
    return _predicted(bench, SHIP)


def predict_run(bench: Bench) -> Timed:
    """`mmg predict` of one file with a run folder: bands, and the past of each window."""
    if not bench.fits:
        _warm(bench)
    return _predicted(bench, str(bench.fits["TZRB"]))


def _predicted(bench: Bench, model: str) -> Timed:
    (file,) = splits.find(splits.DEVELOPMENT_HOLDOUT[:1])

    def once() -> Timed:
        out = bench.new("predicted").with_suffix(".csv")
        wall, processor, _ = bench.mmg("predict", model, str(file), "--window", "30", "--out", str(out))
        return Timed(wall, 1, processor)

    once()
    return bench.median(once, 5)


def start_up(bench: Bench) -> Timed:
    """`mmg --help`."""
    return bench.median(lambda: Timed(*_two(bench.mmg("--help"))), 5)


def _two(measured: tuple[float, float, str]) -> tuple[float, int, float]:
    return measured[0], 1, measured[1]


def check(bench: Bench) -> Timed:
    """`mmg check` of the eight records of Train-TZRB."""
    files = [str(p) for p in splits.find(splits.TRAIN_TZRB)]
    return bench.median(lambda: Timed(*_two(bench.mmg("check", *files))))


def _inside(bench: Bench, function: str, *arguments: str) -> Timed:
    """What a ``function`` of ``benchmarks.timings.inside`` measures in a process of its own."""
    code = f"import sys; from benchmarks.timings import inside; inside.{function}(*sys.argv[1:])"
    found = json.loads(bench.process(["-c", code, *arguments])[2].splitlines()[-1])
    return Timed(found["value"], found.get("runs", 1), found.get("processor"), found.get("note", ""))


def scipy_ratio(bench: Bench) -> Timed:
    """The same objective: seconds of scipy's least_squares over ours."""
    return _inside(bench, "scipy_ratio")


def bootstrap(bench: Bench) -> Timed:
    """100 refits of a bootstrap of Train-TZRB on two processes, the calibration itself not counted."""
    return _inside(bench, "bootstrap_refits", str(REPLICATES))


def blind(bench: Bench) -> Timed:
    """One blind case of seven runs, one core, kernels compiled before."""
    folder = bench.new("blind")
    options = ["--cases", str(CASES), "--seed", "20", "--kind", "mix", "--set", "mixed"]
    bench.process(["-m", "benchmarks.blind.generator", str(folder), *options])
    return _second(bench, lambda: _inside(bench, "blind_cases", str(folder)))


def right_hand_side(bench: Bench) -> Timed:
    """Right-hand side of ESSO OSAKA in a batch, one thread: ns a point."""
    return _inside(bench, "right_hand_side", str(POINTS))


def turnings(bench: Bench) -> Timed:
    """10,000 turnings of KVLCC2 with scattered coefficients, two threads."""
    return _inside(bench, "scattered_turnings", str(TURNINGS))
