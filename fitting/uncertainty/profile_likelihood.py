"""Profile likelihood: how much worse the fit becomes when one coefficient is held and all others adapt.

The increase of the objective is divided by the dispersion of that coefficient (robust over model-based variance), so
that its 95 % limit is 1.92 also for correlated residuals (Pace, Salvan & Sartori 2011). A profile that stays below
the limit up to a bound says that the data and the prior leave the coefficient open on that side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.nlp.problem import Problem
from fitting.parallel import run_all
from fitting.solvers.condensing import solve_led
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


def refit_along(side: tuple[Problem, np.ndarray, int, np.ndarray]) -> list[tuple[float, str]]:
    """(objective, reason of failure or "") along one ``side`` of a profile; each solve starts from the one before.

    A side is a problem, x (n,) at its estimate, i, and the values of p[i] to hold in turn, ever further from it.
    """
    problem, x, i, values = side
    found = []
    for value in values:
        lower, upper = problem.prior.lower.copy(), problem.prior.upper.copy()
        lower[i] = upper[i] = problem.prior.mean[i] + problem.prior.std[i] * value
        try:
            held = problem.with_bounds(lower, upper)
            nodes, p = held.split(x)
            with np.errstate(all="ignore"):
                start = held.join(nodes, np.clip(p, *held.p_bounds()))
                s = solve_led(held, start, 1e-5, 100, None, None, "profile", WARM)
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
    mean, std, best, tasks = problem.prior.mean, problem.prior.std, problem.objective(x), []
    for symbol in symbols:
        if symbol not in names:
            raise ValueError(f"{symbol} is not among the free coefficients")
        i = names.index(symbol)
        se = np.sqrt(covariance[i, i]) if np.isfinite(covariance[i, i]) else 1.0
        for sign in (-1, 1):
            held = np.clip(p[i] + sign * STRIDE * se * np.arange(1, STEPS + 1), lower[i], upper[i])
            held = held[np.abs(held - p[i]) > 1e-9]
            held = held[np.r_[True, np.abs(np.diff(held)) > 1e-9]] if len(held) else held
            tasks.append((problem, x, i, held))
    outcomes, found = run_all(refit_along, tasks, workers, name="profiles"), []
    for k, symbol in enumerate(symbols):
        sides, i = slice(2 * k, 2 * k + 2), names.index(symbol)
        ratio = covariance[i, i] / model[i, i]
        dispersion = float(ratio) if np.isfinite(ratio) and ratio > 0 else 1.0
        held = [mean[i] + std[i] * values for *_, values in tasks[sides]]
        found.append(_profile(symbol, mean[i] + std[i] * p[i], best, dispersion, held, outcomes[sides]))
    return found


def _profile(
    symbol: str, estimate: float, best: float, dispersion: float,
    held: list[np.ndarray], found: list[list[tuple[float, str]]],
) -> Profile:  # fmt: skip
    """The profile from the values ``held`` below and above the ``estimate``, and the objective and reason of each."""
    rises = [np.array([value for value, _ in side]) - best for side in found]
    lower, upper = (_crossing(np.r_[estimate, v], np.r_[0.0, r] / dispersion) for v, r in zip(held, rises, strict=True))
    outcomes = zip(np.concatenate(held), [why for side in found for _, why in side], strict=True)
    return Profile(
        symbol=symbol,
        values=tuple(np.r_[held[0][::-1], estimate, held[1]].tolist()),
        increase=tuple(np.r_[rises[0][::-1], 0.0, rises[1]].tolist()),
        dispersion=dispersion,
        lower=lower,
        upper=upper,
        failures=tuple(f"{symbol} = {value:.6g}: {why}" for value, why in outcomes if why),
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
