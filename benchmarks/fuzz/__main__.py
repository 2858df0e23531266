"""Every reader meets so many damaged inputs; what is neither read nor refused is printed and counted."""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import benchmarks.fuzz
from benchmarks.fuzz.damage import numbered
from benchmarks.fuzz.readers import Reader, readers
from benchmarks.record import Figure, parser_of, report
from mmg.errors import LONGEST, UserError

SLOW = 5.0
"""Seconds of processor after which a reader counts as hung."""


@contextmanager
def strict_warnings() -> Iterator[None]:
    """Within it a RuntimeWarning, such as those of numpy, is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def outcome(reader: Reader, content: bytes) -> str:
    """ "read", "refused" or what else happened, in words, when ``reader`` meets ``content``."""
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
    return result if seconds < SLOW else f"took {seconds:.0f} s"


def strange(name: str, reader: Reader, numbers: Iterable[int]) -> dict[str, list[int]]:
    """What the ``reader`` called ``name`` made of the inputs with these ``numbers``, unless it was read or refused."""
    found: dict[str, list[int]] = {}
    with strict_warnings():
        for number in numbers:
            if (words := outcome(reader, numbered(name, number, reader.seeds))) not in ("read", "refused"):
                found.setdefault(words, []).append(number)
    return found


def main() -> None:
    parser = parser_of("fuzz", benchmarks.fuzz.__doc__)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--reader", nargs="*", default=[""], help="names, or beginnings of them")
    given = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        found = readers(Path(scratch) / "fuzz")
        names = [name for name in found if name.startswith(tuple(given.reader))]
        for name in names:
            for words, some in strange(name, found[name], range(given.first, given.first + given.inputs)).items():
                print(f"{name}, --first {some[0]} ({len(some)} such): {words}", flush=True)
                wrong += len(some)
    what = f"unexpected answers of {len(names)} readers to damaged files"
    made = {"fuzz": Figure(what, wrong, of=len(names) * given.inputs)}
    report(made, f"fuzz --inputs {given.inputs} --first {given.first}", given.record)


if __name__ == "__main__":
    main()
