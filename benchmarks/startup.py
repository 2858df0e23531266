"""What it costs to import the public package and to show the help, beside Python alone.

Run from the repository root: python -m benchmarks.startup
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time

from benchmarks.record import record, table

CASES = {
    "Python alone": "pass",
    "import mmg_ident": "import mmg_ident",
    "mmg --help": "from mmg_ident.commands.main import main; main(['--help'])",
    "mmg fit --help": "from mmg_ident.commands.main import main; main(['fit', '--help'])",
    "mmg_ident.load_ship": "import mmg_ident; mmg_ident.load_ship",
    "mmg_ident.calibrate": "import mmg_ident; mmg_ident.calibrate",
}
HEAVY = ("numpy", "scipy", "casadi", "pandas", "matplotlib", "pydantic", "torch")
TIMES = 5


def seconds(code: str) -> tuple[float, float]:
    """Least wall-clock and processor time [s] of a new process that runs ``code``, of TIMES processes."""
    wall, processor = [], []
    for _ in range(TIMES):
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        wall.append(time.perf_counter() - began)
        processor.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(wall), min(processor)


def heavy(code: str) -> str:
    """Those of HEAVY that are in memory after ``code``."""
    code += f"\nimport sys; print(' '.join(n for n in {HEAVY} if n in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.splitlines()[-1] or "-"


def main() -> None:
    """Measure and record."""
    rows, alone = [], 0.0
    for name, code in CASES.items():
        wall, processor = seconds(code)
        alone = alone or processor
        rows.append([name, f"{1e3 * wall:.0f}", f"{1e3 * processor:.0f}", f"{processor / alone:.1f}", heavy(code)])
    header = ["what", "wall clock, ms", "processor, ms", "times Python alone", "imported of " + ", ".join(HEAVY)]
    lines = [
        f"Least of {TIMES} processes each; the wall clock is that of a machine with other work to do.",
        "",
        *table(header, rows),
    ]
    record("Start of the package and of the command", "python -m benchmarks.startup", lines)


if __name__ == "__main__":
    main()
