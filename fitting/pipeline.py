"""Calibration from trials to a result: estimate, scores, what the trials determine, uncertainty, prediction bands."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from cases.checks.held_out import shared_rows, training_trials
from cases.checks.propulsion import doubtful_revolutions
from cases.shipfiles.effects import varying_effects
from cases.shipfiles.model_changes import with_instruments
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients, finished, first_estimate
from fitting.design.next_trial import identifiability_dict, next_trial
from fitting.nlp.captive import Captive
from fitting.parallel import ProcessBeside, begun_beside, with_one_thread
from fitting.prediction.band_calibration import fit_bands
from fitting.prediction.bands import draws_of
from fitting.prediction.envelope import trial_envelope
from fitting.prediction.score import scores_by_set
from fitting.prediction.score_pairs import NO_SCORES, ScorePair, score_pairs
from fitting.prediction.worth_of_past import adaptation_worth
from fitting.record import FitObjects, FitRecord
from fitting.report.result_rows import coefficient_rows, correlation_of, marked, solved
from fitting.report.run_folder import data_rows, plain
from fitting.result import FitResult
from fitting.selection.campaigns import CampaignFit, CampaignQuestion, by_campaign, may_keep, not_asked
from fitting.selection.sisters import UncertainMean, with_uncertain_mean
from fitting.selection.two_estimates import Second, begin_second, with_second
from fitting.settings import Settings, check_estimator
from fitting.solvers.interrupts import Later
from fitting.solvers.resumed import check_resumable, earlier_passes, iterate_of
from fitting.uncertainty.left_out import moved_by, worth_message, worth_of_left_out
from fitting.uncertainty.rows import check_request, refit_rows, uncertainty_rows
from fitting.uncertainty.without_trials import without_trials
from mmg.errors import UserError
from mmg.messages import Message, message_rows
from mmg.progress import LOGGER, OnProgress
from mmg.rollout import Simulator
from mmg.ship import Ship


@dataclass(frozen=True)
class FitOptions:
    """Options of a calibration besides the settings of its solver.

    bootstrap: refits to runs drawn with replacement; profile: coefficients whose likelihood is profiled; next_trial:
    whether trials are named that would determine what is left open; per_run: effects of which each run has its own
    constants ("NAME" or "NAME:parameter=prior"); per_campaign: instruments that may differ between campaigns, () for
    the usual ones, ("none",) for none; instruments: effects of the instruments that are fitted along; captive: points
    of captive tests that are fitted too; start: values from which the solver begins, by symbol; hold: these stay, and
    only what else is free and the noise is estimated; resume: an interrupted run of the same data and ship, from whose
    iterate to go on; command: what is stored as the command that made the result; name: of the ship and her
    calibration, "": the ship keeps hers, and the calibration takes that of the run folder; prior_mean: how uncertain
    the mean of the prior is, where other ships told it; beside: the process that does meanwhile what can wait; None:
    this one does all. estimator: "both" takes the mean with a ``second`` estimator of the same coefficients, where
    there is one and nothing else is fitted than coefficients to trials, "windows" what multiple shooting gives.
    """

    bootstrap: int = 0
    profile: tuple[str, ...] = ()
    next_trial: bool = True
    per_run: tuple[str, ...] = ()
    per_campaign: tuple[str, ...] = ()
    instruments: tuple[str, ...] = ("velocity_filter",)
    captive: Captive | None = None
    start: Mapping[str, float] = field(default_factory=dict)
    hold: bool = False
    resume: FitResult | None = None
    command: str = ""
    name: str = ""
    prior_mean: UncertainMean | None = None
    beside: ProcessBeside | None = None
    estimator: str = "both"
    second: Second | None = None

    def asks_second(self, settings: Settings) -> bool:
        """Whether the second estimator is asked: it knows no other data than trials, and refits, profiles and held
        values are those of multiple shooting alone; settings: of the solver."""
        asked = (self.captive, self.per_run, self.bootstrap, self.profile, self.hold)
        return self.estimator == "both" and not any(asked) and settings.time_limit is None


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
    that stopped early. Raises UserError for input from which nothing can be identified, for options that contradict
    each other, and for an interrupted run of other data.
    """
    began = time.perf_counter()
    settings, options = settings or Settings(), options or FitOptions()
    train, remarks = training_trials(trials, validation)
    given, ship = ship, with_instruments(ship, options.instruments, train)
    _check_options(ship, train, options)
    model, constants = varying_effects(ship, options.per_run)
    if options.resume:
        check_resumable(options.resume, ship, train, constants)
    later = Later()
    question = CampaignQuestion(model, train, settings, options.captive, options.per_campaign, progress)
    before, sets = Simulator(ship, settings.compiled), {"validation": validation, "training": train}
    other = begin_second(options.second if options.asks_second(settings) else None, given, train, options.beside)
    first = begun_beside(options.beside, partial(scores_by_set, before, sets))
    by_day = _estimated(question, constants, options, later)
    found, model = with_uncertain_mean(by_day.calibration, options.prior_mean), by_day.ship
    if other and found.converged:
        found = later.made("second estimate", lambda: with_second(found, other.value), found)
    after = Simulator(found.ship, settings.compiled)
    envelope = begun_beside(options.beside, partial(trial_envelope, found.ship, train))
    scores = later.made("scores", lambda: score_pairs(first.value, scores_by_set(after, sets)), NO_SCORES)
    content = _first_rows(found, options, scores, train, validation)
    objects = FitObjects(found, before, after, tuple(train), tuple(validation))
    bands_of = begun_beside(options.beside, partial(prediction_bands, found, after, train))
    past = begun_beside(options.beside, partial(worth_of_past, found, after, train, validation))
    moved = partial(moved_by, found, model, options.captive, by_day.own)
    worth = begun_beside(options.beside, partial(worth_of_left_out, after, sets, scores, moved, found.prior.symbols))
    objects = _with_next_trial(objects, options, later)
    uncertainty = uncertainty_rows(found) | _refitted(found, options, later)
    awaited = (("worth of adaptation", past), ("worth of what was left out", worth), ("prediction bands", bands_of))
    adaptation, left_out, bands = (later.made(name, partial(getattr, one, "value"), None) for name, one in awaited)
    warnings = [*found.warnings, *remarks, *worth_message(left_out), *shared_rows(train, validation)]
    warnings += [*_of_scores(scores), *later.left_out, *doubtful_revolutions(ship, train)]
    named = marked(found.ship, ship, train, options.name)
    content |= {
        "ship_name": named.name,
        "mark": vars(named.mark),
        "identifiability": identifiability_dict(found.identifiability, objects.next_trial),
        "messages": _message_rows(warning=warnings, notice=[*found.notices, *by_day.messages]),
        "bands": bands,
        "adaptation": adaptation,
        "envelope": envelope.value,
        "left_out": left_out,
        "campaigns": by_day.content,
        **uncertainty,
        "timings_s": {
            **found.timings,
            "campaigns": by_day.seconds,
            "identifiability": later.seconds.get("next trial", 0.0),
            **{name.replace(" ", "_"): seconds for name, seconds in later.seconds.items()},
            "wall": time.perf_counter() - began,
        },
    }
    return FitResult(**vars(FitRecord.of(content)), ship=named, start=ship, iterate=found.iterate, objects=objects)


def _first_rows(
    found: Calibration,
    options: FitOptions,
    scores: Mapping[str, ScorePair],
    train: Sequence[Trial],
    validation: Sequence[Trial],
) -> dict[str, Any]:
    """What is known of a calibration with its scores, by attribute of the result: all that its figures show."""
    return {
        **solved(found, options.command),
        "passes": (*earlier_passes(options.resume, found), *found.passes),
        "data": data_rows(train),
        "validation_data": data_rows(validation),
        "coefficients": coefficient_rows(found),
        "correlation": correlation_of(found),
        "scores": scores,
        "identifiability": identifiability_dict(found.identifiability),
        "messages": [],
        "timings_s": {},
    }


def _with_next_trial(objects: FitObjects, options: FitOptions, later: Later) -> FitObjects:
    """The ``objects`` with the next trial."""
    found = objects.calibration
    if options.next_trial and found.converged and np.isfinite(found.covariance).all():
        return replace(objects, next_trial=later.made("next trial", lambda: next_trial(found), None))
    return objects


def _refitted(found: Calibration, options: FitOptions, later: Later) -> dict[str, Any]:
    """Rows of the bootstrap and the profiles that ``options`` ask for."""
    rows: dict[str, Any] = {}
    for number, name in ((options.bootstrap, "--bootstrap"), (len(options.profile), "--profile")):
        asked = (number, ()) if name == "--bootstrap" else (0, options.profile)
        if number:
            rows = rows | later.made(name, partial(refit_rows, found, *asked), {})
    return rows


def _estimated(
    question: CampaignQuestion, constants: tuple[str, ...], options: FitOptions, later: Later
) -> CampaignFit:
    """The calibration of the ship in ``question``, with values by campaign where they pay; without with constants of
    runs, or with coefficients that are held."""
    model, train, settings, progress = question.ship, question.trials, question.settings, question.progress
    warm = iterate_of(options.resume, model) if options.resume else started_from(model, options.start)
    held = tuple(options.start) if options.hold else ()
    if held or constants:
        found = estimate_coefficients(model, train, settings, progress, warm, options.captive, constants, held)
        messages = () if held else not_asked(train, options.per_campaign)
        return CampaignFit(found, model, constants, messages=messages)
    found = first_estimate(model, train, settings, progress, warm, options.captive, may_keep(question))
    by_day = later.made("values by campaign", lambda: by_campaign(found, question), CampaignFit(found, model))
    return replace(by_day, calibration=finished(by_day.calibration, progress))


def _message_rows(**levels: Sequence[Message]) -> list[dict[str, str]]:
    """Rows of the messages of each of the ``levels``, each message once."""
    return [{"level": level, **row} for level, some in levels.items() for row in message_rows(dict.fromkeys(some))]


def _of_scores(scores: Mapping[str, ScorePair]) -> list[Message]:
    """Messages on ``scores`` by set of trials: those that are no numbers, or worse than before, or bad."""
    failed = [message for name, pair in scores.items() for message in pair.failed(name)]
    worse = [message for name, pair in scores.items() for message in pair.worse(name)]
    worse += [message for name, pair in scores.items() for message in pair.worse_by_run(name)]
    return failed + worse + (scores["training"].undescribed() if "training" in scores else [])


def started_from(ship: Ship, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """What ``estimate_coefficients`` takes as ``warm``, "p" (P,), to begin at ``values`` of the free coefficients of
    ``ship``, by symbol; those that are not among them begin at their prior mean."""
    rows = [ship.coefficients[s] for s in ship.free] if values else []
    return {"p": np.array([(values.get(c.symbol, c.value) - c.value) / c.std for c in rows])} if values else {}


def _check_options(ship: Ship, train: Sequence[Trial], options: FitOptions) -> None:
    if options.per_run and options.per_campaign not in ((), ("none",)):
        raise UserError(
            f"--per-campaign {','.join(options.per_campaign)}: values by campaign and constants of each run are not "
            "fitted together; leave out --per-campaign or --per-run"
        )
    check_estimator(options.estimator)
    check_request(options.bootstrap, options.profile, ship.free)
    if options.per_run and len(train) == 1:
        same = f"--with {' --with '.join(options.per_run)}"
        LOGGER.info(f"a single run: its own constants are, but for the narrower prior, those of {same}")


def prediction_bands(found: Calibration, simulator: Simulator, trials: Sequence[Trial]) -> dict[str, Any] | None:
    """How far predictions of ``simulator``, by the calibration ``found``, are off on its ``trials``, each left out."""
    known = plain({"coefficients": coefficient_rows(found), "correlation": correlation_of(found)})
    return fit_bands(simulator, trials, draws_of(known, found.ship), without_trials(found, trials))


def worth_of_past(
    found: Calibration, simulator: Simulator, trials: Sequence[Trial], validation: Sequence[Trial] = ()
) -> dict[str, Any] | None:
    """What the past of a window brings to predictions of ``simulator``, that of the calibration ``found``, on
    ``validation`` trials, or where there are none on its own ``trials``, each left out in turn."""
    if any(t.has_position for t in validation):
        return adaptation_worth(simulator, validation)
    return adaptation_worth(simulator, trials, without_trials(found, trials).run)
