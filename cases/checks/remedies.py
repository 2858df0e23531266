"""What to write into trials.toml so that a folder's contradictions go: the line, and the trials as it makes them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cases.evidence.readings import Keys
from cases.io.conventions import converted
from cases.io.read import read_trial
from cases.io.sidecar import NAME, SidecarEntry, sidecar_entry
from cases.io.units import si_unit, to_si, unit_by_factor
from cases.trial import Trial
from mmg.errors import UserError

OPPOSITE = {"rudder_positive": ("starboard", "port"), "velocity_frame": ("body", "earth")}
"""Key -> its values, of which the other one is meant."""


def labels(trial: Trial) -> dict[str, tuple[str, str]]:
    """Column -> its header and unit in the file of ``trial``; names and units of a Trial where it has none."""
    found = json.loads(trial.meta.get("labels", "{}"))
    return {name: tuple(found.get(name, (name, si_unit(name)))) for name in trial.columns}


def settings(trial: Trial, keys: Keys) -> dict[str, Any] | None:
    """What has to stand in the sidecar so that ``keys`` are true of ``trial``, over what stands there; None where no
    accepted unit makes it so.

    keys: of a reading: units as factors, columns by their canonical names.
    """
    known, entry = labels(trial), entry_of(trial)
    out: dict[str, Any] = {}
    if "columns" in keys:
        out["columns"] = {**entry.columns, **{name: known[other][0] for name, other in keys["columns"].items()}}
    if "units" in keys:
        units = dict(entry.units)
        for name, factor in keys["units"].items():
            units[name] = unit_by_factor(name, to_si(name, known[name][1], name) * factor)
            if not units[name]:
                return None
        out["units"] = units
    if "sign" in keys:
        out["sign"] = {**entry.sign, **{name: s * entry.sign.get(name, 1) for name, s in keys["sign"].items()}}
    if "lag" in keys:
        lags = {name: round(s + entry.lag.get(name, 0.0), 3) for name, s in keys["lag"].items()}
        out["lag"] = {**entry.lag, **lags}
    for key in ("velocity_frame", "rudder_positive", "heading_from", "reference_point"):
        if key in keys:
            out[key] = keys[key]
    for key, (first, other) in OPPOSITE.items():
        if key in out and getattr(entry, key) == out[key]:
            out[key] = first if out[key] == other else other
    if "reference_point" in out and (entry.reference_point.x or entry.reference_point.y):
        return None
    return out


def line(wanted: Mapping[str, Any]) -> str:
    """``wanted`` settings as lines of TOML, with "and" between them."""
    return " and ".join(f"{key} = {_toml(value)}" for key, value in wanted.items())


def mended(trial: Trial, wanted: Mapping[str, Any], keys: Keys) -> Trial | None:
    """``trial`` as it is read with the ``wanted`` settings, or made so where it has no file; None where that fails.

    keys: of the reading, from which the settings are.
    """
    try:
        if trial.path is not None and trial.path.exists():
            entry = {**entry_of(trial).model_dump(exclude_unset=True), **wanted}
            return read_trial(trial.path, SidecarEntry(**entry), refuse=False)
        columns = {name: np.array(values, dtype=float) for name, values in trial.columns.items()}
        for name, other in keys.get("columns", {}).items():
            columns[name] = trial[other]
        for name, factor in keys.get("units", {}).items():
            columns[name] = columns[name] * factor
        told = {key: value for key, value in wanted.items() if key not in ("columns", "units")}
        return Trial(trial.name, converted(columns, SidecarEntry(**told), []))
    except UserError:
        return None


def place(trial: Trial, everywhere: bool) -> str:
    """Where in which sidecar a line on ``trial`` belongs: for all files of its folder if ``everywhere``, or its own."""
    file = trial.path.name if trial.path else trial.name
    where = "[default]" if everywhere else f'[files."{file}"]'
    return f"{trial.path.parent / NAME if trial.path else NAME}, {where}"


def entry_of(trial: Trial) -> SidecarEntry:
    """What the sidecar says of ``trial`` so far."""
    return sidecar_entry(trial.path) if trial.path is not None and trial.path.exists() else SidecarEntry()


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)
