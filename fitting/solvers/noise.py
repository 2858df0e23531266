"""Sizes of noise: what the residuals of a fit say of them, and solves in turn, each with that of the one before.

Residuals of a real ship are not white: a gust or an unmodelled effect displaces a trajectory for many seconds, so a
1 Hz record of 1000 s holds far fewer than 1000 independent errors. Each channel therefore gets an effective standard
deviation rms sqrt(tau), tau the integrated autocorrelation time in samples (at least 1): the likelihood then counts
the effective number of samples, and white noise (tau = 1) is weighted as usual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from fitting.nlp.loss import without_outliers
from fitting.nlp.problem import Problem
from fitting.nlp.windows import Segments
from fitting.settings import Settings
from fitting.solvers.control import Control
from fitting.solvers.solve import STUCK, Solution, solve, solve_damped

STAYS = 0.1  # Least share of the squares of residuals that is not blamed on how their states were derived. Set by hand.


@dataclass(frozen=True)
class ResidualNoise:
    """Residual statistics by state channel, each (6,): rms [SI], tau [samples], sigma = rms sqrt(tau)."""

    rms: np.ndarray
    tau: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        return self.rms * np.sqrt(self.tau)

    def counted(self, weight: float) -> tuple[np.ndarray, np.ndarray]:
        """sigma and tau (6,) with which all residuals count with the share ``weight`` of their information."""
        return self.sigma / np.sqrt(weight), self.tau / weight  # an outlier stays one: rms = sigma / sqrt(tau)


def residual_series(segments: Segments, node_residuals: np.ndarray, interior: np.ndarray) -> list[np.ndarray]:
    """Residuals in time order per window of ``segments``, each (samples, 6), NaN where not measured.

    node_residuals: (B, 6); interior: (K-1, 6, M) residuals inside the intervals.
    """
    parts: list[list[np.ndarray]] = [[] for _ in segments.run]
    for i in np.lexsort((segments.start, segments.window)):  # nodes of a window are numbered in time
        inside = np.where(segments.mask[:, :, i] > 0, interior[:, :, i], np.nan)[: segments.steps[i] - 1]
        parts[segments.window[i]] += [node_residuals[segments.start[i]][None], inside]
    last = np.zeros(len(parts), dtype=int)
    np.maximum.at(last, segments.window, segments.end)  # .at: several intervals have the same window
    return [np.vstack([*p, node_residuals[node][None]]) for p, node in zip(parts, last, strict=True)]


def correlation_time(residuals: list[np.ndarray], longest: int) -> float:
    """Integrated autocorrelation time [samples] of one channel from ``residuals`` of windows, (n,) each; at least 1.

    Sums the pooled autocorrelation up to its first value below 0.05 (Sokal 1997), or to the lag ``longest``.
    """
    products, counts = np.zeros(longest), np.zeros(longest)
    for e in residuals:
        n, e = len(e), np.nan_to_num(e)  # zeros for what is missing: it adds nothing to any product
        lags = np.arange(min(longest, n))
        products[lags] += np.correlate(e, e, "full")[n - 1 :][lags]  # from n - 1 on lags are not negative
        counts[lags] += n - lags
    if products[0] <= 0:
        return 1.0
    rho = (products / np.maximum(counts, 1)) / (products[0] / counts[0])
    below = np.flatnonzero(rho < 0.05)  # what follows is noise of the estimate
    end = int(below[0]) if len(below) else longest
    return float(max(1.0, 1 + 2 * rho[1:end].sum()))


def estimate_noise(
    segments: Segments, node_residuals: np.ndarray, interior: np.ndarray, floor: np.ndarray, robust: bool = False
) -> ResidualNoise:
    """Noise of each channel from the residuals of a fit over ``segments``.

    node_residuals: (B, 6); interior: (K - 1, 6, M); floor: (6,) smallest rms; robust: without outliers. Where states of
    a window were derived, their variance is taken off the squares, of which at least STAYS is left. One degree of
    freedom per window and channel is given to the free initial states. One that is not measured keeps rms = floor, tau
    = 1.
    """
    windows = residual_series(segments, np.where(segments.node_mask > 0, node_residuals, np.nan), interior)
    rms, tau = np.array(floor, dtype=float), np.ones(6)
    for channel in range(6):
        e = [w[:, channel] for w in windows if np.isfinite(w[:, channel]).any()]
        e = without_outliers(e) if robust else e
        count = sum(int(np.isfinite(part).sum()) for part in e)
        if count <= len(e):  # no more samples than free first states
            continue
        total = sum(float(np.nansum(part**2)) for part in e)
        if segments.variance is not None:
            each = zip(windows, segments.variance[:, channel], strict=True)
            derived = sum(int(np.isfinite(w[:, channel]).sum()) * v for w, v in each)
            total = max(total - derived, STAYS * total)
        # one degree of freedom went into each first state
        rms[channel] = max(np.sqrt(total / (count - len(e))), floor[channel])
        tau[channel] = correlation_time(e, longest=max(2, max(len(part) for part in e) // 2))
    return ResidualNoise(rms, tau)


NEVER = 1e300  # Limit [iterations, s] that no other one is wider than: a mark, no size
# Windows of the first solve: they bring the coefficients near and show the size of residuals. Set by hand.
FEW_WINDOWS = 12
TIMES = 3  # Windows of a further solve over those of the one before, until all are there. Set by hand.


@dataclass(frozen=True)
class Resumption:
    """Where the last of the solves in turn began, so that they can go on as if they had not been stopped.

    number, count: of that solve, and of all that there are to be, (1,) each; x, best: where it began and where it
    ended, (n,) of all windows; sigma, tau: noise that it assumed, (6,); limits: iterations and seconds (2,), those that
    stopped it, else 0; NEVER where it cannot end better from where it began.
    """

    number: np.ndarray
    count: np.ndarray
    x: np.ndarray
    best: np.ndarray
    sigma: np.ndarray
    tau: np.ndarray
    limits: np.ndarray

    @classmethod
    def of(
        cls, solve: tuple[int, int], problem: Problem, x: np.ndarray, best: np.ndarray, status: str, settings: Settings
    ) -> Resumption:
        """That of a ``solve``, by its number and how many there are to be, of the whole ``problem`` from x to best,
        (n,) each, which ended with ``status`` by ``settings``."""
        reached = {
            "Maximum_Iterations_Exceeded": (settings.max_iterations, 0.0),
            "Maximum_WallTime_Exceeded": (0.0, settings.time_limit or 0.0),
        }
        reached |= dict.fromkeys(("Solve_Succeeded", "User_Requested_Stop"), (0.0, 0.0))
        limits, noise = reached.get(status, (NEVER, NEVER)), (problem.sigma, problem.loss.tau)
        values = (*([k] for k in solve), x, best, *noise, limits)
        return cls(*(np.array(value, dtype=float) for value in values))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray], problem: Problem) -> Resumption | None:
        """That in ``arrays``, as ``arrays`` gives them; None where they are not of this ``problem``."""
        n = (problem.n,)
        shapes = dict(zip(_NAMES, ((1,), (1,), n, n, (6,), (6,), (2,)), strict=True))
        found = {name: arrays.get(f"solve.{name}", np.zeros(int(name == "count"))) for name in _NAMES}
        return cls(**found) if all(found[name].shape == shape for name, shape in shapes.items()) else None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What ``of_arrays`` takes."""
        return {f"solve.{name}": getattr(self, name) for name in _NAMES}

    def restored(self, problem: Problem, settings: Settings) -> tuple[int, Problem, np.ndarray]:
        """The number of the solve, the whole ``problem`` as it had it, and where it begins (n,): as before, or at the
        best where the limits of ``settings`` would stop it there again."""
        wider = (settings.max_iterations, settings.time_limit or np.inf) > self.limits
        full = problem.with_sigma(self.sigma, self.tau)
        return int(self.number[0]), full, self.x if wider.all() else self.best


_NAMES = tuple(field.name for field in fields(Resumption))


def solve_row(problem: Problem, solution: Solution, restarted: bool = False) -> dict:
    """What is kept of the ``solution`` of a ``problem``; restarted: with damping."""
    return {
        "objective": solution.objective,
        "status": solution.status,
        "iterations": solution.iterations,
        "seconds": solution.seconds,
        "windows": len(problem.segments.run),
        "sigma": problem.sigma.tolist(),
        "restarted": restarted,
    }


@dataclass(frozen=True)
class NoiseSolves:
    """Solves in turn: the last ``problem`` and its ``solution``, the ``noise`` of its residuals, passes: a row on each
    solve, resumption: how to go on with the last one, draft: which was left out, the solution being where it begins."""

    problem: Problem
    solution: Solution
    noise: ResidualNoise
    passes: tuple[dict, ...]
    resumption: Resumption
    draft: bool = False


def noise_of(problem: Problem, solution: Solution) -> ResidualNoise:
    """The noise of the residuals of ``problem`` at its ``solution``."""
    floor = 1e-6 * problem.scale[:6]  # of exact data, whose residuals are rounding
    return estimate_noise(problem.segments, *problem.errors(solution.x), floor=floor, robust=problem.loss.robust)


def _sizes_of_rough(windows: int) -> list[int]:
    """Numbers of windows of the rough solves that come before those of all ``windows``."""
    sizes = [FEW_WINDOWS] if windows > 1.5 * FEW_WINDOWS else []  # 1.5: set by hand
    while sizes and windows > 1.5 * TIMES * sizes[-1]:
        sizes.append(TIMES * sizes[-1])
    return sizes


def _without_last(
    problem: Problem, x: np.ndarray, number: int, passes: Sequence[dict], settings: Settings
) -> NoiseSolves:
    """Solves in turn, of which the last one, that of this ``number``, is left out: ``problem`` and x (n,) where it
    begins, ``passes`` and ``settings`` as there."""
    start = Solution.at(problem, x, "Solved_To_Acceptable_Level")
    last = Resumption.of((number, number + 1), problem, x, x, "User_Requested_Stop", settings)
    return NoiseSolves(problem, start, noise_of(problem, start), tuple(passes), last, draft=True)


def solve_with_noise_estimation(
    problem: Problem,
    x: np.ndarray,
    settings: Settings,
    control: Control,
    resumed: Resumption | None = None,
    near: bool = False,
    draft: bool = False,
) -> NoiseSolves:
    """Rough solves that estimate the noise, then one to full tolerance.

    problem, x (n,): where to start; settings: passes, sigma, tolerance; control: of all of them; resumed: the solve to
    go on with; near: they begin near a solution; draft: the last one is left out where a rough one of all windows came
    before it. The first rough solve has at most FEW_WINDOWS windows, evenly spread, unless x is near a solution, and
    others TIMES as many as the one before, until all are there; the estimate of each solve starts the next. One that
    gets stuck is repeated with damping. With a robust loss the rough solves use Student's t, which gives gross outliers
    no weight. Returns the last solve, and what is kept of all.
    """
    passes: list[dict] = []
    count = 1 if settings.sigma else max(1, settings.passes)  # given noise needs no estimate
    full, p = problem, problem.split(x)[1]
    number = 0
    if resumed:
        number, full, x = resumed.restored(full, settings)
        p, count, problem = full.split(x)[1], max(count, number + 1, int(resumed.count[0])), full
    sizes = _sizes_of_rough(len(full.segments.run)) if count > 1 and not near else []
    count += 0 if resumed else max(0, len(sizes) - 1)  # the first rough pass is one of ``passes``
    while number < count:
        rough, start = number < count - 1, x
        if draft and not rough and number > 0 and problem.segments is full.segments:
            return _without_last(full, x, number, passes, settings)
        if rough and number < len(sizes):
            few = np.linspace(0, len(full.segments.run) - 1, sizes[number]).round().astype(int)
            problem = full.with_changes(segments=full.segments.subset(few))
            x = problem.start(p)  # other windows have other nodes
        else:
            problem = full
        if rough and problem.loss.robust:
            problem = problem.with_changes(loss=replace(problem.loss, name="student"))
        own = control.of(f"pass {number + 1} of {count}")
        solution = solve(problem, x, own, settings.tolerance, rough)
        restarted = solution.status in STUCK
        if restarted:
            solution = solve_damped(problem, p, control, settings.tolerance)
        noise = noise_of(problem, solution)
        passes.append(solve_row(problem, solution, restarted))
        p = problem.split(solution.x)[1]
        end = solution.x if problem.segments is full.segments else full.start(p)
        last = Resumption.of((number, count), full, start, end, solution.status, settings)
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x if problem.segments is full.segments else full.start(p)
        full = full.with_sigma(*noise.counted(settings.weight))
        number += 1
    if problem.segments is not full.segments:  # stopped early: carried over with nodes on the measurements
        problem, x = full, full.start(p)
        here = Solution.at(full, x, solution.status)
        solution = replace(solution, x=x, objective=here.objective, violation=here.violation)
    # as asked, where a rough pass was the last
    problem = problem.with_changes(loss=replace(problem.loss, name=full.loss.name))
    return NoiseSolves(problem, solution, noise, tuple(passes), last)
