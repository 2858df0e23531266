"""Estimates with runs drawn anew: the bootstrap by run.

Runs are resampled, never samples: residuals of one run belong together (block bootstrap, Kuensch 1989; by cluster,
Cameron, Gelbach & Miller 2008). Each replicate also draws the prior's centres anew from the prior, so that the spread
includes the uncertainty of the prior; without that, a coefficient that no run excites would look certain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fitting.nlp.fisher_information import Information
from fitting.nlp.loss import Loss
from fitting.nlp.problem import Problem
from fitting.parallel import Shared, run_all, width
from fitting.solvers.leading import solve_led

WARM = {"ipopt.mu_init": 1e-3, "ipopt.warm_start_init_point": "yes", "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6}
"""IPOPT options for a refit that starts near its optimum."""
REFIT_TOLERANCE, REFIT_ITERATIONS = 1e-4, 100
CHUNK = 5
"""Refits of a task: few, so that workers end together and little is lost with one of them."""


@dataclass(frozen=True)
class Replicates:
    """Estimates of changed data, scaled and relative to the original prior.

    p: (replicates, P), NaN where a refit failed; failures: (number, reason) of those.
    """

    p: np.ndarray
    failures: tuple[tuple[str, str], ...]

    @property
    def good(self) -> np.ndarray:
        """Replicates that did not fail, (n, P)."""
        return self.p[np.isfinite(self.p).all(axis=1)]


def reweighted(problem: Problem, x: np.ndarray, counts: np.ndarray, shift: np.ndarray) -> tuple[Problem, np.ndarray]:
    """The ``problem`` in which window w counts ``counts[w]`` times (W,), the prior's centre moved by ``shift`` (P,).

    Windows that do not count are left out; also returns which nodes (B,) are kept. A robust loss becomes the weights
    that it gives the samples at x (n,).
    """
    seg = problem.segments
    kept = np.flatnonzero(counts > 0)
    prior = replace(problem.prior, mean=problem.prior.mean + problem.prior.std * shift)
    part = problem.with_changes(prior=prior, segments=seg.subset(kept), loss=Loss())
    times, kept_nodes, kept_at = counts[kept].astype(float), np.isin(seg.node_window, kept), np.isin(seg.window, kept)
    node_weight, weight = problem.weights_at(x)
    at_nodes, inside = times[part.segments.node_window], times[part.segments.window]
    part.scale = problem.scale
    part.measured_nodes = problem.measured_nodes[kept_nodes]
    part.node_weight = node_weight[kept_nodes] * at_nodes[:, None]
    part.memory_weight = part.memory_weight * at_nodes[:, None]
    part.weight = weight[:, :, kept_at] * inside
    return part, kept_nodes


def refit(task: tuple[Shared[tuple[Problem, np.ndarray]], np.ndarray, np.ndarray]) -> list[tuple[np.ndarray, str]]:
    """(p relative to the original prior (P,), reason of failure or "") of each replicate of a ``task``.

    A task is a problem with x (n,) at its estimate, how often each window counts (replicates, W), and the shifts of the
    prior's centres in prior standard deviations (replicates, P).
    """
    (problem, x), counts, shifts = task[0].value, *task[1:]
    return [_refit_one(problem, x, c, s) for c, s in zip(counts, shifts, strict=True)]


def _refit_one(problem: Problem, x: np.ndarray, counts: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, str]:
    nothing = np.full(problem.P, np.nan)
    if not (counts > 0).any():
        return nothing, "no window is left"
    try:
        nodes, p = problem.split(x)
        part, kept = reweighted(problem, x, counts, shift)
        start = part.join(nodes[kept], np.clip(p - shift, *part.p_bounds()))
        with np.errstate(all="ignore"):
            s = solve_led(part, start, REFIT_TOLERANCE, REFIT_ITERATIONS, None, None, "refit", WARM)
    except Exception as error:  # a replicate that breaks is a result, not the end of the others
        return nothing, f"{type(error).__name__}: {error}"
    if not s.converged and s.status != "Solved_To_Acceptable_Level":
        return nothing, s.status
    return part.split(s.x)[1] + shift, ""


def drawn_runs(run: np.ndarray, replicates: int, rng: np.random.Generator) -> np.ndarray:
    """How often each window counts when its ``run`` (W,) is drawn with replacement by ``rng``, (replicates, W)."""
    runs, position = np.unique(run, return_inverse=True)
    drawn = rng.multinomial(len(runs), np.full(len(runs), 1 / len(runs)), size=replicates)
    return drawn[:, position]


def bootstrap(
    info: Information, replicates: int, seed: int, problem: Problem, x: np.ndarray, workers: int = 1
) -> Replicates:
    """Estimates of ``replicates`` data sets: runs drawn with replacement, prior centres drawn from the prior, and
    refits over ``workers`` processes.

    info: of the windows of the ``problem`` at its solution x (n,). The draws depend on the ``seed`` only, not on the
    number of workers. A single run is replaced by its windows.
    """
    rng = np.random.default_rng([11, seed])
    clusters = info.run if len(np.unique(info.run)) > 1 else np.arange(len(info.run))
    counts = drawn_runs(clusters, replicates, rng)
    # a centre outside the bounds is no prior of this ship
    shifts = np.clip(rng.standard_normal((replicates, len(info.p))), *problem.p_bounds())
    parts = -(-replicates // CHUNK) if width(workers) > 1 else 1
    shared = Shared((problem, x))
    tasks = [(shared, counts[i], shifts[i]) for i in np.array_split(np.arange(replicates), parts)]
    outcomes = [outcome for part in run_all(refit, tasks, workers, name="bootstrap, parts") for outcome in part]
    failures = tuple((str(i), why) for i, (_, why) in enumerate(outcomes) if why)
    return Replicates(np.array([p for p, _ in outcomes]), failures)
