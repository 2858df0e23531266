"""Calibration of a ship on trials: the one function that ``mmg fit`` calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial

import numpy as np

from cases.checks import inputs_are_constant
from cases.trial import Trial
from fitting import gauss_newton
from fitting.ipopt import Solution, solve
from fitting.noise import Noise, estimate
from fitting.problem import Prior, Problem
from fitting.segments import Segments, cut, default_step
from fitting.shooting import Kernels, kernels
from mmg.errors import UserError
from mmg.model import assemble
from mmg.ship import Ship


@dataclass(frozen=True)
class Settings:
    """How to calibrate.

    window: length of a shooting window [s], None: 100 steps; step: integration and sampling
    step [s], None: a twentieth; interval: Runge-Kutta steps per shooting interval; passes: solves, the noise being
    re-estimated between them; starts: further random starts of the last solve; tolerance, max_iterations, time_limit
    [s, of the whole calibration]: of IPOPT; sigma: fixed residual standard deviations (6,) instead of estimated ones;
    compiled: use a C compiler if there is one.
    """

    window: float | None = None
    step: float | None = None
    interval: int = 5
    passes: int = 3
    starts: int = 1
    seed: int = 0
    tolerance: float = 1e-6
    max_iterations: int = 300
    time_limit: float | None = None
    sigma: tuple[float, ...] | None = None
    compiled: bool = True


@dataclass(frozen=True)
class Start:
    """One start of the multi-start: seed number, objective, whether it converged, largest |p - p_best|."""

    number: int
    objective: float
    converged: bool
    distance: float


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


Report = Callable[[str, int, float, float], None]


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
    segments = cut(trials, step, window, settings.interval)
    prior = Prior.of(ship)
    positions = np.array([ship.symbols.index(s) for s in prior.symbols])
    kernel = kernels(assemble(ship), positions, settings.compiled)
    timings = {"prepare": time.perf_counter() - began}
    notices = [*segments.dropped, *ship.notices, *_missing(trials)]
    if kernel.interpreted_because:
        notices.append(f"running without compiled code, several times slower: {kernel.interpreted_because}")
    sigma = _given_sigma(settings) if settings.sigma else first_sigma(ship, segments)
    problem = Problem(ship, prior, kernel, segments, sigma)
    x = problem.start()
    if warm and len(warm.get("p", ())) == problem.P:
        if len(warm.get("nodes", ())) == problem.B:
            x = problem.join(warm["nodes"], np.clip(warm["p"], *problem.p_bounds()))
        problem = problem.with_sigma(warm["sigma"]) if not settings.sigma else problem
    problem, solution, noise, passes = _passes(problem, x, settings, began, report)
    timings["solve"] = time.perf_counter() - began - timings["prepare"]
    best, starts = _starts(problem, solution, settings, began, report)
    nodes, p = problem.split(best.x)
    p = np.clip(p, *problem.p_bounds())
    covariance = _covariance(problem, kernel, trials, window, nodes, p)
    warnings = _warnings(problem, best, p, starts, passes)
    timings["total"] = time.perf_counter() - began
    return Calibration(
        ship=_calibrated(ship, prior, p, covariance, best.converged),
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
        words.append(f"calm air is assumed in {', '.join(no_wind)} (no wind columns)")
    if no_position:
        words.append(f"positions cannot be fitted in {', '.join(no_position)} (no x, y columns)")
    return words


def _given_sigma(settings: Settings) -> np.ndarray:
    sigma = np.asarray(settings.sigma, dtype=float)
    if sigma.shape != (6,) or not (sigma > 0).all():
        raise UserError("sigma must be six positive numbers: x, y [m], psi [rad], u, v [m/s], r [rad/s]")
    return sigma


def _left(settings: Settings, began: float) -> float | None:
    return None if settings.time_limit is None else settings.time_limit - (time.perf_counter() - began)


def _noise(problem: Problem, x: np.ndarray) -> Noise:
    seg = problem.segments
    nodes, _, _, interior = problem._evaluate(x)
    floor = 1e-6 * problem.scale
    return estimate(seg, nodes - seg.nodes, interior - seg.targets, floor)


FEW_WINDOWS = 30
"""Windows of the first solve: enough to bring the coefficients near and to see the size of the residuals."""


def _passes(
    problem: Problem, x: np.ndarray, settings: Settings, began: float, report: Report | None
) -> tuple[Problem, Solution, Noise, list[dict]]:
    """Rough solves that estimate the noise, then one with that noise to full tolerance.

    The first rough solve sees at most FEW_WINDOWS windows, evenly spread; the estimate of each solve starts the next.
    """
    passes: list[dict] = []
    count = 1 if settings.sigma else max(1, settings.passes)
    full, p = problem, problem.split(x)[1]
    for number in range(count):
        rough = number < count - 1
        windows = len(full.segments.run)
        if rough and number == 0 and windows > 1.5 * FEW_WINDOWS:
            few = np.unique(np.linspace(0, windows - 1, FEW_WINDOWS).round().astype(int))
            segments = full.segments.subset(few)
            problem = Problem(full.ship, full.prior, full.kernels, segments, full.sigma)
            x = problem.start(p)
        else:
            problem = full
        name = f"pass {number + 1} of {count}"
        solution = solve(
            problem,
            x,
            settings.tolerance,
            settings.max_iterations,
            _left(settings, began),
            report=partial(report, name) if report else None,
            rough=rough,
        )
        noise = _noise(problem, solution.x)
        passes.append(
            {
                "objective": solution.objective,
                "status": solution.status,
                "iterations": solution.iterations,
                "seconds": solution.seconds,
                "windows": len(problem.segments.run),
                "sigma": problem.sigma.tolist(),
            }
        )
        p = problem.split(solution.x)[1]
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x if problem is full else full.start(p)
        full = full.with_sigma(noise.sigma)
    if problem.segments is not full.segments:
        problem, solution = _whole(full, p, solution)
    return problem, solution, noise, passes


def _whole(full: Problem, p: np.ndarray, solution: Solution) -> tuple[Problem, Solution]:
    """A solution of a subset that stopped early, carried over to all windows with nodes on the measurements."""
    x = full.start(p)
    return full, replace(
        solution,
        x=x,
        multipliers=np.zeros(full.m),
        objective=full.objective(x),
        violation=float(np.abs(full.defects(x)).max()),
    )


def _starts(
    problem: Problem, first: Solution, settings: Settings, began: float, report: Report | None
) -> tuple[Solution, list[Start]]:
    """Further random starts of the last problem; returns the best solution and the list of all starts."""
    solutions = [first]
    if first.converged:
        rng = np.random.default_rng(settings.seed)
        for number in range(1, settings.starts):
            left = _left(settings, began)
            if left is not None and left <= 0:
                break
            x0 = problem.start(rng.normal(scale=0.5, size=problem.P))
            name = f"start {number + 1}"
            solutions.append(
                solve(
                    problem,
                    x0,
                    settings.tolerance,
                    settings.max_iterations,
                    left,
                    report=partial(report, name) if report else None,
                )
            )
            if solutions[-1].status == "User_Requested_Stop":
                break
    converged = [s for s in solutions if s.converged] or solutions[:1]
    best = min(converged, key=lambda s: s.objective)
    p = problem.split(best.x)[1]
    starts = [
        Start(i, s.objective, s.converged, float(np.abs(problem.split(s.x)[1] - p).max()))
        for i, s in enumerate(solutions)
    ]
    return best, starts


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
    whole = cut(trials, seg.h, window, longest)
    single = Problem(problem.ship, problem.prior, kernel, whole, problem.sigma)
    first = np.unique(seg.node_window, return_index=True)[1]
    data = gauss_newton.information(single, nodes[first], p).sum(axis=0)
    total = data + np.eye(problem.P)
    if not np.isfinite(total).all():
        return np.full_like(total, np.nan)
    return np.linalg.inv(0.5 * (total + total.T))


def at_bound(p: float, lower: float, upper: float) -> str:
    """ "lower", "upper" or "" for a scaled coefficient against its scaled bounds."""
    if p <= lower + 1e-4:
        return "lower"
    return "upper" if p >= upper - 1e-4 else ""


def verdict(share: float, where: str) -> str:
    """A sentence on what decided a coefficient; share: posterior over prior variance (1: the data said nothing)."""
    if where:
        return f"at its {where} bound: the data ask for a value outside the range given"
    if not np.isfinite(share):
        return "its uncertainty could not be computed"
    if share < 0.1:
        return f"determined by the data (the prior's share of the variance is {share:.0%})"
    if share < 0.7:
        return f"partly determined by the data (the prior's share of the variance is {share:.0%})"
    return f"decided by the prior (its share of the variance is {min(share, 1):.0%})"


def _calibrated(ship: Ship, prior: Prior, p: np.ndarray, covariance: np.ndarray, converged: bool) -> Ship:
    changed = {}
    for i, symbol in enumerate(prior.symbols):
        c = ship.coefficients[symbol]
        share = float(covariance[i, i])
        where = at_bound(
            p[i], (prior.lower[i] - prior.mean[i]) / prior.std[i], (prior.upper[i] - prior.mean[i]) / prior.std[i]
        )
        words = verdict(share, where)
        value = float(np.clip(prior.mean[i] + prior.std[i] * p[i], prior.lower[i], prior.upper[i]))
        std = float(np.sqrt(share) * prior.std[i]) if np.isfinite(share) else c.std
        changed[symbol] = c.with_(
            value=value,
            std=std,
            prior_value=float(prior.mean[i]),
            prior_std=float(prior.std[i]),
            verdict=words if converged else f"NOT CONVERGED; {words}",
            source="calibrated by mmg fit" if "calibrated by mmg fit" in c.source or not c.source
            else f"calibrated by mmg fit; prior: {c.source}",
        )  # fmt: skip
    return replace(ship.with_coefficients(changed), notices=())


def _warnings(
    problem: Problem, best: Solution, p: np.ndarray, starts: list[Start], passes: list[dict]
) -> list[str]:
    words = []
    if not best.converged:
        words.append(f"not converged ({best.status}): {best.advice or 'the best iterate is kept'}")
    lower, upper = problem.p_bounds()
    hit = [
        f"{s} ({where})"
        for s, value, lo, hi in zip(problem.prior.symbols, p, lower, upper, strict=True)
        if (where := at_bound(value, lo, hi))
    ]
    if hit:
        words.append(f"at a bound: {', '.join(hit)}")
    away = [s for s, value in zip(problem.prior.symbols, p, strict=True) if abs(value) > 3]
    if away:
        words.append(f"more than three prior standard deviations from the prior: {', '.join(away)}")
    other = [s for s in starts if s.converged and s.objective > best.objective * (1 + 1e-5) + 1e-6]
    if other:
        words.append(
            f"{len(other)} of {len(starts)} starts ended in another optimum; the lowest objective is kept"
        )
    return words


def settings_dict(settings: Settings) -> dict:
    """Settings as plain JSON values."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(settings).items()}
