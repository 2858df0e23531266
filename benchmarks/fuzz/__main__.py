"""The runs in pieces, and the table of all of them."""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import benchmarks.fuzz
from benchmarks.fuzz.damage import numbered
from benchmarks.fuzz.outcome import outcome, strict_warnings
from benchmarks.fuzz.readers import Reader, readers
from benchmarks.fuzz.reproducers import REPRODUCERS


def piece(name: str, reader: Reader, numbers: Sequence[int]) -> dict[str, Any]:
    """Counts of what happened to the inputs with these ``numbers`` of the ``reader`` called ``name``."""
    counts, longest, strange = {"read": 0, "refused": 0}, 0.0, {}
    began = time.process_time()
    with strict_warnings():
        for number in numbers:
            words, seconds = outcome(reader, numbered(name, number, reader.seeds))
            longest = max(longest, seconds)
            if words in counts:
                counts[words] += 1
            else:
                strange.setdefault(words, []).append(number)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return {
        "reader": name, "first": numbers[0], "inputs": len(numbers), **counts, "strange": strange,
        "slowest_s": round(longest, 3), "seconds": round(time.process_time() - began, 2), "peak_MB": round(peak),
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Lines of a table that adds up the pieces ``rows``, by reader."""
    heads = (
        "reader",
        "numbers",
        "inputs",
        "read",
        "refused",
        "unexpected",
        "slowest [s]",
        "per CPU second",
        "peak [MB]",
    )
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for name in dict.fromkeys(row["reader"] for row in rows):
        own = [row for row in rows if row["reader"] == name]
        inputs, read, refused = (sum(row[key] for row in own) for key in ("inputs", "read", "refused"))
        last = max(row["first"] + row["inputs"] for row in own) - 1
        speed = inputs / max(sum(row["seconds"] for row in own), 0.01)
        span = f"{min(row['first'] for row in own)} to {last}"
        slowest, peak = max(row["slowest_s"] for row in own), max(row["peak_MB"] for row in own)
        cells = (name, span, inputs, read, refused, inputs - read - refused, slowest, f"{speed:.0f}", peak)
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=benchmarks.fuzz.__doc__)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--reader", choices=sorted(REPRODUCERS), nargs="*")
    parser.add_argument("--log", type=Path)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    if given.table:
        print("\n".join(table([json.loads(line) for line in given.table.read_text().splitlines()])))
        return
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        found = readers(Path(scratch) / "fuzz")
        for name in given.reader or found:
            rows.append(piece(name, found[name], range(given.first, given.first + given.inputs)))
            if given.log:
                with given.log.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    print("\n".join(table(rows)))
    for row in rows:
        for words, numbers in row["strange"].items():
            print(f"{row['reader']}, --first {numbers[0]} ({len(numbers)} such): {words}")


if __name__ == "__main__":
    main()
