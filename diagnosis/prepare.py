"""The problem of a diagnosis made ready: the wide ship, the trials on a grid, what is known before, the first fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.io.site import Site
from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from diagnosis.estimation.candidates import LOCAL, Column, FullModel, ship_with_all_effects
from diagnosis.estimation.gridded_trials import COARSE, GriddedTrials, grid_trials, is_measured_rudder
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.parameters import Priors
from diagnosis.estimation.residual_checks import lag_correlation, residuals, spectral_line, with_correlation_time
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.forward_selection import Problem
from diagnosis.hypotheses.reference import refer
from diagnosis.sensors.kinematics import Kinematics
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.progress import LOGGER
from mmg.ship import Ship

ECHO, APART, LEAST = 0.25, 5.0, 100
"""Correlation of neighbouring whitened residuals from which samples APART seconds [of a 3 m model] are compared, if
at least LEAST grid times are left. On the records of the 3 m tanker the correlation is .65 and the latent force three
times what it is at 3, 5 or 10 s, with worse predictions; with white errors it is below .05."""
FEW = 20
"""The same where the instruments are known from other trials."""
MAX_FITS = 12
"""Linearisations of the first fit."""
RUNS = 3
"""Runs from which effects of the surroundings may differ from run to run."""


@dataclass(frozen=True)
class Prepared:
    """The problem, the fit without any effect, and what was learnt on the way.

    straight: inputs are joined by lines; gap: one in so many grid times is compared; line: of ``spectral_line``.
    """

    problem: Problem
    full: FullModel
    null: Estimate
    straight: bool
    gap: int
    notices: tuple[str, ...]
    line: tuple[float, float]


def priors_before(ship: Ship, unseen: bool = False) -> Priors:
    """The priors that a calibrated ship started from, or those that an uncalibrated one states.

    unseen: it was calibrated on other trials than these, so that its estimates are what is known before these.
    """
    rows = [ship.coefficients[s] for s in ship.free]
    known = [not unseen and c.prior_value is not None and c.prior_std is not None for c in rows]
    mean = np.array([c.prior_value if k else c.value for c, k in zip(rows, known, strict=True)], dtype=float)
    std = np.array([c.prior_std if k else c.std for c, k in zip(rows, known, strict=True)], dtype=float)
    lower, upper = (np.array([getattr(c, k) for c in rows]) for k in ("lower", "upper"))
    usable = std > 0
    columns = tuple(Column(s) for s, u in zip(ship.free, usable, strict=True) if u)
    return Priors(columns, *(a[usable] for a in (mean, std, lower, upper)))


def prepare(
    ship: Ship,
    trials: Sequence[Trial],
    site: Site | None = None,
    step: float | None = None,
    unseen: bool = False,
    reference: Sequence[Trial] = (),
) -> Prepared:
    """Arrange the trials, choose how inputs lie between samples, and fit without any effect.

    reference: the trials that the ship was calibrated on, if those are others; then only what these do not show counts.
    """
    place = site or Site({}, {})
    full = ship_with_all_effects(ship, [*trials, *reference], place.held, place.start)
    base = priors_before(ship, unseen and not reference)
    if not base.symbols:
        raise UserError(f"{ship.name}: every coefficient is fixed, so nothing is known of how far each may be off")
    length = float(ship.particulars["L"])
    notices: list[str] = []
    straight = is_measured_rudder(trials)
    if max(t.dt for t in trials) > COARSE * time_scale(length):
        how = "joined by straight lines" if straight else "held until the next one"
        notices.append(
            f"samples of the actuators are taken as {how}; a delay of half a sample cannot be told from the other way"
        )
    data = grid_trials(trials, full.ship.inputs, length, step, straight)
    steps = TransitionModel(full.ship, [*base.symbols, *full.symbols], data.h)
    values = full.ship.values
    at = [full.ship.symbols.index(s) for s in base.symbols]
    values[at] = [ship.coefficients[s].value for s in base.symbols]
    usual, noise, gap = np.zeros(2), initial_noise(full.ship), 0
    if reference:
        old = grid_trials(reference, full.ship.inputs, length, data.h, is_measured_rudder(reference))
        old, null, gap, *_ = fitted(steps, old, values, base, initial_noise(full.ship))
        known = refer(steps, old, null, base, full.candidates, len(trials))
        base, full = known.priors, replace(full, candidates=known.candidates)
        values, noise = known.theta, known.noise.with_(prior=known.noise)
        usual = np.array([known.unnamed, known.unexplained])
        notices.append(
            "the ship was calibrated on other trials, and those were fitted first: only what goes beyond their usual "
            "misfit and scatter counts"
        )
        if known.strong:
            notices.append(
                f"the trials of the calibration show these effects already: {', '.join(c.label for c in known.strong)}"
            )
        LOGGER.info(f"fitted to what the ship was calibrated on: {len(old.trials)} runs, {old.samples} samples")
    data, null, gap, heard, line = fitted(steps, data, values, base, noise, gap)
    if gap > 1:
        notices.append(
            f"what remains of neighbouring samples is alike (correlation {heard:.2f}), as of filtered instruments: one "
            f"sample every {gap * data.h:g} s is compared"
        )
    LOGGER.info(f"fitted without any effect: {len(data.trials)} runs, {data.samples} samples")
    notices += list(data.dropped)
    if not null.converged:
        notices.append("the fit without any effect has not quite settled")
    runs = np.unique(data.run).tolist()
    if len(runs) >= RUNS:
        own = [c.in_each(runs) for c in full.candidates if c.effect in LOCAL]
        full = replace(full, candidates=(*full.candidates, *own))
    problem = Problem(steps, data, base, full.candidates, *(data.samples * usual).tolist())
    return Prepared(problem, full, null, straight, gap, tuple(notices), line)


def fitted(
    steps: TransitionModel, data: GriddedTrials, theta: np.ndarray, base: Priors, noise: NoiseModel, gap: int = 0
) -> tuple[GriddedTrials, Estimate, int, float, tuple[float, float]]:
    """(data, fit, every how many grid times are compared, correlation of neighbouring residuals, sharpest line in their
    spectrum) without any effect; gap: every how many the same instruments were compared in other trials, if known."""
    p = (theta[[steps.ship.symbols.index(s) for s in base.symbols]] - base.mean) / base.std
    null = estimate(steps, data, initial_point(steps, data, theta, base, noise, p), MAX_FITS)
    apart = gap or max(1, round(APART * time_scale(steps.ship.particulars["L"]) / data.h))
    remains = residuals(steps, data, null)
    heard, line = lag_correlation(data, remains), spectral_line(data, remains)
    if not (gap or heard > ECHO) or data.thinned(apart).samples < (FEW if gap else LEAST):
        apart = 1
    if apart > 1:
        data = data.thinned(apart)
        null = estimate(steps, data, initial_point(steps, data, theta, base, noise, p), MAX_FITS)
    return data, null if noise.prior else with_correlation_time(steps, data, null), apart, heard, line


FILTERS = ("velocity_lag", "gyro")
"""Faults of instruments that belong into the model of the measurement before anything is asked of the dynamics."""


def with_sensor_faults(ship: Ship, sensors: Kinematics) -> tuple[Ship, list[str]]:
    """The ship with those faults of FILTERS that the kinematics show, their sizes free, and a sentence on them."""
    faults = [name for name in sensors.effects() if name in FILTERS and name not in ship.effects]
    if not faults:
        return ship, []
    words = f"the logged columns disagree with each other: {' and '.join(faults)} was put into the model of the sensors"
    return freeing_effects(ship, faults), [words]
