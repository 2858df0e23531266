"""The objective minimised as Miyauchi et al. (2023) do: CMA-ES with restarts and a box, through pycma.

Restarts double the population (Auger & Hansen 2005). A population is simulated at once, in parts by the workers of an
executor where one is in force. What CMA-ES knows follows from
the seed and the values it was told, so that these are kept; an interrupted run is told them again and goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save_file

from cases.io.files import replaced
from fitting.parallel import Shared, run_all, width
from fitting.selection.subsequences.learning import Learning, Lesson
from fitting.selection.subsequences.objective import SubsequenceObjective
from mmg.errors import UserError

SIGMA = 0.3
"""First step size, in standard deviations of the priors."""
EVERY = 20
"""Generations between two points of the learning curve."""
SAVED = 30.0
"""Seconds after which the state is saved again."""


@dataclass(frozen=True)
class Evolved:
    """Where the evolution ended: generations in all, restarts, whether a limit stopped it."""

    generations: int
    restarts: int
    limited: bool


def needs_cma(what: str) -> None:
    """Raises UserError where pycma, which ``what`` needs, is missing."""
    try:
        import cma  # noqa: F401
    except ImportError:
        raise UserError(f"{what} needs pycma, which is not installed; pip install 'mmg-ident[cma]'") from None


def evolve(
    learning: Learning,
    seed: int = 0,
    time_limit: float = np.inf,
    evaluations: float = np.inf,
    restarts: int = 9,
    state: Path | None = None,
    start: np.ndarray | None = None,
) -> Evolved:
    """CMA-ES on the objective of ``learning``, where all that it finds is noted.

    seed: of its draws; time_limit [s], evaluations: where it is stopped, after a generation; restarts: most of them;
    state: file from which an interrupted run of the same problem goes on, where it is there, and to which the state is
    written; start: of the first run (P,), by default 0; later ones start at random in the middle of the box. Raises
    UserError where pycma is missing, and for a state of another problem or one that cannot be rebuilt here.
    """
    needs_cma("--optimizer cmaes")
    import cma

    problem, log = learning.objective, _ValuesTold(learning, seed, state)
    population = _Population(problem)
    rng, first = np.random.default_rng([31, seed]), np.zeros(problem.P) if start is None else start
    for restart in range(restarts + 1):
        size = int(4 + 3 * np.log(problem.P)) * 2**restart
        begin = first if restart == 0 else np.clip(rng.standard_normal(problem.P), problem.lower, problem.upper)
        strategy: Any = cma.CMAEvolutionStrategy(
            np.clip(begin, 0.99 * problem.lower, 0.99 * problem.upper),
            SIGMA,
            {
                "bounds": [problem.lower.tolist(), problem.upper.tolist()], "popsize": size, "seed": np.nan,
                "randn": lambda *shape: rng.standard_normal(shape), "verbose": -9, "verb_log": 0,
            },
        )  # fmt: skip
        while not strategy.stop():
            points = strategy.ask()
            if log.replaying:
                strategy.tell(points, log.next(size))
                log.verify(strategy.mean)
                continue
            if learning.seconds > time_limit or log.spent + size > evaluations:
                log.save(strategy.mean)
                if learning.best < np.inf:  # a state that is continued has no lesson of the limit
                    learning.note(learning.p)
                return Evolved(len(log.told), restart, True)
            candidates = np.transpose(points)
            values = population.values(candidates)
            values = np.where(np.isfinite(values), values, np.finfo(float).max)  # as bad as a candidate can be
            strategy.tell(points, values.tolist())
            log.add(values)
            best = int(np.argmin(values))
            learning.offer(candidates[:, best], float(values[best]))
            if len(log.told) % EVERY == 0:
                learning.note(np.asarray(strategy.result.xfavorite))
            log.save(strategy.mean, SAVED)
        learning.note(learning.p)
    return Evolved(len(log.told), restarts, False)


class _Population:
    """Values of a generation, spread over the workers of the executor in force; without one this process does all."""

    def __init__(self, problem: SubsequenceObjective) -> None:
        self.problem = problem
        self.shared = Shared(problem) if width(1) > 1 else None

    def values(self, candidates: np.ndarray) -> np.ndarray:
        """J (K,) of ``candidates`` (P, K), the same however they are spread."""
        if self.shared is None:
            return self.problem.values(candidates)
        parts = np.array_split(candidates, min(width(1), candidates.shape[1]), axis=1)
        values = np.concatenate(run_all(_values, [(self.shared, part) for part in parts]))
        self.problem.evaluations += len(values)
        return values


def _values(job: tuple[Shared[SubsequenceObjective], np.ndarray]) -> np.ndarray:
    """J (K,) of a part (P, K) of a generation."""
    return job[0].value.values(job[1])


class _ValuesTold:
    """Values told so far, and the file that keeps them. learning: that is kept along; seed, path: as of ``evolve``."""

    def __init__(self, learning: Learning, seed: int, path: Path | None) -> None:
        self.learning, self.path = learning, path
        self.told: list[np.ndarray] = []
        self.position, self.spent, self._saved = 0, 0, learning.seconds
        self.mean = np.zeros(0)
        problem = learning.objective
        weights = problem.penalties
        probe = problem.values(np.zeros((problem.P, 1)))[0]  # tells one set of trials from another
        problem.evaluations -= 1
        self.key = np.array([problem.P, seed, weights.deviation, weights.sparsity, probe])
        if path is not None and path.exists():
            self._read(path)

    @property
    def replaying(self) -> bool:
        """Whether values of the interrupted run are left."""
        return self.position < len(self.told)

    def next(self, size: int) -> list[float]:
        """The next values of the interrupted run, of a population of ``size``."""
        values = self.told[self.position]
        if len(values) != size:
            raise self._other()
        self.position += 1
        return [float(value) for value in values]

    def add(self, values: np.ndarray) -> None:
        """Values of a new generation."""
        self.told.append(values)
        self.position = len(self.told)
        self.spent += len(values)

    def verify(self, mean: np.ndarray) -> None:
        """Raises UserError unless the strategy, told all again, has the mean (P,) that it had."""
        if not self.replaying and not np.allclose(mean, self.mean, rtol=1e-6, atol=1e-9):
            raise UserError(f"{self.path}: CMA-ES cannot be rebuilt here as it was; start again without --resume")

    def save(self, mean: np.ndarray, after: float = 0.0) -> None:
        """Writes the state, where the last time is ``after`` seconds ago."""
        if self.path is None or self.learning.seconds - self._saved < after:
            return
        found = self.learning
        lessons = [[s.evaluations, s.seconds, s.objective, s.training, s.validation] for s in found.lessons]
        content = {
            "key": self.key, "mean": np.array(mean, dtype=float), "sizes": np.array([len(v) for v in self.told]),
            "values": np.concatenate([*self.told, np.zeros(0)]), "lessons": np.array(lessons).reshape(-1, 5),
            "p": found.p, "p_chosen": found.p_chosen, "least": np.array([found.best, found.chosen, found.seconds]),
        }  # fmt: skip
        with replaced(self.path) as scratch:
            save_file({k: np.ascontiguousarray(v) for k, v in content.items()}, scratch)
        self._saved = found.seconds

    def _read(self, path: Path) -> None:
        try:
            content = dict(load_file(path))
            key = content["key"]
            edges = np.cumsum(content["sizes"])
            self.told = np.split(content["values"], edges[:-1]) if len(edges) else []
            found, least = self.learning, content["least"]
            rows, p, p_chosen, self.mean = (content[name] for name in ("lessons", "p", "p_chosen", "mean"))
        except Exception as error:
            raise UserError(f"{path}: cannot be read ({error}); start again without --resume") from None
        if key.shape != self.key.shape or not np.allclose(key, self.key, rtol=1e-6):
            raise self._other()
        self.spent = int(edges[-1]) if len(edges) else 0
        found.lessons = [Lesson(int(row[0]), *map(float, row[1:])) for row in rows]
        found.p, found.p_chosen = p, p_chosen
        found.best, found.chosen, found.before = float(least[0]), float(least[1]), float(least[2])
        found.earlier = self.spent

    def _other(self) -> UserError:
        return UserError(f"{self.path}: belongs to another ship, seed, penalty or trials; start again without --resume")
