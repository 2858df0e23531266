"""Calibration of a ship on trials: the one function that ``mmg fit`` calls."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cases.checks import inputs_are_constant
from cases.inputs import actuator_columns
from cases.trial import Trial
from fitting import gauss_newton
from fitting.ipopt import Solution
from fitting.noise import Noise
from fitting.passes import solve_passes, solve_starts
from fitting.problem import Prior, Problem
from fitting.segments import Segments, cut, default_step
from fitting.settings import Report, Settings, Start
from fitting.shooting import Kernels, kernels
from fitting.verdicts import calibrated_ship, warnings_of
from mmg.errors import UserError
from mmg.model import assemble
from mmg.ship import Ship


@dataclass(frozen=True)
class Calibration:
    """A calibrated ship and how it came about.

    ship: with estimates, standard errors, priors and verdicts. p, covariance: scaled estimate (P,) and its covariance
    (P, P) in prior standard deviations. sigma: (6,) used in the last solve; noise: estimated from its residuals.
    solution: of the last solve; history: objective and status of every pass.
    """

    ship: Ship
    prior: Prior
    p: np.ndarray
    covariance: np.ndarray
    sigma: np.ndarray
    noise: Noise
    solution: Solution
    segments: Segments
    settings: Settings
    passes: tuple[dict, ...]
    starts: tuple[Start, ...]
    warnings: tuple[str, ...]
    notices: tuple[str, ...]
    timings: dict[str, float] = field(default_factory=dict)
    nodes: np.ndarray = field(default_factory=lambda: np.empty((0, 6)))

    @property
    def converged(self) -> bool:
        return self.solution.converged

    @property
    def standard_errors(self) -> np.ndarray:
        """Standard errors of the free coefficients in their own units, (P,)."""
        return np.sqrt(np.diag(self.covariance)) * self.prior.std


def _check_inputs(ship: Ship, trials: Sequence[Trial]) -> None:
    if not trials:
        raise UserError("no trials to fit: name at least one trial file")
    if not ship.free:
        raise UserError(f"{ship.name}: every coefficient is fixed; free some of them in the ship file or with --only")
    if all(inputs_are_constant(t) for t in trials):
        raise UserError(
            f"{', '.join(t.name for t in trials)}: the inputs n and delta never change, so there is nothing to "
            "identify; give trials with manoeuvres"
        )


def first_sigma(ship: Ship, segments: Segments) -> np.ndarray:
    """Residual standard deviations of the first pass (6,): a third of a length, 0.1 rad, a tenth of the speed."""
    speed = np.sqrt(np.mean(segments.nodes[:, 3] ** 2 + segments.nodes[:, 4] ** 2)) + 1e-6
    length = ship.particulars["L"]
    return np.array([length / 3, length / 3, 0.1, 0.1 * speed, 0.1 * speed, 0.1 * speed / length])


@np.errstate(all="ignore")
def calibrate(
    ship: Ship,
    trials: Sequence[Trial],
    settings: Settings | None = None,
    report: Report | None = None,
    warm: dict[str, np.ndarray] | None = None,
) -> Calibration:
    """Fit the free coefficients of a ship to trials, jointly over all of them.

    The residual's standard deviation of each state is re-estimated from pass to pass (``Noise``) until it settles.
    report(pass name, iteration, objective, constraint violation) follows the solver. ``warm`` holds "p", "nodes" and
    "sigma" of an earlier, interrupted run. Raises UserError for input from which nothing can be identified; a solver
    that stops early is no error: the best iterate is returned and ``converged`` is False.
    """
    settings = settings or Settings()
    began = time.perf_counter()
    _check_inputs(ship, trials)
    length = ship.particulars["L"]
    step = settings.step or default_step(trials, length)
    window = settings.window or 100.0 * step
    if window < 10 * step:
        raise UserError(f"a window of {window:g} s holds fewer than ten steps of {step:g} s; use a longer --window")
    segments = cut(trials, step, window, settings.interval, inputs=ship.inputs)
    prior = Prior.of(ship)
    positions = np.array([ship.symbols.index(s) for s in prior.symbols])
    kernel = kernels(assemble(ship), positions, settings.compiled)
    timings = {"prepare": time.perf_counter() - began}
    notices = [*segments.dropped, *ship.notices, *_missing(trials), *_assumed(ship, trials)]
    if kernel.interpreted_because:
        notices.append(f"running without compiled code, several times slower: {kernel.interpreted_because}")
    sigma = _given_sigma(settings) if settings.sigma else first_sigma(ship, segments)
    problem = Problem(ship, prior, kernel, segments, sigma)
    x = problem.start()
    if warm and len(warm.get("p", ())) == problem.P:
        if len(warm.get("nodes", ())) == problem.B:
            x = problem.join(warm["nodes"], np.clip(warm["p"], *problem.p_bounds()))
        problem = problem.with_sigma(warm["sigma"]) if not settings.sigma else problem
    problem, solution, noise, passes = solve_passes(problem, x, settings, began, report)
    timings["solve"] = time.perf_counter() - began - timings["prepare"]
    best, starts = solve_starts(problem, solution, settings, began, report)
    nodes, p = problem.split(best.x)
    p = np.clip(p, *problem.p_bounds())
    covariance = _covariance(problem, kernel, trials, window, nodes, p)
    warnings = warnings_of(problem, best, p, starts)
    if best.converged and len(starts) < settings.starts:
        warnings.append(f"only {len(starts)} of {settings.starts} starts were solved before the run was stopped")
    timings["total"] = time.perf_counter() - began
    return Calibration(
        ship=calibrated_ship(ship, prior, p, covariance, best.converged),
        prior=prior,
        p=p,
        covariance=covariance,
        sigma=problem.sigma,
        noise=noise,
        solution=best,
        segments=segments,
        settings=replace(settings, step=step, window=window),
        passes=tuple(passes),
        starts=tuple(starts),
        warnings=tuple(warnings),
        notices=tuple(dict.fromkeys(notices)),
        timings=timings,
        nodes=nodes,
    )


def _missing(trials: Sequence[Trial]) -> list[str]:
    """What cannot be done for lack of columns."""
    no_wind = [t.name for t in trials if not t.has_wind]
    no_position = [t.name for t in trials if not t.has_position]
    words = []
    if no_wind:
        words.append(f"calm air is assumed in {', '.join(no_wind)} (no complete wind columns)")
    if no_position:
        words.append(f"positions cannot be fitted in {', '.join(no_position)} (no complete x, y columns)")
    return words


def _assumed(ship: Ship, trials: Sequence[Trial]) -> list[str]:
    """What stands in for actuators of the ship that a trial does not log."""
    return [note for trial in trials for note in actuator_columns(trial, ship.actuators)[1]]


def _given_sigma(settings: Settings) -> np.ndarray:
    sigma = np.asarray(settings.sigma, dtype=float)
    if sigma.shape != (6,) or not (sigma > 0).all():
        raise UserError("sigma must be six positive numbers: x, y [m], psi [rad], u, v [m/s], r [rad/s]")
    return sigma


def _covariance(
    problem: Problem,
    kernel: Kernels,
    trials: Sequence[Trial],
    window: float,
    nodes: np.ndarray,
    p: np.ndarray,
) -> np.ndarray:
    """Posterior covariance of p: inverse of the Fisher information of the effective noise plus the prior's."""
    seg = problem.segments
    longest = int(np.bincount(seg.window, weights=seg.steps).max())
    whole = cut(trials, seg.h, window, longest, inputs=problem.ship.inputs)
    single = Problem(problem.ship, problem.prior, kernel, whole, problem.sigma)
    first = np.unique(seg.node_window, return_index=True)[1]
    data = gauss_newton.information(single, nodes[first], p).sum(axis=0)
    total = data + np.eye(problem.P)
    if not np.isfinite(total).all():
        return np.full_like(total, np.nan)
    return np.linalg.inv(0.5 * (total + total.T))
