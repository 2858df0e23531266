"""What was measured, line by line, by the state of the code that it was measured with."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.record import commit

ROOT = Path(__file__).parents[1]
MADE_BY = ("mmg", "cases", "fitting", "diagnosis")
"""Packages on which the figures depend."""
Task = tuple[dict[str, Any], tuple[Any, ...]]
"""Place in the record, and arguments of what is measured."""


@cache
def code_version() -> str:
    """Twelve hex digits that change with any source file of MADE_BY."""
    digest = hashlib.sha256()
    for package in MADE_BY:
        for path in sorted(p for p in (ROOT / package).rglob("*") if p.suffix in (".py", ".c", ".h")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


class Record:
    """Lines of JSON in a file, each with the code, the commit and the date that made it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.rows: list[dict[str, Any]] = [json.loads(line) for line in lines]

    def of(self, **where: Any) -> list[dict[str, Any]]:
        """The rows with these values."""
        return [row for row in self.rows if all(row.get(k) == v for k, v in where.items())]

    def keep(self, **row: Any) -> None:
        """Add a row, of the present code."""
        made = {"code": code_version(), "commit": f"{commit()} {date.today().isoformat()}", **row}
        self.rows.append(made)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(made) + "\n")

    def measure(self, work: Callable[..., dict[str, Any]], tasks: Sequence[Task], workers: int) -> None:
        """Keep and print what ``work`` makes of each of ``tasks``, on so many processes, but of those that were
        measured with the present code."""
        todo = [(place, given) for place, given in tasks if not self.of(code=code_version(), **place)]
        for place, made in done(work, todo, workers):
            self.keep(**place, **made)
            words = [*place.values(), *made.get("answer", ())[:2], f"{made['processor']:.0f} s of processor"]
            print(", ".join(map(str, words)), flush=True)


def done(
    work: Callable[..., Any], tasks: Sequence[tuple[Any, tuple[Any, ...]]], workers: int
) -> Iterator[tuple[Any, Any]]:
    """The first of each of ``tasks``, with what ``work`` makes of its arguments, on so many processes, as they come."""
    if workers < 2:
        yield from ((place, work(*given)) for place, given in tasks)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        places = {pool.submit(work, *given): place for place, given in tasks}
        yield from ((places[one], one.result()) for one in as_completed(places))
