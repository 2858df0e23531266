"""The runs in pieces, and the table of all of them."""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import benchmarks.fuzz
from benchmarks.fuzz.damage import numbered
from benchmarks.fuzz.readers import Reader, log_readers, readers
from benchmarks.record import Figure, parser_of, report
from benchmarks.record import table as markdown
from mmg.errors import LONGEST, UserError

SLOW = 5.0
"""Seconds of processor after which a reader counts as hung."""


@contextmanager
def strict_warnings() -> Iterator[None]:
    """Within it a RuntimeWarning, such as those of numpy, is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def outcome(reader: Reader, content: bytes) -> tuple[str, float]:
    """ "read", "refused" or what else happened, in words, when ``reader`` meets ``content``; and seconds."""
    began = time.process_time()
    try:
        reader.read(content)
        result = "read"
    except UserError as error:
        words = str(error)
        good = "\n" not in words and 0 < len(words) <= LONGEST
        result = "refused" if good else f"an error of {len(words)} characters in {words.count(chr(10)) + 1} lines"
    except Exception as error:
        result = f"{type(error).__name__}: {' '.join(str(error).split())[:100]}"
    seconds = time.process_time() - began
    return (result if seconds < SLOW else f"took {seconds:.0f} s"), seconds


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
    """Lines of a table of the ``rows``, one of each reader."""
    names = ("reader", "first", "inputs", "read", "refused", "slowest_s", "seconds", "peak_MB")
    unexpected = [str(sum(map(len, row["strange"].values()))) for row in rows]
    cells = [[*(str(row[name]) for name in names), wrong] for row, wrong in zip(rows, unexpected, strict=True)]
    return markdown([*names, "unexpected"], cells)


def main() -> None:
    parser = parser_of("fuzz", benchmarks.fuzz.__doc__)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--reader", nargs="*", help="names, or beginnings of them")
    parser.add_argument("--logs", action="store_true", help="only readers of raw logs")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        found = (log_readers if given.logs else readers)(Path(scratch) / "fuzz")
        numbers = range(given.first, given.first + given.inputs)
        names = [n for n in found if not given.reader or n.startswith(tuple(given.reader))]
        rows = [piece(name, found[name], numbers) for name in names]
    print("\n".join(table(rows)))
    for row in rows:
        for words, some in row["strange"].items():
            print(f"{row['reader']}, --first {some[0]} ({len(some)} such): {words}")
    wrong, words = (sum(len(some) for row in rows for some in row["strange"].values()), f"{len(rows)} readers")
    made = {"fuzz": Figure(f"unexpected answers of {words} to damaged files", wrong, of=len(rows) * given.inputs)}
    report(made, f"fuzz --inputs {given.inputs} --first {given.first}", given.record)


if __name__ == "__main__":
    main()
