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
from benchmarks.record import kept, table

ROOT = Path(__file__).parents[1]
README, RESULTS = ROOT / "README.md", ROOT / "benchmarks" / "RESULTS.md"
BEGIN, END = "<!-- figures:begin -->", "<!-- figures:end -->"
HEAD = """# Measured figures

Written by `python -m benchmarks.pages` from `record.json`: do not edit. A benchmark with `--record` puts its figures
there. A commit with + had changes that were not committed.
"""
ROWS = (
    ("`mmg fit` of 8 records (2,530 s), whole command", "{fit_wall}; {fit_processor} of processor"),
    ("`mmg fit` of 35 records (13,460 s)", "{fit_plus_wall}; {fit_plus_processor} of processor"),
    ("the same objective by SciPy `least_squares`", "{scipy_ratio}"),
    ("error of 30 s predictions of runs held out: captive model tests", "{holdout_captive_30}"),
    ("calibrated on 8 records; with the past 30 s of the run known", "{holdout_tzrb_30}; {holdout_tzrb_past_30}"),
    ("calibrated on 30 records; with the past", "{holdout_plus_30}; {holdout_plus_past_30}"),
    ("error of predictions over 100 s: captive; 8 records; 30 records",
     "{holdout_captive_100}; {holdout_tzrb_100}; {holdout_plus_100}"),
    ("cross-validation over 35 records, 30 s; 100 s", "{cv_30}; {cv_100}"),
    ("rows inside the 90 % prediction band, records left out", "{bands_records_30}"),
    ("true coefficients inside their 95 % interval, disturbed trials", "{coverage_disturbed}"),
    ("true manoeuvring figures inside their 90 % interval", "{coverage_figures}"),
    ("diagnosis of blind cases, three generators: a strong effect is named",
     "{blind_library_strong_basin}; {blind_library_strong_kvlcc2}; {blind_library_strong_vectwin}"),
    ("the same: a weak effect", "{blind_library_weak_basin}; {blind_library_weak_kvlcc2}; "
     "{blind_library_weak_vectwin}"),
    ("the same: nothing is there, and \"none\" is the answer",
     "{blind_null_basin}; {blind_null_kvlcc2}; {blind_null_vectwin}"),
    ("the same: a name that is not there", "{blind_wrong_basin}; {blind_wrong_kvlcc2}; {blind_wrong_vectwin}"),
    ("faults planted in trial files and named by `mmg check`", "{files_foreign}; {files_own}"),
    ("commands ended at a random moment: nothing half-written, resumed to the same values", "{kill}"),
    ("faults in the physics that the tests notice", "{mutants}"),
)  # fmt: skip
"""What, and the figures by their anchors in the record."""


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


def anchors(template: str) -> list[str]:
    """Anchors that a ``template`` names."""
    return re.findall(r"\{(\w+)\}", template)


def readme_table(record: Mapping[str, Mapping[str, Any]]) -> str:
    """The lines between the markers of README.md. A row whose figures are missing is left out."""
    rows = []
    for words, template in ROWS:
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
    names = [name for _, template in ROWS for name in anchors(template) if name in record]
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
