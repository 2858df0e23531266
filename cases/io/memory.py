"""Trials from what a program holds: DataFrames and arrays, by the reader of files, with its checks and refusals."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.read import FRT_NAMES, lacking, split_header, trial_of
from cases.io.sidecar import SidecarEntry
from cases.io.toml_file import unknown, validated
from cases.io.trial_table import TrialTable, checked_header
from cases.quantities import accepted, is_canonical, quantity
from cases.trial import Trial
from mmg.errors import BadValue, Conflict, Missing, TooFewData, UnknownName

COLUMNS = ("t", "x", "y", "psi", "u", "v", "r", "n", "delta")
"""What most trials hold, for a hint."""
SETTINGS = tuple(name for name in SidecarEntry.model_fields if name not in ("columns", "units", "name"))
"""What may be said of a trial beside its columns: the keys of ``trials.toml``."""


def trial_from_pandas(frame: Any, name: str, units: Mapping[str, str] | None, settings: Mapping[str, Any]) -> Trial:
    """As ``Trial.from_pandas``, with its ``frame``, ``name``, ``units`` and ``settings``. Raises UserError as that."""
    if hasattr(frame, "data_vars"):  # a Dataset of xarray says units of its own
        units = {
            **{str(k): v.attrs["units"] for k, v in frame.variables.items() if "units" in v.attrs},
            **(units or {}),
        }
        frame = frame.to_dataframe()
    if not hasattr(frame, "columns"):
        raise BadValue(f"{name}: from_pandas takes a DataFrame, not {type(frame).__name__}; see from_arrays")
    header, columns = [str(cell) for cell in frame.columns], [frame[cell].to_numpy() for cell in frame.columns]
    named = {_quantity(cell) for cell in header}
    if "t" not in named and (frame.index.name or frame.index.dtype.kind in "mM"):
        label, kind = str(frame.index.name or "t"), frame.index.dtype.kind
        header.append("t [s]" if kind in "mM" else label)
        columns.append(frame.index.to_numpy())
    return _made(header, columns, name, dict(units or {}), settings)


def trial_from_arrays(name: str, given: Mapping[str, Any], units: Mapping[str, str] | None) -> Trial:
    """As ``Trial.from_arrays``, with its ``units``; given: columns and settings by name. Raises UserError as that."""
    arrays = {k: v for k, v in given.items() if is_canonical(k) and not isinstance(v, str)}
    settings = {k: v for k, v in given.items() if k not in arrays}
    sizes = {}
    for key, values in arrays.items():
        arrays[key] = np.asarray(values)
        if arrays[key].ndim != 1:
            raise BadValue(f"{name}: {key} has shape {arrays[key].shape}; a column has one dimension")
        sizes[key] = len(arrays[key])
    if len(set(sizes.values())) > 1:
        told = ", ".join(f"{key} {size}" for key, size in sizes.items())
        raise Conflict(f"{name}: columns of different lengths ({told}); a sample has one number of each")
    _refuse_settings(name, settings)
    own = {key: quantity(key).unit for key in arrays} | dict(units or {})
    return _made(list(arrays), list(arrays.values()), name, own, settings)


def _made(
    header: list[str], columns: list[np.ndarray], name: str, units: Mapping[str, str], settings: Mapping[str, Any]
) -> Trial:
    _refuse_settings(name, settings)
    named = [_quantity(cell) for cell in header]
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
    path = Path(name)
    digest = hashlib.sha256()
    for cell, values in zip(header, columns, strict=True):
        digest.update(
            cell.encode() + (values.tobytes() if values.dtype.kind != "O" else repr(values.tolist()).encode())
        )

    def read(wanted: Collection[int]) -> Iterator[dict[int, Any]]:
        yield {i: columns[i] for i in wanted}

    table = TrialTable(path, checked_header(path, header), digest.hexdigest(), len(columns[0]), read, is_file=False)
    return trial_of(table, entry)


def _quantity(cell: str) -> str:
    """The canonical name of a header, or its own words."""
    return FRT_NAMES.get(split_header(cell)[0], split_header(cell)[0])


def _refuse_settings(name: str, settings: Mapping[str, Any]) -> None:
    """Raises UserError for what is neither a column nor a setting of a trial."""
    for key in settings:
        if key not in SETTINGS:
            raise UnknownName(f"{name}: {unknown('column or setting', key, [*COLUMNS, *SETTINGS])}")
