"""The record of the benchmarks, record.json: each figure with its command, date, commit and machine.

A benchmark that is given ``--record`` hands its figures to ``keep``; ``python -m benchmarks.pages`` writes RESULTS.md
and the table of README.md from the record. What takes hours is measured line by line into a ``Record`` of its own.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import platform
import re
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import mmg_ident

RECORD = Path(__file__).with_name("record.json")


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    what: in words; value; unit: "" for a plain number, "%" for a share that is given as one of 1; error: standard error
    in the same unit; of: for a count, out of how many; note: what else is to be known.
    """

    what: str
    value: float
    unit: str = ""
    error: float | None = None
    of: int | None = None
    note: str = ""


def row_of(figure: Figure) -> dict[str, Any]:
    """The row of a ``figure`` in the record, without what it does not say."""
    return {key: value for key, value in asdict(figure).items() if value not in ("", None)}


def parser_of(name: str, doc: str | None) -> argparse.ArgumentParser:
    """The parser of the command line of the benchmark ``name``, which its docstring ``doc`` describes."""
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{name}", description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--record", action="store_true", help="keep the figures in record.json")
    return parser


def keep(figures: Mapping[str, Figure], command: str) -> None:
    """Put ``figures``, by their anchor, into the record as measured now by ``command`` with the code that is checked
    out."""
    made = {"command": command, "date": date.today().isoformat(), "commit": commit(), "machine": machine(),
            "version": mmg_ident.__version__}  # fmt: skip
    known = kept() | {name: row_of(figure) | made for name, figure in figures.items()}
    rows = {name: known[name] for name in sorted(known)}
    RECORD.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def shown(figure: Mapping[str, Any]) -> str:
    """The value of a ``figure`` of the record, with its error and unit, as a reader wants it."""
    value, unit, error = figure["value"], figure.get("unit", ""), figure.get("error")
    if "of" in figure:
        return f"{value:g} of {figure['of']}"
    if unit == "%":
        return f"{100 * value:.3g}" + (f" ± {100 * error:.2g}" if error is not None else "") + " %"
    if error is not None:
        return f"{value:.4f} ± {error:.4f} {unit}".rstrip()
    return f"{value:.3g} {unit}".rstrip() if value < 1000 else f"{value:,.0f} {unit}".rstrip()


def report(figures: Mapping[str, Figure], words: str, record: bool) -> None:
    """Print ``figures`` and, where asked, ``keep`` them; words: benchmark and options that measured them."""
    for one in figures.values():
        print(f"{one.what}: {shown(row_of(one))} {one.note}".rstrip(), flush=True)
    if record:
        keep(figures, f"python -m benchmarks.{words}")


def kept() -> dict[str, dict[str, Any]]:
    """All figures of the record, by their anchor."""
    return dict(json.loads(RECORD.read_text(encoding="utf-8"))) if RECORD.exists() else {}


def commit() -> str:
    """Short name of the commit that is checked out, with "+" where files differ from it; "" without git."""
    here = RECORD.parent
    try:
        head, changed = (
            subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=True).stdout.strip()
            for words in (["rev-parse", "--short=7", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return head + "+" * bool(changed)


def machine() -> str:
    """Processor, number of cores and version of Python in words."""
    model = platform.processor() or platform.machine()
    try:
        line = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
        model = line.group(1) if line else model
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a markdown table."""
    return [f"| {' | '.join(row)} |" for row in (header, ["---"] * len(header), *rows)]


# What is measured line by line, by the state of the code that it was measured with
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
