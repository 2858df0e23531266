"""Choice of a model's structure: fit every candidate, choose by validation, test the choice once.

The ship as given is fitted by multiple shooting. A polynomial is estimated by regression on the velocities
(``polynomial_regression``), whole and thinned out, in seconds. (Multiple shooting from there was no better on trials
that neither saw, of ESSO OSAKA and of her simulation.)
What is chosen must stay a ship under random harbour use of all its actuators (Miyauchi et al. 2023, req. 7).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from cases.shipfiles.effects import with_instruments
from cases.simulation.harbour_inputs import harbour_inputs
from cases.trial import Trial
from fitting.calibrate import FitOptions, calibrate
from fitting.calibration import estimate_coefficients
from fitting.prediction.score import check_scorable, pooled_sigma, score
from fitting.record import MessageRow
from fitting.report.run_folder import Store, plain
from fitting.result import FitResult
from fitting.selection.candidates import GIVEN, StructureCandidate
from fitting.selection.learning import Learned, learn_all
from fitting.selection.polynomial_regression import STEP, Regression, increments, regress
from fitting.settings import Settings
from fitting.solvers.control import INTERRUPTED
from mmg.components.expansion.series import STALL, speed_scale
from mmg.components.expansion.words import Word, parse_monomial
from mmg.errors import Missing, NoSolution, TooFewData
from mmg.messages import LOGGER, OnProgress, Progress
from mmg.motion.froude import reference_speed, time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

# Length of the windows fitted [s of a 3 m model] of the ship as given: that of the paper's subsequences.
WINDOW = 100.0  # set by hand
SHORT = 30.0  # The same of a polynomial that is chosen: that of the windows by which it is judged. Set by hand.
# Steps of a shooting interval of a polynomial, half as long as those of others: there are as many. Set by hand.
INTERVAL = 10
LARGEST = 1000  # Most unknowns of a candidate that is tried without being named. Set by hand: it bounds the time.
# Most unknowns of the choice while there are smaller ones: its errors by multiple shooting take gigabytes and minutes.
# Larger ones are chosen as thinned out. Set by hand: it bounds memory.
LARGEST_CHOSEN = 450
START = "as given"  # Row of the ship as given, which is not fitted
NO_LOSS = 1.02  # Factor on the best validation error up to which a model with fewer unknowns is preferred. Set by hand.
INSTRUMENTS = ("shown",)  # As of ``FitOptions``: what the trials themselves show
THINNED = "-thinned"  # Ending of the names of candidates
SEQUENCES = 1000  # Random harbour sequences, for requirement 7 of Miyauchi et al. (2023). Set by hand.
SECONDS = 400.0  # Length of each [s of a 3 m model]. Set by hand.
# Largest speed, and yaw rate times L/2, by 0.1 sqrt(g L), that is still a ship in a harbour (Froude number 0.4). Set by
# hand.
MOST = 4.0
LEAST = 20  # Fewest samples in a sub-model from which anything is fitted. Set by hand.
BEYOND = 1.1  # Factor on the motions of the trials up to which a polynomial is used as it is. Set by hand.
# Least range of a motion, by sqrt(g L), of the yaw rate by sqrt(g / L). Set by hand: it bounds a division.
SMALL = 0.01


@dataclass(frozen=True)
class Stability:
    """Of ``sequences`` simulated from rest, how many ``diverged``; largest speed [m/s] and yaw rate [rad/s] of the
    others."""

    sequences: int
    diverged: int
    speed: float
    yaw_rate: float


@np.errstate(all="ignore")
def stability(ship: Ship, sequences: int = SEQUENCES, seed: int = 0, compiled: bool = True) -> Stability:
    """The stability of ``ship`` in so many ``sequences`` of random inputs in calm air; seed: of the first of them.

    compiled: use a C compiler if there is one.
    """
    L = ship.particulars["L"]
    simulator, dt = Simulator(ship, compiled), 1.0 * time_scale(L)
    names = simulator.model.controls
    runs = [harbour_inputs(ship, SECONDS * time_scale(L), seed + k, dt) for k in range(sequences)]
    t = runs[0]["t"]
    zero = np.zeros(len(t))
    columns = [[t if name == "time" else run.columns.get(name, zero) for name in names] for run in runs]
    controls = np.repeat(np.array(columns).transpose(2, 1, 0)[:-1], 2, axis=0)  # two steps for each order
    states = simulator.run(np.zeros((6, sequences)), controls, 0.5 * dt, ship.values)
    speed = np.hypot(states[:, 3], states[:, 4]).max(axis=0)
    spin = np.abs(states[:, 5]).max(axis=0)
    good = np.isfinite(states).all(axis=(0, 1)) & (np.maximum(speed, 0.5 * L * spin) < MOST * speed_scale(L))
    largest = [float(x[good].max()) if good.any() else float("nan") for x in (speed, spin)]
    return Stability(sequences, int((~good).sum()), *largest)


@dataclass(frozen=True)
class Tried:
    """One candidate and what became of it.

    unknowns: free coefficients; validation, training: mean squared error of 30 s windows, by the variance of the
    trials; stable: sequences of ``stability`` that did not diverge, of those simulated; left_out: why it was not tried.
    """

    name: str
    words: str
    unknowns: int
    terms: int
    validation: float = float("nan")
    training: float = float("nan")
    converged: bool = False
    seconds: float = 0.0
    stable: int = 0
    sequences: int = 0
    left_out: str = ""


@dataclass(frozen=True)
class StructureChoice:
    """The chosen candidate, calibrated; the table of all; errors on the test trials of some models; its stability;
    runs on the objective of the paper, if there were any."""

    chosen: str
    result: FitResult
    table: tuple[Tried, ...]
    test: dict[str, float]
    stability: Stability
    runs: tuple[Learned, ...] = ()

    def __repr__(self) -> str:
        return f"<StructureChoice: {self.chosen} of {len(self.table)} candidates; {self.result!r}>"

    def to_dict(self) -> dict[str, Any]:
        """Content of selection.json, numbers that are not finite as None."""
        keys = ("name", "seed", "objective", "training", "validation", "evaluations", "seconds")
        learned = [{k: getattr(run, k) for k in keys} | {"terms_left_out": len(run.vanished)} for run in self.runs]
        rows = {"chosen": self.chosen, "candidates": self.table, "test": self.test, "stability": self.stability}
        content: dict[str, Any] = plain(rows | ({"learned": learned} if learned else {}))
        return content


@dataclass(frozen=True)
class _Fitted:
    """A candidate with its estimate. values: of a polynomial, which are held; empty for the ship as given."""

    row: Tried
    ship: Ship
    start: StructureCandidate
    values: dict[str, float]

    @property
    def error(self) -> float:
        """On the validation trials, inf where it diverges."""
        return self.row.validation if np.isfinite(self.row.validation) else float("inf")


def choose_structure(
    ship: Ship,
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial], Sequence[Trial]],
    settings: Settings | None = None,
    named: bool = False,
    progress: OnProgress | None = None,
    seeds: int = 0,
    store: Store | None = None,
) -> StructureChoice:
    """The best of candidates ``given`` for ``ship``, calibrated.

    trials: to fit on, to choose by, to test once; settings: of the fits; named: the candidates were named by the user,
    so that one that the trials cannot determine is an error; progress: called before each fit. Each polynomial is also
    tried without the terms that its evidence speaks against. Those on top of the ship's own forces take these as
    calibrated, where the ship is a candidate itself. A model that diverges in one of SEQUENCES random harbour sequences
    is not chosen while another one does not. seeds: polynomials are learned by the objective of the paper instead, so
    many runs of each; store: finished ones, which are taken from there, and to which others are added. Raises UserError
    where no candidate can be fitted, for trials without positions, and for a named one that they cannot determine.
    """
    train, validate, test = trials
    _check(train, validate, ship.inputs)
    scale = time_scale(ship.particulars["L"])
    work = _Work(train, validate, pooled_sigma(train), settings or Settings(), scale, frozenset(ship.free))
    able, table = _able(given, train, named)
    table.insert(0, work.row(given[0], ship, name=START, words="the ship as given, not fitted", unknowns=0, terms=0))

    def say(task: str, number: int) -> None:
        if progress:
            progress(Progress(task, number, len(given)))

    runs: dict[str, list[Learned]] = {}
    if seeds:
        say(f"learning {len(able)} candidates", 0)
        runs = learn_all([one for one in able if one.order], (train, validate), work.settings, seeds, store)
    fitted: list[_Fitted] = []
    for number, one in enumerate(able):
        say(f"fitting {one.name}", number)
        if not one.order:
            fitted.append(work.shot(one))
        elif seeds:
            fitted.append(work.learned(one, runs[one.name][0]))
        else:
            own = next((f.ship for f in fitted if f.row.name == GIVEN), None)  # it is the first of ``able``
            fitted += work.regressed(_based_on(one, own))
    if not fitted:
        raise NoSolution(f"no candidate can be fitted: {'; '.join(row.left_out for row in table[1:4])}")
    small = [f for f in fitted if f.row.unknowns <= LARGEST_CHOSEN] or fitted  # all, where none is small
    best, checked = _stable_best(small, work.settings)
    rows = [checked.get(f.row.name, f.row) for f in fitted]
    options = FitOptions(start=best.values, hold=bool(best.values), instruments=INSTRUMENTS, next_trial=False)
    result = calibrate(best.start.ship, train, validate, work.settings_of(best.start), options, progress)
    if INTERRUPTED.requested:
        raise KeyboardInterrupt
    if table[0].validation < best.row.validation:  # false where the ship as given diverges
        worse = f"the ship as given predicts the validation trials better ({table[0].validation:.4g}): keep her"
        result = replace(result, messages=(MessageRow("warning", "worse_after", worse), *result.messages))
    others = {f"{GIVEN} calibrated": f.ship for f in fitted if f.row.name == GIVEN}
    models = {START: ship, **others, "chosen": result.ship}
    errors = {name: _window_error(model, test, work.sigma) for name, model in models.items()} if test else {}
    final = stability(result.ship, SEQUENCES, work.settings.seed, work.settings.compiled)
    if final.diverged:
        words = f"the chosen model diverges in {final.diverged} of {final.sequences} random harbour sequences"
        advice = "no candidate stays stable in all: keep to motions of the trials, or give more trials"
        result = replace(result, messages=(MessageRow("warning", "diverges", f"{words}; {advice}"), *result.messages))
    return StructureChoice(best.row.name, result, (*rows, *table), errors, final, tuple(chain(*runs.values())))


def _able(
    given: Sequence[StructureCandidate], train: Sequence[Trial], named: bool
) -> tuple[list[StructureCandidate], list[Tried]]:
    """The candidates that the trials may determine, polynomials bounded to the motions of these, the ship as given
    first, and rows on the others."""
    able, left_out = [], []
    for one in sorted(given, key=lambda one: one.name != GIVEN):
        reason = fault(one, train) or ("" if named or one.unknowns <= LARGEST else f"more than {LARGEST} unknowns")
        if reason and named:
            raise TooFewData(reason)
        if reason:
            left_out.append(_row(one, left_out=reason))
        else:
            able.append(replace(one, ship=bounded(one.ship, train)) if one.order else one)
    return able, left_out


def _check(train: Sequence[Trial], validate: Sequence[Trial], inputs: Sequence[str]) -> None:
    if not train or not validate:
        raise Missing(f"{len(train)} trials to fit on and {len(validate)} to choose by: give both (--validate)")
    without = [t.name for t in (*train, *validate) if not t.has_position]
    if without:
        raise Missing(f"{', '.join(without)}: no positions, by which candidates are judged")
    check_scorable(train, "to fit on", inputs)
    check_scorable(validate, "to choose by", inputs)


def _row(one: StructureCandidate, **more: Any) -> Tried:
    return Tried(one.name, one.words, one.unknowns, sum(one.counts), **more)


def _window_error(ship: Ship, trials: Sequence[Trial], sigma: np.ndarray) -> float:
    return score(Simulator(ship), list(trials), sigma).window


@dataclass(frozen=True)
class _Work:
    """What all fits share: trials to fit on and to choose by, sigma of the errors, settings; scale of time, by a 3 m
    model; free coefficients of the ship as given, which count as unknowns of a polynomial on top of her."""

    train: Sequence[Trial]
    validate: Sequence[Trial]
    sigma: np.ndarray
    settings: Settings
    scale: float
    own: frozenset[str]

    def settings_of(self, one: StructureCandidate) -> Settings:
        """Those of the multiple shooting of a candidate: a polynomial takes shorter windows and steps."""
        window = self.settings.window or (SHORT if one.order else WINDOW) * self.scale
        step = max(STEP * self.scale, min(t.dt for t in self.train)) if one.order else None
        interval = INTERVAL if one.order else self.settings.interval
        return replace(self.settings, window=window, step=self.settings.step or step, interval=interval)

    def row(self, one: StructureCandidate, ship: Ship, began: float | None = None, **more: Any) -> Tried:
        """The row of a candidate that became ``ship``, and what it took since ``began``."""
        training, validation = (_window_error(ship, some, self.sigma) for some in (self.train, self.validate))
        seconds = 0.0 if began is None else time.perf_counter() - began
        row = replace(_row(one, validation=validation, training=training, seconds=seconds), **more)
        if row.name.startswith(f"{GIVEN}+"):  # the ship's own coefficients were estimated for it, too
            row = replace(row, unknowns=len(self.own | set(one.ship.free)))
        LOGGER.info(f"{row.name}: {row.unknowns} unknowns, validation {validation:.4g}, training {training:.4g}")
        return row

    def regressed(self, one: StructureCandidate) -> list[_Fitted]:
        """A polynomial by regression: whole, and without the terms that vanish."""
        fitted: list[_Fitted] = []
        one = replace(one, ship=with_instruments(one.ship, INSTRUMENTS, self.train))
        system = None
        for sparse in (False, True):
            began = time.perf_counter()
            system = system or increments(one.ship, self.train)  # the same for both; its time counts for the first
            estimate = regress(one.ship, system, sparse)
            ship = estimate.ship(one.ship)
            if sparse and not 0 < len(ship.monomials) < len(one.ship.monomials):  # nothing vanished, or all
                continue
            words = f"{one.words}, without {len(estimate.vanished)} terms that the evidence speaks against"
            named = replace(one, name=one.name + THINNED, words=words) if sparse else one
            start = replace(named, ship=ship)
            model = ship.with_values(estimate.values)
            fitted.append(_Fitted(self.row(start, model, began, converged=True), model, start, estimate.values))
        return fitted

    def learned(self, one: StructureCandidate, best: Learned) -> _Fitted:
        """A polynomial by its best run on the objective of the paper, without the terms that are zero."""
        ship = with_instruments(one.ship, INSTRUMENTS, self.train)
        values = {s: x for s, x in best.values.items() if s not in best.vanished}
        start = replace(one, ship=Regression(values, {}, best.vanished).ship(ship))
        model = start.ship.with_values(values)
        return _Fitted(self.row(start, model, converged=True, seconds=best.seconds), model, start, values)

    def shot(self, one: StructureCandidate) -> _Fitted:
        """The ship as given, fitted by multiple shooting."""
        began, start = time.perf_counter(), with_instruments(one.ship, INSTRUMENTS, self.train)
        fit = estimate_coefficients(start, self.train, self.settings_of(one))
        if INTERRUPTED.requested:  # the solver stopped early: no estimate to choose by
            raise KeyboardInterrupt
        ship = start.with_values({s: fit.ship.coefficients[s].value for s in start.free})
        return _Fitted(self.row(one, ship, began, converged=fit.converged), ship, one, {})


def _based_on(one: StructureCandidate, calibrated: Ship | None) -> StructureCandidate:
    """The candidate with the coefficients of the calibrated ship where it has her own forces."""
    if calibrated is None or not one.name.startswith(f"{GIVEN}+"):
        return one
    own = {s: c.value for s, c in calibrated.coefficients.items() if s in one.ship.coefficients}
    return replace(one, ship=one.ship.with_values(own))


def _stable_best(fitted: Sequence[_Fitted], settings: Settings) -> tuple[_Fitted, dict[str, Tried]]:
    """The first that stays stable, by validation error, a smaller model first where it loses next to nothing.

    Returns it, and the rows of those that were checked. If none stays stable, the one that diverges least often.
    """
    least = min(f.error for f in fitted)
    if not np.isfinite(least):
        words = "no candidate predicts the validation trials: all diverge; see mmg check, or give other trials"
        raise NoSolution(words)
    near = sorted((f for f in fitted if f.error <= NO_LOSS * least), key=lambda f: f.row.unknowns)
    order = [*near, *sorted((f for f in fitted if f not in near), key=lambda f: f.error)]
    checked: dict[str, Tried] = {}
    for one in order:
        runs = stability(one.ship, SEQUENCES, settings.seed, settings.compiled)  # slow: only until one stays stable
        checked[one.row.name] = replace(one.row, stable=runs.sequences - runs.diverged, sequences=runs.sequences)
        if not runs.diverged and np.isfinite(one.error):
            return one, checked
    return max(order, key=lambda f: checked[f.row.name].stable), checked


def bounded(ship: Ship, trials: Sequence[Trial]) -> Ship:
    """A generated ``ship`` whose polynomial is bounded to the motions of the ``trials`` (``expansion/series``)."""
    limits, L = {}, ship.particulars["L"]
    for name, sign, column in (("u_ahead", 1, "u"), ("u_astern", -1, "u"), ("v_most", 0, "v"), ("r_most", 0, "r")):
        values = np.concatenate([t[column] for t in trials])
        most = np.nanmax(np.abs(values) if sign == 0 else sign * values, initial=0.0)
        least = SMALL * reference_speed(L) / (L if column == "r" else 1.0)
        limits[name] = float(f"{BEYOND * max(most, least):.4g}")  # as it is written to the ship file
    return replace(ship, particulars={**ship.particulars, **limits})


def fault(candidate: StructureCandidate, trials: Sequence[Trial]) -> str:
    """Why ``trials`` cannot determine a ``candidate``, with the counts; "" where they may.

    There must be as many samples as unknowns, and LEAST samples in which the conditions of each sub-model hold.
    """
    samples = sum(len(t) for t in trials)
    if candidate.unknowns > samples:
        return f"{candidate.name} has {candidate.unknowns} unknowns, but the trials hold only {samples} samples"
    sets = {parse_monomial(text).conditions for text in candidate.ship.monomials.values()}
    limit = candidate.ship.particulars.get("delta_stall", STALL)
    lacking = []
    for conditions in sorted(sets, key=str):
        held = sum(int(np.all([_holds(c, t, limit) for c in conditions], axis=0).sum()) for t in trials if conditions)
        if conditions and held < LEAST:
            lacking.append(f"'{' '.join(map(str, conditions))}' ({held} samples)")
    if not lacking:
        return ""
    return (
        f"{candidate.name} ({candidate.submodels}) has sub-models that the trials hardly enter: {', '.join(lacking)} "
        f"of {samples}, {LEAST} are needed; add such trials or take fewer sub-models"
    )


def _holds(condition: Word, trial: Trial, limit: float) -> np.ndarray:
    """Where a condition holds in a trial, (N,) bool."""
    columns = [trial[part.name] for part in condition.parts if part.name in trial]
    if condition.name in ("ahead", "astern"):
        return (trial["u"] >= 0) == (condition.name == "ahead")
    if condition.name in ("driving", "reversing"):
        mean = np.mean(columns, axis=0) if columns else np.zeros(len(trial))
        return (mean >= 0) == (condition.name == "driving")
    beyond = np.any([np.abs(x) > limit for x in columns], axis=0) if columns else np.zeros(len(trial), dtype=bool)
    return beyond == (condition.name == "stalled")
