"""Profile likelihood: how much worse the fit becomes when one coefficient is held and all others adapt.

The increase of the objective is divided by the dispersion of that coefficient (robust over model-based variance), so
that its 95 % limit is 1.92 also for correlated residuals (Pace, Salvan & Sartori 2011). A profile that stays below
the limit up to a bound says that the data and the prior leave the coefficient open on that side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from fitting.nlp.problem import Problem
from fitting.nlp.problem_data import ProblemData
from fitting.parallel import run_all
from fitting.solvers.ipopt import solve
from fitting.uncertainty.bootstrap import WARM

LIMIT = 1.9207
"""Half the 95 % quantile of chi-squared with one degree of freedom."""
STEPS = 5
"""Points on either side of the estimate, one every 0.75 robust standard errors: the last at 3.75."""
STRIDE = 0.75


@dataclass(frozen=True)
class Profile:
    """Profile of one coefficient in its own unit.

    values: held, rising, the estimate among them; increase: of the objective, NaN where the refit failed; dispersion:
    by which it is divided; lower, upper: where increase / dispersion passes LIMIT, NaN where it does not within the
    range; failures: sentences.
    """

    symbol: str
    values: tuple[float, ...]
    increase: tuple[float, ...]
    dispersion: float
    lower: float
    upper: float
    failures: tuple[str, ...]

    def row(self) -> dict:
        """As plain values."""
        return asdict(self)


@dataclass(frozen=True)
class ProfileSide:
    """One side of a profile as a task: values of p[i] to hold in turn, ever further from the estimate."""

    problem_data: ProblemData
    x: np.ndarray
    i: int
    held: np.ndarray


def refit_along(task: ProfileSide) -> list[tuple[float, str]]:
    """(objective, reason of failure or "") at each held value of a ``task``; each solve starts from the one before."""
    return _refit_along(task.problem_data.problem(), task)


def _refit_along(problem: Problem, task: ProfileSide) -> list[tuple[float, str]]:
    x, found = task.x, []
    for value in task.held:
        lower, upper = problem.prior.lower.copy(), problem.prior.upper.copy()
        lower[task.i] = upper[task.i] = problem.prior.mean[task.i] + problem.prior.std[task.i] * value
        try:
            held = problem.with_bounds(lower, upper)
            nodes, p = held.split(x)
            with np.errstate(all="ignore"):
                s = solve(held, held.join(nodes, np.clip(p, *held.p_bounds())), 1e-5, 100, options=WARM)
        except Exception as error:
            found.append((np.nan, f"{type(error).__name__}: {error}"))
            continue
        good = s.converged or s.status == "Solved_To_Acceptable_Level"
        found.append((s.objective, "") if good else (np.nan, s.status))
        x = s.x if good else x
    return found


def profiles(
    problem: Problem, x: np.ndarray, symbols: Sequence[str], covariance: np.ndarray, model: np.ndarray,
    workers: int = 1,
) -> list[Profile]:  # fmt: skip
    """Profiles of the free coefficients ``symbols`` about the solution x (n,) of ``problem``.

    covariance, model: robust and model-based (P, P); workers: processes. Raises ValueError for a symbol that is not
    free.
    """
    names, (_, p) = list(problem.prior.symbols), problem.split(x)
    lower, upper = problem.p_bounds()
    best, data, tasks = problem.objective(x), ProblemData.of(problem), []
    for symbol in symbols:
        if symbol not in names:
            raise ValueError(f"{symbol} is not among the free coefficients")
        i = names.index(symbol)
        se = np.sqrt(covariance[i, i]) if np.isfinite(covariance[i, i]) else 1.0
        for sign in (-1, 1):
            held = np.clip(p[i] + sign * STRIDE * se * np.arange(1, STEPS + 1), lower[i], upper[i])
            held = held[np.abs(held - p[i]) > 1e-9]
            held = held[np.r_[True, np.abs(np.diff(held)) > 1e-9]] if len(held) else held
            tasks.append(ProfileSide(data, x, i, held))
    outcomes = run_all(refit_along, tasks, workers) if workers > 1 else [_refit_along(problem, task) for task in tasks]
    return [
        _profile(problem, symbol, p, best, covariance, model, tasks[2 * k : 2 * k + 2], outcomes[2 * k : 2 * k + 2])
        for k, symbol in enumerate(symbols)
    ]


def _profile(
    problem: Problem, symbol: str, p: np.ndarray, best: float, covariance: np.ndarray, model: np.ndarray,
    tasks: list[ProfileSide], outcomes: list[list[tuple[float, str]]],
) -> Profile:  # fmt: skip
    i = tasks[0].i
    mean, std = problem.prior.mean[i], problem.prior.std[i]
    ratio = covariance[i, i] / model[i, i]
    dispersion = float(ratio) if np.isfinite(ratio) and ratio > 0 else 1.0
    limits, failures = [], []
    for task, found in zip(tasks, outcomes, strict=True):
        at = np.r_[p[i], task.held]
        rise = np.r_[0.0, [value - best for value, _ in found]] / dispersion
        failures += [
            f"{symbol} = {mean + std * v:.6g}: {why}" for v, (_, why) in zip(task.held, found, strict=True) if why
        ]
        limits.append(mean + std * _crossing(at, rise))
    down, up = ([mean + std * v for v in task.held] for task in tasks)
    fallen, risen = ([value - best for value, _ in found] for found in outcomes)
    return Profile(
        symbol=symbol,
        values=(*down[::-1], mean + std * p[i], *up),
        increase=(*fallen[::-1], 0.0, *risen),
        dispersion=dispersion,
        lower=limits[0],
        upper=limits[1],
        failures=tuple(failures),
    )


def _crossing(at: np.ndarray, rise: np.ndarray) -> float:
    """Where a rise first passes LIMIT, linear in its square root; NaN where it does not."""
    good = np.isfinite(rise)
    at, root = at[good], np.sqrt(np.maximum(rise[good], 0.0))
    beyond = np.flatnonzero(root > np.sqrt(LIMIT))
    if not len(beyond):
        return np.nan
    k = beyond[0]
    share = (np.sqrt(LIMIT) - root[k - 1]) / (root[k] - root[k - 1])
    return float(at[k - 1] + share * (at[k] - at[k - 1]))
