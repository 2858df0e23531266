"""Input files of ``mmg simulate --controls``: trial files that need only time and the ship's actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.inputs import actuator_columns
from cases.io.read import read_trial
from cases.trial import Trial
from mmg.errors import Missing
from mmg.messages import Message
from mmg.motion.flow import INPUTS

_INPUTS = (*INPUTS, "wind_speed", "wind_direction")


def read_controls(path: str | Path, actuators: Sequence[str] = ("n", "delta")) -> Trial:
    """Inputs and the first state of a run; a file without psi, u, v, r starts from rest at the origin.

    Returns a trial that begins at its first complete state, inputs without gaps: a missing sample holds the
    last one, and that is said in the notices. Units, signs and the sidecar are those of ``read_trial``.
    Raises UserError as ``read_trial`` does, when an input is missing from the start, and as ``actuator_columns`` does
    for a ship with these ``actuators``. path: CSV or Parquet.
    """
    path = Path(path)
    trial = read_trial(path, from_rest=True)
    actuator_columns(trial, actuators)
    return _without_gaps(trial, path)


def _without_gaps(trial: Trial, path: Path) -> Trial:
    """From the first complete state on, missing inputs replaced by the last one given."""
    whole = np.isfinite(trial.states[:, 2:]).all(axis=1)
    if not whole.any() or len(trial) - int(np.argmax(whole)) < 2:
        raise Missing(f"{path}: no row with psi, u, v and r to start from")
    first, notices = int(np.argmax(whole)), list(trial.notices)
    if first:
        text = f"the simulation starts at row {first + 1}, the first with a complete state"
        notices.append(Message(text, "late_start"))
    columns = {name: values[first:] for name, values in trial.columns.items()}
    for name in _INPUTS:
        if name not in columns:
            continue
        good = np.isfinite(columns[name])
        if not good[0]:
            raise Missing(f"{path}: {name} has no value where the simulation starts (row {first + 1})")
        if not good.all():
            last = np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))
            columns[name] = columns[name][last]
            text = f"{name}: {int((~good).sum())} missing samples hold the last value"
            notices.append(Message(text, "samples_held"))
    return replace(trial, columns=columns, notices=tuple(notices))
