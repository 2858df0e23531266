"""Candidates learned by the objective of Miyauchi et al. (2023), each by several seeds: the best on validation.

By derivatives: a polynomial with wrong coefficients diverges within a subsequence of 100 s, where its error has no
useful slope. So the start is linear: the change of u, v, r over short blocks against the terms along the measured
motion, ridged by the prior. Proximal Gauss-Newton steps follow, along weights of the sparsity from strong to weak: each
minimises the model with the moduli and the bounds exactly, for several dampings at once, of which simulation of all
takes the best. Or as the paper does: CMA-ES with restarts and a box, through pycma; restarts double the population
(Auger & Hansen 2005).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.files import replace_text
from cases.trial import Trial
from fitting.parallel import run_all
from fitting.report.run_folder import Real
from fitting.selection.candidates import StructureCandidate
from fitting.selection.kept import Kept
from fitting.selection.polynomial_regression import increments, regress
from fitting.selection.subsequences import Penalties, SubsequenceObjective
from mmg.errors import NotInstalled, OutOfRange, UnknownName
from mmg.progress import LOGGER

OPTIMIZERS = ("gradient", "cmaes")
SPARSITIES = tuple(float(w) for w in 10.0 ** np.arange(-1.0, -5.1, -0.5))
"""Weights of the sparsity, from strong to weak, on the path by derivatives."""
SPARSITY = 1e-3
"""Weight of the sparsity with CMA-ES."""
WORSE, PATIENCE = 1.5, 3
"""The path ends where the validation error is so many times its least at so many weights in a row."""
SPREAD = 0.3
"""Standard deviation of the starts of further seeds of the descent about that by regression, and first step size of
CMA-ES, in standard deviations of the priors."""
ON_PATH, LAST = 10, 20
"""Most steps at each weight of the path, and without any."""
FACTORS = np.array([1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3])
"""Dampings tried at once, by the last that was best."""
TOLERANCE = 1e-4
"""Relative decrease of the objective in three steps below which it has converged."""
RESTARTS, EVERY = 9, 20
"""Most restarts of CMA-ES, and its generations between two points of the learning curve."""
STEPS, NEAR = 200, 1e-5
"""Most gradient steps to the minimum of a quadratic, and relative change at which they end."""


@dataclass(frozen=True)
class Method:
    """How candidates are learned.

    optimizer: one of OPTIMIZERS; seeds: runs of each candidate, from ``seed`` on; workers: processes over which runs
    are spread; time_limit: of each [s]; compiled: use a C compiler if there is one.
    """

    optimizer: str = "gradient"
    seeds: int = 1
    seed: int = 0
    workers: int = 1
    time_limit: float | None = None
    compiled: bool = True

    def __post_init__(self) -> None:
        if self.optimizer not in OPTIMIZERS:
            raise UnknownName(f"--optimizer {self.optimizer}: must be one of {', '.join(OPTIMIZERS)}")
        if self.seeds < 1:
            raise OutOfRange(f"--seeds {self.seeds} must be at least 1")
        if self.optimizer == "cmaes":
            _cma()


@dataclass(frozen=True)
class Lesson:
    """One point of a learning curve.

    evaluations: simulations of all training subsequences so far; seconds: of the optimiser so far; objective: J of its
    current point; training, validation: E of it.
    """

    evaluations: int
    seconds: float
    objective: Real
    training: Real
    validation: Real


class Learning:
    """The learning curve of one run of an optimiser on ``objective``, which began at ``began`` by the clock of
    ``time.perf_counter``.

    lessons: the curve; best, p: least objective and where; chosen, p_chosen: the least validation error and where.
    """

    def __init__(self, objective: SubsequenceObjective, began: float | None = None) -> None:
        self.objective, self.began = objective, time.perf_counter() if began is None else began
        self.lessons: list[Lesson] = []
        self.best = self.chosen = float("inf")
        self.p = self.p_chosen = np.zeros(objective.P)

    @property
    def seconds(self) -> float:
        """Of the optimiser so far."""
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
        self.offer(p, value)
        if validation < self.chosen:
            self.chosen, self.p_chosen = validation, p.copy()
        return lesson

    def offer(self, p: np.ndarray, value: float) -> None:
        """Keeps the point ``p`` (P,) with this ``value`` of J if it is the best so far."""
        if value < self.best:
            self.best, self.p = value, p.copy()


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


SeededRun = tuple[StructureCandidate, int]
"""One run of a candidate: with this seed."""


def learn_all(
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial]],
    method: Method,
    kept: Kept | None = None,
) -> dict[str, list[Learned]]:
    """Runs of each of the candidates ``given`` by name, the one with the least validation error first.

    trials: to train on and to validate; method: how; kept: finished runs, which are taken from there, and to which
    others are added as they come. Raises UserError for trials from which nothing can be learned.
    """
    kept, seeds = kept or Kept(), range(method.seed, method.seed + method.seeds)
    runs = {f"{one.name}_seed{seed}": (one, seed) for one in given for seed in seeds}
    found = {name: run for name in runs if (run := kept.get(name, Learned)) is not None}
    missing = [name for name in runs if name not in found]

    def keep(run: Learned) -> None:
        kept.put(f"{run.name}_seed{run.seed}", run)
        LOGGER.info(f"{run.name}, seed {run.seed}: J {run.objective:.4g}, validation {run.validation:.4g} after "
                    f"{run.seconds:.0f} s")  # fmt: skip

    task = partial(learn_one, trials=trials, method=method)
    found |= zip(missing, run_all(task, [runs[name] for name in missing], method.workers, keep, "models"), strict=True)
    best = sorted(found.values(), key=lambda run: run.validation if run.validation >= 0 else float("inf"))
    return {one.name: [run for run in best if run.name == one.name] for one in given}


def learn_one(run: SeededRun, trials: tuple[Sequence[Trial], Sequence[Trial]], method: Method) -> Learned:
    """One ``run`` on ``trials`` to train on and to validate, by ``method``.

    The time limit counts from here, compiling and preparing belong to it; a first point is evaluated in any case.
    """
    began, (one, seed) = time.perf_counter(), run
    problem = SubsequenceObjective(one.ship, *trials, compiled=method.compiled)
    learning = Learning(problem, began)
    limit = float("inf") if method.time_limit is None else method.time_limit
    if method.optimizer == "cmaes":
        problem.penalties = Penalties(sparsity=SPARSITY)
        evolve(learning, seed, limit)
    else:
        start = regression(problem, trials[0])
        if seed != method.seed:
            rng = np.random.default_rng([37, seed])
            start = np.clip(start + SPREAD * rng.standard_normal(problem.P), problem.lower, problem.upper)
        follow(learning, start, limit)
    p, symbols = learning.p_chosen, problem.prior.symbols
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
        about = problem.quadratic(p)
        diagonal = np.diag(about.hessian)
        size = np.maximum(diagonal, 1e-6 * diagonal.max() + 1e-300)
        tried = []
        for mu in damping * FACTORS:
            H = about.hessian + np.diag(1e-3 * mu * size + 1e-9 * diagonal.max())
            tried.append(minimise_quadratic(H, about.gradient, p, box, weight))
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
        if len(past) > 3 and past[-4] - past[-1] < TOLERANCE * past[-1]:
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
    for _ in range(STEPS):
        free = y - (b + A @ (y - origin)) / largest
        new = np.clip(np.sign(free) * np.maximum(np.abs(free) - lam / largest, 0), low, high)
        if np.abs(new - x).max() < NEAR * np.abs(new).max():
            break
        t = 1.0 if (y - new) @ (new - x) > 0 else t
        later = 0.5 * (1 + np.sqrt(1 + 4 * t * t))
        y, x, t = new + (t - 1) / later * (new - x), new, later
    return min((x, origin), key=value) * scale


def _cma() -> Any:
    """The module pycma. Raises UserError where it is missing."""
    try:
        import cma
    except ImportError:
        raise NotInstalled(
            "--optimizer cmaes needs pycma, which is not installed; pip install 'mmg-ident[cma]'"
        ) from None
    return cma


def evolve(
    learning: Learning, seed: int = 0, time_limit: float = float("inf"), evaluations: float = float("inf")
) -> None:
    """CMA-ES on the objective of ``learning``, where all that it finds is noted.

    seed: of its draws; time_limit [s], evaluations: where it is stopped, after a generation. The first run begins at
    0, later ones at random in the middle of the box. Raises UserError where pycma is missing.
    """
    cma, problem, spent, generation = _cma(), learning.objective, 0, 0
    rng = np.random.default_rng([31, seed])
    for restart in range(RESTARTS + 1):
        size = int(4 + 3 * np.log(problem.P)) * 2**restart
        begin = np.zeros(problem.P) if restart == 0 else rng.standard_normal(problem.P)
        strategy = cma.CMAEvolutionStrategy(
            np.clip(begin, 0.99 * problem.lower, 0.99 * problem.upper),
            SPREAD,
            {
                "bounds": [problem.lower.tolist(), problem.upper.tolist()], "popsize": size, "seed": np.nan,
                "randn": lambda *shape: rng.standard_normal(shape), "verbose": -9, "verb_log": 0,
            },
        )  # fmt: skip
        while not strategy.stop():
            points = strategy.ask()
            values = problem.values(np.transpose(points))
            values = np.where(np.isfinite(values), values, np.finfo(float).max)  # as bad as a candidate can be
            strategy.tell(points, values.tolist())
            spent, generation = spent + size, generation + 1
            best = int(np.argmin(values))
            learning.offer(np.asarray(points[best]), float(values[best]))
            if learning.seconds > time_limit or spent + size > evaluations:
                learning.note(learning.p)
                return
            if generation % EVERY == 0:
                learning.note(np.asarray(strategy.result.xfavorite))
        learning.note(learning.p)
