"""The same objective minimised by IPOPT, by SciPy with finite differences, by Gauss-Newton and by CMA-ES, in one run.

Run from the repository root: python -m benchmarks.optimisers
"""

from __future__ import annotations

import contextlib
import time

import numpy as np
from scipy.optimize import least_squares

from benchmarks import gauss_newton
from benchmarks.record import record, table
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.calibration import Settings, estimate_coefficients
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from fitting.solvers.ipopt import solve
from mmg.model import assemble

STEP, WINDOW = 1.0, 100.0


class SingleShooting:
    """Residual vector of the objective in (z0 of every window, p): what a user would hand to SciPy."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.W = problem, problem.segments.intervals
        self.evaluations = 0
        seg = problem.segments
        self.z_start = seg.nodes[seg.start]
        self.end_weight = np.sqrt(problem.node_weight[seg.end])
        self.start_weight = np.sqrt(problem.node_weight[seg.start])
        self.weight = np.sqrt(problem.weight)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.z_start + x[: 6 * self.W].reshape(self.W, 6) * self.problem.scale, x[6 * self.W :]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        seg = self.problem.segments
        z0, p = self.split(x)
        end, interior = self.problem.shooting.values(z0.T, self.problem.coefficients(p))
        parts = [
            self.start_weight * (z0 - self.z_start),
            self.end_weight * (end.T - seg.nodes[seg.end]),
            self.weight * (interior - seg.targets),
            p,
        ]
        return np.nan_to_num(np.concatenate([part.reshape(-1) for part in parts]), nan=1e6, posinf=1e6, neginf=-1e6)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = self.problem.p_bounds()
        free = np.full(6 * self.W, np.inf)
        return np.concatenate([-free, lower]), np.concatenate([free, upper])


def scipy_time(one: SingleShooting, goal: float, limit: float) -> tuple[float, float]:
    """Seconds until `least_squares` (trf, 2-point) reaches ``goal``, and the objective then (or at the limit)."""
    began, best = time.perf_counter(), [np.inf, 0.0]

    class Done(Exception):
        pass

    def residuals(x: np.ndarray) -> np.ndarray:
        r = one.residuals(x)
        value = 0.5 * float(r @ r)
        if value < best[0]:
            best[:] = [value, time.perf_counter() - began]
        if best[0] <= goal or time.perf_counter() - began > limit:
            raise Done
        return r

    with contextlib.suppress(Done):
        least_squares(residuals, np.zeros(6 * one.W + one.problem.P), bounds=one.bounds(), x_scale="jac",
                      ftol=1e-10, xtol=1e-10, gtol=1e-10)  # fmt: skip
    return time.perf_counter() - began, best[0]


def cma_time(one: SingleShooting, goal: float, limit: float, seed: int = 1) -> tuple[float, float]:
    """Seconds that CMA-ES (pycma, bounds, sigma 0.3) ran, and the objective it reached."""
    import cma

    lower, upper = one.bounds()
    began = time.perf_counter()
    es = cma.CMAEvolutionStrategy(
        np.zeros(len(lower)), 0.3, {"bounds": [lower.tolist(), upper.tolist()], "seed": seed, "verbose": -9}
    )
    best = np.inf
    while not es.stop() and best > goal and time.perf_counter() - began < limit:
        points = es.ask()
        values = [0.5 * float(r @ r) for r in map(one.residuals, map(np.asarray, points))]
        es.tell(points, values)
        best = min(best, *values)
    return time.perf_counter() - began, best


def problems() -> tuple[Problem, SingleShooting]:
    """The objective of Train-TZRB by multiple shooting, and by single shooting as SciPy gets it."""
    ship = load_ship("esso_osaka_3m")
    trials = read_trials(splits.find(splits.TRAIN_TZRB))
    sigma = estimate_coefficients(ship, trials, Settings(window=WINDOW, step=STEP)).sigma
    prior = Prior.of(ship)
    kernel = Kernels(assemble(ship), np.array([ship.symbols.index(s) for s in prior.symbols]))
    problem = Problem(ship, prior, kernel, cut(trials, STEP, WINDOW, 5), sigma)
    whole = Problem(ship, prior, kernel, cut(trials, STEP, WINDOW, 200), sigma)
    return problem, SingleShooting(whole)


def main() -> None:
    problem, one = problems()
    whole = one.problem
    began = time.perf_counter()
    ours = solve(problem, problem.start())
    seconds = time.perf_counter() - began
    goal = ours.objective * (1 + 1e-5)
    rows = [["IPOPT, exact Hessian, multiple shooting", f"{seconds:.2f}", "1", f"{ours.objective:.6f}", ours.status]]
    began = time.perf_counter()
    first = whole.segments
    z0 = np.zeros((one.W, 6))
    z0[first.window] = first.nodes[first.start]
    gn = gauss_newton.solve(whole, z0, np.zeros(whole.P), damping=1.0)
    took = time.perf_counter() - began
    words = f"relative difference {abs(gn.objective / ours.objective - 1):.1e}"
    rows.append(
        [
            "structured Gauss-Newton, single shooting",
            f"{took:.2f}",
            f"{took / seconds:.1f}",
            f"{gn.objective:.6f}",
            words,
        ]
    )
    took, value = scipy_time(one, goal, limit=200 * seconds)
    words = "reached" if value <= goal else "not reached"
    rows.append(
        ["scipy least_squares, finite differences", f"{took:.1f}", f"{took / seconds:.0f}", f"{value:.6f}", words]
    )
    took, value = cma_time(one, goal, limit=105 * seconds)
    words = "reached" if value <= goal else "not reached in this time"
    rows.append(["CMA-ES (pycma)", f"{took:.1f}", f"{took / seconds:.0f}", f"{value:.1f}", words])
    lines = [
        f"Train-TZRB, {whole.P} coefficients and {6 * one.W} initial states, the same objective and start "
        "(captive coefficients); time until the objective of IPOPT is reached within 1e-5.",
        "",
    ]
    lines += table(["method", "seconds", "times IPOPT", "objective", "outcome"], rows)
    record("Optimisers", "python -m benchmarks.optimisers", lines)


if __name__ == "__main__":
    main()
