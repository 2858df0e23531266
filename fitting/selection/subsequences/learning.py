"""What an optimiser learns on its way: the objective against evaluations and time, and the best on validation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cases.io.files import replace_text
from fitting.selection.subsequences.objective import SubsequenceObjective


@dataclass(frozen=True)
class Lesson:
    """One point of a learning curve.

    evaluations: simulations of all training subsequences so far; seconds: of the optimiser so far; objective: J of its
    current point; training, validation: E of it, the latter NaN without validation trials.
    """

    evaluations: int
    seconds: float
    objective: float
    training: float
    validation: float


@dataclass
class Learning:
    """The learning curve of one run of an optimiser on ``objective``, which began at ``began`` by the clock of
    ``time.perf_counter``.

    before, earlier: seconds and evaluations of an interrupted run. lessons: the curve; best, p: least objective and
    where; chosen, p_chosen: the least validation error and where, without validation trials as best and p.
    """

    objective: SubsequenceObjective
    before: float = 0.0
    earlier: int = 0
    lessons: list[Lesson] = field(default_factory=list)
    best: float = float("inf")
    p: np.ndarray = field(default_factory=lambda: np.zeros(0))
    chosen: float = float("inf")
    p_chosen: np.ndarray = field(default_factory=lambda: np.zeros(0))
    began: float = field(default_factory=lambda: time.perf_counter())

    def __post_init__(self) -> None:
        self._first = self.objective.evaluations
        self.p = self.p_chosen = np.zeros(self.objective.P)

    @property
    def seconds(self) -> float:
        """Of the optimiser so far."""
        return self.before + time.perf_counter() - self.began

    def note(self, p: np.ndarray) -> Lesson:
        """Adds the point ``p`` (P,) to the curve; its evaluation does not count."""
        problem = self.objective
        evaluations, seconds = self.earlier + problem.evaluations - self._first, self.seconds
        before = problem.evaluations
        value = float(problem.values(p[:, None])[0])
        training = float(problem.errors(p[:, None], problem.train)[0])
        validation = float(problem.errors(p[:, None], problem.validate)[0]) if problem.validate else float("nan")
        problem.evaluations = before
        lesson = Lesson(evaluations, seconds, value, training, validation)
        self.lessons.append(lesson)
        self.offer(p, value)
        judged = validation if problem.validate else value
        if judged < self.chosen:
            self.chosen, self.p_chosen = judged, p.copy()
        return lesson

    def offer(self, p: np.ndarray, value: float) -> None:
        """Keeps the point ``p`` (P,) with this ``value`` of J if it is the best so far."""
        if value < self.best:
            self.best, self.p = value, p.copy()


def write_learning(curves: Sequence[tuple[str, int, Sequence[Lesson]]], path: Path) -> None:
    """Writes learning curves as CSV to ``path``: candidate, seed and lessons of each of ``curves``."""
    rows = ["candidate,seed,evaluations,seconds,objective,training,validation"]
    for name, seed, lessons in curves:
        rows += [
            f"{name},{seed},{s.evaluations},{s.seconds:.3f},{s.objective:.9g},{s.training:.9g},{s.validation:.9g}"
            for s in lessons
        ]
    replace_text(path, "\n".join(rows) + "\n")
