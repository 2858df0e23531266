"""The objective of a calibration as a function of the coefficients alone, for optimisers and samplers from outside.

Given the coefficients the windows have nothing in common, and each leaves its first state free. That state is
eliminated: the reduced objective is the minimum of the objective over the node states (variable projection, Golub &
Pereyra 1973), so its minimum over the coefficients is that of the whole problem. By the envelope theorem its gradient
is the derivative of the objective where the nodes are optimal.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.nlp.fisher_information import information
from fitting.nlp.problem import Problem
from fitting.parallel import with_one_thread
from fitting.solvers.condensing import Lead, lead
from mmg.errors import BadValue, UnknownName, as_array, by_name, refusing

# Predicted relative change of the objective [-] at which the node states count as optimal: finite differences of steps
# of 1e-5 prior standard deviations then have five digits. Set by hand.
TOLERANCE = 1e-12
FEASIBLE = 1e-9  # Largest scaled gap [-] between the end of an interval and the next node there. Set by hand.
MOST_STEPS = 50  # Steps of that minimisation; a few suffice near the calibration. Set by hand.
# The same gap up to which states that are not optimal after so many steps still count. Set by hand: a line search that
# went too far needs a number, not an exact one.
JOINED = 1e-3


@refusing
class ReducedProblem:
    """What ``calibrate`` minimises, by the free coefficients in physical units.

    The value is the negative log posterior density, up to a constant, with the noise that the last solve assumed: half
    the sum of weighted squared residuals (by the loss of the fit) over the best states of the windows, and half the
    squares of what coefficients are off the mean of their prior, in its standard deviations. Its minimum within the
    bounds is where multiple shooting ended: ``start``, and the coefficients of a result of ``estimator="windows"``. The
    default result is the mean with a second estimate, whose likelihood is another one.

    symbols: of the P coefficients, those of single runs or campaigns behind the others; start: (P,) estimate of
    multiple shooting; scale: (P,) prior standard deviations; bounds: lower and upper ones, (P,) each.
    """

    def __init__(self, problem: Problem, x: np.ndarray) -> None:
        """problem: as the last solve had it; x: (n,) where that ended."""
        prior, (self._nodes, p) = problem.prior, problem.split(x)
        self._problem = problem
        self.symbols, self.scale = prior.symbols, prior.std.copy()
        self.bounds = prior.lower.copy(), prior.upper.copy()
        self.start = np.clip(prior.mean + prior.std * p, *self.bounds)
        self._last: tuple[np.ndarray, Problem, Lead] | None = None

    @with_one_thread
    def objective(self, p: Mapping[str, float] | np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient (P,) at the coefficients ``p``: (P,) as ``symbols``, or by symbol, others at ``start``.

        Infinite, with a gradient of zeros, where no finite states join the intervals. Bounds are not regarded. Raises
        UserError for an unknown symbol or another number of coefficients.
        """
        problem, x, _ = self._with_best_states(p)
        value = self.value(p)  # of the same states, which are kept
        if not np.isfinite(value):
            return value, np.zeros(len(self.scale))
        info = information(problem, x)  # envelope theorem: the score at optimal nodes is the gradient
        return value, (info.score.sum(axis=0) + info.prior_score) / self.scale

    @with_one_thread
    def value(self, p: Mapping[str, float] | np.ndarray) -> float:
        """That of ``objective`` alone. Raises UserError as it."""
        problem, x, is_found = self._with_best_states(p)
        return float(problem.objective(x)) if is_found else np.inf

    @with_one_thread
    def residuals(self, p: Mapping[str, float] | np.ndarray) -> np.ndarray:
        """Weighted residuals (N,) of samples, captive tests and prior at ``p``, as of ``objective``, whose value is
        half the sum of their squares; infinite where that is. Raises UserError as ``objective``."""
        problem, x, is_found = self._with_best_states(p)
        nodes, scaled = problem.split(x)
        weights = (problem.node_weight, problem.weight)
        parts = [
            (np.sign(e) * np.sqrt(problem.loss.cost(w, e)))[w > 0]  # half its square is half phi
            for w, e in zip(weights, problem.errors(x), strict=True)
        ]
        memory = np.sqrt(problem.memory_weight)
        parts.append((memory * (nodes - problem.measured_nodes)[:, 6:])[memory > 0])
        if problem.captive:
            weight, forces = problem.captive.weight, problem.captive.residuals(problem.captive_coefficients(scaled))
            parts.append((np.sqrt(weight) * forces)[weight > 0])
        every = np.concatenate([*parts, scaled])
        return every if is_found else np.full_like(every, np.inf)

    def best_states(self, p: Mapping[str, float] | np.ndarray) -> np.ndarray | None:
        """All variables (n,) of the problem at ``p`` with the states that minimise the objective; None where no finite
        states join the intervals. Raises UserError as ``objective``."""
        _, x, is_found = self._with_best_states(p)
        return x.copy() if is_found else None

    def _with_best_states(self, p: Mapping[str, float] | np.ndarray) -> tuple[Problem, np.ndarray, bool]:
        """The problem with its coefficients bound to ``p``, where the best node states are (n,), and whether they were
        found; always from the states of the calibration, so that ``p`` alone decides the value."""
        wanted = self._vector(p)
        if self._last is None or not np.array_equal(wanted, self._last[0]):
            held = self._problem.with_bounds(wanted, wanted)  # equal bounds: nodes alone are free
            with np.errstate(all="ignore"):
                found = lead(held, held.join(self._nodes, held.p_bounds()[0]), TOLERANCE, MOST_STEPS, feasible=FEASIBLE)
            self._last = wanted, held, found
        _, held, found = self._last
        with np.errstate(all="ignore"):
            value, gap = held.objective(found.x), np.abs(held.defects(found.x)).max(initial=0.0)
        return held, found.x, bool(np.isfinite(value) and gap < JOINED)

    def _vector(self, p: Mapping[str, float] | np.ndarray) -> np.ndarray:
        p = by_name(p)
        if isinstance(p, dict):
            if unknown := [s for s in p if s not in self.symbols]:
                names = ", ".join(self.symbols)
                raise UnknownName(f"{', '.join(map(str, unknown))}: not free; coefficients of this fit are {names}")
            return np.array([p.get(s, x) for s, x in zip(self.symbols, self.start, strict=True)], dtype=float)
        vector: np.ndarray = as_array("p", p)
        if vector.shape != self.start.shape:
            raise BadValue(f"coefficients of shape {vector.shape}: must be {self.start.shape}, in the order of symbols")
        return vector
