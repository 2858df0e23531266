"""Open-loop predictions over windows of a trial, started from the measured state, and forces along a measured motion.

A window is planned first (``planned_windows``), so that all windows of all trials are simulated side by side.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cases.inputs import model_inputs
from cases.io.campaigns import campaign_among
from cases.io.files import replace_text
from cases.trial import Trial, bridged
from fitting.nlp.windows import Stretch
from fitting.prediction.bands import Bands
from fitting.prediction.stretches import WindowBatch, adapt, record_of, rollout, window_rows, wrapped_error
from fitting.report.run_folder import write_whole
from mmg.errors import NotWritable
from mmg.messages import Message
from mmg.model import states_behind
from mmg.rollout import Simulator
from mmg.ship import Ship

LONGEST_GAP = 1.0  # Seconds, beside two samples, between samples across which a window may run. Set by hand.


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

    def error(self, measured: np.ndarray) -> np.ndarray:
        """Predicted minus the ``measured`` states of the whole trial (N, 6), headings wrapped into (-pi, pi]."""
        return wrapped_error(self.states, measured[self.first : self.last + 1])


def change_over(trials: Sequence[Trial], length: float, stride: float) -> np.ndarray:
    """What each state changes by since the first row of windows of ``length`` [s] every ``stride`` [s] of ``trials``
    (rms, (6,)): the unit of an error of a prediction. A heading is wrapped, so that its unit does not grow with every
    turn, as a standard deviation does; inf of a state that is not measured or does not change."""
    squares, count = np.zeros(6), np.zeros(6)
    for trial in trials:
        states = trial.states
        for first, last in window_rows(trial.t, length, stride, False):
            change = wrapped_error(states[first + 1 : last + 1], states[first])
            squares += np.nansum(change**2, axis=0)
            count += np.isfinite(change).sum(axis=0)
    mean = squares / np.maximum(count, 1)
    return np.where(mean > 0, np.sqrt(mean), np.inf)


class ShipsByTrial(Simulator):
    """A simulator of trials in which the ship has coefficients of her own each: ``by_trial`` (trials, P), all of them,
    in the order of the trials that it is to predict."""

    def __init__(self, ship: Ship, by_trial: np.ndarray, compiled: bool = True) -> None:
        super().__init__(ship, compiled)
        self.by_trial = np.asarray(by_trial, dtype=float)

    def __reduce__(self) -> tuple[Any, ...]:
        return ShipsByTrial, (self.ship, self.by_trial, self.compiled)


def values_of(ship: Ship, trial: Trial) -> np.ndarray | None:
    """All coefficients (P,) of ``ship`` in the campaign of a ``trial``, those of all where that is not known; None for
    a ship without campaigns."""
    if not ship.campaigns:
        return None
    campaign = campaign_among(trial, ship.campaigns)
    return ship.values if campaign is None else ship.of_campaign(campaign).values


def planned_windows(
    trial: Trial,
    inputs: Sequence[str],
    length: float,
    stride: float,
    short_last: bool,
    values: np.ndarray | None = None,
) -> tuple[dict[int, Stretch], list[Message]]:
    """Windows of a ``trial`` by number before simulation, and a note on those left out.

    inputs: of the model, as of ``Ship.inputs``; length, stride [s], short_last: as of ``window_rows``; values: all
    coefficients (P,) of the ship in this trial, where they are not the simulator's.
    """
    record = record_of(trial, inputs, values)
    gap = np.diff(trial.t) > LONGEST_GAP + 2 * trial.dt
    rows = window_rows(trial.t, length, stride, short_last)
    usable = record.good | bridged(trial)  # rows that were interpolated over: inside of a window, not at its ends
    kept = {
        number: Stretch(record, first, last)
        for number, (first, last) in enumerate(rows)
        if record.good[[first, last]].all() and usable[first : last + 1].all() and not gap[first:last].any()
    }
    lost = f"{len(rows) - len(kept)} of {len(rows)} windows of {length:g} s"
    words = f"{trial.name}: {lost} touch missing samples and were left out"
    return kept, [Message(words, "windows_left_out")] if len(kept) < len(rows) else []


Predicted = list[tuple[list[Window], list[Message]]]  # Windows of each of several trials, and notes on those left out


def predict_all(
    simulator: Simulator | Forecaster,
    trials: Sequence[Trial],
    length: float,
    stride: float,
    short_last: bool = True,
    method: str = "rk4",
    past: float = 0.0,
    bands: Bands | None = None,
) -> Predicted:
    """Windows of each of ``trials``, predicted open-loop by ``simulator``, and notes on those left out.

    length, stride [s], short_last: as of ``window_rows``; method: "rk4" or "euler"; past: seconds before each window
    that are used; bands: add standard deviations. (A forecaster has a method of its own and neither of the last two.)
    Inputs are held from sample to sample. A window that begins at, or runs across, missing samples or a gap of more
    than LONGEST_GAP is left out. Without measured positions a window starts at (0, 0). All windows are simulated side
    by side.
    """
    values: Sequence[np.ndarray | None] = [None] * len(trials)
    if isinstance(simulator, ShipsByTrial):
        values = list(simulator.by_trial)
    elif isinstance(simulator, Simulator):
        values = [values_of(simulator.ship, trial) for trial in trials]
    plans = [
        planned_windows(t, simulator.inputs, length, stride, short_last, v) for t, v in zip(trials, values, strict=True)
    ]
    flat = [stretch for kept, _ in plans for stretch in kept.values()]
    if not flat:
        return [([], notes) for _, notes in plans]
    std: np.ndarray | None = None
    if isinstance(simulator, Simulator):
        batch = WindowBatch.of(flat)
        water, offset = adapt(simulator, flat, past) if past else (None, None)
        out = rollout(simulator, batch, water, offset, method)[0]
        std = bands.std(simulator, batch, out, past > 0) if bands else None
    else:
        out = simulator.forecast(flat)
    column = itertools.count()  # of the batch: its columns are the windows of all trials in turn

    def predicted(number: int, s: Stretch) -> Window:
        rows, at = slice(s.steps + 1), next(column)  # a shorter one was filled up with steps of length 0
        deviations = None if std is None else np.ascontiguousarray(std[rows, :, at])
        return Window(number, s.first, s.last, np.ascontiguousarray(out[rows, :, at]), deviations)

    return [([predicted(number, s) for number, s in kept.items()], notes) for kept, notes in plans]


def predict(
    simulator: Simulator | Forecaster, trial: Trial, *args: Any, **options: Any
) -> tuple[list[Window], list[Message]]:
    """Windows of one ``trial``, predicted open-loop by ``simulator``, and notes on those left out; args, options: as of
    ``predict_all``."""
    return predict_all(simulator, [trial], *args, **options)[0]


Forces = dict[str, np.ndarray]  # Role -> (N, 3)


def forces_along(simulator: Simulator, trial: Trial) -> Forces:
    """Force of each component along the measured motion of ``trial``, role -> (N, 3): X, Y [N], N [N m], body axes.

    simulator: of the ship; what its effects remember is taken as settled at each sample. NaN where a state or an input
    is missing. The accelerations of a network are shown as the force that they stand for.
    """
    ship, model = simulator.ship, simulator.model
    record = record_of(trial, ship.inputs)
    good = record.good
    if not good.any():
        return {}
    logged, controls, values = record.states[good].T, record.controls[good].T, ship.values
    states = states_behind(model, logged, controls, values)
    by_role = model.forces_by_role(states, controls, values)
    forces = {role: np.full((len(good), 3), np.nan) for role in by_role}
    for role, part in by_role.items():
        forces[role][good] = part
    return forces


def outside_share(simulator: Simulator, trial: Trial, windows: Sequence[Window]) -> float | None:
    """Share of rows predicted by ``simulator`` in ``windows`` of ``trial`` with a network input outside its training
    range. None for a ship without a network or without windows. Rows without inputs count nothing."""
    network, model = simulator.ship.network, simulator.model
    if network is None or not windows:
        return None
    controls = model_inputs(trial, simulator.ship.inputs).array
    logged = np.vstack([w.states for w in windows]).T
    inputs = np.vstack([controls[w.first : w.last + 1] for w in windows]).T
    good = np.isfinite(logged).all(axis=0) & np.isfinite(inputs).all(axis=0)
    if not good.any():
        return None
    # the network sees the motion itself, behind lags and filters of the sensors
    logged, inputs, values = logged[:, good], inputs[:, good], simulator.ship.values
    features = np.array(model.features(states_behind(model, logged, inputs, values), inputs, values))
    order = [simulator.ship.features.index(name) for name in network.features]
    return float(network.outside(features[order]).mean())


HEADER = "window,t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s]"
STD_HEADER = ",x_std [m],y_std [m],psi_std [rad],u_std [m/s],v_std [m/s],r_std [rad/s]"


def write_tables(tables: dict[Path, np.ndarray]) -> None:
    """Write ``tables`` {path: (rows, 8 or 14)} as CSV, each atomically; a new folder of them appears whole or not at
    all. Raises UserError when a folder cannot be written."""
    folders = {path.parent for path in tables}
    new = next(iter(folders)) if len(folders) == 1 and not any(folder.exists() for folder in folders) else None

    def fill(folder: Path | None) -> None:
        for path, rows in tables.items():
            lines = [f"{int(row[0])}," + ",".join(map(repr, row[1:])) for row in rows.astype(float).tolist()]
            text = "\n".join([HEADER + (STD_HEADER if rows.shape[1] > 8 else ""), *lines, ""])
            replace_text(folder / path.name if folder else path, text)

    try:
        write_whole(new, fill) if new else fill(None)
    except OSError as error:
        raise NotWritable(f"{error.filename or 'output'}: cannot be written ({error.strerror})") from None
