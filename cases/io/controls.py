"""Input files of ``mmg simulate --controls``: trial files that need only time and the ship's actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.inputs import actuator_columns
from cases.io.conventions import converted
from cases.io.headers import FRT_NAMES, match_headers, split_header
from cases.io.read import SUFFIXES, read_trial
from cases.io.sidecar import sidecar_entry
from cases.io.trial_table import trial_table
from cases.io.units import to_si
from cases.trial import Trial
from mmg.errors import BadValue, Missing
from mmg.messages import Message
from mmg.motion.flow import INPUTS

STATE_UNITS = {"psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s"}
_INPUTS = (*INPUTS, "wind_speed", "wind_direction")


def read_controls(path: str | Path, actuators: Sequence[str] = ("n", "delta")) -> Trial:
    """Inputs and the first state of a run; a file without psi, u, v, r starts from rest at the origin.

    Returns a trial that begins at its first complete state, inputs without gaps: a missing sample holds the
    last one, and that is said in the notices. Units, signs and the sidecar are those of ``read_trial``.
    Raises UserError as ``read_trial`` does, when an input is missing from the start, and as ``actuator_columns`` does
    for a ship with these ``actuators``. path: CSV or Parquet.
    """
    path = Path(path)
    trial = _from_rest(path) or read_trial(path)
    actuator_columns(trial, actuators)
    return _without_gaps(trial, path)


def _from_rest(path: Path) -> Trial | None:
    """A trial of inputs alone, its states zero; None for a file that is no table or holds one of psi, u, v, r."""
    if path.suffix.lower() not in SUFFIXES:
        return None
    table = trial_table(path)
    header = table.header
    entry = sidecar_entry(path)
    if set(STATE_UNITS) & {*entry.columns, *(FRT_NAMES.get(name, name) for name, _ in map(split_header, header))}:
        return None
    notices = [Message("no states in the file: the ship starts from rest at the origin", "starts_from_rest")]
    matched = match_headers(path, header + [f"{s} [{u}]" for s, u in STATE_UNITS.items()], entry, notices)
    given = {name: (index, unit) for name, (index, unit) in matched.items() if index < len(header)}
    factors = {name: to_si(name, unit, f"{path}: column '{header[index]}'") for name, (index, unit) in given.items()}
    numbers = table.numbers([index for index, _ in given.values()], given["t"][0])
    columns = {name: numbers[index] * factors[name] for name, (index, _) in given.items()}
    if "apparent_wind_speed" in columns and "wind_speed" not in columns:
        raise Missing(f"{path}: apparent wind needs psi, u and v to become true wind; give wind_speed, wind_direction")
    keep = np.isfinite(columns["t"])
    columns = {name: values[keep] for name, values in columns.items()}
    if len(columns["t"]) < 2 or (np.diff(columns["t"]) <= 0).any():
        raise BadValue(f"{path}: time must increase from row to row, over two rows at least")
    nothing = np.zeros(len(columns["t"]))
    columns |= dict.fromkeys(STATE_UNITS, nothing)
    columns = converted(columns, entry, notices)
    return Trial(path.stem, columns, path=path, notices=tuple(notices), kind=entry.kind)


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
