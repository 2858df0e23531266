"""Captive, calibrated, hybrid and black boxes on the five development hold-outs: the tables of ``mmg compare``.

Run from the repository root: python -m benchmarks.compare [FOLDER], FOLDER being what ``mmg compare --out`` wrote;
without it the comparison is made first (half an hour on two cores).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benchmarks.record import record
from fitting.report.run_folder import read_result
from mmg_ident.commands.main import main as mmg

ARGUMENTS = ["compare", "--seeds", "5", "--fractions", "0.1,0.3,1", "--no-random", "--workers", "2"]


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "compare"
        if len(sys.argv) < 2 and mmg([*ARGUMENTS, "--out", str(folder)]):
            raise SystemExit("the comparison was not finished")
        command = read_result(folder)["command"].split(" --out ")[0]
        lines = (folder / "tables.md").read_text(encoding="utf-8").rstrip().splitlines()
        record("Captive, calibrated, hybrid and black boxes", command, lines)


if __name__ == "__main__":
    main()
