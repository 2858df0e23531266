"""Command line: python -m benchmarks.ablation [fits] [diagnoses] [table] [--rows NAME ...] [--work FOLDER].

The table, ``benchmarks/ablation.md``, is of ``benchmarks/ablation.json``, which holds every row that was ever measured:
one whose switch is gone stays as it was, with the commit that it was measured at.
"""

from __future__ import annotations

import argparse
import datetime
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ablation import diagnoses, fits
from benchmarks.ablation.diagnoses import RARE, RULES
from benchmarks.ablation.fits import METRICS, SWITCHES, change
from benchmarks.ablation.switches import Switch
from benchmarks.blind.cases import Answer, is_right, is_wrong
from benchmarks.record import ROOT, Record, Task, table

KEPT = ROOT / "benchmarks" / "ablation.json"
PAGE = KEPT.with_suffix(".md")
GROUNDS = {"records": METRICS, "gunnerus": METRICS[:2], "pond": METRICS[:2], "kvlcc2": METRICS[:2]}
"""Grounds and the metrics of each that the page shows."""
CLEAR = 2.0
"""Standard errors from which a change counts."""
FIRST = "as it is"
REPLAYED = "(replayed from the evidence of five lines)"
"""What a row says whose answers follow from recorded evidence, without a switch."""
ANSWERS = {"two numbers", "five lines"}
"""Rows that are no switch: an answer from the evidence alone, and the verdict that replaced the rules above it."""
HEAD = """# What each mechanism is worth

Written {date} by `python -m benchmarks.ablation table` from `ablation.json`. Each row was measured at the commit it
names, against the product as it was then. *Gone*: the mechanism was deleted. **Bold**: more than two standard errors.

## Calibration

Change of the error of runs left out when the mechanism is switched off or another taken [%], with its jackknife error:
minus is better without it. Windows of 30 s and restarts every 100 s, without and with 30 s of past. Records: 35 of
Train-TZRB+ in five folds; Gunnerus: seven runs; pond, kvlcc2: twelve cases of `benchmarks/blind`. First row: errors.
Thirty fits are a whole row."""
MIDDLE = """## Diagnosis

Answers to open cases of all worlds of `benchmarks/blind`. Right: of effects of the library the first name, of strangers
that something without a name is there, of nothing hidden that nothing is missing. Wrong names: with nothing left over.
Change of right answers [%], with its paired error; worlds in which it is 1 % or more."""

WORK = Path(tempfile.gettempdir()) / "mmg_ablation"
grounds = cache(fits.grounds)
cases = cache(diagnoses.cases)


def fit_task(work: Path, name: str, number: int) -> dict[str, Any]:
    """What is measured of the switch ``name`` on the fold ``number``."""
    return fits.measured(next(s for s in fits.SWITCHES if s.name == name), grounds(work)[number])


def diagnosis_task(work: Path, number: int) -> dict[str, Any]:
    """The answers to the case ``number``, of some also those without rules that change all fits."""
    rare = () if number % diagnoses.SOME else diagnoses.RARE
    return diagnoses.answers(cases(work)[number], diagnoses.RULES + rare)


def write_table(fits: Record, diagnoses: Record) -> None:
    """Bring what was measured into the kept rows, and write the page."""
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {"fits": {}, "diagnoses": {}}
    kept["fits"] |= {s.name: row for s in SWITCHES if (row := fit_row(fits, s))}
    kept["diagnoses"] |= diagnosis_rows(diagnoses)
    sections = [f'"{part}": {{\n{_rows(rows)}\n}}' for part, rows in kept.items()]  # a line a row
    KEPT.write_text("{\n" + ",\n".join(sections) + "\n}\n", encoding="utf-8")
    PAGE.write_text(page(kept, datetime.date.today().isoformat()), encoding="utf-8")


def _rows(rows: Mapping[str, Any]) -> str:
    return ",\n".join(f"{json.dumps(name)}: {json.dumps(row, ensure_ascii=False)}" for name, row in rows.items())


def fit_row(record: Record, switch: Switch) -> dict[str, Any] | None:
    """What the ``record`` holds of a ``switch`` against the first, of the code that measured it last; None: nothing."""
    rows = record.of(row=switch.name)
    if not rows:
        return None
    code = rows[-1]["code"]
    found: dict[str, Any] = {"off": switch.off, "commit": rows[-1]["commit"], "grounds": {}}
    for ground in GROUNDS:
        after = {r["fold"]: r for r in record.of(row=switch.name, code=code, ground=ground)}
        before = {r["fold"]: r for r in record.of(row=FIRST, code=code, ground=ground) if r["fold"] in after}
        after = {fold: r for fold, r in after.items() if fold in before}
        if not after:
            continue
        pair = [_by_cluster(some, ground) for some in (before, after)]
        spent = [[r["processor"] for r in some.values() if r["processor"]] for some in (before, after)]
        found["grounds"][ground] = {
            "fits": len(after),
            "changes": {name: _rounded(change(*pair, i)) for i, name in enumerate(METRICS)},
            "processor": round(float(np.mean(spent[1])), 1) if spent[1] else None,
        }
    return found


def _by_cluster(rows: Mapping[str, Mapping[str, Any]], ground: str) -> dict[str, Any]:
    """Errors by cluster and file: of a generator a cluster is a case, else a file."""
    if ground in ("records", "gunnerus"):
        return {name: {name: v} for row in rows.values() for name, v in row["files"].items()}
    return {fold: row["files"] for fold, row in rows.items()}


def _rounded(values: Sequence[float]) -> list[float | None]:
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in values]


def diagnosis_rows(record: Record) -> dict[str, Any]:
    """What the ``record`` holds of each rule, of the code that answered last."""
    if not record.rows:
        return {}
    rows = record.of(code=record.rows[-1]["code"])
    of: dict[str, tuple[str, Callable[[Mapping[str, Any]], Answer | None]]] = {
        FIRST: ("nothing", lambda row: row["answer"]),
    }
    for rule in (*RULES[1:], *RARE):
        of[rule.name] = rule.off, lambda row, name=rule.name: row["without"].get(name)  # type: ignore[misc]
    found = {}
    for name, (off, answer) in of.items():
        pairs = [(row, other) for row in rows if (other := answer(row)) is not None]
        if pairs:
            found[name] = {"off": off, "commit": rows[-1]["commit"], **_measures(pairs)}
    answers = {" ".join(row[k] for k in ("world", "kind", "case")): row["answer"] for row in rows}
    return found if not found else found | {FIRST: found[FIRST] | {"answers": answers}}


def _measures(pairs: Sequence[tuple[Mapping[str, Any], Answer]]) -> dict[str, Any]:
    """Rates of the answers, and how they differ from those as it is; pairs: rows of the record and an answer."""
    library = [p for p in pairs if p[0]["kind"] == "library"]
    parts = {s: [p for p in library if p[0]["strength"] == s] for s in ("weak", "medium", "strong")}
    parts |= {kind: [p for p in pairs if p[0]["kind"] == kind] for kind in ("strangers", "null")}

    def right(row: Mapping[str, Any], answer: Answer) -> bool:
        return is_right(row["kind"], row["truth"], answer)

    moves = [int(right(row, a)) - int(right(row, row["answer"])) for row, a in pairs]
    worlds: dict[str, list[int]] = {}
    for (row, _), move in zip(pairs, moves, strict=True):
        worlds.setdefault(row["world"], []).append(move)
    n, gained, lost = len(pairs), moves.count(1), moves.count(-1)
    return {
        "cases": n,
        "right": {name: [sum(right(*p) for p in part), len(part)] for name, part in parts.items()},
        "wrong names": sum(is_wrong(row["kind"], row["truth"], a) for row, a in pairs),
        "gained": gained,
        "lost": lost,
        "change": _rounded([(gained - lost) / n, np.sqrt(gained + lost - (gained - lost) ** 2 / n) / n]),
        "worlds": sum(bool(abs(np.mean(some)) >= 0.01) for some in worlds.values()),
        "answers changed": sum(list(row["answer"]) != list(a) for row, a in pairs),
    }


def page(kept: Mapping[str, Any], date: str) -> str:
    """The page of the ``kept`` rows, written at a ``date``."""
    own = {s.name for s in SWITCHES}, {r.name for r in (*RULES, *RARE)} | ANSWERS
    lines = [HEAD.format(date=date), ""]
    head = ["switch", *(f"{g} {m}" for g, metrics in GROUNDS.items() for m in metrics), "fits", "processor", "commit"]
    lines += table(head, [_fit_cells(n, row, n in own[0]) for n, row in kept["fits"].items()])
    lines += ["", MIDDLE, ""]
    head = ["rule switched off", "cases", "weak", "medium", "strong", "strangers", "nothing", "wrong names",
            "gained", "lost", "change", "worlds", "commit"]  # fmt: skip
    lines += table(
        head, [_diagnosis_cells(n, row, n in own[1] or REPLAYED in row["off"]) for n, row in kept["diagnoses"].items()]
    )
    return "\n".join([*lines, ""])


def _percent(value: float | None, error: float | None) -> str:
    if value is None or error is None:
        return ""
    words = f"{100 * value:+.1f} ± {100 * error:.1f}"
    return f"**{words}**" if abs(value) > CLEAR * error and abs(value) >= 5e-4 else words


def _name(name: str, row: Mapping[str, Any], is_there: bool) -> list[str]:
    return [f"{name}: {row['off']}", row["commit"] + ("" if is_there else ", *gone*")]


def _fit_cells(name: str, row: Mapping[str, Any], is_there: bool) -> list[str]:
    words, commit = _name(name, row, is_there)
    cells = [words]
    for ground, metrics in GROUNDS.items():
        here = row["grounds"].get(ground)
        for metric in metrics:
            base, by, error = here["changes"][metric] if here else (None, None, None)
            cells.append((f"{base:.4f}" if base else "") if name == FIRST else _percent(by, error))
    spent = [g["processor"] for g in row["grounds"].values() if g["processor"]]
    fits = sum(ground["fits"] for ground in row["grounds"].values())
    return [*cells, str(fits), f"{np.mean(spent):.0f} s a fit" if spent else "", commit]


def _diagnosis_cells(name: str, row: Mapping[str, Any], is_there: bool) -> list[str]:
    words, commit = _name(name, row, is_there)
    rates = [f"{k}/{n}" for k, n in row["right"].values()]
    moves = [str(row["gained"]), str(row["lost"]), _percent(*row["change"]), str(row["worlds"])]
    return [words, str(row["cases"]), *rates, str(row["wrong names"]), *moves, commit]


def main() -> None:
    """Measure what is asked for, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation", description=__doc__)
    parser.add_argument("what", nargs="*", default=["fits", "diagnoses", "table"], help="default: all")
    parser.add_argument("--rows", nargs="+", default=[], help="switches of the fits to measure; default all")
    parser.add_argument("--cases", type=int, help="most cases to diagnose; default all")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path, default=WORK, help="folder of generated cases and of the record")
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    records = Record(given.work / "fits.jsonl"), Record(given.work / "diagnoses.jsonl")
    if "fits" in given.what:
        tasks: list[Task] = [
            ({"row": switch.name, "ground": fold.ground, "fold": fold.name}, (given.work, switch.name, number))
            for switch in fits.SWITCHES
            if not given.rows or switch.name in given.rows
            for number, fold in enumerate(grounds(given.work))
        ]
        records[0].measure(fit_task, tasks, given.workers)
    if "diagnoses" in given.what:
        chosen = enumerate(cases(given.work)[: given.cases])
        places = [({"world": c.world, "kind": c.kind, "case": c.folder.name}, (given.work, k)) for k, c in chosen]
        records[1].measure(diagnosis_task, places, given.workers)
    if "table" in given.what:
        write_table(*records)


if __name__ == "__main__":
    main()
