"""Command line: python -m benchmarks.blind.generator OUT --cases 100 --seed 1 [--kind mix] [--set mixed]."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks.blind.generator.controls import SETS, TWIN
from benchmarks.blind.generator.deal import KINDS
from benchmarks.blind.generator.strangers import STRANGERS
from benchmarks.blind.generator.world import WORLDS
from benchmarks.blind.generator.write import generate


def main(arguments: list[str] | None = None) -> int:
    """Writes a benchmark and prints the hash of its key; 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind.generator",
        description="Blind gap cases.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="strangers:\n" + "\n".join(f"  {e.name}: {(e.__doc__ or '').splitlines()[0]}" for e in STRANGERS),
    )
    parser.add_argument("out", type=Path, help="new folder")
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, default="mix")
    parser.add_argument("--set", choices=tuple(k for k in SETS if k != TWIN), default="mixed", dest="chosen")
    parser.add_argument("--world", choices=tuple(WORLDS), default="pond")
    given = parser.parse_args(arguments)
    began = time.perf_counter()
    if given.cases < 1:
        parser.error("--cases must be at least 1")
    try:
        digest = generate(given.out, given.cases, given.seed, given.kind, given.chosen, WORLDS[given.world])
    except FileExistsError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{given.cases} cases in {given.out}, {time.perf_counter() - began:.0f} s; SHA-256 of key.json: {digest}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
