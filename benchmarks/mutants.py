"""How many small faults in the physics the tests of its rooms notice: the mutation score.

python -m benchmarks.mutants [--sample N] [--seed S] [--least PERCENT] [--workers W] [--record]: draws N faults among
all that ``faults`` can make in the files of ROOMS, runs the tests of the file's room on each until one fails, and
prints the score and the faults that no test noticed. Exit code 1 below --least. Faults that change nothing are
named in mutants.toml with the reason and do not count. The order of the draw depends on the faulty lines alone, so that
a change elsewhere leaves the sample what it was.

Each fault is tested in a copy of the project.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path

from benchmarks.faults import Fault, faults
from benchmarks.measured import done
from benchmarks.record import Figure, parser_of, report
from benchmarks.toml import tables

ROOT = Path(__file__).parents[1]
KEPT = tables(Path(__file__).with_suffix(".toml"))
"""Tests by room, and faults that change nothing."""
ROOMS: dict[str, list[str]] = KEPT["rooms"]
QUIET = ("-x", "-q", "-n0", "-p", "no:cacheprovider", "--hypothesis-seed=0", "--tb=line", "-m", "not slow")
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


def noticed(fault: Fault | None, tests: Sequence[str]) -> bool:
    """Whether ``tests`` fail, or do not end in time, in a copy of the project with a ``fault``; None: without one."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copytree(ROOT, Path(folder) / "copy", ignore=shutil.ignore_patterns(".*", "__pycache__", "runs"))
        if fault:
            (copy / fault.path).write_text(fault.text, encoding="utf-8")
        given = {**os.environ, "PYTHONPATH": str(copy), "HYPOTHESIS_STORAGE_DIRECTORY": folder}
        command = [sys.executable, "-m", "pytest", *QUIET, *tests]
        try:
            code = subprocess.run(command, cwd=copy, env=given, capture_output=True, timeout=LONGEST).returncode
        except subprocess.TimeoutExpired:
            code = 1
    return code != 0


def main() -> int:
    """Draw, test, print; returns 1 where the score is below the least."""
    parser = parser_of("mutants", __doc__)
    for name, value in (("sample", 200), ("seed", 14), ("least", 85), ("workers", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--of", default="", help="only of files whose path begins so")
    given = parser.parse_args()
    reasons = equivalent()
    sample = [f for f in drawn(given.seed, given.sample) if f.path.startswith(given.of)]
    chosen = [fault for fault in sample if fault.key not in reasons]
    every = sorted({test for fault in chosen for test in room_tests(fault.path)})
    for test, found in done(noticed, [(test, (None, [test])) for test in every], given.workers):
        if found:
            print(f"{test} fails without any fault")
            return 1
    killed = 0
    tasks = [(number, (fault, room_tests(fault.path))) for number, fault in enumerate(chosen)]
    for number, found in done(noticed, tasks, given.workers):
        killed += found
        if not found:
            print("not noticed:", chosen[number].key, flush=True)
    print(f"{len(sample) - len(chosen)} drawn faults change nothing")
    made = {"mutants": Figure("faults in the physics that the tests notice", killed, of=len(chosen))}
    report(made, f"mutants --sample {given.sample} --seed {given.seed}", given.record)
    return 0 if 100 * killed >= given.least * len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
