"""The start of a diagnosis: the full ship, the trials on a grid, the priors, the fit without any effect."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from diagnosis.estimation.candidates import FITTED_ALONG, Candidate, Column, FullModel, ship_with_all_effects
from diagnosis.estimation.first_fit import MAX_FITS, FirstFit, fit_without_effects
from diagnosis.estimation.gridded_trials import COARSE, GriddedTrials, grids_as_read
from diagnosis.estimation.gusts import trials_in_gusts, with_gusts
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.map_estimate import BrokenModelError, Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise, swallows, wider
from diagnosis.estimation.parameters import Priors, set_values
from diagnosis.estimation.residual_checks import finer_step
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.inputs import Case
from mmg.errors import Missing, UserError
from mmg.messages import LOGGER, Message
from mmg.motion.froude import time_scale
from mmg.ship import Ship

if TYPE_CHECKING:
    from diagnosis.hypotheses.score_test import ScoreTest

# Gain in log likelihood from which one way of reading the actuators is clearly the better one (a ratio of 20).
CLEAR = 3.0  # set by hand


# Probability by chance below which an effect in the trials of the calibration is said to be usual. Set by hand.
USUAL = 0.03


@dataclass(frozen=True)
class InputReading:
    """How samples of the actuators were read.

    straight: joined by lines, not held; gain: how much more likely than the other way (logarithm), None where
    there was no choice; sample: longest sampling time [s]; length: of the ship [m].
    """

    straight: bool
    gain: float | None
    sample: float
    length: float

    @property
    def is_doubtful(self) -> bool:
        """Whether half a sample matters, and nobody said how the samples are to be read."""
        return self.gain is not None and self.sample > COARSE * time_scale(self.length)

    @property
    def time_error(self) -> float:
        """Standard uncertainty [s] of the time of the actuators: uniform over half a sample where nobody said how they
        are read (type B, GUM 2008, 4.3.7)."""
        return 0.5 * self.sample / math.sqrt(3.0) if self.gain is not None else 0.0

    @property
    def chosen(self) -> bool | None:
        """How they are read where that is clear, None where a finer step may tell."""
        return self.straight if self.gain is None or self.gain > CLEAR else None

    @property
    def is_sampled(self) -> bool:
        """Whether the trials speak for inputs that move along straight lines between their samples."""
        return self.straight and self.gain is not None and self.gain > CLEAR

    @property
    def notices(self) -> tuple[Message, ...]:
        """What is to be said of it: where half a sample matters, or a calibration, which holds samples, differs."""
        if self.gain is None or not (self.is_doubtful or self.is_sampled):
            return ()
        how = "joined by straight lines" if self.straight else "held until the next one"
        more = f"log likelihood + {self.gain:.1f}" if math.isfinite(self.gain) else "the other way explodes"
        words = f"samples of the actuators are taken as {how}, which is more likely ({more})"
        said = f'say inputs = "{"sampled" if self.straight else "held"}" in trials.toml if that is so'
        tail = "; a delay of half a sample cannot be told from the other way" if self.is_doubtful else ""
        return (Message(f"{words}: {said}{tail}", "coarse_samples"),)


@dataclass(frozen=True)
class Prepared:
    """The problem and the fit without any effect.

    case: whose ship and trials were fitted; reading: how samples of the actuators were read; gap: one in so many grid
    times is compared; line: of ``spectral_line``; is_order_usual: channels of the latent force follow each other in
    trials of the calibration, too.
    """

    case: Case
    problem: SearchProblem
    full: FullModel
    null: Estimate
    reading: InputReading
    gap: int
    notices: tuple[Message, ...]
    line: tuple[float, float]
    is_order_usual: bool = False


def priors_before(ship: Ship, other_trials: bool = False) -> Priors:
    """The priors from which a calibrated ``ship`` started, or those that an uncalibrated one states.

    other_trials: it was calibrated on other trials, so that its estimates and standard errors are the priors here.
    """
    rows = [ship.coefficients[s] for s in ship.free]
    known = [not other_trials and c.prior_value is not None and c.prior_std is not None for c in rows]
    mean = np.array([c.prior_value if k else c.value for c, k in zip(rows, known, strict=True)], dtype=float)
    std = np.array([c.prior_std if k else c.std for c, k in zip(rows, known, strict=True)], dtype=float)
    lower, upper = (np.array([getattr(c, k) for c in rows]) for k in ("lower", "upper"))
    usable = std > 0
    columns = tuple(Column(s) for s, u in zip(ship.free, usable, strict=True) if u)
    return Priors(columns, *(a[usable] for a in (mean, std, lower, upper)))


def _of_reference(shown: Sequence[ScoreTest], strong: Sequence[Candidate]) -> list[Message]:
    """What the trials of the calibration themselves say: effects ``shown`` by their scores, and ``strong`` ones."""
    from diagnosis.hypotheses.forward_selection import MOST

    words = "the ship was calibrated on other trials, which were fitted first: only what goes beyond their usual"
    notices = [Message(f"{words} misfit and scatter counts", "reference_fitted")]
    if usual := [f"{t.candidate.label} (p = {t.p_value:.1g})" for t in shown if t.candidate not in strong]:
        words = f"the trials of the calibration themselves show more than chance of {', '.join(usual[:MOST])}: here it "
        words += "is usual, and only a change from it counts; to have it named, diagnose those trials"
        notices.append(Message(words, "usual_effects"))
    if strong:
        names = ", ".join(c.label for c in strong)
        words = f"the trials of the calibration show these effects already: {names}"
        notices.append(Message(words, "effects_in_reference"))
    return notices


def prepare(
    case: Case, step: float | None = None, straight: bool | None = None, effects: Collection[str] | None = None
) -> Prepared:
    """Put the trials of a ``case`` on a grid, choose how inputs are interpolated, and fit without any effect.

    step: of the grid [s], None: by the trials; straight: whether the actuators are joined, where it is known; effects:
    those that the model has at most, beside the ship's own, None for all that can be tested. An effect must go beyond
    the usual misfit of the trials of the calibration. Tests are left out of the problem where none is long enough.
    Returns the problem with its first fit. Raises UserError where every coefficient is fixed, or all trials are too
    short.
    """
    ship, trials, place, reference = case.ship, case.trials, case.place, case.calibration.reference
    full = ship_with_all_effects(ship, [*trials, *reference], place.held, place.start, effects)
    base = priors_before(ship, case.calibration.other and not reference)
    if {c.symbol.partition(".")[0] for c in base.columns} <= set(FITTED_ALONG):
        raise Missing(f"{ship.name}: every coefficient is fixed, so nothing is known of how far each may be off")
    notices: list[Message] = []
    grids = grids_as_read(trials, full.ship, step, straight)  # before a minute of compiling
    steps = TransitionModel(full.ship, [*base.symbols, *full.symbols], grids[0].h)
    values = full.ship.values
    at = [full.ship.symbols.index(s) for s in base.symbols]
    values[at] = [ship.coefficients[s].value for s in base.symbols]
    usual, noise, gap, is_order_usual = np.zeros(2), initial_noise(full.ship), 0, False
    if reference:  # late, with all that tests hypotheses: a calibration has no such trials
        from diagnosis.estimation.force_order import force_order
        from diagnosis.hypotheses.reference import fit_reference
        from diagnosis.hypotheses.score_test import score_tests, slopes

        old_grids = grids_as_read(reference, full.ship, steps.h)
        known_fit = fit_as_read(steps, old_grids, values, base, initial_noise(full.ship))[0]
        old, null, gap = known_fit.data, known_fit.null, known_fit.gap
        is_order_usual = not force_order(steps, old, null).is_random
        known = fit_reference(steps, old, null, base, full.candidates, len(trials))
        base, full = known.priors, replace(full, candidates=known.candidates)
        values, noise = known.theta, wider(known.noise, full.ship)
        usual = np.array([known.unnamed, known.unexplained])
        tests = score_tests(slopes(steps, old, null, full.candidates), full.candidates)
        notices += _of_reference([t for t in tests if t.p_value < USUAL], known.strong)
        LOGGER.info("fitted to the trials of the calibration: %d runs, %d samples", len(old.trials), old.samples)
    first, reading = fit_as_read(steps, grids, values, base, noise, gap)
    data, null, gap = first.data, first.null, first.gap
    notices += reading.notices
    finer = None
    if not (step or reference or gap > 1 or swallows(null.noise, full.ship)):
        finer = finer_step(steps, data, null, data.sample, data.is_even)
    if finer is not None:
        LOGGER.info(f"the random force changes too much over {data.h:g} s for sensors as quiet as these: {finer:g} s")
        finely = prepare(case, finer, reading.chosen, effects)
        notices = [*reading.notices, *finely.notices]
        return finely if reading.chosen is None else replace(finely, reading=reading, notices=tuple(notices))
    if gap > 1:
        correlated = f"residuals of neighbouring samples are correlated ({first.correlation:.2f})"
        words = f"{correlated}, as of filtered instruments"
        notices.append(Message(f"{words}: one sample every {gap * data.h:g} s is compared", "correlated_residuals"))
    LOGGER.info("fitted without any effect: %d runs, %d samples", len(data.trials), data.samples)
    notices += [Message(words, getattr(words, "code", "left_out")) for words in data.dropped]
    if not null.converged:
        notices.append(Message("the fit without any effect has not fully converged", "not_converged"))
    expected, of_null = (data.samples * usual).tolist()
    unseen = _like_training(case, steps, data, gap)
    problem = SearchProblem(steps, data, base, full.candidates, expected, of_null, unseen)
    return Prepared(case, problem, full, null, reading, gap, tuple(notices), first.line, is_order_usual)


def _like_training(case: Case, steps: TransitionModel, data: GriddedTrials, gap: int) -> GriddedTrials | None:
    """The test trials on the grid ``data`` of the training trials, or None without any that is long enough."""
    try:
        tests = trials_in_gusts(steps, case.tests, data.straight) if case.tests else None
    except UserError:
        return None
    return tests.thinned(gap) if tests is not None else None


def fit_as_read(
    steps: TransitionModel,
    grids: Sequence[GriddedTrials],
    theta: np.ndarray,
    base: Priors,
    noise: NoiseModel,
    gap: int = 0,
) -> tuple[FirstFit, InputReading]:
    """The fit without effects of trials, whose actuators are held from sample to sample, or joined by lines where both
    may be and that is more likely.

    steps: the transition model; grids: the trials read in one way, or in both (``grids_as_read``); theta: (all,) first
    coefficients; base: their priors; noise: first sizes; gap: as of ``fit_without_effects``. Returns the fit, and how
    they were read.
    """
    length, sample = float(steps.ship.particulars["L"]), grids[0].sample
    ways = [with_gusts(steps, grid) for grid in grids]
    # each from the same start: from the fit before, coefficients that the trials hardly tell would creep
    held = fit_without_effects(steps, ways[0], theta, base, noise, gap)
    if len(ways) == 1:
        return held.finished(steps), InputReading(ways[0].straight, None, sample, length)
    try:
        joined = fit_without_effects(steps, ways[1], theta, base, noise, gap)
    except BrokenModelError:
        return held.finished(steps), InputReading(False, math.inf, sample, length)
    gap = max(held.gap, joined.gap)  # both are compared by the same samples
    fits = [
        fit if fit.gap == gap else fit_without_effects(steps, way, theta, base, noise, gap)
        for fit, way in zip((held, joined), ways, strict=True)
    ]
    gain = fits[0].null.nll - fits[1].null.nll
    better = joined if gain > 0 else held
    return better.finished(steps), InputReading(gain > 0, abs(gain), sample, length)


def fit_of_more(few: Prepared, trials: Sequence[Trial], free: Priors, begin: Estimate) -> Estimate:
    """The fit of what is ``free`` to ``trials``, of which a ``few`` were fitted before.

    It begins at the values, sizes of the noise and correlation times of ``begin``, what belongs to a run at its prior,
    with samples as far apart and inputs read as in that fit; other coefficients stay where the ``few`` began. Raises
    BrokenModelError.
    """
    steps, ship = few.problem.steps, few.full.ship
    data = trials_in_gusts(steps, trials, few.reading.straight).thinned(few.gap)
    values = np.array([begin.value(*c) if c.run is None else m for c, m in zip(free.columns, free.mean, strict=True)])
    theta = set_values(steps.ship, data, few.null.theta, free.columns, values)
    noise = wider(begin.noise, ship)
    found = estimate(
        steps, data, initial_point(steps, data, theta, free, noise, (values - free.mean) / free.std), MAX_FITS
    )
    return found if found.converged else estimate(steps, data, found, MAX_FITS)


def with_sensor_faults(case: Case) -> tuple[Case, list[Message]]:
    """The ``case`` of a ship with a free gain of the gyro and the faults that its sensors show, and words on these.

    No gyro is exact: an error of its gain within the prior is none of the ship's dynamics.
    """
    ship, sensors = case.ship, case.sensors
    faults = [name for name in sensors.effects() if name in FITTED_ALONG and name not in ship.effects]
    free = [sensors.form_of(name) for name in dict.fromkeys([*faults, "gyro"]) if name not in ship.effects]
    case = replace(case, ship=freeing_effects(ship, free))
    if not faults:
        return case, []
    words = f"the logged columns disagree with each other: {' and '.join(faults)} was put into the model of the sensors"
    return case, [Message(words, "sensor_fault_modelled")]
