"""Wall time and memory of `mmg fit`, cold and warm, on Train-TZRB and Train-TZRB+, and how it grows with the data.

Run from the repository root: python -m benchmarks.fit
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.record import record, table
from cases import published_splits as splits


def run(names: list[str], folder: Path, cache: Path, *options: str) -> dict:
    """One `mmg fit` in a process of its own: wall seconds, peak memory [MB] and its result.json."""
    out = folder / f"run-{time.time_ns()}"
    files = [str(p) for p in splits.find(names)]
    code = (
        "import resource, sys; from mmg_ident.commands.main import main; code = main(sys.argv[1:]); "
        "print(code, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    )
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code, "fit", "esso_osaka_3m", *files, "--out", str(out), *options],
        capture_output=True,
        text=True,
        env={**os.environ, "MMG_CACHE": str(cache)},
    )
    wall = time.perf_counter() - began
    status, memory = done.stdout.split()[-2:]
    if status != "0":
        raise RuntimeError(done.stderr)
    content = json.loads((out / "result.json").read_text())
    return {"wall": wall, "memory": float(memory), **content}


def main() -> None:
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        folder, cache = Path(scratch), Path(scratch) / "cache"
        plan = [
            ("Train-TZRB, cold code cache", splits.TRAIN_TZRB, "60"),
            ("Train-TZRB, warm", splits.TRAIN_TZRB, "15"),
            ("Train-TZRB+ (all files), warm", splits.TRAIN_TZRB_PLUS, "45"),
        ]
        results = {}
        for name, names, limit in plan:
            r = results[name] = run(list(names), folder, cache)
            rows.append(
                [name, f"{r['seconds_used']:.0f}", str(sum(p["iterations"] for p in r["passes"])),
                 f"{r['timings_s']['solve']:.1f}", f"{r['wall']:.1f}", limit, f"{r['memory']:.0f}", r["status"]]
            )  # fmt: skip
        names = [n for n in splits.TRAIN_TZRB_PLUS if not n.startswith("turn_cut")]
        growth = []
        sigma = ",".join(str(v) for v in results["Train-TZRB+ (all files), warm"]["sigma"].values())
        for share in (4, 2, 1):
            r = run(list(names[::share]), folder, cache, "--sigma", sigma)
            p = r["passes"][-1]
            growth.append(
                [f"1/{share}", f"{r['seconds_used']:.0f}", str(p["iterations"]), f"{p['seconds']:.2f}",
                 f"{1e3 * p['seconds'] / p['iterations'] / r['seconds_used']:.4f}", f"{r['wall']:.1f}"]
            )  # fmt: skip
    header = ["data", "seconds of data", "iterations", "solve [s]", "wall, start to run folder [s]", "limit [s]",
              "peak memory [MB]", "IPOPT"]  # fmt: skip
    lines = table(header, rows)
    lines += ["", "Growth with the data (every 4th, every 2nd, all files of Train-TZRB+; one solve, sigma fixed):", ""]
    lines += table(
        ["share", "seconds of data", "iterations", "solve [s]", "ms per iteration and second of data", "wall [s]"],
        growth,
    )
    record("mmg fit", "python -m benchmarks.fit", lines)


if __name__ == "__main__":
    main()
