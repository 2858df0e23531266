"""Times one turning with shipmmg (PyPI), for benchmarks.open_comparisons.turning: JSON in on stdin, JSON out on stdout.

Runs in an interpreter that has shipmmg and need not have this package. Input: basic, maneuvering (fields of shipmmg's
dataclasses), t, delta, n (nodes of the inputs), u0, rho, at (times of output), repeats. Output: one row per setting of
solve_ivp: its words, seconds (best of repeats, solution at ``at`` included), calls of the right-hand side, largest
position error [m] against shipmmg's own model at rtol 1e-11 and steps of at most 0.1 s.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any
from unicodedata import normalize

import numpy as np

SETTINGS: tuple[dict[str, Any], ...] = (
    {},
    {"rtol": 1e-4},
    {"rtol": 1e-5},
    {"rtol": 1e-6},
    {"rtol": 1e-7},
    {"rtol": 1e-6, "atol": 1e-8},
    {"rtol": 1e-7, "atol": 1e-8},
    {"rtol": 1e-8, "atol": 1e-9},
    {"method": "LSODA", "rtol": 1e-6, "atol": 1e-8},
    {"method": "DOP853", "rtol": 1e-6, "atol": 1e-8},
)


def main() -> None:
    from shipmmg import mmg_3dof

    given = json.load(sys.stdin)
    basic = mmg_3dof.Mmg3DofBasicParams(**{normalize("NFKC", k): v for k, v in given["basic"].items()})
    maneuvering = mmg_3dof.Mmg3DofManeuveringParams(**given["maneuvering"])
    at = np.array(given["at"])
    calls = 0

    def run(**options: Any) -> np.ndarray:
        nonlocal calls
        solution = mmg_3dof.simulate_mmg_3dof(
            basic, maneuvering, given["t"], given["delta"], given["n"], u0=given["u0"], ρ=given["rho"], **options
        )
        calls = solution.nfev
        return np.array(solution.sol(at)[3:5])

    reference = run(method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.1)
    rows = []
    for options in SETTINGS:
        best = np.inf
        for _ in range(given["repeats"]):
            began = time.perf_counter()
            path = run(**options)
            best = min(best, time.perf_counter() - began)
        error = float(np.hypot(*(path - reference)).max())
        words = ", ".join(f"{k} {v if isinstance(v, str) else f'{v:g}'}" for k, v in options.items())
        rows.append({"words": words or "its defaults (RK45, rtol 1e-3)", "s": best, "calls": calls, "error": error})
    json.dump(rows, sys.stdout)


if __name__ == "__main__":
    main()
