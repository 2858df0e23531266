"""The objective of Miyauchi et al. (2023) on 3,000 s of the 3 m VecTwin ship: derivatives and CMA-ES in one run.

``python -m benchmarks.subsequences [NAME...] [--times N]``: candidates sm2-order2 (133 unknowns) and sm3-order3 (613);
CMA-ES runs N times (20) as long as the descent, from the paper's start (nothing known) and from the start of the
descent. One thread each. Data as of benchmarks/structures.py: five runs of 600 s to train on, two to validate, two to
test. Prints the objective against time, then the path of the sparsity.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.record import record, table
from benchmarks.structures import campaign, started_from, true_ship
from fitting.selection.candidates import candidate
from fitting.selection.subsequences.data import subsequences
from fitting.selection.subsequences.descent import descend, regression, sparsity_path
from fitting.selection.subsequences.evolution import evolve
from fitting.selection.subsequences.learning import Learning
from fitting.selection.subsequences.objective import SubsequenceObjective

NAMES = ("sm2-order2", "sm3-order3")
TIMES = 20.0
WEIGHTS = 10.0 ** np.arange(-1.0, -6.1, -0.5)
"""Of the sparsity."""


def curve(learning: Learning, at: list[float]) -> list[str]:
    """Least objective until each of the times ``at`` [s]."""
    found = []
    for limit in at:
        until = [lesson.objective for lesson in learning.lessons if lesson.seconds <= limit]
        found.append(f"{min(until):.4f}" if until else "-")
    return found


def measure(name: str, times: float) -> list[str]:
    """Rows on one candidate."""
    truth = true_ship("vectwin")
    runs = campaign(truth)
    began = time.perf_counter()
    problem = SubsequenceObjective(candidate(started_from(truth), name).ship, runs[:5], runs[5:7])
    problem.values(np.zeros((problem.P, 1)))
    built = time.perf_counter() - began
    test = subsequences(runs[7:], problem.step, problem.length, problem.ship.inputs)
    noise = SubsequenceObjective(truth, runs[:5], runs[5:7])
    floor = float(noise.errors(np.zeros((noise.P, 1)), noise.train)[0])
    descent = Learning(problem)
    start = regression(problem)
    ended = descend(problem, start, descent)
    seconds = descent.seconds
    final = descent.lessons[-1].objective
    near = next(s.seconds for s in descent.lessons if s.objective <= 1.01 * final)
    runs_of = {"descent by derivatives": descent}
    print(f"{name}: {seconds:.1f} s, {final:.5f}, converged {ended.converged}, {ended.steps} steps", flush=True)
    for words, begin in (("CMA-ES from nothing", None), ("CMA-ES from the regression", start)):
        learning = Learning(problem)
        told = evolve(learning, 1, times * seconds, start=begin)
        learning.note(learning.p)
        words = f"{words}: {learning.lessons[-1].evaluations} evaluations, {told.restarts} restarts"
        runs_of[words] = learning
        print(f"{words}, {learning.best:.5f} after {learning.seconds:.0f} s", flush=True)
    at = [0.2 * seconds, seconds, 5 * seconds, times * seconds]
    header = ["optimiser", *(f"{t:.1f} s" for t in at)]
    lines = [
        f"{name}: {problem.P} unknowns; ready in {built:.1f} s (longer where no compiled code is cached); "
        f"descent {seconds:.1f} s ({ended.steps} steps, "
        f"converged: {ended.converged}), within 1 % of its end after {near:.1f} s. E of the true ship: {floor:.4f}.",
        "Least objective until that time:",
        "",
        *table(header, [[words, *curve(learning, at)] for words, learning in runs_of.items()]),
        "",
    ]
    return lines + path(problem, test, descent.p)


def path(problem: SubsequenceObjective, test: object, unpenalised: np.ndarray) -> list[str]:
    """Rows on the path of the sparsity, from strong to weak, and on the model without any."""
    began, rows = time.perf_counter(), []
    own = problem.sparse > 0

    def each(weight: float, p: np.ndarray) -> None:
        errors = [float(problem.errors(p[:, None], data)[0]) for data in (problem.train, problem.validate, test)]
        words = f"{weight:.0e}" if weight else "none"
        row = [words, str(int((p[own] != 0).sum())), *(f"{e:.4f}" for e in errors)]
        rows.append([*row, f"{time.perf_counter() - began:.0f}"])
        print(*rows[-1], flush=True)

    sparsity_path(problem, regression(problem), list(WEIGHTS), each, 10)
    each(0.0, unpenalised)
    header = [
        "weight of the moduli",
        f"terms kept of {int(own.sum())}",
        "E training",
        "validation",
        "test",
        "after [s]",
    ]
    return [*table(header, rows), ""]


def main(words: list[str]) -> None:
    """Measures and records."""
    times = float(words[words.index("--times") + 1]) if "--times" in words else TIMES
    names = [word for word in words if word in NAMES] or list(NAMES)
    lines = ["Mean squared error E in subsequences of 100 s, by the variance of u, v, r; J with w_D = 0.01.", ""]
    for name in names:
        lines += measure(name, times)
    title = f"The paper's objective, {' and '.join(names)}"
    record(title, f"python -m benchmarks.subsequences {' '.join(words)}".strip(), lines)


if __name__ == "__main__":
    main(sys.argv[1:])
