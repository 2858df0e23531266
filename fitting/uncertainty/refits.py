"""Uncertainty by refits, on request: the bootstrap by run, and profiles of the likelihood.

Runs are resampled, never samples: residuals of one run belong together (block bootstrap, Kuensch 1989; by cluster,
Cameron, Gelbach & Miller 2008). Each replicate also draws the prior's centres anew from the prior, so that the spread
includes the uncertainty of the prior; without that, a coefficient that no run excites would look certain.

A profile says how much worse the fit becomes when one coefficient is held and all others adapt. The increase of the
objective is divided by the dispersion of that coefficient (robust over model-based variance), so that its 95 % limit is
1.92 also for correlated residuals (Pace, Salvan & Sartori 2011). A profile that stays below the limit up to a bound
says that the data and the prior leave the coefficient open on that side.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.calibration import Calibration
from fitting.nlp.fisher_information import Information
from fitting.nlp.loss import Loss
from fitting.nlp.problem import Problem
from fitting.parallel import Shared, run_all, width
from fitting.solvers.control import Control
from fitting.solvers.solve import Solution, solve
from mmg.errors import UnknownName, whole
from mmg.messages import Message

REFIT_TOLERANCE = 1e-4  # Of a refit of the bootstrap: a spread needs no more digits. Set by hand.
PROFILE_TOLERANCE = 1e-5  # Of one along a profile, whose rises are differences of objectives. Set by hand.
REFIT_ITERATIONS = 100  # Most of a refit. Set by hand: one that takes more counts as failed.
CHUNK = 5  # Refits of a task: few, so that workers end together and little is lost with one of them. Set by hand.
OUT_OF_TIME = "not made within the time limit"  # Why a refit is missing, in words
LIMIT = 1.9207  # Half the 95 % quantile of chi-squared with one degree of freedom. (Wilks 1938.)
STEPS = 5  # Points on either side of the estimate: the last at 3.75 robust standard errors. Set by hand.
STRIDE = 0.75  # Between these points [robust standard errors]. Set by hand.


def check_request(replicates: int, symbols: Sequence[str], free: Sequence[str], draws: int = 0) -> None:
    """Raises UserError for fewer than 0 bootstrap ``replicates`` or ``draws`` from the posterior, for these without
    their sampler, and for ``symbols`` to profile that are not ``free``."""
    for option, count in (("--bootstrap", replicates), ("--posterior", draws)):
        whole(option, count, 0)
    if draws:
        from fitting.uncertainty.posterior import needs_nutpie  # late: few ask for draws

        needs_nutpie()
    unknown = [s for s in symbols if s not in free]
    if unknown:
        raise UnknownName(f"--profile: {', '.join(unknown)} is not among the free coefficients: {', '.join(free)}")


def refit_rows(
    calibration: Calibration, replicates: int = 0, profiled: Sequence[str] = (), end: float = math.inf
) -> dict:
    """Keys "bootstrap" (when ``replicates`` > 0) and "profiles" (of the ``profiled``) of a ``calibration``.

    Refits are spread over the calibration's workers. end: when time is over, by ``time.time`` [s]. What fails is
    listed, never raised.
    """
    spread, prior, content = calibration.spread, calibration.prior, dict[str, Any]()
    problem, x, settings = calibration.problem, calibration.solution.x, calibration.settings
    if replicates:
        began, info = time.perf_counter(), calibration.information
        p, why = bootstrap(info, replicates, settings.seed, problem, x, settings.workers, end)
        good = p[np.isfinite(p).all(axis=1)]  # those that did not fail
        nan = np.full((2, p.shape[1]), np.nan)
        std = good.std(axis=0, ddof=1) if len(good) > 1 else nan[0]
        lower, upper = np.quantile(good, (0.025, 0.975), axis=0) if len(good) else nan
        sizes = np.sqrt(np.diag(spread.covariance))
        content["bootstrap"] = {
            "method": "refit",
            "replicates": len(p),
            "failed": [{"replicate": str(number), "reason": reason} for number, reason in enumerate(why) if reason],
            "coefficients": {  # of what all runs share
                s: {
                    "std": float(std[i] * prior.std[i]),
                    "std_over_robust": float(std[i] / sizes[i]),
                    "lower": float(prior.mean[i] + prior.std[i] * lower[i]),
                    "upper": float(prior.mean[i] + prior.std[i] * upper[i]),
                }
                for i, s in enumerate(prior.symbols)
            },
            "seconds": time.perf_counter() - began,
        }
    if profiled:
        content["profiles"] = profiles(problem, x, profiled, spread.covariance, spread.model, settings.workers, end)
    return content


def failed_refits(content: Mapping[str, Any]) -> list[Message]:
    """Warnings on refits of ``refit_rows`` that failed; content: with its keys."""
    drawn, messages = content.get("bootstrap") or {}, []
    reasons = [row["reason"] for row in drawn.get("failed", ())]
    rows = [("--bootstrap", drawn.get("replicates", 0), reasons)]
    for profile in content.get("profiles") or ():
        reasons = [failure.partition(": ")[2] for failure in profile.failures]
        rows.append((f"--profile {profile.symbol}", len(profile.values) - 1, reasons))
    for option, count, reasons in rows:
        if reasons:
            why = ", ".join(f"{reason} ({reasons.count(reason)})" for reason in dict.fromkeys(reasons))
            messages.append(Message(f"{option}: {len(reasons)} of {count} refits are missing: {why}", "refits_missing"))
    return messages


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
    part.scale = problem.scale  # that of the runs left would be another
    part.measured_nodes = problem.measured_nodes[kept_nodes]
    part.node_weight = node_weight[kept_nodes] * at_nodes[:, None]
    part.memory_weight = part.memory_weight * at_nodes[:, None]  # a window that counts twice begins twice
    part.weight = weight[:, :, kept_at] * inside
    return part, kept_nodes


def _resolved(
    problem: Problem, nodes: np.ndarray, p: np.ndarray, tolerance: float, end: float
) -> tuple[Solution | None, str]:
    """The solution of ``problem`` from ``nodes`` (B, S) and p (P,), else None and why: what breaks is a result, not the
    end of the others. end: of the time [s]."""
    if time.time() > end:
        return None, OUT_OF_TIME
    try:
        with np.errstate(all="ignore"):
            start = problem.join(nodes, np.clip(p, *problem.p_bounds()))
            s = solve(problem, start, Control(iterations=REFIT_ITERATIONS, end=end), tolerance)
    except Exception as error:
        return None, f"{type(error).__name__}: {error}"
    if s.converged or s.status == "Solved_To_Acceptable_Level":
        return s, ""
    return None, OUT_OF_TIME if time.time() > end else s.status


def refit(
    task: tuple[Shared[tuple[Problem, np.ndarray, float]], np.ndarray, np.ndarray],
) -> list[tuple[np.ndarray, str]]:
    """(p relative to the original prior (P,), reason of failure or "") of each replicate of a ``task``.

    A task is a problem with x (n,) at its estimate and the end of its time [s], how often each window counts
    (replicates, W), and the shifts of the prior's centres in prior standard deviations (replicates, P).
    """
    (problem, x, end), found = task[0].value, []
    nodes, p = problem.split(x)
    for counts, shift in zip(*task[1:], strict=True):
        part, kept = reweighted(problem, x, counts, shift)
        s, why = _resolved(part, nodes[kept], p - shift, REFIT_TOLERANCE, end)
        found.append((part.split(s.x)[1] + shift if s else np.full(problem.P, np.nan), why))
    return found


def drawn_runs(run: np.ndarray, replicates: int, rng: np.random.Generator) -> np.ndarray:
    """How often each window counts when its ``run`` (W,) is drawn with replacement by ``rng``, (replicates, W)."""
    runs, position = np.unique(run, return_inverse=True)
    drawn = rng.multinomial(len(runs), np.full(len(runs), 1 / len(runs)), size=replicates)
    return drawn[:, position]  # windows of a run go together


def bootstrap(
    info: Information,
    replicates: int,
    seed: int,
    problem: Problem,
    x: np.ndarray,
    workers: int = 1,
    end: float = math.inf,
) -> tuple[np.ndarray, list[str]]:
    """Estimates (replicates, P) of ``replicates`` data sets, scaled and relative to the original prior, NaN where a
    refit failed, and why each did, "" where it did not: runs drawn with replacement, prior centres drawn from the
    prior, and refits over ``workers`` processes.

    info: of the windows of the ``problem`` at its solution x (n,). The draws depend on the ``seed`` only, not on the
    number of workers. A single run is replaced by its windows. end: of the time [s], by ``time.time``.
    """
    rng = np.random.default_rng([11, seed])
    clusters = info.run if len(np.unique(info.run)) > 1 else np.arange(len(info.run))
    counts = drawn_runs(clusters, replicates, rng)
    # a centre outside the bounds is no prior of this ship
    shifts = np.clip(rng.standard_normal((replicates, len(info.p))), *problem.p_bounds())
    parts = -(-replicates // CHUNK) if width(workers) > 1 else 1  # rounded up
    shared = Shared((problem, x, end))
    tasks = [(shared, counts[i], shifts[i]) for i in np.array_split(np.arange(replicates), parts)]
    outcomes = [outcome for part in run_all(refit, tasks, workers, name="bootstrap, parts") for outcome in part]
    return np.array([p for p, _ in outcomes]), [why for _, why in outcomes]


@dataclass(frozen=True)
class Profile:
    """Profile of one coefficient in its own unit.

    values: held, rising, the estimate among them; increase: of the objective, NaN where the refit failed; dispersion:
    by which it is divided; lower, upper: where increase / dispersion passes LIMIT, NaN where it does not; failures:
    sentences.
    """

    symbol: str
    values: tuple[float, ...]
    increase: tuple[float, ...]
    dispersion: float
    lower: float
    upper: float
    failures: tuple[str, ...]


def refit_along(side: tuple[Problem, np.ndarray, int, np.ndarray, float]) -> list[tuple[float, str]]:
    """(objective, reason of failure or "") along one ``side`` of a profile; each solve starts from the one before.

    A side is a problem, x (n,) at its estimate, i, the values of p[i] to hold in turn, ever further from it, and the
    end of the time [s].
    """
    problem, x, i, values, end = side
    found = []
    for value in values:
        lower, upper = problem.prior.lower.copy(), problem.prior.upper.copy()
        lower[i] = upper[i] = problem.prior.mean[i] + problem.prior.std[i] * value
        s, why = _resolved(problem.with_bounds(lower, upper), *problem.split(x), PROFILE_TOLERANCE, end)
        found.append((s.objective if s else np.nan, why))
        x = s.x if s else x
    return found


def profiles(
    problem: Problem, x: np.ndarray, symbols: Sequence[str], covariance: np.ndarray, model: np.ndarray,
    workers: int = 1, end: float = math.inf,
) -> list[Profile]:  # fmt: skip
    """Profiles of the free coefficients ``symbols`` about the solution x (n,) of ``problem``.

    covariance, model: robust and model-based (P, P); workers: processes; end: of the time [s], by ``time.time``. Raises
    ValueError for what is not free.
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
            # beyond a bound all are on it
            held = np.clip(p[i] + sign * STRIDE * se * np.arange(1, STEPS + 1), lower[i], upper[i])
            held = held[np.abs(held - p[i]) > 1e-9]  # where the estimate is at the bound
            held = held[np.r_[True, np.abs(np.diff(held)) > 1e-9]] if len(held) else held  # one of those
            tasks.append((problem, x, i, held, end))
    outcomes, found = run_all(refit_along, tasks, workers, name="profiles"), []
    for k, symbol in enumerate(symbols):
        i, ends = names.index(symbol), slice(2 * k, 2 * k + 2)
        estimate, ratio = mean[i] + std[i] * p[i], covariance[i, i] / model[i, i]
        dispersion = float(ratio) if np.isfinite(ratio) and ratio > 0 else 1.0
        held = [mean[i] + std[i] * task[3] for task in tasks[ends]]  # below and above the estimate
        rises = [np.array([value for value, _ in side]) - best for side in outcomes[ends]]
        low, high = (
            _crossing(np.r_[estimate, v], np.r_[0.0, r] / dispersion) for v, r in zip(held, rises, strict=True)
        )
        reasons = [why for side in outcomes[ends] for _, why in side]
        rows = zip(np.concatenate(held), reasons, strict=True)
        found.append(
            Profile(
                symbol=symbol,
                values=tuple(np.r_[held[0][::-1], estimate, held[1]].tolist()),
                increase=tuple(np.r_[rises[0][::-1], 0.0, rises[1]].tolist()),
                dispersion=dispersion,
                lower=low,
                upper=high,
                failures=tuple(f"{symbol} = {value:.6g}: {why}" for value, why in rows if why),
            )
        )
    return found


def _crossing(at: np.ndarray, rise: np.ndarray) -> float:
    """Where a rise first passes LIMIT, linear in its square root; NaN where it does not."""
    good = np.isfinite(rise)
    at, root = at[good], np.sqrt(np.maximum(rise[good], 0.0))
    beyond = np.flatnonzero(root > np.sqrt(LIMIT))
    if not len(beyond):
        return np.nan
    k = beyond[0]
    share = (np.sqrt(LIMIT) - root[k - 1]) / (root[k] - root[k - 1])  # k > 0: the rise is 0 at the estimate
    return float(at[k - 1] + share * (at[k] - at[k - 1]))
