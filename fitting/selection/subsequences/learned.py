"""Candidates learned by the objective of Miyauchi et al. (2023), each by several seeds: the best on validation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cases.trial import Trial
from fitting.parallel import kept_workers, run_all
from fitting.selection.candidates import StructureCandidate
from fitting.selection.kept import Kept
from fitting.selection.subsequences.descent import descend, regression, sparsity_path
from fitting.selection.subsequences.evolution import evolve, needs_cma
from fitting.selection.subsequences.learning import Learning, Lesson
from fitting.selection.subsequences.objective import Penalties, SubsequenceObjective
from mmg.errors import UserError
from mmg.progress import LOGGER

OPTIMIZERS = ("gradient", "cmaes")
SPARSITIES = tuple(float(w) for w in 10.0 ** np.arange(-1.0, -5.1, -0.5))
"""Weights of the sparsity, from strong to weak, on the path by derivatives."""
SPARSITY = 1e-3
"""Weight of the sparsity with CMA-ES."""
WORSE, PATIENCE = 1.5, 3
"""The path ends where the validation error is so many times its least at so many weights in a row."""
SPREAD = 0.3
"""Standard deviation of the starts of further seeds of the descent about that by regression."""


class TooLate(UserError):
    """The time limit of a run had passed before anything was evaluated."""


@dataclass(frozen=True)
class Method:
    """How candidates are learned.

    optimizer: one of OPTIMIZERS; seeds: runs of each candidate, from ``seed`` on; workers: processes over which runs
    are spread; time_limit: of each [s]; evaluations: most of CMA-ES, None: as the time limit allows; compiled: use a C
    compiler if there is one.
    """

    optimizer: str = "gradient"
    seeds: int = 1
    seed: int = 0
    workers: int = 1
    time_limit: float | None = None
    evaluations: int | None = None
    compiled: bool = True

    def __post_init__(self) -> None:
        if self.optimizer not in OPTIMIZERS:
            raise UserError(f"--optimizer {self.optimizer}: must be one of {', '.join(OPTIMIZERS)}")
        if self.seeds < 1:
            raise UserError(f"--seeds {self.seeds} must be at least 1")
        if self.optimizer == "cmaes":
            needs_cma("--optimizer cmaes")


@dataclass(frozen=True)
class Learned:
    """The best run of a candidate.

    values: of its free coefficients, by symbol; vanished: generated terms that are zero; training, validation: E of the
    objective; objective: least J; seconds, evaluations: of the run; seed; lessons: learning curve.
    """

    name: str
    seed: int
    values: dict[str, float]
    vanished: tuple[str, ...]
    training: float
    validation: float
    objective: float
    seconds: float
    evaluations: int
    lessons: tuple[Lesson, ...]

    @classmethod
    def of(cls, content: dict[str, Any]) -> Learned:
        """From plain values, as ``to_dict`` gives them. Raises KeyError or TypeError for anything else."""
        lessons = tuple(Lesson(int(row[0]), *(float("nan") if x is None else x for x in row[1:]))
                        for row in content["lessons"])  # fmt: skip
        numbers = {k: float("nan") if content[k] is None else content[k] for k in ("training", "validation")}
        return cls(**{**content, **numbers, "vanished": tuple(content["vanished"]), "lessons": lessons})

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self) | {"lessons": [list(asdict(lesson).values()) for lesson in self.lessons]}


@dataclass(frozen=True)
class SeededRun:
    """One run of a candidate: its seed, and the file of its state with CMA-ES, None: none."""

    candidate: StructureCandidate
    seed: int
    state: Path | None

    @property
    def name(self) -> str:
        return f"{self.candidate.name}_seed{self.seed}"


def learn_all(
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial]],
    method: Method,
    kept: Kept | None = None,
) -> dict[str, tuple[Learned, ...]]:
    """Runs of each of the candidates ``given`` by name, the one with the least validation error first; none for one
    that came too late.

    trials: to train on and to validate; method: how; kept: finished runs, which are taken from there, and to which
    others are added as they come. Raises UserError for trials from which nothing can be learned, TooLate where all
    candidates came too late.
    """
    kept = kept or Kept()
    runs = [
        SeededRun(one, seed, kept.path(f"{one.name}_seed{seed}.safetensors"))
        for one in given
        for seed in range(method.seed, method.seed + method.seeds)
    ]
    found = {run.name: content for run in runs if (content := kept.get(run.name)) is not None}
    left = [run for run in runs if run.name not in found]

    def keep(content: dict[str, Any]) -> None:
        if late := content.get("too_late"):
            LOGGER.warning(late)
            return
        kept.put(f"{content['name']}_seed{content['seed']}", content)
        LOGGER.info(
            f"{content['name']}, seed {content['seed']}: J {content['objective']:.4g}, validation "
            f"{content['validation']:.4g} after {content['seconds']:.0f} s"
        )

    task = partial(_in_time, trials=trials, method=method)
    if len(left) == 1 and method.optimizer == "cmaes":  # its generations are spread instead
        with kept_workers(method.workers):
            found[left[0].name] = content = task(left[0])
        keep(content)
        left = []
    for run, content in zip(left, run_all(task, left, method.workers, keep, "models"), strict=True):
        found[run.name] = content
    late = [content["too_late"] for content in found.values() if "too_late" in content]
    if late and len(late) == len(runs):
        raise TooLate(late[0])
    try:
        done = [Learned.of(found[run.name]) for run in runs if "too_late" not in found[run.name]]
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{kept.folder}: holds a part that cannot be read ({error}); start without --resume") from None
    by_name = {one.name: [row for row in done if row.name == one.name] for one in given}
    return {
        name: tuple(sorted(rows, key=lambda row: row.validation if row.validation >= 0 else float("inf")))
        for name, rows in by_name.items()
    }


def _in_time(run: SeededRun, trials: tuple[Sequence[Trial], Sequence[Trial]], method: Method) -> dict[str, Any]:
    """As ``learn_one``; of a run that came too late why."""
    try:
        return learn_one(run, trials, method)
    except TooLate as error:
        return {"too_late": str(error)}


def learn_one(run: SeededRun, trials: tuple[Sequence[Trial], Sequence[Trial]], method: Method) -> dict[str, Any]:
    """One ``run`` on ``trials`` to train on and to validate, by ``method``: plain values of ``Learned``.

    The time limit counts from here: compiling and preparing belong to it. Raises TooLate where it had passed before
    anything was evaluated.
    """
    began = time.perf_counter()
    problem = SubsequenceObjective(run.candidate.ship, *trials, compiled=method.compiled)
    learning = Learning(problem, began=began)
    limit = float("inf") if method.time_limit is None else method.time_limit
    if method.optimizer == "cmaes":
        problem.penalties = Penalties(sparsity=SPARSITY)
        most = float("inf") if method.evaluations is None else method.evaluations
        evolve(learning, run.seed, limit, most, state=run.state)
    else:
        start = regression(problem)
        if run.seed != method.seed:
            rng = np.random.default_rng([37, run.seed])
            start = np.clip(start + SPREAD * rng.standard_normal(problem.P), problem.lower, problem.upper)
        follow(problem, start, learning, limit)
    if not learning.lessons:
        raise TooLate(
            f"{run.candidate.name}: nothing was evaluated within --time-limit {limit:g}: compiling and preparing took "
            f"{learning.seconds:.0f} s; give more"
        )
    p = learning.p_chosen
    train, validate = problem.train, problem.validate
    assert validate is not None
    own = problem.ship_at(p)
    symbols = problem.prior.symbols
    return Learned(
        name=run.candidate.name,
        seed=run.seed,
        values={s: own.coefficients[s].value for s in symbols},
        vanished=tuple(s for s, x, sparse in zip(symbols, p, problem.sparse, strict=True) if sparse and x == 0),
        training=float(problem.errors(p[:, None], train)[0]),
        validation=float(problem.errors(p[:, None], validate)[0]),
        objective=learning.best,
        seconds=learning.seconds,
        evaluations=learning.lessons[-1].evaluations if learning.lessons else 0,
        lessons=tuple(learning.lessons),
    ).to_dict()


def follow(problem: SubsequenceObjective, start: np.ndarray, learning: Learning, limit: float) -> None:
    """The path of the sparsity from strong to weak on ``problem``, then the descent without any.

    Notes all in ``learning``; from ``start`` (P,); ends early where validation grows worse, or at the ``limit`` [s].
    """
    worse, last = [0], [start]

    def each(weight: float, p: np.ndarray) -> bool:
        lesson = learning.note(p)
        last[0] = p
        worse[0] = worse[0] + 1 if lesson.validation > WORSE * learning.chosen else 0
        return worse[0] >= PATIENCE or learning.seconds > limit

    sparsity_path(problem, start, SPARSITIES, each, 10, limit - learning.seconds)
    if worse[0] < PATIENCE and learning.seconds <= limit:
        problem.penalties = replace(problem.penalties, sparsity=0.0)
        descend(problem, last[0], learning, limit, (1.0,), 20)
