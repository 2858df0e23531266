"""The figures of both machines as a table of RESULTS.md: see the package."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from benchmarks.gpu_rollouts.problem import BATCH, STEPS, WIDTH
from benchmarks.record import record, table

COMMAND = "python -m benchmarks.gpu_rollouts.write FOLDER, then run and record"


def main(folder: Path, figures: Path) -> None:
    processor = json.loads((folder / "processor.json").read_text(encoding="utf-8"))
    there = json.loads(figures.read_text(encoding="utf-8").splitlines()[-1])
    ways = [("one thread of the processor below", BATCH, processor)]
    ways += [(f"{there['device']}, one thread per trajectory", round(f["points"]), f) for f in there["figures"]]
    rows = []
    for name, points, found in ways:
        cells = [name, f"{points}"]
        for kind in ("forward", "gradient"):
            ratio = processor[kind] / BATCH / (found[kind] / points)
            cells += [f"{found[kind]:.1f}", f"{ratio:.0f}"]
        rows.append(cells)
    errors = {k: v for f in there["figures"] for k, v in f.items() if k.startswith("error")}
    lines = table(["machine", "trajectories", "forward [ms]", "times as fast", "gradient [ms]", "times as fast"], rows)
    lines += [
        "",
        f"ESSO OSAKA with a network of two layers of {WIDTH}; {STEPS} steps of Runge-Kutta 4; float64 in both. A "
        "gradient is forward pass, loss, adjoint and the products for the weights. Times as fast: per trajectory. "
        "Relative differences between the two (last: states at the end; first, W2: gradients by start and weights): "
        f"{', '.join(f'{k[9:]} {v:.0e}' for k, v in errors.items())}.",
        f"Processor: {processor['machine']}.",
    ]
    record("Rollouts on a GPU", COMMAND, lines)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
