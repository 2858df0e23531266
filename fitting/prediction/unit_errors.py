"""Errors in units: metres, degrees, m/s and deg/s, by run and together, beside those of what a model must beat.

They are taken over windows that suit the ship: MOST ship times L/U of the trials, where 30 s are less than LEAST of
them; as rms over all rows, after one ship length of sailing and at the end. With them come errors of her manoeuvring
figures. Beside the rms errors stands their share of what the states change by over a window: a heading that goes round
several times is wrapped there, so that its size does not hide the error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from cases.criteria.figures import figure_unit
from cases.criteria.standard_runs import Run, measured_figures, measured_runs
from cases.trial import Trial
from fitting.prediction.baselines import Persistence
from fitting.prediction.predict import Forecaster, Window, change_over, predict_all
from fitting.report.run_folder import Real
from mmg.errors import UserError
from mmg.motion.flow import STATES
from mmg.rollout import Simulator

# Window [s] of the 30 s metric of a 3 m model; ship times L/U below which it is too short; those of a longer one.
SHORTEST, LEAST, MOST = 30.0, 2.5, 4.0  # set by hand

# Figures of a manoeuvre whose errors are given.
COMPARED = ("advance", "transfer", "tactical_diameter", "overshoot_1", "overshoot_2", "track_reach")

KEPT = 64  # Trials whose manoeuvres are kept. Set by hand: it bounds memory.


@dataclass(frozen=True)
class FigureError:
    """A manoeuvring figure as measured and as predicted with the measured rudder and revolutions, in ``unit``; error:
    predicted less measured."""

    figure: str
    unit: str
    measured: float
    predicted: float
    error: float


@dataclass(frozen=True)
class ManeuverErrors:
    """Errors of the figures of a manoeuvre in a run. title: as of ``Run.title``."""

    title: str
    figures: tuple[FigureError, ...]


# Errors of a prediction by key -> state and unit.
STATE_ERRORS = {
    "position_m": ("position", "m"),
    "heading_deg": ("heading", "deg"),
    "u_m_s": ("u", "m/s"),
    "v_m_s": ("v", "m/s"),
    "r_deg_s": ("r", "deg/s"),
}
# What a model must beat -> words for it.
REFERENCES = {"persistence": "keeping the velocities", "baseline": "the baseline"}
# Names of the times at which errors are given: after one ship length of sailing, and at the end of a window.
SHIP_LENGTH, END = "ship_length", "window"
NOTED = 0.005  # Share of an error by which it must change for that to be said. Set by hand: it words a finding.


@dataclass(frozen=True)
class StateErrors:
    """rms errors: NaN of no prediction, inf where one diverges."""

    position_m: Real = math.nan
    heading_deg: Real = math.nan
    u_m_s: Real = math.nan
    v_m_s: Real = math.nan
    r_deg_s: Real = math.nan

    @classmethod
    def of(cls, rms: np.ndarray) -> StateErrors:
        """Of the ``rms`` errors of x, y, psi, u, v, r (6,) in SI units."""
        x, y, psi, u, v, r = rms.tolist()
        return cls(math.hypot(x, y), math.degrees(psi), u, v, math.degrees(r))


@dataclass(frozen=True, kw_only=True)
class RunErrors(StateErrors):
    """Errors of one run: rms over the rows of all its ``windows``, NaN without one, inf where a prediction diverges;
    those with _end at the ends of the windows. share_of_change: rms over the states of error / change over the window;
    after: at the rows SHIP_LENGTH, where a length is known and shorter than the window, and END; maneuvers: those that
    the run holds."""

    name: str
    windows: int
    position_end_m: Real = math.nan
    heading_end_deg: Real = math.nan
    share_of_change: Real = math.nan
    after: dict[str, StateErrors] = field(default_factory=dict)
    maneuvers: tuple[ManeuverErrors, ...] = ()

    @property
    def scored(self) -> bool:
        """Whether it has windows and their errors are finite."""
        return self.windows > 0 and math.isfinite(self.position_m)


@dataclass(frozen=True)
class UnitErrors:
    """Errors of trials over windows of ``window_s`` every ``stride_s``, as in result.json.

    ship_times: the window in ship times L/U, None where no length is known; change: rms change of each state over a
    window, heading wrapped; runs; pooled: over the rows of all; persistence, baseline: the same of keeping the
    velocities of the first row, and of a grey box, where there is one; ratio: of the pooled rms errors to those of
    either, below 1 where the model is better.
    """

    window_s: float
    stride_s: float
    ship_times: float | None
    change: dict[str, Real]
    runs: tuple[RunErrors, ...]
    pooled: RunErrors = field(repr=False)
    persistence: UnitErrors | None = field(default=None, repr=False)
    baseline: UnitErrors | None = field(default=None, repr=False)
    ratio: dict[str, dict[str, Real]] = field(default_factory=dict)

    @property
    def references(self) -> dict[str, UnitErrors]:
        """Errors of what the model must beat, by name in REFERENCES."""
        by_name = {name: getattr(self, name) for name in REFERENCES}
        return {name: errors for name, errors in by_name.items() if errors is not None}

    @property
    def seconds(self) -> dict[str, float]:
        """When errors are told [s], by name."""
        early = {SHIP_LENGTH: self.window_s / self.ship_times} if self.ship_times and self.ship_times > 1 else {}
        return {**early, END: self.window_s}

    def defeats(self, by_run: bool = True) -> list[str]:
        """A sentence for each reference that is better over all runs, at one of the times of ``seconds``, or
        ``by_run`` over the windows of one of them."""
        sentences = []
        for name, reference in self.references.items():
            parts = []
            for key, seconds in self.seconds.items():
                model, rival = (errors.pooled.after.get(key, StateErrors()) for errors in (self, reference))
                if lost := _defeats(model, rival):
                    first, *rest = lost
                    parts.append(f"after {seconds:.3g} s in {', '.join([f'{first} ({lost[first][1]})', *rest])}")
            pairs = zip(self.runs, reference.runs, strict=True) if by_run and len(self.runs) > 1 else ()
            worst = {model.name: next(iter(lost.items())) for model, rival in pairs if (lost := _defeats(model, rival))}
            if worst:
                run, (state, (_, words)) = max(worst.items(), key=lambda row: row[1][1][0])
                count = f"on {len(worst)} of {len(self.runs)} runs, most " if len(worst) > 1 else ""
                parts.append(f"{count}on {run} in {state} ({words})")
            if parts:
                sentences.append(f"worse than {REFERENCES[name]} {'; '.join(parts)}")
        return sentences


def is_worse(before: float, after: float) -> bool:
    """Whether an error rose from ``before`` to ``after`` by more than is worth a word."""
    return after > (1 + NOTED) * before + 1e-6  # the summand: of two errors of nothing none is worse


def _defeats(model: StateErrors, reference: StateErrors) -> dict[str, tuple[float, str]]:
    """States in which the ``reference`` is better, the worst first, each with the ratio of the errors and both."""
    worse = {}
    for key, (state, unit) in STATE_ERRORS.items():
        mine, other = getattr(model, key), getattr(reference, key)
        if is_worse(other, mine) and math.isfinite(mine):  # one that diverges is said to elsewhere
            worse[state] = (mine / max(other, 1e-9), f"{mine:.3g} against {other:.3g} {unit}")
    return dict(sorted(worse.items(), key=lambda row: row[1][0], reverse=True))


def ship_time(trials: Sequence[Trial], length: float) -> float:
    """L/U [s] of a ship of this ``length`` [m] at the speed that she has in the faster fifth of ``trials``; NaN where
    she lies still."""
    speeds = np.concatenate([np.hypot(t["u"], t["v"]) for t in trials])
    fast = float(np.nanpercentile(speeds, 80)) if np.isfinite(speeds).any() else 0.0
    return length / fast if fast > 0 else math.nan


def window_for(trials: Sequence[Trial], length: float | None) -> float:
    """Window [s] for predictions of ``trials`` of a ship of this ``length`` [m], None where it is not known.

    30 s, but MOST ship times in tens of seconds where 30 s are less than LEAST of them; no more than half of the
    longest trial.
    """
    unit = ship_time(trials, length) if length else math.nan
    if not math.isfinite(unit) or LEAST * unit <= SHORTEST:
        return SHORTEST
    longest = max(trial.duration for trial in trials)
    # 0.05: half of the longest trial, in tens of seconds
    return max(min(10 * round(0.1 * MOST * unit), 10 * math.floor(0.05 * longest)), SHORTEST)


def errors_in_units(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    window: float | None = None,
    method: str = "rk4",
    past: float = 0.0,
    baseline: Forecaster | None = None,
) -> UnitErrors:
    """Errors of ``simulator`` on ``trials`` in units, over windows of ``window`` [s], None: as of ``window_for``.

    method: "rk4" or "euler"; past: seconds before each window that are used; baseline: what the model must beat beside
    persistence. Manoeuvres are predicted from their order on with the measured inputs, of a ship and without a past
    only.
    """
    length = simulator.ship.particulars["L"] if isinstance(simulator, Simulator) else None
    size = window or window_for(trials, length)
    unit = ship_time(trials, length) if length else math.nan
    change = change_over(trials, size, 0.5 * size)
    times = size / unit if math.isfinite(unit) else None
    when = {SHIP_LENGTH: unit, END: size} if times and times > 1 else {END: size}  # L/U is the time for one length
    by_state = dict(zip(STATES, np.where(np.isfinite(change), change, np.nan).tolist(), strict=True))

    def errors_of(model: Simulator | Forecaster, past: float = 0.0) -> UnitErrors:
        predicted = predict_all(model, trials, size, 0.5 * size, False, method, past=past)
        parts = [_parts(trial, windows, when) for trial, (windows, _) in zip(trials, predicted, strict=True)]
        runs = tuple(_errors(trial.name, [part], change) for trial, part in zip(trials, parts, strict=True))
        return UnitErrors(size, 0.5 * size, times, by_state, runs, _errors("all rows", parts, change))

    errors = errors_of(simulator, past)
    if isinstance(simulator, Simulator) and length and not past:
        pairs = zip(errors.runs, _maneuvers(simulator, trials, length, method), strict=True)
        errors = replace(errors, runs=tuple(replace(run, maneuvers=maneuvers) for run, maneuvers in pairs))
    references = {"persistence": errors_of(Persistence(simulator.inputs))}
    references |= {"baseline": errors_of(baseline)} if baseline else {}
    ratio = {name: ratios(errors.pooled, reference.pooled) for name, reference in references.items()}
    return replace(errors, persistence=references["persistence"], baseline=references.get("baseline"), ratio=ratio)


def ratios(own: StateErrors, reference: StateErrors) -> dict[str, float]:
    """Errors of a model, its ``own``, divided by those of a ``reference``, by state; NaN where either has none."""
    pairs = {state: (getattr(own, key), getattr(reference, key)) for key, (state, _) in STATE_ERRORS.items()}
    return {state: mine / other if other > 0 else math.nan for state, (mine, other) in pairs.items()}


# Errors (rows, 6) of all windows of a trial without their first rows; those at some times (windows, 6) by name.
_Parts = tuple[np.ndarray, dict[str, np.ndarray]]


def _parts(trial: Trial, windows: Sequence[Window], when: Mapping[str, float]) -> _Parts:
    """Errors of ``windows`` of a ``trial``; when: seconds after their first rows by name."""
    measured, rows = trial.states, [np.zeros((0, 6))]
    after = {name: [np.zeros((0, 6))] for name in when}
    for w in windows:
        error = w.error(measured)[1:]  # the first row is the measurement itself
        finite = np.isfinite(measured[w.first + 1 : w.last + 1]).all(axis=1)
        rows.append(error[finite])
        since = trial.t[w.first + 1 : w.last + 1] - trial.t[w.first]
        for name, seconds in when.items():  # the last measured row up to that time
            until = finite & ((since < seconds + 0.5 * trial.dt) | (name == END))
            if until.any():
                after[name].append(error[until][-1:])
    return np.vstack(rows), {name: np.vstack(errors) for name, errors in after.items()}


def _errors(name: str, parts: Sequence[_Parts], change: np.ndarray) -> RunErrors:
    """Errors of the ``parts`` together, in units and as a share of the ``change`` (6,)."""
    rows = np.vstack([errors for errors, _ in parts])
    after = {key: np.vstack([later[key] for _, later in parts]) for key in parts[0][1]}
    if not len(rows):
        return RunErrors(name=name, windows=0)
    rms = np.sqrt((rows**2).mean(axis=0))
    share = math.sqrt(np.mean((rms / change) ** 2))
    by_time = {key: np.sqrt((errors**2).mean(axis=0)) for key, errors in after.items() if len(errors)}
    if not np.isfinite(rms).all():  # it diverges in some row: no number is given for the others either
        rms, share, by_time = np.full(6, math.inf), math.inf, {key: np.full(6, math.inf) for key in by_time}
    end = StateErrors.of(by_time[END])
    return RunErrors(
        name=name,
        windows=len(after[END]),
        **vars(StateErrors.of(rms)),
        position_end_m=end.position_m,
        heading_end_deg=end.heading_deg,
        share_of_change=share,
        after={key: StateErrors.of(errors) for key, errors in by_time.items()},
    )


def _maneuvers(
    simulator: Simulator, trials: Sequence[Trial], length: float, method: str
) -> list[tuple[ManeuverErrors, ...]]:
    """Of each of ``trials`` the errors of its manoeuvres, all predicted side by side."""
    runs = [(number, *both) for number, trial in enumerate(trials) for both in _measured_runs(trial, length)]
    by_trial: list[list[ManeuverErrors]] = [[] for _ in trials]
    predicted = predict_all(simulator, [cut for _, _, cut in runs], 0.0, 0.0, False, method)
    for (number, run, cut), (windows, _) in zip(runs, predicted, strict=True):
        if windows and np.isfinite(windows[0].states).all():
            states = dict(zip(STATES, windows[0].states.T, strict=True))
            # times of a run count from the first row of its trial: here that is a later one
            begin = run.order_time - float(cut.t[0] - run.trial.t[0])
            shifted = replace(run, order_time=begin, reversals=tuple(t - run.order_time + begin for t in run.reversals),
                            end=run.end - run.order_time + begin)  # fmt: skip
            figures = measured_figures(cut.with_columns(**states), shifted)
            names = [name for name in COMPARED if name in run.figures and name in figures]
            rows = tuple(_figure(name, run.figures[name], figures[name]) for name in names)
            by_trial[number] += [ManeuverErrors(run.title, rows)] if rows else []
    return [tuple(errors) for errors in by_trial]


@lru_cache(maxsize=KEPT)
def _measured_runs(trial: Trial, length: float) -> tuple[tuple[Run, Trial], ...]:
    """The manoeuvres in a ``trial`` of a ship of this ``length`` [m], each with its rows from the order on; kept, as
    each model that is scored on the same trials has them read again."""
    cuts = []
    with suppress(UserError):  # it holds none
        for run in measured_runs(trial, length):
            t = run.trial.t - run.trial.t[0]
            first = max(int(np.searchsorted(t, run.order_time + 1e-9)) - 1, 0)  # the last before the order
            rows = slice(first, int(np.searchsorted(t, run.end + 1e-9)))
            columns = {name: values[rows] for name, values in run.trial.columns.items()}
            cuts.append((run, Trial(run.trial.name, columns, meta={})))
    return tuple((run, cut) for run, cut in cuts if len(cut) > 3)


def _figure(name: str, measured: float, predicted: float) -> FigureError:
    """The error of a figure in SI and rad, its angles in degrees."""
    unit = figure_unit(name)
    factor = math.degrees(1.0) if unit == "rad" else 1.0
    measured, predicted = factor * measured, factor * predicted
    return FigureError(name, "deg" if unit == "rad" else unit, measured, predicted, predicted - measured)
