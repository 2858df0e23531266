"""Errors of predictions in the customer's units: metres, degrees, m/s and deg/s per run, over windows that suit the
ship, and the errors of her manoeuvring figures.

Windows are as long as MOST ship times L/U of the trials, where 30 s are less than LEAST of them. Beside the rms errors
stands their share of what the states change by over a window: a heading that goes round several times is wrapped there,
so that its size does not hide the error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from cases.criteria.figures import figure_unit
from cases.criteria.standard_runs import Run, measured_figures, measured_runs
from cases.trial import Trial
from fitting.prediction.adaptation import Adaptation
from fitting.prediction.predict import Forecaster, Predicted, Window, predict_all
from fitting.report.run_folder import Real
from mmg.errors import UserError
from mmg.rollout import Simulator
from mmg.states import STATES

SHORTEST, LEAST, MOST = 30.0, 2.5, 4.0
"""Window [s] of the paper's metric for a 3 m model; ship times L/U below which it is too short; those of a longer
one."""

TOLD = ("advance", "transfer", "tactical_diameter", "overshoot_1", "overshoot_2", "track_reach")
"""Figures whose errors are told of a manoeuvre."""

KEPT = 64
"""Trials whose manoeuvres are kept. Set by hand: it bounds memory."""


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
    """Errors of the figures of a manoeuvre in a run. title: as of ``Execute.title``."""

    title: str
    figures: tuple[FigureError, ...]


@dataclass(frozen=True)
class RunErrors:
    """Errors of one run: rms over the rows of all its ``windows``, NaN without one, inf where a prediction diverges;
    those with _end at the ends of the windows. share_of_change: rms over the states of error / change over the window;
    maneuvers: those that the run holds."""

    name: str
    windows: int
    position_m: Real = math.nan
    heading_deg: Real = math.nan
    u_m_s: Real = math.nan
    v_m_s: Real = math.nan
    r_deg_s: Real = math.nan
    position_end_m: Real = math.nan
    heading_end_deg: Real = math.nan
    share_of_change: Real = math.nan
    maneuvers: tuple[ManeuverErrors, ...] = ()


@dataclass(frozen=True)
class UnitErrors:
    """Errors of trials over windows of ``window_s`` every ``stride_s``, as in result.json.

    ship_times: the window in ship times L/U, None for a black box and where no length is known; change: rms change of
    each state over a window, heading wrapped; runs; pooled: over the rows of all.
    """

    window_s: float
    stride_s: float
    ship_times: float | None
    change: dict[str, Real]
    runs: tuple[RunErrors, ...]
    pooled: RunErrors = field(repr=False)


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
    return max(min(10 * round(0.1 * MOST * unit), 10 * math.floor(0.05 * longest)), SHORTEST)


def errors_in_units(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    window: float | None = None,
    method: str = "rk4",
    adaptation: Adaptation | None = None,
    known: tuple[float, float, Predicted] | None = None,
) -> UnitErrors:
    """Errors of ``simulator`` on ``trials`` in units, over windows of ``window`` [s], None: as of ``window_for``.

    method: "rk4" or "euler"; adaptation: use the past of each window; known: length and stride [s] of whole windows
    that are predicted already, and what ``predict_all`` gave. Manoeuvres are predicted from their order on with the
    measured inputs, of a ship and without adaptation only.
    """
    length = simulator.ship.particulars["L"] if isinstance(simulator, Simulator) else None
    size = window or window_for(trials, length)
    unit = ship_time(trials, length) if length else math.nan
    if known and known[:2] == (size, 0.5 * size):
        found = known[2]
    else:
        found = predict_all(simulator, trials, size, 0.5 * size, False, method, adaptation=adaptation)
    parts = [_parts(trial, windows) for trial, (windows, _) in zip(trials, found, strict=True)]
    changes = np.vstack([part.changes for part in parts])
    change = np.sqrt((changes**2).mean(axis=0)) if len(changes) else np.full(6, np.nan)
    maneuvers: list[tuple[ManeuverErrors, ...]] = [()] * len(trials)
    if isinstance(simulator, Simulator) and length and adaptation is None:
        maneuvers = _maneuvers(simulator, trials, length, method)
    runs = [
        replace(_errors(trial.name, [part], change), maneuvers=own)
        for trial, part, own in zip(trials, parts, maneuvers, strict=True)
    ]
    times = size / unit if math.isfinite(unit) else None
    by_state = dict(zip(STATES, change.tolist(), strict=True))
    return UnitErrors(size, 0.5 * size, times, by_state, tuple(runs), _errors("all rows", parts, change))


@dataclass(frozen=True)
class _Parts:
    """Errors (rows, 6) of all windows of a trial without their first rows, at their ends (windows, 6), changes of the
    measured states since the window's first row (rows, 6)."""

    rows: np.ndarray
    ends: np.ndarray
    changes: np.ndarray


def _parts(trial: Trial, windows: Sequence[Window]) -> _Parts:
    measured, rows, ends, changes = trial.states, [np.zeros((0, 6))], [np.zeros((0, 6))], [np.zeros((0, 6))]
    for w in windows:
        error = w.error(measured)[1:]
        change = measured[w.first + 1 : w.last + 1] - measured[w.first]
        change[:, 2] = np.pi - np.mod(np.pi - change[:, 2], 2 * np.pi)
        known = np.isfinite(measured[w.first + 1 : w.last + 1]).all(axis=1)
        rows.append(error[known])
        changes.append(change[known])
        if known.any():
            ends.append(error[known][-1:])
    return _Parts(np.vstack(rows), np.vstack(ends), np.vstack(changes))


def _errors(name: str, parts: Sequence[_Parts], change: np.ndarray) -> RunErrors:
    """Errors of the ``parts`` together, in units and as a share of the ``change`` (6,)."""
    rows, ends = np.vstack([p.rows for p in parts]), np.vstack([p.ends for p in parts])
    if not len(rows):
        return RunErrors(name, 0)
    rms, end = np.sqrt((rows**2).mean(axis=0)), np.sqrt((ends**2).mean(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = math.sqrt(np.mean((rms / change) ** 2))
    if not np.isfinite(rms).all():
        rms, end, share = np.full(6, math.inf), np.full(6, math.inf), math.inf
    return RunErrors(
        name,
        len(ends),
        position_m=float(np.hypot(rms[0], rms[1])),
        heading_deg=math.degrees(rms[2]),
        u_m_s=float(rms[3]),
        v_m_s=float(rms[4]),
        r_deg_s=math.degrees(rms[5]),
        position_end_m=float(np.hypot(end[0], end[1])),
        heading_end_deg=math.degrees(end[2]),
        share_of_change=share,
    )


def _maneuvers(
    simulator: Simulator, trials: Sequence[Trial], length: float, method: str
) -> list[tuple[ManeuverErrors, ...]]:
    """Of each of ``trials`` the errors of its manoeuvres, all predicted side by side."""
    held = [(number, *both) for number, trial in enumerate(trials) for both in _measured_runs(trial, length)]
    found: list[list[ManeuverErrors]] = [[] for _ in trials]
    if not held:
        return [tuple(own) for own in found]
    predicted = predict_all(simulator, [cut for _, _, cut in held], 0.0, 0.0, False, method)
    for (number, run, cut), (windows, _) in zip(held, predicted, strict=True):
        if windows and np.isfinite(windows[0].states).all():
            states = dict(zip(STATES, windows[0].states.T, strict=True))
            begin = run.order_time - float(cut.t[0] - run.trial.t[0])
            moved = replace(run, order_time=begin, reversals=tuple(t - run.order_time + begin for t in run.reversals),
                            end=run.end - run.order_time + begin)  # fmt: skip
            figures = measured_figures(cut.with_columns(**states), moved)
            told = [name for name in TOLD if name in run.figures and name in figures]
            rows = tuple(_figure(name, run.figures[name], figures[name]) for name in told)
            found[number] += [ManeuverErrors(run.title, rows)] if rows else []
    return [tuple(own) for own in found]


@lru_cache(maxsize=KEPT)
def _measured_runs(trial: Trial, length: float) -> tuple[tuple[Run, Trial], ...]:
    """The manoeuvres in a ``trial`` of a ship of this ``length`` [m], each with its rows from the order on; kept, as
    each model that is scored on the same trials has them read again."""
    try:
        runs = [(run, _ordered(run)) for run in measured_runs(trial, length)]
    except UserError:
        return ()
    return tuple((run, cut) for run, cut in runs if len(cut) > 3)


def _ordered(run: Run) -> Trial:
    """The rows of the trial of ``run`` from the last before the order to its end."""
    t = run.trial.t - run.trial.t[0]
    first = max(int(np.searchsorted(t, run.order_time + 1e-9)) - 1, 0)
    rows = slice(first, int(np.searchsorted(t, run.end + 1e-9)))
    columns = {name: values[rows] for name, values in run.trial.columns.items()}
    return Trial(run.trial.name, columns, meta={})


def _figure(name: str, measured: float, predicted: float) -> FigureError:
    unit = figure_unit(name)
    factor = math.degrees(1.0) if unit == "rad" else 1.0
    measured, predicted = factor * measured, factor * predicted
    return FigureError(name, "deg" if unit == "rad" else unit, measured, predicted, predicted - measured)
