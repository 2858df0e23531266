"""Writes RESULTS.md and the table of figures in README.md from the record: python -m benchmarks.pages [--check].

--check: writes nothing, and ends with 1 where a page differs from the record, or where a figure of the README was
measured with another minor version of the package.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mmg_ident
from benchmarks.record import kept, shown, table
from benchmarks.toml import tables

ROOT = Path(__file__).parents[1]
README, RESULTS = ROOT / "README.md", ROOT / "benchmarks" / "RESULTS.md"
BEGIN, END = "<!-- figures:begin -->", "<!-- figures:end -->"
HEAD = """# Measured figures

Written by `python -m benchmarks.pages` from `record.json`: do not edit. A benchmark with `--record` puts its figures
there. A commit with + had changes that were not committed.
"""
ROWS: dict[str, str] = tables(Path(__file__).with_suffix(".toml"))
"""What, and the figures by their anchors in the record."""


def anchors(template: str) -> list[str]:
    """Anchors that a ``template`` names."""
    return re.findall(r"\{(\w+)\}", template)


def readme_table(record: Mapping[str, Mapping[str, Any]]) -> str:
    """The lines between the markers of README.md. A row whose figures are missing is left out."""
    rows = []
    for words, template in ROWS.items():
        names = anchors(template)
        if any(name not in record for name in names):
            continue
        links = {name: f"[{shown(record[name])}](benchmarks/RESULTS.md#{name})" for name in names}
        sources = dict.fromkeys(f"{record[name]['date']}, {record[name]['commit']}" for name in names)
        rows.append([words, template.format(**links), "; ".join(sources)])
    return "\n".join(table(["what", "measured", "when, at which commit"], rows))


def results(record: Mapping[str, Mapping[str, Any]]) -> str:
    """The text of RESULTS.md."""
    machines = list(dict.fromkeys(figure["machine"] for figure in record.values()))
    rows = [
        [f'<a id="{name}"></a>{f["what"]}', shown(f), f"`{f['command'].removeprefix('python -m benchmarks.')}`",
         f["date"], f["commit"], str(1 + machines.index(f["machine"])), f.get("note", "")]
        for name, f in sorted(record.items(), key=lambda pair: (pair[1]["command"], pair[0]))
    ]  # fmt: skip
    head = ["figure", "value", "python -m benchmarks. ...", "date", "commit", "machine", "note"]
    listed = [f"{k}. {words}" for k, words in enumerate(machines, 1)]
    return "\n".join([HEAD, *table(head, rows), "", "Machines:", "", *listed, ""])


def pages(record: Mapping[str, Mapping[str, Any]]) -> dict[Path, str]:
    """README.md and RESULTS.md as the ``record`` makes them."""
    text = README.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return {README: f"{before}{BEGIN}\n{readme_table(record)}\n{END}{after}", RESULTS: results(record)}


def old(record: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Figures of the README that were measured with another minor version of the package."""
    minor = mmg_ident.__version__.split(".")[:2]
    names = [name for _, template in ROWS.items() for name in anchors(template) if name in record]
    return [name for name in names if record[name]["version"].split(".")[:2] != minor]


def main() -> int:
    """Write the pages, or say what differs."""
    record = kept()
    wrong = [f"{name}: measured with version {record[name]['version']}" for name in old(record)]
    for path, text in pages(record).items():
        if "--check" not in sys.argv:
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            wrong.append(f"{path.name} is not what the record makes: python -m benchmarks.pages")
    print("\n".join(wrong or ["the pages are those of the record"]))
    return 1 if wrong and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
