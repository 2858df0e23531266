"""Size and correlation time of the residuals of a fit: the weights of the next solve; and the solves in turn.

Residuals of a real ship are not white: a gust or an unmodelled effect displaces a trajectory for many seconds, so a
1 Hz record of 1000 s holds far fewer than 1000 independent errors. Each channel therefore gets an effective standard
deviation rms sqrt(tau), tau the integrated autocorrelation time in samples (at least 1): the likelihood then counts
the effective number of samples, and white noise (tau = 1) is weighted as usual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from fitting.nlp.loss import without_outliers
from fitting.nlp.problem import Problem
from fitting.nlp.windows import Segments
from fitting.settings import Settings
from fitting.solvers.ipopt import ROUGH, Solution, solve
from fitting.solvers.latent_forces import free_axes, typical_sizes, update_sizes
from fitting.solvers.leading import solve_led
from fitting.solvers.multistart import STUCK, solve_damped, solve_in_time
from mmg.effects.disturbance import LATENT_STATES
from mmg.progress import OnProgress

FORCE_PASSES = 3
"""Further solves when sizes of latent forces are estimated, which settle more slowly than the noise."""
STAYS = 0.1
"""Least share of the squares of residuals that is not blamed on how their states were derived."""
NEVER = 1e300
"""A limit that is never wider."""
FEW_WINDOWS = 12
"""Windows of the first solve: enough to bring the coefficients near and to see the size of the residuals."""


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
        return self.sigma / np.sqrt(weight), self.tau / weight


@dataclass(frozen=True)
class Resumption:
    """Where the last of the solves in turn began, so that they can go on as if they had not been stopped.

    number: of that solve, (1,); x, best: where it began and where it ended, (n,) of all windows; sigma, tau: noise that
    it assumed, (6,); sizes: of the latent forces of the ship; limits: iterations and seconds (2,), those that stopped
    it, else 0; NEVER where it cannot end better from where it began.
    """

    number: np.ndarray
    x: np.ndarray
    best: np.ndarray
    sigma: np.ndarray
    tau: np.ndarray
    sizes: np.ndarray
    limits: np.ndarray

    @classmethod
    def of(
        cls, number: int, problem: Problem, x: np.ndarray, best: np.ndarray, status: str, settings: Settings
    ) -> Resumption:
        """That of the solve ``number`` of the whole ``problem`` from x to best, (n,) each, which ended with ``status``
        by ``settings``."""
        reached = {
            "Maximum_Iterations_Exceeded": (settings.max_iterations, 0.0),
            "Maximum_WallTime_Exceeded": (0.0, settings.time_limit or 0.0),
        }
        reached |= dict.fromkeys(("Solve_Succeeded", "User_Requested_Stop"), (0.0, 0.0))
        sizes = [problem.ship.coefficients[s].value for s in _sizes(problem)]
        values = ([number], x, best, problem.sigma, problem.loss.tau, sizes, reached.get(status, (NEVER, NEVER)))
        return cls(*(np.array(value, dtype=float) for value in values))

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray], problem: Problem) -> Resumption | None:
        """That in ``arrays``, as ``arrays`` gives them; None where they are not of this ``problem``."""
        n = (problem.n,)
        shapes = dict(zip(_NAMES, ((1,), n, n, (6,), (6,), (len(_sizes(problem)),), (2,)), strict=True))
        found = {name: arrays.get(f"solve.{name}", np.empty(0)) for name in _NAMES}
        return cls(**found) if all(found[name].shape == shape for name, shape in shapes.items()) else None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What ``of_arrays`` takes."""
        return {f"solve.{name}": getattr(self, name) for name in _NAMES}

    def restored(self, problem: Problem, settings: Settings) -> tuple[int, Problem, np.ndarray]:
        """The number of the solve, the whole ``problem`` as it had it, and where it begins (n,): as before, or at the
        best where the limits of ``settings`` would stop it there again."""
        ship = problem.ship.with_values(dict(zip(_sizes(problem), map(float, self.sizes), strict=True)))
        wider = (settings.max_iterations, settings.time_limit or np.inf) > self.limits
        full = problem.with_changes(ship=ship).with_sigma(self.sigma, self.tau)
        return int(self.number[0]), full, self.x if wider.all() else self.best


_NAMES = tuple(field.name for field in fields(Resumption))


def _sizes(problem: Problem) -> list[str]:
    """Symbols of the sizes of the ship's latent forces."""
    return [symbol for symbol in LATENT_STATES if symbol in problem.ship.coefficients]


def residual_series(segments: Segments, node_residuals: np.ndarray, interior: np.ndarray) -> list[np.ndarray]:
    """Residuals in time order per window of ``segments``, each (samples, 6), NaN where not measured.

    node_residuals: (B, 6); interior: (K-1, 6, M) residuals inside the intervals.
    """
    parts: list[list[np.ndarray]] = [[] for _ in segments.run]
    for i in np.lexsort((segments.start, segments.window)):
        inside = np.where(segments.mask[:, :, i] > 0, interior[:, :, i], np.nan)[: segments.steps[i] - 1]
        parts[segments.window[i]] += [node_residuals[segments.start[i]][None], inside]
    last = np.zeros(len(parts), dtype=int)
    np.maximum.at(last, segments.window, segments.end)
    return [np.vstack([*p, node_residuals[node][None]]) for p, node in zip(parts, last, strict=True)]


def correlation_time(residuals: list[np.ndarray], longest: int) -> float:
    """Integrated autocorrelation time [samples] of one channel from ``residuals`` of windows, (n,) each; at least 1.

    Sums the pooled autocorrelation up to its first value below 0.05 (a self-consistent window, Sokal 1997), or to the
    lag ``longest``.
    """
    products, counts = np.zeros(longest), np.zeros(longest)
    for e in residuals:
        e = np.nan_to_num(e)
        n = len(e)
        lags = np.arange(min(longest, n))
        products[lags] += np.correlate(e, e, "full")[n - 1 :][lags]
        counts[lags] += n - lags
    if products[0] <= 0:
        return 1.0
    rho = (products / np.maximum(counts, 1)) / (products[0] / counts[0])
    below = np.flatnonzero(rho < 0.05)
    end = int(below[0]) if len(below) else longest
    return float(max(1.0, 1 + 2 * rho[1:end].sum()))


def estimate_noise(
    segments: Segments, node_residuals: np.ndarray, interior: np.ndarray, floor: np.ndarray, robust: bool = False
) -> ResidualNoise:
    """Noise of each channel from the residuals of a fit over ``segments``.

    node_residuals: (B, 6); interior: (K - 1, 6, M); floor: (6,) smallest rms; robust: leave out residuals beyond
    four robust standard deviations. Where the states of a window were derived, their variance is taken off the squares,
    of which at least STAYS is left. One degree of freedom per window and channel is given to the free initial states. A
    channel that is nowhere measured keeps rms = floor, tau = 1.
    """
    windows = residual_series(segments, np.where(segments.node_mask > 0, node_residuals, np.nan), interior)
    rms, tau = np.array(floor, dtype=float), np.ones(6)
    for channel in range(6):
        e = [w[:, channel] for w in windows if np.isfinite(w[:, channel]).any()]
        e = without_outliers(e) if robust else e
        count = sum(int(np.isfinite(part).sum()) for part in e)
        if count <= len(e):
            continue
        total = sum(float(np.nansum(part**2)) for part in e)
        if segments.variance is not None:
            derived = [
                int(np.isfinite(w[:, channel]).sum()) * v
                for w, v in zip(windows, segments.variance[:, channel], strict=True)
            ]
            total = max(total - sum(derived), STAYS * total)
        rms[channel] = max(np.sqrt(total / (count - len(e))), floor[channel])
        tau[channel] = correlation_time(e, longest=max(2, max(len(part) for part in e) // 2))
    return ResidualNoise(rms, tau)


Choose = Callable[[Problem, np.ndarray], tuple[str, float]]
"""From a problem and its rough solution x (n,): the loss, and the share of its information with which a run counts."""


def _row(problem: Problem, solution: Solution, restarted: bool) -> dict:
    """What is kept of a solve."""
    return {
        "objective": solution.objective,
        "status": solution.status,
        "iterations": solution.iterations,
        "seconds": solution.seconds,
        "windows": len(problem.segments.run),
        "sigma": problem.sigma.tolist(),
        "restarted": restarted,
    }


def reweighed(problem: Problem, x: np.ndarray, loss: str, weight: float = 1.0) -> Problem:
    """The ``problem`` with a ``loss``, and the noise that its residuals at x (n,) have for it, all counting with the
    share ``weight`` of their information."""
    floor, changed = 1e-6 * problem.scale[:6], replace(problem.loss, name=loss)
    noise = estimate_noise(problem.segments, *problem.errors(x), floor=floor, robust=changed.robust)
    return problem.with_changes(loss=changed).with_sigma(*noise.counted(weight))


def solve_with_noise_estimation(
    problem: Problem,
    x: np.ndarray,
    settings: Settings,
    began: float,
    progress: OnProgress | None,
    resumed: Resumption | None = None,
    choose: Choose | None = None,
    near: bool = False,
) -> tuple[Problem, Solution, ResidualNoise, list[dict], Resumption]:
    """Rough solves that estimate the noise and the sizes of latent forces, then one to full tolerance.

    problem, x (n,): where to start; settings, began [s], progress: as of ``multistart.solve_in_time``. The first rough
    solve has at most FEW_WINDOWS windows, evenly spread, unless x is ``near`` a solution; the estimate of each solve
    starts the next. IPOPT alone makes the first one, far from any solution; the
    others are those of ``leading``. One that gets stuck is repeated with damping. With a robust loss the rough solves
    use Student's t, which gives gross outliers no weight. resumed: the solve to go on with; choose: called before the
    last solve; where it names another loss than the problem has, a rough solve more settles the noise. Returns the last
    problem, its solution, the noise of its residuals, a row on each solve, and how to go on from the last one.
    """
    passes: list[dict] = []
    axes = free_axes(problem.ship)
    count = 1 if settings.sigma and not axes else max(1, settings.passes) + (FORCE_PASSES if axes else 0)
    full, p = problem, problem.split(x)[1]
    weight, choose = settings.weight or 1.0, None if settings.sigma else choose
    if axes:
        typical = typical_sizes(problem.ship)
        full = problem.with_changes(ship=problem.ship.with_values({f"disturbance.{a}": typical[a] for a in axes}))
    number = 0
    if resumed:
        number, full, x = resumed.restored(full, settings)
        p, count = full.split(x)[1], max(count, number + 1)
    while number < count:
        rough, start = number < count - 1, x
        windows = len(full.segments.run)
        if rough and number == 0 and windows > 1.5 * FEW_WINDOWS and not near:
            few = np.unique(np.linspace(0, windows - 1, FEW_WINDOWS).round().astype(int))
            problem = full.with_changes(segments=full.segments.subset(few))
            x = problem.start(p)
        else:
            problem = full
        if rough and problem.loss.robust:
            problem = problem.with_changes(loss=replace(problem.loss, name="student"))
        name = f"pass {number + 1} of {count}"
        method = solve_led if number or near else solve
        rest = (settings, began, progress, name, ROUGH if rough else None)
        solution = solve_in_time(problem, x, *rest, method)
        restarted = solution.status in STUCK
        if restarted:
            solution = solve_damped(problem, p, settings, began, progress)
        noise = estimate_noise(
            problem.segments, *problem.errors(solution.x), floor=1e-6 * problem.scale[:6], robust=problem.loss.robust
        )
        passes.append(_row(problem, solution, restarted))
        p = problem.split(solution.x)[1]
        end = solution.x if problem.segments is full.segments else full.start(p)
        last = Resumption.of(number, full, start, end, solution.status, settings)
        good = solution.converged or (rough and solution.status == "Solved_To_Acceptable_Level")
        if not good or not rough:
            break
        x = solution.x
        if axes:
            problem, x = update_sizes(problem, x, axes)
            full = full.with_changes(ship=problem.ship)
        x = x if problem.segments is full.segments else full.start(p)
        if not settings.sigma:
            full = full.with_sigma(*noise.counted(weight))
        number += 1
        if choose and number == count - 1 and problem.segments is not full.segments:
            count += 1  # a choice needs a rough solution of all windows
        elif choose and number == count - 1:
            name, weight = choose(full, x)
            count += name != full.loss.name
            full, choose = reweighed(full, x, name, weight), None
    if problem.segments is not full.segments:  # stopped early: carried over with nodes on the measurements
        problem, x = full, full.start(p)
        violation = float(np.abs(full.defects(x)).max())
        solution = replace(solution, x=x, objective=full.objective(x), violation=violation)
    return problem.with_changes(loss=replace(problem.loss, name=full.loss.name)), solution, noise, passes, last
