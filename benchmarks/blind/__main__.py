"""Blind benchmark of ``mmg diagnose``: cases whose key is sealed, answers, and only then the score.

Run from the repository root: python -m benchmarks.blind [--cases 100] [--seed 1] [--workers 2]
[--kinds null,pair] [--world pond] [--out runs/blind] [--record].
Begun again with the same arguments it goes on where it stopped.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from benchmarks.blind.cases import Pair, answered, dealt, figures, folders, opened, scored
from benchmarks.blind.generator.cases import KINDS
from benchmarks.blind.generator.foreign import STRANGERS
from benchmarks.blind.generator.world import WORLDS
from benchmarks.record import Record, code_version, keep, parser_of
from mmg.errors import UserError


def main(arguments: list[str] | None = None) -> int:
    """Generates, solves, scores; 2 on bad input or a key that was changed."""
    parser = parser_of("blind", "Blind benchmark of mmg diagnose.")
    parser.epilog = "strangers:\n" + "\n".join(f"  {e.name}: {(e.__doc__ or '').splitlines()[0]}" for e in STRANGERS)
    parser.add_argument("--cases", type=int, default=100, help="cases of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kinds", default=",".join(KINDS), help="comma-separated: " + ", ".join(KINDS))
    parser.add_argument("--world", default="pond", choices=tuple(WORLDS), help="ship, noise and numerics")
    parser.add_argument("--out", type=Path, default=Path("runs") / "blind", help="folder")
    given = parser.parse_args(arguments)
    try:
        pairs = _answered(given)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    lines = scored(pairs, given.world)
    (given.out / "score.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "--out" in words:  # a path of this machine
        del words[words.index("--out") : words.index("--out") + 2]
    if given.record:
        keep(figures(pairs, given.world), shlex.join(["python", "-m", "benchmarks.blind", *words]))
    return 0


def _answered(given: argparse.Namespace) -> list[Pair]:
    """All cases with their answers; the hashes of the keys are printed before any case is answered."""
    record, keys = Record(given.out / "answers.jsonl"), {}
    for kind in given.kinds.split(","):
        folder = given.out / f"{given.world}_{kind}_{given.seed}_{given.cases}"
        keys[folder] = dealt(folder, given.world, kind, given.cases, given.seed)
        print(f"{folder.name}: SHA-256 of the key {keys[folder]}", flush=True)
    tasks = [({"key": key, "case": case.name}, (case,)) for folder, key in keys.items() for case in folders(folder)]
    record.measure(answered, tasks, given.workers)
    return [
        (case, record.of(code=code_version(), key=key, case=case.folder.name)[0])
        for folder, key in keys.items()
        for case in opened(folder, key)
    ]


if __name__ == "__main__":
    sys.exit(main())
