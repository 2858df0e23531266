"""Blind benchmark of ``mmg diagnose``: cases whose key is sealed, answers, and only then the score.

Run from the repository root: python -m benchmarks.blind [--cases 100] [--seed 1] [--workers 2] [--scheduler ADDRESS]
[--kinds mix,pair,misfit] [--sets mixed] [--world pond] [--out runs/blind_1] [--record].
Begun again with the same arguments it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.blind.generator.deal import KINDS
from benchmarks.blind.generator.world import WORLDS
from benchmarks.blind.rows import Refused, Row, rows_of
from benchmarks.blind.score import figures, scored
from benchmarks.blind.solve import cases_of, solve
from benchmarks.record import keep
from fitting.parallel.dask_cluster import dask_cluster
from mmg.errors import UserError

ROOT = Path(__file__).parents[2]


def main(arguments: list[str] | None = None) -> int:
    """Generates, solves, scores; 2 on bad input or a key that was changed."""
    given = _parsed(arguments)
    name = "_".join([f"blind_{given.seed}", *([given.world] if given.world != "pond" else [])])
    out = given.out or Path("runs") / name
    parts = [(kind, chosen) for chosen in given.sets.split(",") for kind in given.kinds.split(",")]
    try:
        with dask_cluster(given.scheduler) if given.scheduler else nullcontext():
            rows, lines = _answered(out, parts, given)
    except (Refused, UserError) as error:
        print(error, file=sys.stderr)
        return 2
    (out / "score.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    words = list(sys.argv[1:] if arguments is None else arguments)
    for option in ("--out", "--scheduler"):  # a path of this machine, an address
        if option in words:
            del words[words.index(option) : words.index(option) + 2]
    if given.record:
        keep(figures(rows, given.world), shlex.join(["python", "-m", "benchmarks.blind", *words]))
    return 0


def _answered(out: Path, parts: list[tuple[str, str]], given: argparse.Namespace) -> tuple[list[Row], list[str]]:
    """Generates and solves the cases of all ``parts``; returns them, and the lines of the score."""
    digests = {part: sealed(out, *part, given.cases, given.seed, given.world) for part in parts}
    answers = {part: solve(_cases(out, *part), _answers(out, *part), given.workers, _say) for part in parts}
    every: list[Row] = []
    lines = []
    for chosen in given.sets.split(","):
        rows = []
        for part in (part for part in parts if part[1] == chosen):
            here = rows_of(_cases(out, *part), digests[part], answers[part])
            rows += [replace(row, case=f"{part[0]}/{row.case}") for row in here]
        hashes = ", ".join(f"{kind} {digests[kind, chosen][:16]}..." for kind in given.kinds.split(","))
        lines += [f"Manoeuvres: {chosen}. Keys (SHA-256): {hashes}.", "", *scored(rows), ""]
        every += rows
    return every, lines


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description="Blind benchmark of mmg diagnose.")
    parser.add_argument("--cases", type=int, default=100, help="cases of each kind and set")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--scheduler", help="Dask scheduler whose workers solve the cases, as tcp://host:8786")
    parser.add_argument("--kinds", default="mix", help="comma-separated: " + ", ".join(KINDS))
    parser.add_argument("--sets", default="mixed", help="comma-separated: mixed, zigzag, turn, random, berthing")
    parser.add_argument("--world", default="pond", help="ship, noise and numerics: " + ", ".join(WORLDS))
    parser.add_argument("--out", type=Path, help="folder (default: runs/blind_SEED, with the world)")
    parser.add_argument("--record", action="store_true", help="keep the figures in record.json")
    return parser.parse_args(arguments)


def _cases(out: Path, kind: str, chosen: str) -> Path:
    return out / "cases" / f"{kind}_{chosen}"


def _answers(out: Path, kind: str, chosen: str) -> Path:
    return out / "answers" / f"{kind}_{chosen}"


def _say(words: str) -> None:
    print(words, flush=True)


def sealed(out: Path, kind: str, chosen: str, count: int, seed: int, world: str = "pond") -> str:
    """Generates a benchmark in a process of its own, unless it is there; prints and returns the hash of its key.

    The hash is kept in ``made.json``: what is scored later is what was generated now.
    """
    folder, notes = _cases(out, kind, chosen), out / "made.json"
    made: dict[str, Any] = json.loads(notes.read_text(encoding="utf-8")) if notes.is_file() else {}
    known, asked = made.get(folder.name), {"cases": count, "seed": seed, "world": world}
    if known is not None and {k: known[k] for k in asked} != asked:
        raise Refused(f"{folder} holds {known['cases']} cases of seed {known['seed']}; choose another --out")
    if known is None:
        options = ["--cases", str(count), "--seed", str(seed), "--kind", kind, "--set", chosen]
        options += ["--world", world]
        command = [sys.executable, "-m", "benchmarks.blind.generator", str(folder.resolve()), *options]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode:
            raise Refused((done.stderr.strip().splitlines() or ["the generator failed"])[-1])
        known = asked | {"sha256": (folder / "key.sha256").read_text(encoding="utf-8").split()[0]}
        notes.write_text(json.dumps(made | {folder.name: known}, indent=1) + "\n", encoding="utf-8")
    _say(f"{folder.name}: {len(cases_of(folder))} cases, SHA-256 of the key {known['sha256']}")
    return str(known["sha256"])


if __name__ == "__main__":
    sys.exit(main())
