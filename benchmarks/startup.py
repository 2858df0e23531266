"""What it costs to import the public package and to show the help, beside Python alone.

Run from the repository root: python -m benchmarks.startup
"""

from __future__ import annotations

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
TIMES = 15


def seconds(code: str) -> float:
    """Least wall-clock time [s] of a new process that runs ``code``, of TIMES processes."""
    times = []
    for _ in range(TIMES):
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - began)
    return min(times)


def heavy(code: str) -> str:
    """Those of HEAVY that are in memory after ``code``."""
    code += f"\nimport sys; print(' '.join(n for n in {HEAVY} if n in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.splitlines()[-1] or "-"


def main() -> None:
    """Measure and record."""
    alone = seconds(CASES["Python alone"])
    rows = []
    for name, code in CASES.items():
        spent = seconds(code)
        rows.append([name, f"{1e3 * spent:.0f}", f"{spent / alone:.1f}", heavy(code)])
    lines = table(["what", "ms", "times Python alone", "imported of " + ", ".join(HEAVY)], rows)
    record("Start of the package and of the command", "python -m benchmarks.startup", lines)


if __name__ == "__main__":
    main()
