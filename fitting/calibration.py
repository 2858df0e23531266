"""Calibration of a ship on trials: estimates of the free coefficients of a ship.

Two estimates of the same coefficients are averaged (``with_second``). Multiple shooting predicts windows open loop, so
that it is right over a manoeuvre, but takes what pushed the ship for a part of her; a filter predicts the next sample
from the past, with random forces between, so that it is hardly misled by gusts, but sees the error of a second, not of
a minute. Where the model is not quite the ship, both are off in their own way, and their mean is off less (a composite
likelihood, Varin, Reid and Firth 2011, in equal parts). On the 35 records of Train-TZRB+, left out in five folds, it
predicts every kind of manoeuvre better than multiple shooting alone ("windows alone" in ``benchmarks/ablation.md``).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.inputs import assumed
from cases.trial import Trial
from cases.trial_set import TrialSet
from fitting.identifiability.analysis import (
    Identifiability,
    analyse,
    calibrated_ship,
    estimate_warnings,
    with_estimates,
)
from fitting.identifiability.data_checks import (
    against_captive,
    contradictions,
    outlying_runs,
    refuse_outliers,
    unexcited_astern,
)
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.loss import Loss
from fitting.nlp.prior import ByCampaign, Own, RunConstants, neutral_values, prior_with, ship_of_all
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.windows import Segments, cut, default_step
from fitting.parallel import with_one_thread
from fitting.settings import Settings, Start
from fitting.solvers.control import Control
from fitting.solvers.noise import ResidualNoise, Resumption, noise_of, solve_row, solve_with_noise_estimation
from fitting.solvers.reduced import ReducedProblem
from fitting.solvers.solve import Solution, solve, solve_starts
from fitting.uncertainty.sandwich import Robust, robust
from mmg.effects import EFFECTS
from mmg.errors import BadValue, Missing, OutOfRange, UnknownName
from mmg.messages import Message, OnProgress, as_messages
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.nlp.captive import Captive


# Condition number of the covariance [-] beyond which doubles leave its inverse four digits at most. Set by hand.
SINGULAR = 1e12


@dataclass(frozen=True)
class Calibration:
    """A calibrated ship and how it came about.

    ship: with estimates, standard errors, priors and verdicts. p, covariance: scaled estimate (P,) and its covariance
    (P, P) in prior standard deviations, robust to correlated residuals (fitting/uncertainty/sandwich.py), of what all
    runs share, as ``prior``; identifiability: what the trials determine. noise: estimated from the residuals of the
    last solve; solution: of that solve; passes: objective and status of every solve. information: of each window on p,
    from which ``spread`` has the robust and the model-based covariance; problem: solved; resumption: how to go on with
    the last solve. constants: what each run has of its own; solution, information, spread and problem are of all that
    was fitted, the shared ones first. data_warnings: on the trials and on what the fit began with; outlying: on runs
    that the others contradict; draft: its last solve is left out, ``solution`` is where that begins; trials: fitted.
    """

    ship: Ship
    prior: Prior
    p: np.ndarray
    covariance: np.ndarray
    noise: ResidualNoise
    identifiability: Identifiability
    solution: Solution
    settings: Settings
    passes: tuple[dict, ...]
    starts: tuple[Start, ...]
    data_warnings: tuple[Message, ...]
    notices: tuple[Message, ...]
    timings: dict[str, float]
    information: Information
    spread: Robust
    problem: Problem
    resumption: Resumption
    constants: RunConstants | None
    draft: bool = False
    outlying: tuple[Message, ...] = ()
    trials: TrialSet = field(default_factory=lambda: TrialSet(()))

    @property
    def converged(self) -> bool:
        """Whether the last solve did."""
        return self.solution.converged

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the residuals in the last solve, (6,)."""
        return self.problem.sigma

    @property
    def segments(self) -> Segments:
        """The windows fitted."""
        return self.problem.segments

    @property
    def warnings(self) -> tuple[Message, ...]:
        """What must be known before the estimates are used, of them and of the trials; () of a draft."""
        if self.draft:
            return ()
        p = np.clip(self.problem.split(self.solution.x)[1], *self.problem.p_bounds())
        p[: len(self.p)] = self.p  # the mean of two estimates, where it is one
        unsure = []
        if self.converged and len(self.starts) < self.settings.starts:
            words = f"only {len(self.starts)} of {self.settings.starts} starts were solved before the run was stopped"
            unsure.append(Message(words, "starts_left_out"))
        if (condition := condition_number(self.covariance)) > SINGULAR:
            words = (
                f"condition number {condition:.1g}: some combination of coefficients is not determined at all and the "
                "standard errors are unreliable; add trials that excite it, or fix coefficients (--fix)"
            )
            unsure.append(Message(words, "ill_conditioned"))
        of_estimates = estimate_warnings(self.problem, self.solution, p, list(self.starts))
        return (*of_estimates, *unsure, *self.data_warnings, *self.outlying)

    def with_estimate(self, p: np.ndarray, more: np.ndarray) -> Calibration:
        """With the scaled estimate ``p`` (P,) in place of its own and ``more`` (P, P) added to the covariance: values,
        standard errors, findings and verdicts are those of the estimate that is handed out."""
        covariance = self.covariance + more
        findings = analyse(self.prior, p, covariance, self.information.of_data())
        ship = with_estimates(self.ship, self.prior, p, covariance, findings, self.converged)
        every, shared = self.spread.covariance.copy(), slice(len(p))
        every[shared, shared] = covariance
        spread = replace(self.spread, covariance=every)
        return replace(self, p=p, covariance=covariance, identifiability=findings, spread=spread, ship=ship)

    def of_trials(self, trials: TrialSet, warnings: Sequence[Message], notices: Sequence[Message]) -> Calibration:
        """This calibration as of these ``trials``, with ``warnings`` and ``notices`` on them."""
        return replace(self, trials=trials, data_warnings=tuple(warnings), notices=tuple(notices))

    @property
    def iterate(self) -> dict[str, np.ndarray]:
        """From which a fit can be resumed: scaled estimates "p" of all that was fitted, as the solver ended, constants
        of the runs last, states "nodes" (B, S), "sigma" (6,), and where the last solve began (``Resumption``)."""
        nodes, p = self.problem.split(self.solution.x)
        p = np.clip(p, *self.problem.p_bounds())
        return {"p": p, "nodes": nodes, "sigma": self.sigma, **self.resumption.arrays}


def condition_number(covariance: np.ndarray) -> float:
    """Largest over smallest eigenvalue of a covariance (P, P); infinite where it is no covariance."""
    if not np.isfinite(covariance).all():
        return float("inf")
    values = np.linalg.eigvalsh(covariance)
    return float(values[-1] / values[0]) if values[0] > 0 else float("inf")


def prepared(
    ship: Ship,
    trials: Sequence[Trial],
    settings: Settings,
    warm: dict[str, np.ndarray] | None,
    captive: Captive | None,
    per_run: Own,
) -> tuple[Problem, np.ndarray, Settings, list[Message], list[Message]]:
    """A problem, where to start, the settings used, and the warnings and notices on the way.

    ship, trials, settings, captive, per_run: as of ``calibration.estimate_coefficients``; warm: as there, with "p"
    (P,), "nodes" (B, S) and "sigma" (6,). Raises UserError for input from which nothing can be identified.
    """
    trials = TrialSet.of(trials).moving("fit")
    if not ship.free:
        raise Missing(f"{ship.name}: every coefficient is fixed; free some of them in the ship file or with --only")
    step = settings.step or default_step(trials, ship.particulars["L"])
    window = settings.window or 100.0 * step  # 100: set by hand; rows ``windows of`` of benchmarks/ablation.md
    if window < 10 * step:
        raise OutOfRange(f"a window of {window:g} s holds fewer than ten steps of {step:g} s; use a longer --window")
    segments = cut(trials, step, window, settings.interval, inputs=ship.inputs)
    refuse_outliers(trials, step)
    unexcited = unexcited_astern(ship, segments)
    own = per_run.symbols if isinstance(per_run, ByCampaign) else tuple(per_run)
    prior = prior_with(ship, per_run, segments.trials)
    warnings = [*contradictions(prior), *unexcited]
    # of the first solve alone [SI]: typical changes over a window, set by hand; 1e-6 [m/s]: no size of zero
    speed, length = np.sqrt((segments.nodes[:, 3:5] ** 2).sum(axis=1).mean()) + 1e-6, ship.particulars["L"]
    rough = (length / 3, length / 3, 0.1, 0.1 * speed, 0.1 * speed, 0.1 * speed / length)
    sigma = np.asarray(settings.sigma or rough, dtype=float)
    if sigma.shape != (6,) or not (sigma > 0).all():
        raise BadValue("sigma must be six positive numbers: x, y [m], psi [rad], u, v [m/s], r [rad/s]")
    problem = Problem.of(ship, prior, segments, sigma, Loss(settings.loss), captive, settings.compiled)
    if problem.captive:
        shared = prior.positions(ship)[: prior.shared]
        warnings += against_captive(problem.captive, neutral_values(ship, own), shared, prior.common)
    x = problem.start()
    if warm and len(warm.get("p", ())) == problem.P:  # of an interrupted run that fits
        x = problem.start(warm["p"])
        if len(warm.get("nodes", ())) == problem.B:
            x = problem.join(warm["nodes"], np.clip(warm["p"], *problem.p_bounds()))
        problem = problem.with_sigma(warm["sigma"]) if "sigma" in warm and not settings.sigma else problem
    notices = [*segments.dropped, *as_messages(ship.notices, "ship")]
    if names := ", ".join(t.name for t in trials if not t.has_position):
        notices.append(Message(f"positions cannot be fitted in {names} (no complete x, y columns)", "no_position"))
    notices += assumed(trials, ship.inputs)
    if why := problem.kernels.interpreted_because:
        notices.append(Message(f"running without compiled code, several times slower: {why}", "interpreted"))
    return problem, x, replace(settings, step=step, window=window), warnings, notices


@with_one_thread
@np.errstate(all="ignore")
def estimate_coefficients(
    ship: Ship,
    trials: Sequence[Trial],
    settings: Settings | None = None,
    progress: OnProgress | None = None,
    warm: dict[str, np.ndarray] | None = None,
    captive: Captive | None = None,
    per_run: Own = (),
    draft: bool = False,
) -> Calibration:
    """Fit the free coefficients of ``ship`` to ``trials``, jointly over all of them.

    The residual's standard deviation of each state is re-estimated from solve to solve (``ResidualNoise``) until it
    settles. settings: of windows and solver; progress: called at each iteration of the solver, with the objective and
    the constraint violation; warm: ``Calibration.iterate`` of an interrupted run, which goes on as if it had not been,
    or its "p" (P,) alone, and "held" (P,) where coefficients stay where the solver starts, their covariance being that
    of a fit in which they move; captive: points whose forces are fitted too; per_run: coefficients of effects of the
    ship, fixed in it, of which each run, or each campaign, gets its own (``cases.shipfiles.effects.varying_effects``);
    draft: leave out the last solve where rough ones of all windows came before, for a calibration that another may
    replace; ``finished`` makes it. Returns the calibration, whose ship is without those effects of runs, and has those
    of campaigns at their mean; a solver that stops early is no error: the best iterate is kept and ``converged`` is
    False. Raises UserError for input from which nothing can be identified.
    """
    began, warm, settings = time.perf_counter(), warm or {}, settings or Settings()
    control = Control.within(settings.time_limit, progress, settings.max_iterations)
    problem, x, settings, warnings, notices = prepared(ship, trials, settings, warm, captive, per_run)
    resumed = Resumption.of_arrays(warm, problem)
    near = resumed is None and len(warm.get("nodes", ())) == problem.B
    prepare = time.perf_counter() - began
    found = estimated(problem, StartingPoint(x, resumed, near), settings, control, per_run, draft, warm.get("held"))
    timings = {**found.timings, "prepare": prepare, "total": prepare + found.timings["total"]}
    notices = list(dict.fromkeys(notices))
    return replace(found, timings=timings).of_trials(TrialSet.of(trials), warnings, notices)


@dataclass(frozen=True)
class StartingPoint:
    """Where solves begin: x (n,); resumed, near: as of ``solve_with_noise_estimation``."""

    x: np.ndarray
    resumed: Resumption | None = None
    near: bool = False


@with_one_thread
@np.errstate(all="ignore")
def estimated(
    problem: Problem,
    start: StartingPoint,
    settings: Settings,
    control: Control,
    per_run: Own = (),
    draft: bool = False,
    held: np.ndarray | None = None,
) -> Calibration:
    """The calibration by ``problem`` from a ``start``, without warnings and notices on its trials.

    settings: with step and window; control: of all solves; per_run, draft: as of ``estimate_coefficients``; held: (P,)
    coefficients that stay where they start.
    """
    began, free, x = time.perf_counter(), problem.prior, start.x
    if held is not None:
        here = free.mean + free.std * problem.split(x)[1]
        problem = problem.with_bounds(np.where(held, here, free.lower), np.where(held, here, free.upper))
    solves = solve_with_noise_estimation(problem, x, settings, control, start.resumed, start.near, draft)
    seconds = time.perf_counter() - began  # without further starts
    best, starts = solve_starts(solves.problem, solves.solution, settings, control)
    statistics = _statistics(solves.problem.with_changes(prior=free), best, per_run)  # all coefficients move in these
    moves = statistics["spread"].moves
    # of a copy, whose caches are not kept with the calibration
    is_judged = not solves.draft and np.isfinite(best.objective)
    outlying = outlying_runs(statistics["problem"].with_changes(), best.x, moves) if is_judged else []
    return Calibration(
        **statistics,
        noise=solves.noise,
        solution=best,
        settings=settings,
        passes=solves.passes,
        starts=tuple(starts),
        data_warnings=(),
        notices=(),
        timings={"prepare": 0.0, "solve": seconds, "total": time.perf_counter() - began},
        resumption=solves.resumption,
        draft=solves.draft,
        outlying=tuple(outlying),
    )


def finished(draft: Calibration, progress: OnProgress | None = None) -> Calibration:
    """The ``draft`` with its last solve made; progress: called at each iteration."""
    control = Control.within(draft.settings.time_limit, progress, draft.settings.max_iterations)
    last = estimated(draft.problem, StartingPoint(draft.solution.x, draft.resumption), draft.settings, control)
    timings = {name: seconds + last.timings[name] for name, seconds in draft.timings.items()}
    last = replace(last, passes=(*draft.passes, *last.passes), timings=timings)
    return last.of_trials(draft.trials, draft.data_warnings, draft.notices)


@np.errstate(all="ignore")
def solve_again(found: Calibration, hold: Mapping[str, float], progress: OnProgress | None = None) -> Calibration:
    """The calibration ``found`` solved once more, from where it ended and with the noise that it assumed, while the
    coefficients ``hold`` (values by symbol) stay.

    progress: called at each iteration. Returns it with the covariance of a fit in which all coefficients move. Raises
    UserError for a symbol that not all runs share and for a value outside its bounds.
    """
    began, problem, prior = time.perf_counter(), found.problem, found.problem.prior
    lower, upper = prior.lower.copy(), prior.upper.copy()
    for symbol, value in hold.items():
        if symbol not in found.prior.symbols:
            raise UnknownName(f"{symbol}: not free; what can be held is {', '.join(found.prior.symbols)}")
        i = prior.symbols.index(symbol)
        if not prior.lower[i] <= value <= prior.upper[i]:
            raise OutOfRange(f"{symbol} = {value:g}: must lie between {prior.lower[i]:g} and {prior.upper[i]:g}")
        lower[i] = upper[i] = value
    held, (nodes, p) = problem.with_bounds(lower, upper), problem.split(found.solution.x)  # equal bounds hold
    x = held.join(nodes, np.clip(p, *held.p_bounds()))
    s = found.settings
    best = solve(held, x, Control.within(s.time_limit, progress, s.max_iterations).of("refit"), s.tolerance)
    names = found.constants.runs if found.constants else ()
    own = ByCampaign(prior.constants, names, prior.campaign) if prior.campaign else prior.constants
    seconds = time.perf_counter() - began
    return replace(
        found,
        **_statistics(problem, best, own),
        noise=noise_of(held, best),
        solution=best,
        passes=(solve_row(held, best),),
        starts=(Start(0, best.objective, best.converged, 0.0),),
        timings={"prepare": 0.0, "solve": seconds, "total": seconds},
        resumption=replace(found.resumption, x=x, best=best.x),  # number and noise of the solve stay
    )


def _statistics(problem: Problem, best: Solution, per_run: Own) -> dict[str, Any]:
    """What the ``best`` solution of the ``problem`` says of the coefficients, by attribute of ``Calibration``.

    per_run: as of ``estimate_coefficients``.
    """
    prior = problem.prior
    shared, common = slice(prior.shared), prior.common
    p = np.clip(problem.split(best.x)[1], *problem.p_bounds())
    info = information(problem, best.x)
    spread = robust(info)
    covariance = spread.covariance[shared, shared]  # own constants are not fixed in it: they are marginalised
    findings = analyse(common, p[shared], covariance, info.of_data())
    names = per_run.names if isinstance(per_run, ByCampaign) else problem.segments.trials
    constants = RunConstants.of(problem.ship, prior, p, spread.covariance, names)
    own_ship = ship_of_all(problem.ship, per_run, constants)
    return {
        "ship": calibrated_ship(own_ship, common, p[shared], covariance, findings, best.converged),
        "prior": common,
        "p": p[shared],
        "covariance": covariance,
        "identifiability": findings,
        "information": info,
        "spread": spread,
        "problem": problem.with_changes(),  # without what it has cached
        "constants": constants,
    }


@dataclass(frozen=True)
class SecondEstimate:
    """What another estimator of the same coefficients finds.

    values: of free coefficients, and of the suspects, by symbol, or why there are none; suspects: symbols of parameters
    of effects that the trials speak for beside the coefficients, as "current.x", to be fitted along; by_run: names of
    effects of which each run gets its own constants; is_sampled:
    whether their actuators are taken as joined by straight lines; messages: on both; random_force: its
    sizes "X", "Y" [N], "N" [N m] and "memory_s", None where they are not known.
    """

    values: Mapping[str, float] | str
    suspects: tuple[str, ...] = ()
    by_run: tuple[str, ...] = ()
    is_sampled: bool = False
    messages: tuple[Message, ...] = ()
    random_force: dict[str, float] | None = None

    def of_suspects(self) -> dict[str, float]:
        """Values of the suspects by symbol."""
        return {} if isinstance(self.values, str) else {s: self.values[s] for s in self.suspects}


# Another estimator: of a ship on trials; then whether suspects that it finds are fitted along, and surroundings too.
Second = Callable[[Ship, Sequence[Trial], bool, bool], SecondEstimate]
# Share [-] of the second estimate: the plain mean of both. Set by hand; the row ``filter alone`` of
# benchmarks/ablation.md has the other end.
SHARE = 0.5


def averages(ship: Ship) -> bool:
    """Whether estimates of ``ship`` are averaged with a second one: only coefficients and instruments are free."""
    own = {s.partition(".")[0] for s in ship.free if "." in s}  # "current.x" is of an effect, "Y_v" of the ship
    return all(name in EFFECTS and EFFECTS[name].measures for name in own)


def with_second(found: Calibration, second: Mapping[str, float] | str) -> Calibration:
    """The calibration ``found`` with the means of its estimates and those of a ``second`` estimator.

    Its covariance has the square of half their difference added: so far each may be off by its own way of seeing what
    the model lacks. As it is, with a notice, where ``second`` says why it has none, and where the mean is worse than
    the second estimate by the objective of ``found``, as no point between two minima of one valley is.
    """
    if isinstance(second, str):
        return _noted(found, f"the estimate is that of multiple shooting alone: {second}")
    if not np.isfinite(found.covariance).all():
        return found
    prior = found.prior
    other = np.array([second.get(s, np.nan) for s in prior.symbols])
    apart = np.nan_to_num((other - prior.mean) / prior.std - found.p)  # 0 where the second has none
    p = np.clip(found.p + SHARE * apart, *prior.scaled_bounds)
    ratio = apart / np.sqrt(np.diag(found.covariance))  # in standard errors of multiple shooting
    farthest = ", ".join(f"{prior.symbols[i]} ({ratio[i]:+.1f})" for i in np.argsort(-np.abs(ratio))[:3])
    reduced = ReducedProblem(found.problem, found.solution.x)
    costs = [
        reduced.value(dict(zip(prior.symbols, (prior.mean + prior.std * at).tolist(), strict=True)))
        for at in (p, found.p + apart)
    ]
    if not costs[0] < costs[1]:  # not >=, so that nan counts as worse
        words = (
            "the estimate is that of multiple shooting alone: a Kalman filter finds another, and predictions between "
            f"both are worse than by either; they differ most in {farthest} standard errors"
        )
        return _noted(found, words)
    words = (
        "coefficients are the mean of two estimates, by multiple shooting and by a Kalman filter, which differ most in "
        f"{farthest} standard errors of the former; half of that is part of the errors given"
    )
    return _noted(found.with_estimate(p, SHARE**2 * np.outer(apart, apart)), words)


def _noted(found: Calibration, words: str) -> Calibration:
    """The notice comes first, so that those of a run that goes on have the same order."""
    return replace(found, notices=(Message(words, "two_estimates"), *found.notices))
