"""The trial that would determine most: every manoeuvre of a library is run with the calibrated ship and scored.

One such run adds its Fisher information F to the posterior precision C^-1; with it the covariance would be
(C^-1 + F)^-1 (Bayesian D- and A-optimal design, Chaloner & Verdinelli 1995). All runs count for the same time at sea: a
manoeuvre that is over sooner is repeated, with way to gain speed again between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.maneuvers.definitions import parse_maneuver
from cases.simulation.simulate import simulate
from cases.trial import Trial
from fitting.design.candidates import Option, features, library, missing
from fitting.identifiability.analysis import DETERMINED, CoefficientFinding, Identifiability, information_discount
from fitting.identifiability.verdicts import cause, verdict
from fitting.nlp.fisher_information import information
from fitting.nlp.group_sums import group_sums
from fitting.nlp.problem import Problem
from fitting.nlp.windows import Segments, cut
from mmg.errors import UserError
from mmg.motion.froude import reference_speed, time_scale
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.calibration import Calibration

DURATION = 300.0
"""Time at sea of a trial [s of a 3 m model, Froude scaled]."""

REGAIN = 5.0
"""Way between two repetitions, in which she gains the speed of the approach again [ship lengths at that speed]."""

HELPS, MANY = 0.1, 10
"""Least part of a variance that a trial must remove to be recommended for it, and repetitions of a long campaign."""

NEARLY = 0.9
"""Of several trials that gain at least this part of the best one's the first of the library, a simple one, is named."""


@dataclass(frozen=True)
class NextTrial:
    """What each possible trial would add.

    options: (K,) trials that can be simulated; duration: time at sea of each [s]; left_out: sentences.
    left, left_by_many: (K, P) posterior variance with the trial, once or ``MANY`` times, by that without.
    total: (K,) mean prior's share with the trial; mean: without, both by the information alone, discounted by worth;
    before: (P,) prior's share by the covariance.
    worth: factor on the information of a run that makes up for residuals correlated beyond the noise model.
    missing: (P,) what a trial that excites a coefficient has and these had not.
    plan: numbers of the trials that are best one after another, by the mean prior's share; planned: that mean then.
    """

    options: tuple[Option, ...]
    duration: float
    left_out: tuple[str, ...]
    left: np.ndarray
    left_by_many: np.ndarray
    total: np.ndarray
    mean: float
    before: np.ndarray
    worth: float
    missing: tuple[str, ...]
    plan: tuple[int, ...]
    planned: tuple[float, ...]

    def best(self, i: int | Sequence[int], many: bool = False) -> tuple[Option, float] | None:
        """The best trial for coefficient i, or several of them, and the mean part of their variance left.

        many: for ``MANY`` times the time at sea. None when no trial helps by ``HELPS``.
        """
        left = (self.left_by_many if many else self.left)[:, np.atleast_1d(i)].mean(axis=1)
        if not len(left) or left.min() > 1 - HELPS:
            return None
        k = simplest(-np.log(left))
        return self.options[k], float(left[k])

    def to_dict(self, symbols: Sequence[str]) -> dict[str, Any]:
        """Plain values for result.json, by coefficient of ``symbols`` (P,)."""
        runs_ = [{"name": o.name, "simulate": o.arguments} for o in self.options]
        return {
            "duration_s": self.duration,
            "worth": self.worth,
            "mean_prior_share": self.mean,
            "options": [r | {"mean_prior_share": share} for r, share in zip(runs_, self.total.tolist(), strict=True)],
            "best": {s: best_row(self.best(i)) for i, s in enumerate(symbols)},
            "plan": [runs_[k] | {"mean_prior_share": share} for k, share in zip(self.plan, self.planned, strict=True)],
            "left_out": list(self.left_out),
        }


def best_row(best: tuple[Option, float] | None) -> dict[str, Any] | None:
    """The ``best`` trial as plain values, None for none."""
    return {"name": best[0].name, "variance_left": best[1]} if best else None


def next_trial(
    calibration: Calibration, options: Sequence[Option] | None = None, duration: float | None = None
) -> NextTrial:
    """Score possible trials by what they would add to a calibration.

    options: default ``library`` of its ship, in wind only where her trials had wind; duration: time at sea of each
    [s], default 300 s of a 3 m model, Froude scaled. Noise levels, windows and step are those of the calibration.
    Returns what each would add, without options where the covariance is not finite. Takes seconds.
    """
    ship, prior = calibration.ship, calibration.prior
    P, C = len(prior.symbols), calibration.covariance
    seconds = duration or DURATION * time_scale(ship.particulars["L"])
    had = features(calibration.segments, ship)
    chosen, trials, left_out = runs(ship, options or library(ship, "wind" in had), seconds, calibration.segments.h)
    empty = np.empty((0, P))
    if not trials or not np.isfinite(C).all():
        return NextTrial(
            (), seconds, tuple(left_out), empty, empty, np.empty(0), np.nan, np.diag(C), 1.0, ("",) * P, (), ()
        )
    F, own_features = fisher(calibration, trials, seconds)
    data = calibration.information.of_data()
    worth = information_discount(data, C)
    A, F = worth * data + np.eye(P), worth * F
    own = np.diag(np.linalg.inv(A))
    left, by_many = (np.diagonal(np.linalg.inv(A + k * F), axis1=1, axis2=2) / own for k in (1, MANY))
    plan, planned = _plan(A, F)
    return NextTrial(
        tuple(chosen),
        seconds,
        tuple(left_out),
        left,
        by_many,
        (left * own).mean(axis=1),
        float(own.mean()),
        np.diag(C).copy(),
        worth,
        tuple(missing(F[:, i, i], own_features, had) for i in range(P)),
        plan,
        planned,
    )


def runs(
    ship: Ship, options: Sequence[Option], seconds: float, dt: float
) -> tuple[list[Option], list[Trial], list[str]]:
    """Those of ``options`` that ``ship`` can run for ``seconds`` at steps of ``dt`` [s], their trials, and why the
    others are left out."""
    chosen, trials, left_out = [], [], []
    for option in options:
        try:
            maneuver = parse_maneuver(option.maneuver, ship, n=option.n, speed=option.speed, duration=seconds)
            trial = simulate(ship, maneuver, dt, option.wind)
        except UserError as error:
            left_out.append(f"{option.name}: {error}")
            continue
        if len(trial) < 12:
            left_out.append(f"{option.name}: over before it begins")
        else:
            chosen.append(option)
            trials.append(trial)
    return chosen, trials, left_out


def fisher(calibration: Calibration, trials: Sequence[Trial], seconds: float) -> tuple[np.ndarray, list[frozenset]]:
    """Information (K, P, P) of runs of the calibrated ship, each repeated to fill ``seconds``, and their features.

    calibration: whose ship, noise and windows are used; trials: the K runs. In prior standard deviations, prior
    excluded, the initial state of every window being unknown.
    """
    ship, settings, P = calibration.ship, calibration.settings, len(calibration.prior.symbols)
    h = calibration.segments.h
    window = settings.window or 100 * h
    parts = cut(trials, h, window, settings.interval, shortest=10 * h, inputs=ship.inputs)
    problem = _problem(calibration, parts)
    p = np.concatenate([calibration.p, np.zeros(problem.P - P)])
    per_window = information(problem, problem.join(problem.measured_nodes, p)).fisher[:, :P, :P]
    F = group_sums(parts.run, np.nan_to_num(per_window), len(trials))
    repeats = np.array([repetitions(t, seconds, ship) for t in trials])
    found = [features(parts.subset(np.flatnonzero(parts.run == k)), ship) for k in range(len(trials))]
    return F * repeats[:, None, None], found


def _problem(calibration: Calibration, parts: Segments) -> Problem:
    """That of the calibrated ship on the windows ``parts``, with the kernels of the calibration where its ship had the
    same coefficients; constants of campaigns come last then, at their mean."""
    ship, prior, fitted = calibration.ship, calibration.prior, calibration.problem
    if ship.symbols != fitted.ship.symbols or ship.effects != fitted.ship.effects:
        return Problem.of(ship, prior, parts, calibration.sigma, compiled=calibration.settings.compiled)
    return Problem(ship, prior.joined(ship, fitted.prior.constants), fitted.kernels, parts, calibration.sigma)


def repetitions(trial: Trial, seconds: float, ship: Ship) -> float:
    """How often a ``trial`` of a ``ship`` is run in so many ``seconds``, with way for another approach between: 1 or
    more."""
    speed = max(abs(float(trial["u"][0])), 0.01 * reference_speed(ship.particulars["L"]))
    between = REGAIN * ship.particulars["L"] / speed
    return max(1.0, (seconds + between) // max(trial.duration + between, 1e-9))


def simplest(gain: np.ndarray) -> int:
    """First of the trials whose gain (K,) is nearly the best."""
    return int(np.argmax(gain >= NEARLY * gain.max()))


def _plan(A: np.ndarray, F: np.ndarray, most: int = 3) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Up to ``most`` trials, each the best addition to those before it by the mean prior's share; and that mean.

    A: precision (P, P) before; F: (K, P, P) added by each trial.
    """
    plan: list[tuple[int, float]] = []
    for _ in range(most):
        means = np.diagonal(np.linalg.inv(A + F), axis1=1, axis2=2).mean(axis=1)
        k = simplest(float(np.diag(np.linalg.inv(A)).mean()) - means)
        plan.append((k, float(means[k])))
        A = A + F[k]
    numbers, shares = zip(*plan, strict=True)
    return numbers, shares


def advice(i: int, finding: CoefficientFinding, trial: NextTrial | None) -> str:
    """Which ``trial`` would help coefficient ``i``; "" when its ``finding`` needs none, or none was scored."""
    if trial is None or finding.kind in ("determined", "unknown") or not trial.options:
        return ""
    best = trial.best(i)
    if best:
        option, left = best
        after = trial.before[i] * left
        outcome = f"would bring its standard error down by {1 - np.sqrt(left):.0%}"
        if after < DETERMINED:
            outcome = f"would determine it (share {after:.0%})"
        return f"best next trial: {option.name}, {trial.duration:.0f} s of it {outcome}"
    many = trial.best(i, many=True)
    if many:
        option, left = many
        return (
            f"{trial.duration:.0f} s of no trial of the library would help by much; {MANY} times that of "
            f"{option.name} would bring its standard error down by {1 - np.sqrt(left):.0%}"
        )
    return "none of the library would help: take it from captive tests, computation or regression"


def identifiability_dict(found: Identifiability, trial: NextTrial | None = None) -> dict[str, Any]:
    """Plain values for result.json: what was ``found``, a sentence each, and the trials scored (``trial``), if any."""
    content = found.to_dict()
    for i, finding in enumerate(found.findings):
        missing, help_ = trial.missing[i] if trial else "", advice(i, finding, trial)
        words = verdict(finding, missing)
        content["coefficients"][finding.symbol] |= {
            "sentence": f"{words}; {help_}" if help_ else words,
            "cause": cause(finding, missing),
            "advice": help_,
        }
    if trial:
        symbols = [f.symbol for f in found.findings]
        content["next_trial"] = trial.to_dict(symbols)
        for cluster in content["clusters"]:
            cluster["best_trial"] = best_row(trial.best([symbols.index(s) for s in cluster["symbols"]]))
    return content
