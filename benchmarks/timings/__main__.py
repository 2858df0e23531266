"""All timings of the tool in one table: beside what they must be, and what they were before on the same machine.

Run from the repository root, with the records in place: python -m benchmarks.timings [ROW ...] [--quick] [--record]
Rows (default all, about half an hour; --list names them): fit, fit_plus, cold, no_compiler, scipy, bootstrap,
diagnose, blind, predict, predict_run, check, help, rhs, turnings. --quick measures each once instead of the median of
three. Rows that are not measured keep their last figure. With --record the table goes to RESULTS.md, and the figures to
timings.json beside it, which is what the next one is compared with; without it nothing is kept.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.record import machine, record, table
from benchmarks.timings import work
from benchmarks.timings.work import Bench, Timed

KEPT = Path(__file__).parents[1] / "timings.json"
SLOWER = 1.1
"""Times what it was before, from which a row is said to be slower."""


@dataclass(frozen=True)
class Row:
    """One row: its words, what measures it, its unit, what it must be and then be; more: larger is better."""

    words: str
    measure: Callable[[Bench], Timed]
    unit: str
    must: float
    then: float | None = None
    more: bool = False


ROWS = {
    "fit": Row("`mmg fit` Train-TZRB, whole command", work.fit, "s", 6, 4),
    "fit_plus": Row("`mmg fit` Train-TZRB+, whole command", work.fit_plus, "s", 18, 12),
    "cold": Row("cold code cache, with compiler: more than warm", work.cold, "s", 6),
    "no_compiler": Row("no compiler, whole command", work.no_compiler, "s", 20),
    "scipy": Row("same objective: times faster than scipy least_squares", work.scipy_ratio, "x", 100, more=True),
    "bootstrap": Row("bootstrap of 100 fits, Train-TZRB", work.bootstrap, "s", 40),
    "diagnose": Row("`mmg diagnose`, eight real records with test", work.diagnose, "s", 30, 20),
    "blind": Row("one blind case of 7 runs, one core", work.blind, "s", 4),
    "predict": Row("`mmg predict` of one file, library ship", work.predict, "s", 0.6),
    "predict_run": Row("`mmg predict` of one file, run folder", work.predict_run, "s", 0.6),
    "check": Row("`mmg check` of eight records", work.check, "s", 2),
    "help": Row("`mmg --help`", work.start_up, "s", 0.15),
    "rhs": Row("right-hand side, batch", work.right_hand_side, "ns", 25),
    "turnings": Row("10,000 turnings, 2 threads", work.turnings, "s", 0.2),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and record where that is asked for."""
    given = _parsed(arguments)
    if given.list:
        print("\n".join(f"{name}: {row.words}" for name, row in ROWS.items()))
        return 0
    chosen = given.rows or list(ROWS)
    if unknown := [name for name in chosen if name not in ROWS]:
        print(f"no such row: {', '.join(unknown)}; known are {', '.join(ROWS)}", file=sys.stderr)
        return 2
    tables = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    before = tables.get(machine(), {})
    measured: dict[str, Timed] = {}
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(Path(scratch), 1 if given.quick else 3, Path(scratch) / "cache", known=measured)
        for name in [name for name in ROWS if name in chosen]:
            try:
                measured[name] = ROWS[name].measure(bench)
            except RuntimeError as error:
                print(f"{name}: {error}", file=sys.stderr, flush=True)
                continue
            print(f"{name}: {shown(measured[name].value, ROWS[name].unit)}  {measured[name].note}", flush=True)
    now = {name: _kept(timed) for name, timed in measured.items()}
    lines = report(now, before)
    lines += _phases({name: measured[name].phases for name in measured if measured[name].phases})
    if given.record:
        words = " ".join(["python -m benchmarks.timings", *given.rows, *(["--quick"] if given.quick else [])])
        record("Timings", words, lines)
        tables[machine()] = {**before, **now}
        KEPT.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")
    else:
        print("\n".join(lines))
    return 0 if len(measured) == len(chosen) else 1


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.timings", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--quick", action="store_true", help="each row once")
    parser.add_argument("--record", action="store_true", help="keep the table and the figures")
    parser.add_argument("--list", action="store_true", help="name the rows")
    return parser.parse_args(arguments)


def _kept(timed: Timed) -> dict[str, Any]:
    """What is kept of a row for the next table."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"value": timed.value, "processor": timed.processor, "runs": timed.runs, "note": timed.note,
            "date": date.today().isoformat(), "load": load}  # fmt: skip


def shown(value: float, unit: str) -> str:
    """A figure with its ``unit``, to three digits."""
    return f"{value:.3g} {unit}" if value < 1000 else f"{value:.0f} {unit}"


def report(now: Mapping[str, Mapping[str, Any]], before: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The table of all rows that are known, and what became slower. now, before: rows as they are kept, by name."""
    rows, slower = [], []
    for name, row in ROWS.items():
        found = now.get(name) or before.get(name)
        if found is None:
            continue
        earlier = before.get(name) if name in now else None
        ratio = found["value"] / earlier["value"] if earlier and earlier["value"] > 0 and found["value"] > 0 else None
        reached = found["value"] >= row.must if row.more else found["value"] <= row.must
        limits = shown(row.must, row.unit) + ("" if row.then is None else f", then {shown(row.then, row.unit)}")
        processor = "" if found["processor"] is None else f"{found['processor']:.3g} s"
        past = f"{shown(earlier['value'], row.unit)} ({earlier['date']})" if earlier else "-"
        rows.append(
            [row.words, shown(found["value"], row.unit) + ("" if name in now else f" ({found['date']})"), processor,
             past, "-" if ratio is None else f"{ratio:.2f}", limits, "yes" if reached else "no", found["note"]]
        )  # fmt: skip
        if ratio is not None and earlier and (1 / ratio if row.more else ratio) > SLOWER:
            slower.append(f"{row.words} ({shown(earlier['value'], row.unit)} -> {shown(found['value'], row.unit)})")
    header = ["work", "now", "processor", "before", "now / before", "must", "reached", "note"]
    said = f"Slower than before: {'; '.join(slower)}." if slower else "Nothing became slower than before."
    return [*table(header, rows), "", said if any(name in before for name in now) else "First table of this machine."]


def _phases(found: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The share of each phase of the fits in ``found``: row -> phase -> seconds."""
    names = sorted(
        {p for phases in found.values() for p in phases}, key=lambda p: -max(f.get(p, 0) for f in found.values())
    )
    if not names:
        return []
    rows = []
    for name in names:
        cells = []
        for phases in found.values():
            seconds, whole = phases.get(name, 0.0), sum(phases.values())
            cells.append(f"{seconds:.2f} s, {seconds / whole:.0%}")
        rows.append([name.replace("_", " "), *cells])
    return ["", "Share of each phase of a fit, by the clock:", "", *table(["phase", *found], rows)]


if __name__ == "__main__":
    sys.exit(main())
