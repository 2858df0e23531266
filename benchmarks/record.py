"""The record of the benchmarks, record.json: each figure with its command, date, commit and machine.

A benchmark that is given ``--record`` hands its figures to ``keep``; ``python -m benchmarks.pages`` writes RESULTS.md
and the table of README.md from the record.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
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
