"""Cost of one right-hand side, compiled and interpreted, and of `mmg --help`.

Run from the repository root: python -m benchmarks.speed
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import casadi as ca
import numpy as np

from benchmarks.record import record, table
from cases.shipfiles.ship_file import load_ship
from mmg.compile.cache import compile_library
from mmg.model import assemble
from mmg.rollout import Simulator


def best_of(count: int, work) -> float:  # type: ignore[no-untyped-def]
    """Shortest of ``count`` runs [s]."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    ship, N = load_ship("esso_osaka_3m"), 8192
    rng = np.random.default_rng(0)
    state = rng.normal(size=(6, N)) * np.array([[1], [1], [1], [0.3], [0.1], [0.05]])
    controls = np.vstack([rng.uniform(-15, 15, N), rng.normal(size=N) * 0.3, rng.normal(size=(2, N))])
    rows = []
    for name, simulator in (("batch kernel (SIMD C), 8192 points", Simulator(ship)),
                            ("CasADi virtual machine, same points", Simulator(ship, compiled=False))):  # fmt: skip
        seconds = best_of(5, lambda simulator=simulator: simulator.rates(state, controls))
        rows.append([name, f"{1e6 * seconds / N:.3f}"])
    model = assemble(ship)
    with tempfile.TemporaryDirectory() as scratch:
        code = ca.CodeGenerator("rates.c")
        code.add(model.rates)
        code.generate(scratch + "/")
        library, reason = compile_library((Path(scratch) / "rates.c").read_text(), ("-O2", "-fPIC", "-shared", "-w"))
        if library:
            one = ca.external("rates", str(library)).map(N, "serial")
            arguments = [ca.DM(state), ca.DM(controls), ca.DM(np.repeat(ship.values[:, None], N, axis=1))]
            seconds = best_of(5, lambda: one(*arguments))
            rows.append(["CasADi's C, one point per call", f"{1e6 * seconds / N:.3f}"])
        else:
            rows.append([f"CasADi's C: {reason}", "-"])
    seconds = best_of(
        5,
        lambda: subprocess.run(
            [sys.executable, "-m", "mmg_ident.commands.main", "--help"], capture_output=True, check=True
        ),
    )
    lines = table(["right-hand side of ESSO OSAKA (61 coefficients)", "microseconds per call"], rows)
    lines += ["", f"`mmg --help`: {seconds:.2f} s (limit 0.5 s)"]
    record("Right-hand side and start-up", "python -m benchmarks.speed", lines)


if __name__ == "__main__":
    main()
