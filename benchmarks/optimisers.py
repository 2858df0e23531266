"""The objective of Train-TZRB minimised by this package, and by SciPy with finite differences.

Run from the repository root: python -m benchmarks.optimisers [--record]
The same objective and start (captive coefficients); time until the objective of this package is reached within 1e-5.
SciPy gets what a user would hand to it: single shooting, the residual vector in (initial states, p).
"""

from __future__ import annotations

import contextlib
import time

import numpy as np
from scipy.optimize import least_squares

from benchmarks.record import Figure, parser_of, report
from cases.io import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.calibration import estimate_coefficients
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import cut
from fitting.settings import Settings
from fitting.solvers.solve import solve

STEP, WINDOW = 1.0, 100.0
"""Of the integration and of a window [s]."""
LONGEST = 315.0
"""Times the seconds of this package that SciPy gets."""


class Reached(Exception):
    """The goal is reached, or the time is up."""


class SingleShooting:
    """Residual vector of the objective in (z0 of every window, p), which stops at a ``goal`` or after ``limit`` [s]."""

    def __init__(self, problem: Problem, goal: float, limit: float) -> None:
        self.problem, self.goal, self.limit = problem, goal, limit
        self.windows = problem.segments.intervals
        self.began, self.best = time.perf_counter(), np.inf

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Residuals (n,) at x (6 W + P,). Raises Reached."""
        seg, problem = self.problem.segments, self.problem
        z0 = seg.nodes[seg.start] + x[: 6 * self.windows].reshape(self.windows, 6) * problem.scale
        p = x[6 * self.windows :]
        end, interior = problem.shooting.values(z0.T, problem.coefficients(p))
        parts = [
            np.sqrt(problem.node_weight[seg.start]) * (z0 - seg.nodes[seg.start]),
            np.sqrt(problem.node_weight[seg.end]) * (end.T - seg.nodes[seg.end]),
            np.sqrt(problem.weight) * (interior - seg.targets),
            p,
        ]
        r = np.nan_to_num(np.concatenate([part.reshape(-1) for part in parts]), nan=1e6, posinf=1e6, neginf=-1e6)
        self.best = min(self.best, 0.5 * float(r @ r))
        if self.best <= self.goal or time.perf_counter() - self.began > self.limit:
            raise Reached
        return r

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (6 W + P,)."""
        lower, upper = self.problem.p_bounds()
        free = np.full(6 * self.windows, np.inf)
        return np.concatenate([-free, lower]), np.concatenate([free, upper])


def main() -> None:
    """Measure, print and, if asked, record."""
    ship, trials = load_ship("esso_osaka_3m"), read_trials(splits.find(splits.TRAIN_TZRB))
    sigma = estimate_coefficients(ship, trials, Settings(window=WINDOW, step=STEP)).sigma
    prior = Prior.of(ship)
    problem, whole = (Problem.of(ship, prior, cut(trials, STEP, WINDOW, nodes), sigma) for nodes in (5, 200))
    times = []
    for _ in range(5):
        began = time.perf_counter()
        ours = solve(problem, problem.start())
        times.append(time.perf_counter() - began)
    seconds = sorted(times)[2]
    one = SingleShooting(whole, ours.objective * (1 + 1e-5), LONGEST * seconds)
    begin = np.zeros(6 * one.windows + whole.P)
    with contextlib.suppress(Reached):  # Levenberg-Marquardt within bounds, slopes by finite differences
        least_squares(one.residuals, begin, bounds=one.bounds(), x_scale="jac", ftol=1e-10, xtol=1e-10, gtol=1e-10)
    ratio = (time.perf_counter() - one.began) / seconds
    note = "" if one.best <= one.goal else f"not reached: {one.best:.1f} for {ours.objective:.1f}"
    made = {
        "solve_wall": Figure("the objective of Train-TZRB minimised, code compiled", seconds, "s"),
        "scipy_ratio": Figure("the same objective by SciPy least_squares", ratio, "times as long", note=note),
    }
    report(made, "optimisers", parser_of("optimisers", __doc__).parse_args().record)


if __name__ == "__main__":
    main()
