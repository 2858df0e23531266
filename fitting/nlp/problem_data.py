"""A calibration problem as plain data, to be built again in another process (compiled code cannot travel)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.nlp.captive import Captive, CaptiveForces
from fitting.nlp.loss import Loss
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import kernels
from fitting.nlp.windows import Segments
from mmg.model import assemble
from mmg.ship import Ship


@dataclass(frozen=True)
class ProblemData:
    """What a Problem is made of. compiled: whether its kernels were."""

    ship: Ship
    prior: Prior
    segments: Segments
    sigma: np.ndarray
    loss: Loss
    captive: Captive | None
    compiled: bool

    @classmethod
    def of(cls, problem: Problem) -> ProblemData:
        """What ``problem`` is made of."""
        points = problem.captive.points if problem.captive else None
        compiled = not problem.kernels.interpreted_because
        return cls(problem.ship, problem.prior, problem.segments, problem.sigma, problem.loss, points, compiled)

    def problem(self) -> Problem:
        """The problem again; its compiled code comes from the cache."""
        free = self.prior.positions(self.ship)
        kernel = kernels(assemble(self.ship), free, self.compiled)
        shared = free[: self.prior.shared]
        forces = CaptiveForces(kernel.model, shared, self.captive, self.compiled) if self.captive else None
        return Problem(self.ship, self.prior, kernel, self.segments, self.sigma, self.loss, forces)
