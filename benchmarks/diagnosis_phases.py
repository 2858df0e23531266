"""Processor seconds of ``mmg diagnose`` by phase, with the filter and the paths in numpy and compiled, in one run.

python -m benchmarks.diagnosis_phases [CASE ...] [--record]

CASE: folders of a blind benchmark (``python -m benchmarks.blind.generator``), default: one case made here of each of
the worlds basin and kvlcc2. Both ways call the same compiled kernels of the ship; what differs is what goes along the
trials. The answers must be the same.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from benchmarks.blind.solve import blind_ship, ship_of
from benchmarks.record import record, table
from cases.io.read import read_trials
from cases.io.site import read_site
from diagnosis.diagnose import DiagnosisOptions, diagnose
from diagnosis.estimation.filtering import forget_code
from diagnosis.result import Diagnosis

PHASES = {
    "consistency": "kinematics of the logs",
    "prepare": "fit without effects",
    "judged_search": "tests, refits, test trials",
    "not_random": "order of the random force",
    "pattern": "pattern of the named effects",
    "where": "where the gap lies",
    "_advice": "next test",
    "_unexplained": "force without a name",
}
"""What ``diagnosis.diagnose`` calls, and its name in the table."""
WORLDS, SEED = ("basin", "kvlcc2"), 7301


def timed(name: str, work: Callable[..., Any], spent: Counter[str]) -> Callable[..., Any]:
    """``work`` whose processor seconds are added to those ``spent`` in the phase ``name``."""

    def run(*arguments: Any, **named: Any) -> Any:
        began = time.process_time()
        try:
            return work(*arguments, **named)
        finally:
            spent[name] += time.process_time() - began

    return run


@contextmanager
def in_numpy() -> Iterator[None]:
    """Filter and paths by the portable functions."""
    nothing = mock.patch("diagnosis.estimation.filtering.load_library", lambda *_: (None, ""))
    forget_code()
    with nothing, mock.patch("diagnosis.estimation.transition_model.path_code", lambda: None):
        yield
    forget_code()


def measured(case: Path) -> tuple[Diagnosis, Counter[str]]:
    """The diagnosis of a case and the processor seconds of its phases."""
    ship = blind_ship(ship_of(case))
    site, train, test = read_site([case], ship), read_trials(case / "train"), read_trials(case / "test")
    spent: Counter[str] = Counter()
    module = sys.modules["diagnosis.diagnose"]
    with ExitStack() as stack:
        for name in PHASES:
            stack.enter_context(mock.patch.object(module, name, timed(name, getattr(module, name), spent)))
        began = time.process_time()
        found = diagnose(ship, train, test, site, DiagnosisOptions(learn=False))
        spent["all"] = time.process_time() - began
    return found, spent


def rows_of(case: Path) -> list[list[str]]:
    """The rows of a case; raises AssertionError where the two ways do not give the same answer."""
    diagnose_once, _ = measured(case)  # compiles, reads, imports
    with in_numpy():
        slow, before = measured(case)
    fast, after = measured(case)
    assert [e.name for e in slow.effects] == [e.name for e in fast.effects] == [e.name for e in diagnose_once.effects]
    assert abs(slow.final.nll - fast.final.nll) < 1e-6 * abs(slow.final.nll)
    label = f"{case.parent.name}/{case.name}"
    rest = {w: x["all"] - sum(x[name] for name in PHASES) for w, x in (("before", before), ("after", after))}
    rows = [
        [label, words, f"{before[name]:.2f}", f"{after[name]:.2f}", f"{before[name] / max(after[name], 1e-9):.1f}"]
        for name, words in PHASES.items()
        if before[name] > 0.005
    ]
    rows.append([label, "rest", f"{rest['before']:.2f}", f"{rest['after']:.2f}", ""])
    return [*rows, [label, "all", f"{before['all']:.2f}", f"{after['all']:.2f}", f"{before['all'] / after['all']:.1f}"]]


def main() -> None:
    """Measure, print and perhaps record."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis_phases", description=__doc__)
    parser.add_argument("cases", nargs="*", type=Path)
    parser.add_argument("--record", action="store_true", help="put the table into RESULTS.md")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cases = given.cases
        for world in () if cases else WORLDS:
            options = ["--cases", "1", "--seed", str(SEED), "--kind", "mix", "--set", "mixed", "--world", world]
            made = Path(folder) / world
            subprocess.run([sys.executable, "-m", "benchmarks.blind.generator", str(made), *options], check=True)
            cases = [*cases, made / "case_0000"]
        rows = [row for case in cases for row in rows_of(case)]
    lines = table(["case", "phase", "in numpy, s", "compiled, s", "ratio"], rows)
    words = "Processor seconds of one diagnosis of seven runs with test trials, everything compiled and read before."
    if given.record:
        record("Diagnosis by phase", "python -m benchmarks.diagnosis_phases", [words, "", *lines])
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
