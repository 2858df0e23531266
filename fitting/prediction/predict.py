"""Open-loop predictions over windows of a trial, started from the measured state."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cases.inputs import STANDARD, model_inputs
from cases.trial import Trial
from fitting.prediction.adaptation import Adaptation, adapt
from fitting.prediction.bands import Bands
from fitting.prediction.stretches import FadingCurrent, Record, Stretch, WindowBatch, rollout
from mmg.errors import UserError
from mmg.messages import Message
from mmg.rollout import Simulator

LONGEST_GAP = 1.0
"""Seconds, beside two samples, between samples across which a window may run."""


class Forecaster(Protocol):
    """What predicts without being a ship: a black box."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of its inputs, as of ``Ship.inputs``."""

    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        """Logged columns (N + 1, 6, M) at the samples of stretches, each from its measured first row."""


@dataclass(frozen=True)
class Window:
    """One open-loop window: rows ``first`` .. ``last`` (inclusive) of the trial, and the predicted states there.

    states: (last - first + 1, 6): x, y, psi (unwrapped), u, v, r; the first row is the measured state.
    std: their standard deviations, of the same shape, where they are known.
    """

    number: int
    first: int
    last: int
    states: np.ndarray
    std: np.ndarray | None = None


def window_rows(t: np.ndarray, length: float, stride: float, short_last: bool) -> list[tuple[int, int]]:
    """First and last row of windows of ``length`` seconds every ``stride`` seconds from the first of the times t (N,).

    ``length`` 0 is the whole run. ``short_last`` keeps a last window that the run's end cuts short.
    """
    if length <= 0:
        return [(0, len(t) - 1)]
    tolerance = 0.5 * float(np.median(np.diff(t)))
    result = []
    start = t[0]
    while start < t[-1] - tolerance:
        first = int(np.searchsorted(t, start - tolerance))
        last = int(np.searchsorted(t, t[first] + length + tolerance)) - 1
        whole = t[min(last, len(t) - 1)] >= t[first] + length - 2 * tolerance
        if last > first and (whole or short_last):
            result.append((first, min(last, len(t) - 1)))
        start += stride
    return result


def usable_rows(trial: Trial, inputs: Sequence[str] = STANDARD) -> np.ndarray:
    """Rows of ``trial`` whose state and ``inputs`` are all measured, shape (N,)."""
    needed = np.column_stack([trial.states[:, 2:], model_inputs(trial, inputs).array])
    if trial.has_position:
        needed = np.column_stack([needed, trial.states[:, :2]])
    return np.isfinite(needed).all(axis=1)


@dataclass(frozen=True)
class _Plan:
    """Windows of one trial before simulation: their numbers and rows, and remarks on those left out."""

    kept: list[tuple[int, Stretch]]
    notes: list[Message]


def record_of(trial: Trial, inputs: Sequence[str]) -> Record:
    """A ``trial`` as windows need it, for a model with these ``inputs``; x = y = 0 where no positions were measured."""
    states = trial.states
    if not trial.has_position:
        states = states.copy()
        states[:, :2] = 0.0
    return Record(trial.t, states, model_inputs(trial, inputs).array, usable_rows(trial, inputs), trial.has_position)


def _plan(trial: Trial, inputs: Sequence[str], length: float, stride: float, short_last: bool) -> _Plan:
    record = record_of(trial, inputs)
    gap = np.diff(trial.t) > LONGEST_GAP + 2 * trial.dt
    kept, left_out = [], 0
    for number, (first, last) in enumerate(window_rows(trial.t, length, stride, short_last)):
        if not record.good[first : last + 1].all() or gap[first:last].any():
            left_out += 1
        else:
            kept.append((number, Stretch(record, first, last)))
    words = f"{trial.name}: {left_out} window(s) touch missing samples and were left out"
    return _Plan(kept, [Message(words, "windows_left_out")] if left_out else [])


def predict_all(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    length: float,
    stride: float,
    short_last: bool = True,
    method: str = "rk4",
    adaptation: Adaptation | None = None,
    bands: Bands | None = None,
) -> list[tuple[list[Window], list[Message]]]:
    """Windows of each of ``trials``, predicted open-loop by ``simulator``, and notes on those left out.

    length, stride [s], short_last: as of ``window_rows``; method: "rk4" or "euler"; adaptation: use the past of each
    window; bands: add standard deviations. (A forecaster has a method of its own and neither of the last two.) Inputs
    are held from sample to sample. A window that begins at, or runs across, missing samples or a gap of more than
    LONGEST_GAP is left out. Without measured positions a window starts at (0, 0). All windows are simulated side by
    side.
    """
    inputs = simulator.ship.inputs if isinstance(simulator, Simulator) else simulator.inputs
    plans = [_plan(trial, inputs, length, stride, short_last) for trial in trials]
    flat = [stretch for plan in plans for _, stretch in plan.kept]
    if not flat:
        return [([], plan.notes) for plan in plans]
    if isinstance(simulator, Simulator):
        out, std = _simulated(simulator, flat, method, adaptation, bands)
    else:
        out, std = simulator.forecast(flat), None
    result, at = [], 0
    for plan in plans:
        windows = []
        for number, s in plan.kept:
            rows = slice(s.last - s.first + 1)
            deviations = None if std is None else np.ascontiguousarray(std[rows, :, at])
            windows.append(Window(number, s.first, s.last, np.ascontiguousarray(out[rows, :, at]), deviations))
            at += 1
        result.append((windows, plan.notes))
    return result


def _simulated(
    simulator: Simulator, flat: Sequence[Stretch], method: str, adaptation: Adaptation | None, bands: Bands | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Logged columns (N + 1, 6, M) of stretches by a ship, and their standard deviations where asked for."""
    batch = WindowBatch.of(flat)
    water: FadingCurrent | None = None
    offset: np.ndarray | None = None
    if adaptation is not None:
        water, offset = adapt(simulator, flat, adaptation)
    out = rollout(simulator, batch, water, offset, method)[0]
    return out, bands.std(simulator, batch, out, adaptation is not None) if bands else None


def predict(
    simulator: Simulator | Forecaster, trial: Trial, *args: Any, **options: Any
) -> tuple[list[Window], list[Message]]:
    """Windows of one ``trial``, predicted open-loop by ``simulator``, and notes on those left out; args, options: as of
    ``predict_all``.
    """
    return predict_all(simulator, [trial], *args, **options)[0]


def prediction_rows(trial: Trial, windows: list[Window]) -> np.ndarray:
    """Rows (window, t, x, y, psi, u, v, r) of ``windows`` of a ``trial``, (rows, 8), or with standard deviations (rows,
    14).
    """
    parts = []
    for w in windows:
        columns = [np.full(len(w.states), float(w.number)), trial.t[w.first : w.last + 1], w.states]
        parts.append(np.column_stack(columns if w.std is None else [*columns, w.std]))
    return np.vstack(parts) if parts else np.empty((0, 8))


HEADER = "window,t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s]"
STD_HEADER = ",x_std [m],y_std [m],psi_std [rad],u_std [m/s],v_std [m/s],r_std [rad/s]"


def write_tables(tables: dict[Path, np.ndarray]) -> None:
    """Write ``tables`` {path: (rows, 8 or 14)} as CSV, each atomically. Raises UserError when a folder cannot be
    written.
    """
    try:
        for path, rows in tables.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            scratch = path.with_name(f".{path.name}.part")
            with scratch.open("w", encoding="utf-8") as file:
                file.write(HEADER + (STD_HEADER if rows.shape[1] > 8 else "") + "\n")
                file.writelines(
                    f"{int(row[0])}," + ",".join(repr(float(value)) for value in row[1:]) + "\n" for row in rows
                )
            os.replace(scratch, path)
    except OSError as error:
        raise UserError(f"{error.filename or 'output'}: cannot be written ({error.strerror})") from None
