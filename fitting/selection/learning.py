"""Candidates learned by the objective of Miyauchi et al. (2023), each by several seeds: the best on validation.

A polynomial with wrong coefficients diverges within a subsequence of 100 s, where its error has no useful slope. So the
start is that of a regression on the velocities (``polynomial_regression``). Proximal Gauss-Newton steps follow, along
weights of the sparsity from strong to weak: each minimises the model with the moduli and the bounds, for several
dampings at once, of which simulation of all takes the best. (CMA-ES, as in the paper, reached J = .354 for .353 with 22
unknowns and .257 for .200 with 50, in 20 times as many simulations.)
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from cases.io.files import replace_text
from cases.trial import Trial
from fitting.parallel import run_all
from fitting.report.parts import Store
from fitting.report.run_folder import Real, adapter, plain
from fitting.selection.candidates import StructureCandidate
from fitting.selection.polynomial_regression import increments, regress
from fitting.selection.subsequences import SubsequenceObjective
from fitting.settings import Settings
from mmg.progress import LOGGER

SPARSITIES = tuple(float(w) for w in 10.0 ** np.arange(-1.0, -5.1, -0.5))
"""Weights of the sparsity, from strong to weak."""
WORSE, PATIENCE = 1.5, 3
"""The path ends where the validation error is so many times its least at so many weights in a row. Set by hand."""
SPREAD = 0.3
"""Standard deviation of starts of further seeds about the regression, by those of the priors. Set by hand."""
ON_PATH, LAST = 10, 20
"""Most steps at each weight of the path, and without any. Set by hand: they bound the time."""
FACTORS = np.array([1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3])
"""Dampings tried at once, by the last that was best. A grid set by hand."""


@dataclass(frozen=True)
class Lesson:
    """One point of a learning curve.

    evaluations: simulations of all training subsequences so far; seconds: of the run so far; objective: J of its
    current point; training, validation: E of it.
    """

    evaluations: int
    seconds: float
    objective: Real
    training: Real
    validation: Real


class Learning:
    """The learning curve of one run on ``objective``, which began at ``began`` by the clock of ``time.perf_counter``.

    lessons: the curve; best: least objective; chosen, p: the least validation error and where.
    """

    def __init__(self, objective: SubsequenceObjective, began: float | None = None) -> None:
        self.objective, self.began = objective, time.perf_counter() if began is None else began
        self.lessons: list[Lesson] = []
        self.best = self.chosen = float("inf")
        self.p = np.zeros(objective.P)

    @property
    def seconds(self) -> float:
        """Of the run so far."""
        return time.perf_counter() - self.began

    def note(self, p: np.ndarray) -> Lesson:
        """Adds the point ``p`` (P,) to the curve; its evaluation does not count."""
        problem = self.objective
        evaluations = problem.evaluations
        value = float(problem.values(p[:, None])[0])
        training, validation = (float(problem.errors(p[:, None], d)[0]) for d in (problem.train, problem.validate))
        problem.evaluations = evaluations
        lesson = Lesson(evaluations, self.seconds, value, training, validation)
        self.lessons.append(lesson)
        self.best = min(self.best, value)
        if validation < self.chosen:
            self.chosen, self.p = validation, p.copy()
        return lesson


def write_learning(runs: Sequence[Learned], path: Path) -> None:
    """Writes the learning curves of ``runs`` as CSV to ``path``."""
    rows = ["candidate,seed,evaluations,seconds,objective,training,validation"]
    for run in runs:
        rows += [
            f"{run.name},{run.seed},{s.evaluations},{s.seconds:.3f},{s.objective:.9g},{s.training:.9g},"
            f"{s.validation:.9g}"
            for s in run.lessons
        ]
    replace_text(path, "\n".join(rows) + "\n")


@dataclass(frozen=True)
class Learned:
    """The best point of one run of a candidate.

    values: of its free coefficients, by symbol; vanished: generated terms that are zero; training, validation: E of the
    objective; objective: least J; seconds, evaluations: of the run; seed; lessons: learning curve.
    """

    name: str
    seed: int
    values: dict[str, float]
    vanished: tuple[str, ...]
    training: Real
    validation: Real
    objective: Real
    seconds: float
    evaluations: int
    lessons: tuple[Lesson, ...]


def kept_run(store: Store, name: str) -> Learned | None:
    """The finished run ``name`` of a ``store``, None where there is none or it cannot be read: it is made again."""
    with suppress(ValidationError):
        return adapter(Learned).validate_python(part[0]) if (part := store.load(name)) else None
    return None


SeededRun = tuple[StructureCandidate, int]
"""One run of a candidate: with this seed."""


def learn_all(
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial]],
    settings: Settings,
    seeds: int = 1,
    store: Store | None = None,
) -> dict[str, list[Learned]]:
    """Runs of each of the candidates ``given`` by name, the one with the least validation error first.

    trials: to train on and to validate; settings: seed of the first run, workers over which runs are spread, time limit
    of each [s]; seeds: runs of each candidate; store: finished runs, which are taken from there, and to which others
    are added as they come. Raises UserError for trials from which nothing can be learned.
    """
    numbers = range(settings.seed, settings.seed + seeds)
    runs = {f"{one.name}_seed{seed}": (one, seed) for one in given for seed in numbers}
    if store:
        store.open()
    found = {name: run for name in runs if store and (run := kept_run(store, name))}
    missing = [name for name in runs if name not in found]

    def keep(run: Learned) -> None:
        if store:
            store.save(f"{run.name}_seed{run.seed}", plain(run))
        LOGGER.info(f"{run.name}, seed {run.seed}: J {run.objective:.4g}, validation {run.validation:.4g} after "
                    f"{run.seconds:.0f} s")  # fmt: skip

    task = partial(learn_one, trials=trials, settings=settings)
    done = run_all(task, [runs[name] for name in missing], settings.workers, keep, "models")
    found |= zip(missing, done, strict=True)
    best = sorted(found.values(), key=lambda run: run.validation if run.validation >= 0 else float("inf"))
    return {one.name: [run for run in best if run.name == one.name] for one in given}


def learn_one(run: SeededRun, trials: tuple[Sequence[Trial], Sequence[Trial]], settings: Settings) -> Learned:
    """One ``run`` on ``trials`` to train on and to validate, by ``settings``: the first seed begins at the regression.

    The time limit counts from here, compiling and preparing belong to it; a first point is evaluated in any case.
    """
    began, (one, seed) = time.perf_counter(), run
    problem = SubsequenceObjective(one.ship, *trials, compiled=settings.compiled)
    learning, start = Learning(problem, began), regression(problem, trials[0])
    if seed != settings.seed:
        start += SPREAD * np.random.default_rng([37, seed]).standard_normal(problem.P)
    follow(learning, np.clip(start, problem.lower, problem.upper), settings.time_limit or float("inf"))
    p, symbols = learning.p, problem.prior.symbols
    ship = problem.ship_at(p)
    return Learned(
        name=one.name,
        seed=seed,
        values={s: ship.coefficients[s].value for s in symbols},
        vanished=tuple(s for s, x, sparse in zip(symbols, p, problem.sparse, strict=True) if sparse and x == 0),
        training=float(problem.errors(p[:, None], problem.train)[0]),
        validation=float(problem.errors(p[:, None], problem.validate)[0]),
        objective=learning.best,
        seconds=learning.seconds,
        evaluations=learning.lessons[-1].evaluations,
        lessons=tuple(learning.lessons),
    )


def follow(learning: Learning, p: np.ndarray, limit: float = float("inf")) -> None:
    """The path of the sparsity from strong to weak from ``p`` (P,) on, then the descent without any.

    Notes in ``learning`` the end of each weight, and each step of the descent; ends early where validation grows worse,
    or at the ``limit`` [s].
    """
    problem, worse = learning.objective, 0
    for weight in (*SPARSITIES, 0.0):
        problem.penalties = replace(problem.penalties, sparsity=weight)
        if learning.seconds <= limit:
            for step in descent(problem, p, ON_PATH if weight else LAST):
                p = step
                if not weight:
                    learning.note(p)
                if learning.seconds > limit:
                    break
        lesson = learning.note(p)
        worse = worse + 1 if lesson.validation > WORSE * learning.chosen else 0
        if worse >= PATIENCE or learning.seconds > limit:
            break


def regression(problem: SubsequenceObjective, trials: Sequence[Trial]) -> np.ndarray:
    """Scaled coefficients p (P,) of ``problem`` by regression on the velocities of its training ``trials``."""
    found = regress(problem.ship, increments(problem.ship, trials)).values
    return (np.array([found[s] for s in problem.prior.symbols]) - problem.prior.mean) / problem.prior.std


def descent(problem: SubsequenceObjective, p: np.ndarray, most: int) -> Iterator[np.ndarray]:
    """Points (P,) of at most so many steps that lower the objective of ``problem`` from ``p`` on, until it has
    converged."""
    value, damping, past = float(problem.values(p[:, None])[0]), 1.0, []
    weight, box = problem.penalties.sparsity * problem.sparse, (problem.lower, problem.upper)
    for _ in range(most):
        gradient, hessian = problem.quadratic(p)
        diagonal = np.diag(hessian)
        size = np.maximum(diagonal, 1e-6 * diagonal.max() + 1e-300)
        tried = []
        for mu in damping * FACTORS:
            H = hessian + np.diag(1e-3 * mu * size + 1e-9 * diagonal.max())
            tried.append(minimise_quadratic(H, gradient, p, box, weight))
        values = problem.values(np.transpose(tried))
        best = int(np.argmin(np.where(np.isfinite(values), values, np.inf)))
        if not values[best] < value:
            if damping > 1e8:
                return
            damping *= 1e4
            continue
        p, value, damping = tried[best], float(values[best]), max(damping * FACTORS[best], 1e-10)
        yield p
        past.append(value)
        if len(past) > 3 and past[-4] - past[-1] < 1e-4 * past[-1]:
            return


def minimise_quadratic(
    H: np.ndarray, g: np.ndarray, p: np.ndarray, box: tuple[np.ndarray, np.ndarray], weight: np.ndarray
) -> np.ndarray:
    """The point x (P,) that makes g (x - p) + 1/2 (x - p) H (x - p) + sum weight |x| least within ``box``.

    H: (P, P), positive definite; g, p, weight: (P,); p within the box. The value is never above that of p.
    Accelerated proximal gradients with restarts (Beck & Teboulle 2009; O'Donoghue & Candes 2015) in variables scaled by
    the diagonal.
    """
    scale = 1 / np.sqrt(np.diag(H))
    A, b = H * np.outer(scale, scale), scale * g
    low, high, lam, origin = box[0] / scale, box[1] / scale, weight * scale, p / scale
    largest = float(np.linalg.eigvalsh(A)[-1])

    def value(x: np.ndarray) -> float:
        d = x - origin
        return float(b @ d + 0.5 * d @ (A @ d) + lam @ np.abs(x))

    x = y = origin
    t = 1.0
    for _ in range(200):
        free = y - (b + A @ (y - origin)) / largest
        new = np.clip(np.sign(free) * np.maximum(np.abs(free) - lam / largest, 0), low, high)
        if np.abs(new - x).max() < 1e-5 * np.abs(new).max():
            break
        t = 1.0 if (y - new) @ (new - x) > 0 else t
        later = 0.5 * (1 + np.sqrt(1 + 4 * t * t))
        y, x, t = new + (t - 1) / later * (new - x), new, later
    return min((x, origin), key=value) * scale
