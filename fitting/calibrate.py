"""Calibration from trials to a result: estimate, scores, what the trials determine, uncertainty, prediction bands, and
the rows of result.json on them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.checks.single import doubtful_revolutions
from cases.criteria.own_rates import with_own_rates, with_speed_through_water
from cases.quantities import UNITS
from cases.shipfiles.effects import suspects_in, varying_effects, with_instruments, with_suspects
from cases.trial import Trial
from cases.trial_set import TrialSet, shared_rows
from fitting.calibration import (
    Calibration,
    Second,
    SecondEstimate,
    averages,
    condition_number,
    estimate_coefficients,
    finished,
    solve_again,
    with_second,
)
from fitting.design.next_trial import identifiability_dict, next_trial
from fitting.parallel import with_one_thread
from fitting.prediction.bands import draws_of, fit_bands
from fitting.prediction.envelope import trial_envelope
from fitting.prediction.score import (
    NO_SCORES,
    ScorePair,
    adaptation_worth,
    score_messages,
    score_pairs,
    scores_by_set,
    worth_message,
    worth_of_left_out,
)
from fitting.record import CoefficientRow, FitObjects, FitRecord
from fitting.report.run_folder import data_rows, plain, versions
from fitting.result import FitResult
from fitting.selection.campaigns import CampaignFit, by_campaign, may_keep, not_asked, with_values
from fitting.selection.left_out_runs import coefficients_without, each_alone
from fitting.settings import Settings, check_estimator
from fitting.solvers.control import Control, Made, OutOfTimeError, left_out_message, make_in_turn
from fitting.uncertainty.refits import check_request, failed_refits, refit_rows
from fitting.uncertainty.sandwich import changes_without_each
from mmg.errors import Conflict, check_name, refusing
from mmg.messages import LOGGER, Message, OnProgress, message_rows
from mmg.motion.flow import STATES
from mmg.rollout import Simulator
from mmg.ship import CalibrationMark, Ship

if TYPE_CHECKING:
    from fitting.nlp.captive import Captive
    from fitting.selection.sisters import UncertainMean


# What is said where a fit asks for what a filter does not know.
ALONE = (
    "the estimate is that of multiple shooting alone, and the usual suspects (antenna, current, compass, log, sampled "
    "inputs) were not looked for: the filter that finds them knows no values by run, captive tests, profiles, refits "
    "and held values; fit without these to see"
)
# Share [-] of the limit of time that the second estimate may take, which comes first. Set by hand: both take about as
# long.
TIME_SHARE = 0.5
# What is made first, by its name among the parts of a fit.
SECOND = "second estimate"


@refusing
@dataclass(frozen=True)
class FitOptions:
    """Options of a calibration besides the settings of its solver.

    bootstrap: refits to runs drawn with replacement; profile: coefficients whose likelihood is profiled; posterior:
    draws from the posterior by the no-U-turn sampler; next_trial: whether trials are named that would determine what is
    left open; per_run: effects of which each run has its own constants ("NAME" or "NAME:parameter=prior");
    per_campaign: instruments that may differ between campaigns, () for the usual ones, ("none",) for none;
    instruments: as of ``with_instruments``, and with ("none",) suspects of the second estimate are not fitted along;
    captive: points of captive tests that are fitted too; start: values from which the solver begins, by symbol; hold:
    these stay, and only what else is free and the noise is estimated; resume: an interrupted run of the same data and
    ship, from whose iterate to go on; command: stored as what made the result; name: of the ship and her calibration,
    "": the ship keeps hers, and the calibration takes that of the run folder; surroundings: whether a current that the
    second estimator finds is fitted along; prior_mean: how uncertain the mean of the prior is, where other ships told
    it. estimator: "both" fits the suspects of a ``second`` estimator along, where there is one, and takes the mean of
    both where nothing else is free than coefficients and instruments; "windows" what multiple shooting gives.
    """

    bootstrap: int = 0
    profile: tuple[str, ...] = ()
    posterior: int = 0
    next_trial: bool = True
    per_run: tuple[str, ...] = ()
    per_campaign: tuple[str, ...] = ()
    instruments: tuple[str, ...] = ("shown",)
    captive: Captive | None = None
    start: Mapping[str, float] = field(default_factory=dict)
    hold: bool = False
    resume: FitResult | None = None
    command: str = ""
    name: str = ""
    surroundings: bool = True
    prior_mean: UncertainMean | None = None
    estimator: str = "both"
    second: Second | None = None

    def __post_init__(self) -> None:
        check_name(self.name, "calibration")  # before the work, not where its result is named

    @property
    def asks_second(self) -> bool:
        """Whether the second estimator is asked: it knows no other data than trials, and refits, profiles and held
        values are those of multiple shooting alone."""
        return self.estimator == "both" and not any(
            (self.captive, self.per_run, self.bootstrap, self.profile, self.hold)
        )


@dataclass(frozen=True)
class FitTask:
    """What a calibration is asked for.

    start: the ship with the rates that her trials show; ship: she with the instruments and suspects that are fitted;
    trials, validation: fitted and held out; settings, options: as of ``calibrate``; by_run: effects of which each run
    gets its own constants since the trials speak for it; remarks: on the trials; notes: on the ship and the options.
    """

    start: Ship
    ship: Ship
    trials: TrialSet
    validation: TrialSet
    settings: Settings
    options: FitOptions
    by_run: tuple[str, ...] = ()
    remarks: tuple[Message, ...] = ()
    notes: tuple[Message, ...] = ()

    @property
    def prepared(self) -> FitTask:
        """The task with the ship's own rates and her instruments. Raises UserError for contradicting options."""
        start, notes = with_own_rates(self.start, self.trials)
        ship, options = with_instruments(start, self.options.instruments, self.trials), self.options
        _check_options(ship, options)
        if options.per_run:
            notes.append(_without_own(options.per_run))
            if len(self.trials) == 1:
                same = f"--with {' --with '.join(options.per_run)}"
                LOGGER.info(f"a single run: its own constants are, but for the narrower prior, those of {same}")
        if options.second and options.estimator == "both" and not options.asks_second:
            notes.append(Message(ALONE, "two_estimates"))
        return replace(self, start=start, ship=ship, notes=tuple(notes))

    def asked_first(self, second: Second, seconds: float, made: Made) -> FitTask:
        """The task after the ``second`` estimate, which may take so many ``seconds`` and is ``made``: it tells what
        else is to be free, and how inputs are joined."""
        frees, along = tuple(self.options.instruments) != ("none",), self.options.surroundings
        with Control.within(seconds).in_force():
            make_in_turn({SECOND: lambda: second(self.start, self.trials, frees, along)}, made)
        other = made.get(SECOND, SecondEstimate("interrupted"))
        trials, validation = (
            (self.trials.sampled, self.validation.sampled) if other.is_sampled else (self.trials, self.validation)
        )
        return replace(
            self,
            ship=with_suspects(self.ship, other.suspects),
            trials=trials,
            validation=validation,
            options=replace(self.options, start={**other.of_suspects(), **self.options.start}),
            by_run=other.by_run,
            remarks=(*self.remarks, *other.messages),
            notes=(*self.notes, *([_without_own(other.by_run)] if other.by_run else [])),
        )


def _without_own(names: Sequence[str]) -> Message:
    own = f"the constants that runs have of their own ({', '.join(names)})"
    words = f"scores and intervals are without {own}, as of runs never seen"
    water = "; training runs are judged through the water that the fit found" if "current" in names else ""
    return Message(f"{words}{water}", "without_own_constants")


@with_one_thread
def calibrate(
    ship: Ship,
    trials: Sequence[Trial],
    validation: Sequence[Trial] = (),
    settings: Settings | None = None,
    options: FitOptions | None = None,
    progress: OnProgress | None = None,
) -> FitResult:
    """Calibrate the free coefficients of ``ship`` on ``trials`` and judge the result, also on ``validation`` trials.

    Trials whose sidecar gives them the role test or validate are not trained on. settings: of the solver; options: what
    else is wanted; progress: called at each iteration. Returns the result, whose ``converged`` is False for a solver
    that stopped early; what Ctrl-C left out after the coefficients were solved is named in a warning. Raises UserError
    for input from which nothing can be identified, contradicting options, an interrupted run of other data.
    """
    began, made = time.perf_counter(), Made()
    settings, options = settings or Settings(), options or FitOptions()
    fitted, remarks = TrialSet.of(trials).training(validation)
    task = FitTask(ship, ship, fitted, TrialSet.of(validation), settings, options, remarks=tuple(remarks)).prepared
    limit = Control.within(settings.time_limit)
    if options.second and options.asks_second:
        task = task.asked_first(options.second, TIME_SHARE * limit.seconds, made)
    with limit.in_force():
        fit = _estimated(task, made, progress)
    found = fit.calibration
    if options.prior_mean is not None:
        from fitting.selection.sisters import with_uncertain_mean  # late: only the ships of a fleet have sisters

        found = with_uncertain_mean(found, options.prior_mean)
    if options.second and options.asks_second and averages(task.start) and found.converged:
        found = with_second(found, made.get(SECOND, SecondEstimate("interrupted")).values)
    objects = _with_parts(found, task, limit, made)
    return _result(fit, made, objects, task, began)


def _with_parts(found: Calibration, task: FitTask, limit: Control, made: Made) -> FitObjects:
    """The objects of the calibration ``found`` of a ``task``. What else is asked for within the ``limit`` is ``made``,
    or missing in it."""
    settings, options = task.settings, task.options
    before, after = Simulator(task.ship, settings.compiled), Simulator(found.ship, settings.compiled)
    objects = FitObjects(found, before, after, task.validation)
    sets, apart = objects.sets, coefficients_without(found, each_alone(len(found.trials)))  # (R, P): without each run
    # of trials that nobody fitted, else of its own, each left out
    past = (task.validation, None) if any(t.has_position for t in task.validation) else (objects.trials, apart)
    known = plain({"coefficients": coefficient_rows(found), "correlation": correlation_of(found)})
    # in this order: the second takes what the first has ``made``
    parts: dict[str, Callable[[], Any]] = {
        "scores": lambda: score_pairs(scores_by_set(before, sets), scores_by_set(after, sets)),
        "worth of what was left out": lambda: worth_of_left_out(after, sets, made["scores"]),
        "worth of adaptation": lambda: adaptation_worth(after, *past),
        "prediction bands": lambda: fit_bands(after, objects.trials, draws_of(known, found.ship), apart),
    }
    if options.next_trial and found.converged and np.isfinite(found.covariance).all():
        parts["next trial"] = lambda: next_trial(found)
    if options.bootstrap:
        parts["--bootstrap"] = lambda: refit_rows(found, options.bootstrap, (), limit.end)
    if options.profile:
        parts["--profile"] = lambda: refit_rows(found, 0, options.profile, limit.end)
    if options.posterior and found.converged:
        from fitting.uncertainty.posterior import sampled_posterior  # late: few ask for draws

        parts["--posterior"] = lambda: sampled_posterior(found, options.posterior, settings.seed)
    make_in_turn(parts, made)
    return replace(objects, posterior=made.get("--posterior"))


@with_one_thread
def refit(earlier: FitResult, hold: Mapping[str, float], progress: OnProgress | None = None) -> FitResult:
    """The calibration ``earlier`` again, from where it ended, with the coefficients ``hold`` (values by symbol) held.

    Trials, windows and the noise that residuals are weighed by stay as they were, so that objectives can be compared; a
    second estimate keeps its distance. Standard errors are those of a fit in which all coefficients move. Left out is
    all but coefficients, noise and scores; progress: called at each iteration. Returns the result. Raises UserError for
    a result that was read from a folder, for a symbol that is not free and a value outside its bounds.
    """
    began, objects, made = time.perf_counter(), earlier.fitted_objects, Made()
    before = objects.calibration
    found = solve_again(before, hold, progress)
    # of the mean from the estimate of multiple shooting, scaled (P,); what is held has none
    distance = np.where(np.isin(found.prior.symbols, list(hold)), 0.0, before.p - before.iterate["p"][: len(before.p)])
    if distance.any():
        p = np.clip(found.p + distance, *found.prior.scaled_bounds)
        found = found.with_estimate(p, np.outer(distance, distance))
    after = Simulator(found.ship, found.settings.compiled)
    scores = scores_by_set(after, objects.sets)
    made["scores"] = {name: ScorePair(earlier.scores[name].before, score) for name, score in scores.items()}
    made["envelope"] = earlier.envelope  # of the same trials
    fit = with_values(CampaignFit(found, earlier.campaigns), objects.trials.campaigns)
    options = FitOptions(command=earlier.command, name=earlier.ship.name)  # of what ``_result`` reads
    remarks = TrialSet((*objects.trials, *objects.validation)).remarks
    objects = replace(objects, calibration=found, after=after, posterior=None)
    start, settings = earlier.start, found.settings
    task = FitTask(
        start, start, found.trials, TrialSet.of(objects.validation), settings, options, remarks=tuple(remarks)
    )
    return _result(fit, made, objects, task, began)


def _result(fit: CampaignFit, made: Made, objects: FitObjects, task: FitTask, began: float) -> FitResult:
    """The result of the ``fit`` of a ``task``, with its ``objects`` and what is ``made`` of it."""
    found, trials, validation = objects.calibration, objects.trials, objects.validation
    start, content = task.ship, _content(fit, made, objects, task.options)
    ship = with_speed_through_water(found.ship, trials, content["per_run"])
    named = marked(ship, start, trials, task.options.name)
    warnings = [*found.warnings, *task.remarks, *worth_message(made.get("worth of what was left out"))]
    warnings += [*shared_rows(trials, validation), *score_messages(content["scores"])]
    warnings += [left_out_message(made.missing)] if made.missing else []
    warnings += doubtful_revolutions(start, trials)
    for option in ("--bootstrap", "--profile"):
        warnings += failed_refits(made.get(option, {}))
    apart, drawn = objects.posterior.by_agreement if objects.posterior else ((), ())
    warnings += apart
    said: dict[str, Sequence[Message]] = {
        "warning": warnings,
        "notice": [*found.notices, *fit.messages, *task.notes, *drawn],
    }
    rows = [{"level": level, **row} for level, some in said.items() for row in message_rows(dict.fromkeys(some))]
    content |= {
        "ship_name": named.name,
        "mark": vars(named.mark),
        "messages": rows,
        "timings_s": {**content["timings_s"], "wall": time.perf_counter() - began},
    }
    return FitResult(**vars(FitRecord.of(content)), ship=named, start=start, iterate=found.iterate, objects=objects)


def _estimated(task: FitTask, made: Made, progress: OnProgress | None) -> CampaignFit:
    """The calibration of a ``task``, with values by campaign where they pay; without with constants of runs, or with
    coefficients that are held. What Ctrl-C leaves out is missing in what is ``made``."""
    settings, options = task.settings, task.options
    model, constants = varying_effects(task.ship, options.per_run or task.by_run)
    warm = started_from(model, options.start, options.hold)
    if options.resume:
        check_resumable(options.resume, task.ship, task.trials, None if task.by_run else constants)
        warm = {**(iterate_of(options.resume, model) or {}), **{k: v for k, v in warm.items() if k == "held"}}
    is_plain = not (constants or "held" in warm) and settings.starts == 1 and settings.time_limit is None
    # where values by campaign may take its place, the last solve without them would be thrown away
    draft = is_plain and may_keep(model, task.trials, options.per_campaign)
    found = estimate_coefficients(model, task.trials, settings, progress, warm, options.captive, constants, draft)
    if constants or "held" in warm:
        messages = () if "held" in warm else not_asked(found.trials, options.per_campaign)
        return CampaignFit(found, messages=messages)
    with suppress(OutOfTimeError):
        make_in_turn({"values by campaign": lambda: by_campaign(found, options.per_campaign, progress)}, made)
    fit = made.get("values by campaign", CampaignFit(found))
    if not fit.calibration.draft:
        return fit
    return replace(fit, calibration=finished(found, progress))


def check_resumable(
    earlier: FitResult, ship: Ship, trials: Sequence[Trial], constants: Sequence[str] | None = ()
) -> None:
    """Raises UserError unless ``earlier`` was of the same ``trials``, free coefficients of ``ship`` and ``constants``.

    constants: symbols of which each run has its own, None where the trials tell.
    """
    suspects = set(suspects_in(ship))  # unknown where it was interrupted before they were
    same_free = set(earlier.estimates) - suspects == set(ship.free) - _by_campaign(earlier) - suspects
    own = {symbol for rows in (earlier.per_run or {}).values() for symbol in rows}
    same_data = sorted(row.sha256 or "" for row in earlier.data) == sorted(t.sha256 for t in trials)
    same_own = constants is None or own == set(constants)
    for is_same, what in (
        (same_free, "--without, --fix and --only"), (same_own, "--per-run"), (same_data, "trial files"),
    ):  # fmt: skip
        if not is_same:
            raise Conflict(f"{earlier.folder}: --resume needs the same {what} as the interrupted run")


def iterate_of(earlier: FitResult, model: Ship) -> dict[str, np.ndarray] | None:
    """Where the interrupted run ``earlier`` goes on: at its iterate; with values by campaign at the coefficients that
    all runs of ``model`` share, "p" (P,), from which these values are found again; None where it begins anew."""
    own = _by_campaign(earlier)
    if set(earlier.estimates) != set(model.free) - own:  # of suspects
        return None
    if earlier.iterate is None or not own:
        return earlier.iterate
    return None if own & set(model.free) else {"p": np.asarray(earlier.iterate["p"])[: len(model.free)]}


def _by_campaign(earlier: FitResult) -> set[str]:
    """Symbols of the constants that have a value in each campaign."""
    rows = (earlier.campaigns or {}).get("values") or {}
    return {symbol for row in rows.values() for symbol in row}


def _content(fit: CampaignFit, made: Made, objects: FitObjects, options: FitOptions) -> dict[str, Any]:
    """What is known of the ``fit``, its ``objects`` and what is ``made`` of it, by attribute of the result."""
    found, trials = objects.calibration, objects.trials
    seconds = {name.strip("-").replace(" ", "_"): value for name, value in made.seconds.items()}
    resumed = options.resume  # the solves of an interrupted run come first, without those made again
    before = resumed.passes[: int(found.resumption.number[0]) + 1 - len(found.passes)] if resumed else ()
    seconds = {"campaigns": fit.seconds, "identifiability": seconds.get("next_trial", 0.0), **seconds}
    return {
        **solved(found, options.command),
        "passes": (*before, *found.passes),
        "data": data_rows(trials),
        "validation_data": data_rows(objects.validation),
        "coefficients": coefficient_rows(found),
        "correlation": correlation_of(found),
        "scores": made.get("scores", NO_SCORES),
        "identifiability": identifiability_dict(found.identifiability, made.get("next trial")),
        "bands": made.get("prediction bands"),
        "adaptation": made.get("worth of adaptation"),
        "random_force": made[SECOND].random_force if SECOND in made else None,
        "envelope": made["envelope"] if "envelope" in made else trial_envelope(found.ship, trials),
        "left_out": made.get("worth of what was left out"),
        "campaigns": fit.content,
        **uncertainty_rows(found),
        **made.get("--bootstrap", {}),
        **made.get("--profile", {}),
        "posterior": made["--posterior"].to_dict() if "--posterior" in made else None,
        "timings_s": {**found.timings, **seconds},
    }


def started_from(ship: Ship, values: Mapping[str, float], hold: bool = False) -> dict[str, np.ndarray]:
    """What ``estimate_coefficients`` takes as ``warm``: "p" (P,), to begin at ``values`` of the free coefficients of
    ``ship``, by symbol, and "held" (P,) to hold them there if ``hold``; the others begin at their prior mean."""
    if not values:
        return {}
    rows = [ship.coefficients[s] for s in ship.free]  # value: the prior's mean, as the ship file states it
    warm = {"p": np.array([(values.get(c.symbol, c.value) - c.value) / c.std for c in rows])}
    return warm | ({"held": np.isin(ship.free, list(values))} if hold else {})


def _check_options(ship: Ship, options: FitOptions) -> None:
    if options.per_run and options.per_campaign not in ((), ("none",)):
        raise Conflict(
            f"--per-campaign {','.join(options.per_campaign)}: values by campaign and constants of each run are not "
            "fitted together; leave out --per-campaign or --per-run"
        )
    check_estimator(options.estimator)
    check_request(options.bootstrap, options.profile, ship.free, options.posterior)


def marked(calibrated: Ship, ship: Ship, trials: Sequence[Trial], name: str) -> Ship:
    """The ship ``calibrated`` with the ``name`` that was given, marked as calibrated today on ``trials`` from
    ``ship``."""
    hashes = sorted(trial.sha256 for trial in trials)  # one data set whatever the order of its files
    data = hashlib.sha256("\n".join(hashes).encode()).hexdigest() if all(hashes) else ""
    today = datetime.now(timezone.utc).date().isoformat()
    mark = CalibrationMark(name, today, data, ship.mark.name if ship.mark else ship.name)
    return replace(calibrated, name=name or calibrated.name, mark=mark)


def solved(calibration: Calibration, command: str) -> dict[str, Any]:
    """What the solver of a ``calibration`` says of itself, by attribute of the result; command: its maker."""
    solution, seg, noise = calibration.solution, calibration.segments, calibration.noise
    return {
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": command,
        "ship_name": calibration.ship.name,
        **{name: getattr(solution, name) for name in ("converged", "status", "advice", "objective", "iterations")},
        "constraint_violation": solution.violation,
        "condition_number": condition_number(calibration.covariance),
        "passes": calibration.passes,
        "starts": calibration.starts,
        "settings": calibration.settings,
        "versions": versions(),
        "compiled": not calibration.problem.kernels.interpreted_because,
        "windows": len(seg.run),
        "intervals": seg.intervals,
        "seconds_used": seg.duration,
        "sigma": dict(zip(STATES, calibration.sigma, strict=True)),
        "noise": {
            s: {"rms": noise.rms[i], "correlation_time_samples": noise.tau[i], "unit": UNITS[s]}
            for i, s in enumerate(STATES)
        },
        "fixed": [s for s in calibration.ship.symbols if s not in calibration.prior.symbols],
        "per_run": calibration.constants.rows()
        if calibration.constants and not calibration.problem.prior.campaign
        else None,
    }


def coefficient_rows(calibration: Calibration) -> dict[str, dict[str, Any]]:
    """What became of each free coefficient of a ``calibration``, by symbol, as of ``CoefficientRow``."""
    kept = {field.name for field in fields(CoefficientRow)}
    return {
        f.symbol: {name: value for name, value in vars(calibration.ship.coefficients[f.symbol]).items() if name in kept}
        | {"at_bound": f.bound or None, "prior_share": share}
        for f, share in zip(calibration.identifiability.findings, np.diag(calibration.covariance), strict=True)
    }


def correlation_of(calibration: Calibration) -> dict[str, Any]:
    """Correlation of the estimates of a ``calibration``, as of ``Correlation``: with the standard errors it is her
    covariance. That of the discounted information is weaker, so that together with robust errors sums and products of
    coefficients that trials know well would seem unknown, and figures up to three times as uncertain."""
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(np.diag(calibration.covariance))
        matrix = calibration.covariance / np.outer(size, size)
    return {"symbols": calibration.prior.symbols, "matrix": np.round(matrix, 6)}


def uncertainty_rows(calibration: Calibration) -> dict:
    """Key "uncertainty" of a ``calibration``."""
    symbols, info, spread = calibration.prior.symbols, calibration.information, calibration.spread
    by_run, unit, sizes = info.by_run(), calibration.prior.std, np.sqrt(np.diag(spread.covariance))
    return {
        "uncertainty": {
            "windows": spread.clusters[0],
            "runs": spread.clusters[1],
            "dispersion": spread.dispersion,
            "coefficients": {
                s: {
                    "std": float(sizes[i] * unit[i]),
                    "std_model": float(np.sqrt(spread.model[i, i]) * unit[i]),
                    "degrees_of_freedom": float(spread.freedom[i]),
                }
                for i, s in enumerate(symbols)
            },
            "without_run": {
                "method": "step",
                "change_in_standard_errors": {
                    calibration.segments.trials[run]: _most_moved(change[: len(symbols)], symbols)
                    for run, change in zip(by_run.run, changes_without_each(by_run) / sizes, strict=True)
                },
            },
        }
    }


def _most_moved(moved: np.ndarray, symbols: Sequence[str]) -> dict:
    """What leaving a run out moves, in standard errors: the coefficients it moves most."""
    most = np.argsort(-np.abs(np.nan_to_num(moved)))[:5]  # set by hand: what a person reads
    return {"largest": {symbols[i]: float(moved[i]) for i in most}, "rms": float(np.sqrt(np.mean(moved**2)))}
