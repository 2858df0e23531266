"""What chance does to the tests, by simulation: a parametric bootstrap of the fitted model (Davison & Hinkley 1997).

New random forces push the fitted ship along the same inputs, new sensor errors are added, priors are drawn again, and
all is fitted and tested as the trials were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point, Trajectory
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.score_test import score_tests, slopes
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.hypotheses.unnamed import unnamed_slopes
from fitting.parallel import run_all
from fitting.report.parts import Store
from mmg.progress import OnProgress, Progress

Task = tuple[TransitionModel, GriddedTrials, Estimate, Sequence[Candidate], np.random.SeedSequence]
"""Model, trials, the fit that is the truth, candidates, and the seed of one campaign."""
FITS = 5
"""Linearisations of a fit, which starts at the truth."""


@dataclass(frozen=True)
class SimulatedChance:
    """Tests of D simulated campaigns in which nothing is missing: unnamed (D, 2), as ``UnnamedForms.chance``; smallest:
    (D,) probability of any candidate by itself."""

    unnamed: np.ndarray
    smallest: np.ndarray

    def of_smallest(self, p_single: float) -> float:
        """Probability that chance gives a candidate as small a probability ``p_single`` by itself."""
        return float((1 + (self.smallest <= p_single).sum()) / (1 + len(self.smallest)))


def simulated_chance(
    problem: SearchProblem,
    null: Estimate,
    draws: int,
    seed: int = 0,
    workers: int = 1,
    progress: OnProgress | None = None,
    store: Store | None = None,
) -> SimulatedChance:
    """Simulate, fit and test as many campaigns as ``draws`` without any effect.

    problem: whose trials give inputs and masks; null: the fit that is taken for the truth; seed: of all that is drawn;
    workers: processes; progress: called after each campaign; store: of finished campaigns, which are not simulated
    again. Returns the tests.
    """
    children = np.random.SeedSequence(seed).spawn(draws)
    done = 0

    def note(_: tuple[float, float, float]) -> None:
        nonlocal done
        done += 1
        if progress:
            progress(Progress("simulated campaigns", done, draws, {}))

    if store is not None:
        store.open()
    tasks = [(problem.steps, problem.data, null, problem.candidates, child) for child in children]
    jobs = [(task, store, f"campaign_{k}") for k, task in enumerate(tasks)]
    rows = np.array(run_all(_kept_tests, jobs, workers, note))
    return SimulatedChance(rows[:, :2], rows[:, 2])


def _kept_tests(job: tuple[Task, Store | None, str]) -> tuple[float, float, float]:
    """The tests of a task as a store kept them under a name, or made now and kept there."""
    task, store, name = job
    known = store.load(name) if store is not None else None
    if known is not None and "tests" in known[1] and known[1]["tests"].shape == (3,):
        mixture, single, smallest = known[1]["tests"].tolist()
        return mixture, single, smallest
    tests = simulated_tests(task)
    if store is not None:
        store.save(name, {}, {"tests": np.array(tests)})
    return tests


def simulated_tests(
    task: Task,
) -> tuple[float, float, float]:
    """The tests of one simulated campaign, of the arguments in ``task`` as processes take them."""
    steps, data, null, candidates, child = task
    rng = np.random.default_rng(child)
    seen, path = simulated_trials(steps, data, null, rng)
    p = rng.standard_normal(len(null.p))  # the truth as the priors see it
    free = replace(null.free, mean=null.free.mean + null.free.std * (null.p - p))
    fit = estimate(steps, seen, Point(null.theta, free, p, path, null.noise), FITS)
    words = unnamed_slopes(steps, seen, fit)
    mixture, single, _ = words.statistics(words.g)
    best = score_tests(slopes(steps, seen, fit, candidates), candidates)[0]
    return float(mixture), float(single), best.p_single


def simulated_trials(
    steps: TransitionModel, data: GriddedTrials, found: Point, rng: np.random.Generator
) -> tuple[GriddedTrials, Trajectory]:
    """``data`` with logged columns drawn from the fitted model, and the true path behind them.

    steps: the transition model; found: the fit; rng: of random forces and sensor errors, coloured ones included.
    """
    noise, h = found.noise, data.h
    data = acting(steps, data, found.theta)
    (K, R), controls = data.inputs.shape[:2], data.controls
    force = _processes(K + 1, R, noise.force, noise.tau, h, rng)
    path = Trajectory(found.path.z, force)
    if data.gusts is not None:
        path = replace(path, gust=_processes(K + 1, R, noise.gust, noise.gust_tau, h, rng), gusts=data.gusts)
    z = steps.follow(found.path.z, controls, found.theta, force=path.push[:-1])
    y = steps.logged(z, found.theta) + noise.white * rng.standard_normal(data.y.shape)
    y += _processes(K + 1, R, noise.coloured, noise.colour_tau, h, rng)
    return replace(data, y=np.where(data.measured, y, 0.0)), path.along(z)


def _processes(rows: int, runs: int, sizes: np.ndarray, tau: float, h: float, rng: np.random.Generator) -> np.ndarray:
    """Stationary first-order processes (rows, runs, c) of ``sizes`` (c,) and correlation time tau [s]."""
    x = rng.standard_normal((rows, runs, len(sizes)))
    left = np.exp(-h / tau)
    for k in range(1, rows):
        x[k] = left * x[k - 1] + np.sqrt(1 - left**2) * x[k]
    return x * sizes
