"""Trial files, frames and arrays into ``Trial``: headers, units, signs and reference points (docs/reference/trials.md).

Everything that is converted, derived or left out is said in the trial's notices; whatever cannot be read safely is a
UserError of one line.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from cases.inputs import SAMPLED, actuator_columns
from cases.io.conventions import converted, mislabelled, through_north
from cases.io.files import check_file
from cases.io.sidecar import NAME, SidecarEntry, line_for, sidecar_entry
from cases.io.toml_file import validated
from cases.io.trial_table import TrialTable, check_forward, checked_header, trial_table
from cases.quantities import accepted, is_canonical, quantity, to_si
from cases.trial import Trial, as_column, left_out
from mmg.errors import (
    BadValue,
    Conflict,
    Missing,
    OutOfRange,
    TooFewData,
    UnknownName,
    Unreadable,
    UserError,
    by_name,
    refusing,
    together,
    unknown,
)
from mmg.messages import Message
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS, STATES

FRT_NAMES = {  # Header names of the FRT-DS-ESSO records -> canonical names (data set README, "Measurement items").
    "x_position_mid": "x", "y_position_mid": "y", "psi_hat": "psi", "u_velo": "u", "vm_velo": "v", "r_angvelo": "r",
    "n_prop": "n", "delta_rudder": "delta", "wind_velo_true": "wind_speed", "wind_dir_true": "wind_direction",
    "wind_velo_relative_mid": "apparent_wind_speed", "wind_dir_relative_mid": "apparent_wind_direction",
}  # fmt: skip
REQUIRED = ("t", "psi", "u", "v", "r", "n")
# Columns that make a craft without propeller and rudder: it then needs neither n nor delta.
THRUSTERS = tuple(name for name, (_, unit) in INPUTS.items() if unit == "rps" and name not in PROPELLERS)
MOST_SHOWN = 40  # Most headers that a message lists. Set by hand: display.


def match_headers(
    path: Path, header: list[str], entry: SidecarEntry, notices: list[Message]
) -> dict[str, tuple[int, str]]:
    """Canonical name -> (column index, unit) for every column of a file that is known.

    path: of the file, for messages; header: its cells; entry: what the sidecar says of it; notices: what was mapped
    or ignored is added. Raises UserError for a mapped header that is absent, two headers for one quantity, a missing
    unit or required column, and a sign of a column that the file lacks.
    """
    parts = [split_header(cell) for cell in header]
    taken: dict[str, tuple[int, str]] = {}
    for name, wanted in entry.columns.items():  # the sidecar first: it wins over the headers' own names
        index = _find(path, wanted, header, parts)
        taken[name] = (index, parts[index][1])
        notices.append(Message(f"{name} is read from '{header[index]}' (sidecar)", "column_mapped"))
    mapped = {index for index, _ in taken.values()}
    ignored = []
    for index, (name, unit) in enumerate(parts):
        canonical = FRT_NAMES.get(name, name)
        if index in mapped:
            continue
        if not is_canonical(canonical) or canonical in entry.columns:
            ignored.append(header[index])
        elif canonical in taken:
            other = header[taken[canonical][0]]
            line = line_for(path, "", f'columns = {{ {canonical} = "{other}" }}')
            raise Conflict(f"{path}: both '{other}' and '{header[index]}' are {canonical}; say which: add to {line}")
        else:
            taken[canonical] = (index, unit)
    if any(ignored):
        notices.append(Message(f"columns not used: {', '.join(filter(None, ignored))}", "columns_ignored"))
    _require(path, header, taken)
    unsigned = [name for name in entry.sign if name not in taken]
    if unsigned:
        raise Missing(f"{path}: sign.{unsigned[0]} in {path.parent / NAME}: the file has no column {unsigned[0]}")
    return {name: (index, _unit(path, name, header[index], unit, entry, notices))
            for name, (index, unit) in taken.items()}  # fmt: skip


def split_header(cell: str) -> tuple[str, str]:
    """("u", "m/s") of "u [m/s]"; the unit is "" when the cell has none."""
    match = re.fullmatch(r"\s*(.*?)\s*\[([^\]]*)\]\s*", cell)
    return (match[1], match[2].strip()) if match else (cell.strip(), "")


def _find(path: Path, wanted: str, header: list[str], parts: list[tuple[str, str]]) -> int:
    """Index of the column a sidecar asks for by its whole header cell or by its name without the unit."""
    hits = [i for i, cell in enumerate(header) if cell == wanted.strip()]
    hits = hits or [i for i, (name, _) in enumerate(parts) if name == wanted.strip()]
    if len(hits) != 1:
        words = f"{'is not in the file' if not hits else 'fits several columns'}; headers: "
        raise Missing(f"{path}: column '{wanted}' named in the sidecar {words}{', '.join(header[:MOST_SHOWN])}")
    return hits[0]


def _unit(path: Path, name: str, cell: str, unit: str, entry: SidecarEntry, notices: list[Message]) -> str:
    """The unit of a column: the sidecar's, else the header's. Raises UserError when neither says."""
    given = entry.units.get(name)
    if given is not None:
        if unit and unit != given:
            text = f"{name}: unit {given} from the sidecar used instead of {unit} in the header"
            notices.append(Message(text, "unit_overridden"))
        return given
    if not unit:
        units = accepted(name)
        line = line_for(path, "", f'units = {{ {name} = "{units[0]}" }}')
        words = f"write '{cell} [{units[0]}]' (accepted: {', '.join(units)}), or add to {line}"
        raise Missing(f"{path}: column '{cell}' has no unit; {words}")
    return unit


def lacking(columns: Collection[str]) -> list[str]:
    """Required columns that are not among the canonical ``columns`` of a trial."""
    thrusters_alone = bool({*THRUSTERS} & {*columns}) and not {"n", *RUDDERS} & {*columns}
    missing = [name for name in REQUIRED if name not in columns and not (thrusters_alone and name == "n")]
    twins = [c for c in ("delta_port", "delta_starboard") if c not in columns]
    if twins and "delta" not in columns and not thrusters_alone:
        missing += ["delta"] if len(twins) == 2 else twins  # of two rudders, the one that lacks
    return missing


def _require(path: Path, header: list[str], taken: dict[str, tuple[int, str]]) -> None:
    """Raises UserError naming the required columns that are missing and how to map them."""
    if missing := lacking(taken):
        advice = f"Name it '{missing[0]} [{accepted(missing[0])[0]}]', or map it: add to "
        advice += line_for(path, "", f'columns = {{ {missing[0]} = "HEADER" }}')
        headers = ", ".join(header[:MOST_SHOWN])
        raise Missing(f"{path}: missing column {', '.join(missing)}; found: {headers}. {advice}")


SUFFIXES = (".csv", ".parquet")
LEAST_STEP = 1e-6  # No clock is finer [s]. Set by hand: bounds what is taken for a clock.


@refusing
def read_trials(paths: Iterable[str | Path] | str | Path) -> list[Trial]:
    """The trials of several files and folders, in the order given (folders: by name). paths: one or several; a folder
    stands for the .csv and .parquet files in it, or in its sub-folders when it holds none itself. What their numbers
    refute is for ``cases.checks`` to say. Raises UserError for all that cannot be read."""
    files, trials, problems = trial_files(paths), list[Trial](), list[UserError]()
    for file in files:
        try:
            trials.append(read_trial(file))
        except UserError as error:
            problems.append(error)
    if problems:
        raise together(problems, f"{len(problems)} of {len(files)} files cannot be read")
    return trials


def trial_files(paths: Iterable[str | Path] | str | Path) -> list[Path]:
    """The trial files that ``paths`` stand for, as ``read_trials`` reads them, each once. Raises UserError for a folder
    without any, and where there is none at all."""
    given = map(Path, [paths] if isinstance(paths, (str, Path)) else paths)
    try:
        files = [file for path in given for file in (_files_of(path) if path.is_dir() else [path])]
    except OSError as error:
        raise Unreadable(f"{error.filename}: cannot be read ({error.strerror}); check the path") from None
    if not files:
        raise Missing("no trial files given")
    return list(dict.fromkeys(files))


def read_trial(
    path: str | Path, settings: SidecarEntry | Mapping[str, Any] | None = None, from_rest: bool = False
) -> Trial:
    """One run in SI units, radians and the frames of this product.

    path: CSV or Parquet; settings: what the header leaves unsaid, with the keys of the sidecar (cases/io/sidecar.py);
    None takes ``trials.toml`` beside the file if there is one; from_rest: the states of a file that holds none of psi,
    u, v, r are zero. Raises UserError, naming file, column and row, for missing or doubled columns, unknown or missing
    units, text in numbers, fewer than two usable rows, time that does not increase, a required column without values,
    and lags that leave no row.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        check_file(path)
        raise BadValue(f"{path}: not a trial file; expected .csv or .parquet")
    notices: list[Message] = []
    entry = sidecar_entry(path, notices) if settings is None else settings
    entry = entry if isinstance(entry, SidecarEntry) else validated(SidecarEntry, dict(entry), "settings")
    return trial_of(trial_table(path), entry, notices, from_rest)


def trial_of(table: TrialTable, entry: SidecarEntry, notices: Sequence[Message] = (), from_rest: bool = False) -> Trial:
    """The run in a ``table``; entry: what its header leaves unsaid; notices: that come before its own; from_rest,
    UserError: as of ``read_trial``."""
    path, notices = table.path, list(notices)
    labels: dict[str, tuple[str, str]] = {}  # canonical name -> header and unit in the file
    raw = _si_columns(table, entry, notices, labels, from_rest)
    columns = _trimmed(path, raw, notices)  # before the clock is judged: cut rows may repeat or lack a time
    _check_time(path, columns["t"], notices)
    rate = None if "r" in entry.derived else columns["r"]  # one derived from the heading shares its faults
    # A heading is mended before anything is turned by it or taken back in time along it.
    columns["psi"], crossings = through_north(columns["t"], columns["psi"], rate)
    if crossings:
        words = f"psi was interpolated straight through 360 at {crossings} crossings of north"
        notices.append(Message(f"{words}; mended along the turn rate", "heading_mended"))
    try:
        columns = converted(columns, entry, notices)
    except UserError as error:
        raise type(error)(f"{path}: {error}") from None
    known = {"day": entry.day, "group": entry.group, "campaign": entry.campaign}
    known["inputs"] = entry.inputs if "inputs" in entry.model_fields_set else ""
    if entry.inputs == SAMPLED:
        notices.append(Message("actuators are taken as they are at each sample, with straight lines between", "inputs"))
    kind = entry.kind or _kind_from_name(path.stem, notices)
    trial = Trial(
        name=entry.name or path.stem,
        columns=columns,
        path=path if table.is_file else None,
        sha256=table.sha256,
        notices=tuple(notices),
        kind=kind,
        role=entry.role,
        std=dict(entry.std),
        ancestors=_ancestors(columns, labels, entry),
        meta={
            "labels": json.dumps(labels),
            "rows_before": str(int(np.argmax(raw["t"] == columns["t"][0]))),
            **{key: value for key, value in known.items() if value},
        },
    )
    return trial if entry.exclude is None else left_out(trial, [(b, e) for b, e in entry.exclude], "trials.toml")


APPARENT = ("apparent_wind_speed", "apparent_wind_direction", "psi", "u", "v")  # What the true wind is derived from


def _ancestors(
    columns: Mapping[str, np.ndarray], labels: Mapping[str, tuple[str, str]], entry: SidecarEntry
) -> dict[str, tuple[str, ...]]:
    """What of the ``columns`` was not measured. labels: of those in the file."""
    new = [name for name in columns if name not in labels]
    on_reading = {name: APPARENT if name in ("wind_speed", "wind_direction") else () for name in new}
    return on_reading | {name: tuple(parts) for name, parts in entry.derived.items() if name in columns}


def _files_of(folder: Path) -> list[Path]:
    """Trial files in a folder (or below it when it holds none). Raises UserError when there are none."""
    for paths in (folder.iterdir(), folder.rglob("*")):
        if files := sorted(p for p in paths if p.suffix.lower() in SUFFIXES and not p.is_dir()):
            return files
    raise Missing(f"{folder}: no .csv or .parquet files in this folder")


def _si_columns(
    table: TrialTable, entry: SidecarEntry, notices: list[Message], labels: dict[str, tuple[str, str]], from_rest: bool
) -> dict[str, np.ndarray]:
    """Canonical columns of the ``table`` in SI and radians, scaled but not yet turned or moved, every row or means of
    rows. labels: to which the header and the unit of each column are added."""
    path = table.path
    named, moving = {*entry.columns, *map(_quantity, table.header)}, STATES[2:]  # psi, u, v, r
    at_rest = [f"{name} [{quantity(name).unit}]" for name in moving if from_rest and not named & {*moving}]
    matched = match_headers(path, table.header + at_rest, entry, notices)
    if at_rest:
        notices.append(Message("no states in the file: the ship starts from rest at the origin", "starts_from_rest"))
        matched = {name: column for name, column in matched.items() if name not in moving}
        if "apparent_wind_speed" in matched and "wind_speed" not in matched:
            words = "apparent wind needs psi, u and v to become true wind; give wind_speed, wind_direction"
            raise Missing(f"{path}: {words}")
    wanted = {}
    for name, (index, unit) in matched.items():
        factor = to_si(name, unit, f"{path}: column '{table.header[index]}'")
        wanted[name] = (index, factor)
        labels[name] = (table.header[index], unit)
        if factor != 1.0:
            notices.append(Message(f"{name} converted from {unit} to {quantity(name).unit}", "unit_converted"))
    columns = table.columns(wanted, None if entry.sentinels == [] else entry.sentinels or (), notices)
    columns |= {name: np.zeros(len(columns["t"])) for name in moving if at_rest}
    if not {"n", *RUDDERS} & set(matched):  # a craft of thrusters
        columns |= {name: np.zeros(len(columns["t"])) for name in ("n", "delta")}
        notices.append(Message("no propeller and no rudder: n and delta are zero", "no_propeller"))
    return columns


def _trimmed(path: Path, columns: dict[str, np.ndarray], notices: list[Message]) -> dict[str, np.ndarray]:
    """Rows without any state cut off at both ends, rows without time dropped, empty columns judged."""
    rows = len(columns["t"])
    states = np.array([np.isfinite(columns[c]) for c in STATES if c in columns])
    alive = np.isfinite(columns["t"]) & states.any(axis=0)
    if not alive.any():
        raise TooFewData(f"{path}: no row holds a time and a state ({rows} rows, all NaN); nothing to read")
    first, last = int(np.argmax(alive)), rows - int(np.argmax(alive[::-1]))
    for word, count in (("first", first), ("last", rows - last)):
        if count:
            notices.append(Message(f"the {word} {count} of {rows} rows hold no state and were cut off", "rows_cut"))
    keep = np.isfinite(columns["t"][first:last])
    if not keep.all():
        notices.append(Message(f"{int((~keep).sum())} rows without a time stamp were dropped", "rows_without_time"))
    columns = {name: values[first:last][keep] for name, values in columns.items()}
    if len(columns["t"]) < 2:
        raise TooFewData(f"{path}: only one usable row; a trial needs at least two")
    for name in list(columns):
        missing = int((~np.isfinite(columns[name])).sum())
        if missing == len(columns["t"]):
            if name in (*STATES[2:], "n", *RUDDERS):
                raise Missing(f"{path}: column {name} holds no number at all; it is required")
            del columns[name]
            notices.append(Message(f"{name} holds no number and is left out", "column_empty"))
        elif missing:
            text = f"{name}: {missing} of {len(columns['t'])} samples missing, kept as gaps"
            notices.append(Message(text, "samples_missing"))
    return columns


def _check_time(path: Path, t: np.ndarray, notices: list[Message]) -> None:
    """Raises UserError when time stands still or runs backwards, naming the first row."""
    check_forward(path, t, np.arange(len(t)))
    if np.median(np.diff(t)) < LEAST_STEP:
        raise OutOfRange(f"{path}: rows are {np.median(np.diff(t)):.3g} s apart, closer than any clock ticks")
    if t[0] != 0.0:
        notices.append(Message(f"the clock starts at {t[0]:.6g} s and is kept", "clock_offset"))


def _kind_from_name(stem: str, notices: list[Message]) -> str:
    """The kind of manoeuvre when the file name begins with it, said in the notices; else ""."""
    kinds = {"turn": "turning", "zigzag": "zigzag", "random": "random", "berthing": "berthing"}
    kind = next((kind for prefix, kind in kinds.items() if stem.lower().startswith(prefix)), "")
    if kind:
        notices.append(Message(f"kind '{kind}' taken from the file name", "kind_from_name"))
    return kind


def read_controls(path: str | Path, actuators: Sequence[str] = ("n", "delta")) -> Trial:
    """Inputs and the first state of a run; a file without psi, u, v, r starts from rest at the origin.

    Returns a trial that begins at its first complete state, inputs without gaps: a missing sample holds the
    last one, and that is said in the notices. Units, signs and the sidecar are those of ``read_trial``.
    Raises UserError as ``read_trial`` does, for inputs in a unit that no ship allows, when an input is missing from the
    start, and as ``actuator_columns`` does for a ship with these ``actuators``. path: CSV or Parquet.
    """
    path = Path(path)
    trial = read_trial(path, from_rest=True)
    if wrong := mislabelled(trial.columns):
        raise BadValue(f"{path}: {wrong[0][2]}")
    actuator_columns(trial, actuators)
    return _without_gaps(trial, path)


def _without_gaps(trial: Trial, path: Path) -> Trial:
    """From the first complete state on, missing inputs replaced by the last one given."""
    complete = np.isfinite(trial.states[:, 2:]).all(axis=1)
    if not complete.any() or len(trial) - int(np.argmax(complete)) < 2:
        raise Missing(f"{path}: no row with psi, u, v and r to start from")
    first, notices = int(np.argmax(complete)), list(trial.notices)
    if first:
        text = f"the simulation starts at row {first + 1}, the first with a complete state"
        notices.append(Message(text, "late_start"))
    columns = {name: values[first:] for name, values in trial.columns.items()}
    for name in [name for name in (*INPUTS, "wind_speed", "wind_direction") if name in columns]:
        good = np.isfinite(columns[name])
        if not good[0]:
            raise Missing(f"{path}: {name} has no value where the simulation starts (row {first + 1})")
        if not good.all():
            last = np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))  # row of the last value given
            columns[name] = columns[name][last]
            text = f"{name}: {int((~good).sum())} missing samples hold the last value"
            notices.append(Message(text, "samples_held"))
    return replace(trial, columns=columns, notices=tuple(notices))


_USUAL = ("t", "x", "y", "psi", "u", "v", "r", "n", "delta")  # Columns that most trials hold, for a hint
# What may be said of a trial beside its columns: the keys of ``trials.toml``.
SETTINGS = tuple(name for name in SidecarEntry.model_fields if name not in ("columns", "units", "name"))


def trial_from_pandas(frame: Any, name: str, units: Mapping[str, str] | None, settings: Mapping[str, Any]) -> Trial:
    """As ``Trial.from_pandas``, with its ``frame``, ``name``, ``units`` and ``settings``. Raises UserError as that."""
    units = dict({} if units is None else by_name(units))
    if hasattr(frame, "data_vars"):  # a Dataset of xarray says units of its own
        of_variables = {str(name): v.attrs["units"] for name, v in frame.variables.items() if "units" in v.attrs}
        units, frame = of_variables | units, frame.to_dataframe()
    elif hasattr(frame, "to_pandas"):  # of polars and pyarrow
        frame = frame.to_pandas()
    if not hasattr(frame, "columns"):
        raise BadValue(f"{name}: from_pandas takes a DataFrame, not {type(frame).__name__}; see from_arrays")
    header, columns = [str(cell) for cell in frame.columns], [frame[cell].to_numpy() for cell in frame.columns]
    index = _in_utc(name, frame.index.to_numpy())
    stamps = index.dtype.kind in "mM"
    if "t" not in map(_quantity, header) and (frame.index.name or stamps):  # the index is the clock
        header.append("t [s]" if stamps else str(frame.index.name))
        columns.append(index)
    return _made(header, columns, name, units, settings)


def _in_utc(name: str, cells: np.ndarray) -> np.ndarray:
    """``cells`` (N,) of the trial of this ``name``, of which time stamps that are objects of Python or pandas, as those
    with a zone are, become those of numpy in UTC. Raises UserError where some have a zone and others none."""
    if cells.dtype.kind != "O" or not all(cell is None or isinstance(cell, datetime) for cell in cells.flat):
        return cells
    known = [cell for cell in cells.flat if cell is not None and cell == cell]  # NaT is equal to nothing
    if len({cell.tzinfo is None for cell in known}) > 1:
        raise BadValue(f"{name}: some time stamps have a zone and others none; give all in one")
    import pandas as pd

    return np.asarray(pd.to_datetime(cells, utc=True).tz_localize(None)) if known else cells


def trial_from_arrays(name: str, given: Mapping[str, Any], units: Mapping[str, str] | None) -> Trial:
    """As ``Trial.from_arrays``, with its ``units``; given: columns and settings by name. Raises UserError as that."""
    arrays = {k: v for k, v in given.items() if is_canonical(k) and not isinstance(v, str)}
    settings = {k: v for k, v in given.items() if k not in arrays}
    sizes = {}
    for key, values in arrays.items():
        arrays[key] = as_column(name, key, values)
        if arrays[key].ndim != 1:
            raise BadValue(f"{name}: {key} has shape {arrays[key].shape}; a column has one dimension")
        sizes[key] = len(arrays[key])
    if len(set(sizes.values())) > 1:
        lengths = ", ".join(f"{key} {size}" for key, size in sizes.items())
        raise Conflict(f"{name}: columns of different lengths ({lengths}); a sample has one number of each")
    all_units = {key: quantity(key).unit for key in arrays} | dict({} if units is None else by_name(units))
    return _made(list(arrays), list(arrays.values()), name, all_units, settings)


def _made(
    header: list[str], columns: list[np.ndarray], name: str, units: Mapping[str, str], settings: Mapping[str, Any]
) -> Trial:
    for key in settings:
        if key not in SETTINGS:
            raise UnknownName(f"{name}: {unknown('column or setting', key, [*_USUAL, *SETTINGS])}")
    named, columns = [_quantity(cell) for cell in header], [_in_utc(name, cells) for cells in columns]
    for column in units:
        if column not in named:
            raise UnknownName(f"{name}: units: {unknown('column', column, named)}")
    chosen = {k: v for k, v in units.items() if is_canonical(k)}
    entry = validated(SidecarEntry, {**settings, "units": chosen, "name": name}, name)
    for cell, column in zip(header, named, strict=True):
        if is_canonical(column) and column not in entry.units and not split_header(cell)[1]:
            known = accepted(column)
            words = f"units={{'{column}': '{known[0]}'}}, or name it '{column} [{known[0]}]'"
            raise Missing(f"{name}: column '{cell}' has no unit; give {words} (accepted: {', '.join(known)})")
    if missing := lacking(named):
        others = {column: cell for cell, column in zip(header, named, strict=True) if not is_canonical(column)}
        near = difflib.get_close_matches(missing[0], others, 1)
        hint = f"; is it '{others[near[0]]}'?" if near else f"; others are {', '.join(others.values()) or 'none'}"
        raise Missing(f"{name}: missing column {', '.join(missing)}{hint}")
    if not columns or not len(columns[0]):
        raise TooFewData(f"{name}: holds no row")
    path, digest = Path(name), hashlib.sha256()
    for cell, values in zip(header, columns, strict=True):  # bytes of objects are addresses
        content = values.tobytes() if values.dtype.kind != "O" else repr(values.tolist()).encode()
        digest.update(cell.encode() + content)

    def read(wanted: Collection[int]) -> Iterator[dict[int, Any]]:
        yield {i: columns[i] for i in wanted}

    table = TrialTable(path, checked_header(path, header), digest.hexdigest(), len(columns[0]), read, is_file=False)
    return trial_of(table, entry)


def _quantity(cell: str) -> str:
    """The canonical name of a header, or its own words."""
    return FRT_NAMES.get(split_header(cell)[0], split_header(cell)[0])
