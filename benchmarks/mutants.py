"""How many small faults in the physics the tests of its rooms notice: the mutation score.

python -m benchmarks.mutants [--sample N] [--seed S] [--least PERCENT] [--workers W] [--record]: draws N faults among
all that ``faults`` can make in the files of ROOMS, runs the tests of the file's room on each until one fails, and
prints the score by room and the faults that no test noticed. Exit code 1 below --least. Faults that change nothing are
named in mutants.toml with the reason and do not count. The order of the draw depends on the faulty lines alone, so that
a change elsewhere leaves the sample what it was.

Each fault is tested in a process forked from one that has imported the libraries but nothing of this project: where a
module is imported, its faulty text is compiled in its place, and no file is changed. Needs fork.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from benchmarks.faults import Fault, faults
from benchmarks.record import Figure, keep, table

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
KEPT = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
"""Tests by room, and faults that change nothing."""
ROOMS: dict[str, list[str]] = KEPT["rooms"]
LIBRARIES = (
    "casadi", "numpy", "scipy.optimize", "scipy.integrate", "scipy.interpolate", "scipy.signal", "pandas", "pytest",
    "hypothesis", "hypothesis.strategies", "matplotlib.pyplot", "pydantic", "tomlkit", "jinja2", "typer",
    "safetensors.numpy", "xdist",
)  # fmt: skip
"""What the tests import besides this project: once, before the forks."""
LONGEST = 240.0
"""Time [s] after which a test that does not end counts as one that fails."""


def physics() -> list[str]:
    """Files with physics, paths from the root of the repository with /."""
    found = {file for place in ROOMS for file in [ROOT / place, *(ROOT / place).rglob("*.py")] if file.suffix == ".py"}
    return sorted(file.relative_to(ROOT).as_posix() for file in found if file.name != "__init__.py")


def room_tests(path: str) -> list[str]:
    """The test files of the physics file ``path``."""
    return ROOMS[max((place for place in ROOMS if path.startswith(place)), key=len)]


@cache
def _every() -> tuple[Fault, ...]:
    """All faults of the physics."""
    return tuple(fault for path in physics() for fault in faults(path, (ROOT / path).read_text(encoding="utf-8")))


def drawn(seed: int, count: int) -> list[Fault]:
    """The first ``count`` of all faults of the physics in an order that ``seed`` makes."""
    return sorted(_every(), key=lambda fault: sha256(f"{seed} {fault.key}".encode()).digest())[:count]


def equivalent() -> dict[str, str]:
    """Faults that change nothing, by their key: the reason."""
    return {f"{row['file']}: {row['line']} -> {row['faulty']}": row["reason"] for row in KEPT["fault"]}


class Faulty(importlib.abc.MetaPathFinder):
    """Imports one module with a fault."""

    def __init__(self, fault: Fault) -> None:
        self.fault = fault
        self.module = fault.path.removesuffix(".py").replace("/", ".")

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        """Of the module with the fault. name: of any module; path, target: not needed."""
        if name != self.module:
            return None
        file = str(ROOT / self.fault.path)
        return importlib.util.spec_from_file_location(name, file, loader=_Text(name, file, self.fault.text))


class _Text(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, file: str, text: str) -> None:
        super().__init__(name, file)
        self.text = text

    def get_code(self, fullname: str) -> Any:
        return compile(self.text, self.path, "exec")


def noticed(fault: Fault | None, tests: Sequence[str], folder: str) -> int:
    """Be the tests: this process, newly forked, ends with 0 where they pass. fault: in the code, None for none."""
    os.setsid()
    sink = os.open(f"{folder}/{os.getpid()}.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    if fault:
        sys.meta_path.insert(0, Faulty(fault))
    import pytest

    quiet = ["-x", "-q", "-n0", "-p", "no:cacheprovider", "--hypothesis-seed=0", "--tb=line", "-m", "not slow"]
    return int(pytest.main([*quiet, *tests]))


def outcomes(work: Sequence[tuple[Fault | None, list[str]]], workers: int) -> Iterator[tuple[int, int]]:
    """Number of a piece of ``work`` and exit code of its tests (-1: not ended in time), as they end."""
    waiting, running = list(enumerate(work)), dict[int, tuple[int, float]]()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = folder
        while waiting or running:
            while waiting and len(running) < workers:
                number, (fault, tests) = waiting.pop(0)
                child = os.fork()
                if not child:
                    code = 3
                    try:
                        code = noticed(fault, tests, folder)
                    finally:
                        os._exit(code)
                running[child] = (number, time.monotonic())
            child, status = os.waitpid(-1, os.WNOHANG)
            if child:
                number, _ = running.pop(child)
                yield number, os.waitstatus_to_exitcode(status)
            for late in [c for c, (_, start) in running.items() if time.monotonic() - start > LONGEST]:
                os.killpg(late, signal.SIGKILL)
                os.waitpid(late, 0)
                yield running.pop(late)[0], -1
            time.sleep(0.02)


def room(path: str) -> str:
    """The room of a file: its folder, or its name where it lies on the floor itself."""
    parts = path.split("/")
    return "/".join(parts[:3]) if parts[1] == "components" else "/".join(parts[:2])


def main() -> int:
    """Draw, test, print; returns 1 where the score is below the least."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("sample", 200), ("seed", 14), ("least", 85), ("workers", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--record", action="store_true", help="keep the figure in record.json")
    parser.add_argument("--of", default="", help="only of files whose path begins so")
    given = parser.parse_args()
    os.chdir(ROOT)
    for name in LIBRARIES:
        importlib.import_module(name)
    reasons = equivalent()
    sample = [f for f in drawn(given.seed, given.sample) if f.path.startswith(given.of)]
    chosen = [fault for fault in sample if fault.key not in reasons]
    every = sorted({test for fault in chosen for test in room_tests(fault.path)})
    for number, code in outcomes([(None, [test]) for test in every], given.workers):
        if code:
            print(f"{every[number]} fails without any fault")
            return 1
    codes = dict[int, int]()
    for number, code in outcomes([(fault, room_tests(fault.path)) for fault in chosen], given.workers):
        codes[number] = code
        if code == 0:
            print("not noticed:", chosen[number].key, flush=True)
    print("\n".join(summary(sample, chosen, codes)))
    killed = sum(code != 0 for code in codes.values())
    score = 100 * killed / max(len(chosen), 1)
    print(f"{killed} of {len(chosen)} faults noticed: {score:.1f} % (least {given.least} %)")
    if given.record:
        figure = Figure("faults in the physics that the tests notice", killed, of=len(chosen))
        keep({"mutants": figure}, f"python -m benchmarks.mutants --sample {given.sample} --seed {given.seed}")
    return 0 if score >= given.least else 1


def summary(sample: Sequence[Fault], chosen: Sequence[Fault], codes: dict[int, int]) -> list[str]:
    """A table by room. sample: all that were drawn; chosen: those that change something; codes: of their tests."""
    rows = []
    for name in sorted({room(fault.path) for fault in sample}):
        mine = [number for number, fault in enumerate(chosen) if room(fault.path) == name]
        some = sum(room(fault.path) == name for fault in sample)
        seen = sum(codes[number] != 0 for number in mine)
        rows.append([name, str(some), str(some - len(mine)), str(seen), str(len(mine) - seen)])
    sums = [str(sum(int(row[i]) for row in rows)) for i in range(1, 5)]
    return table(["room", "drawn", "change nothing", "noticed", "not noticed"], [*rows, ["all", *sums]])


if __name__ == "__main__":
    sys.exit(main())
