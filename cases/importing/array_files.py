"""Arrays of MATLAB (.mat, by scipy, of version 7.3 by h5py), HDF5 and netCDF (of version 3 by scipy) as tables.

Vectors of one length in a struct or group are a table; time and values in a struct are one series. Tables whose columns
have different names are parts of one log; of those with the same names each is a log.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.clocks import clock_of
from cases.importing.import_map import ImportMap
from cases.importing.raw_table import Account, RawTable, raw_table
from cases.importing.series import SourceSeries, table_of_series
from cases.importing.vocabulary import meaning
from cases.io.files import LARGEST, read_bytes
from cases.io.trial_table import MOST_CELLS
from mmg.errors import BadValue, OutOfRange, TooFewData, Unreadable, UserError, needed, reason
from mmg.messages import Message

HDF5 = b"\x89HDF\r\n\x1a\n"
# Bytes at which its signature may lie: MATLAB writes 512 of its own before. Set by hand: the first of the places that
# the HDF5 File Format Specification 3.0 names (II.A).
HDF5_AT = (0, 512, 1024, 2048)
MATLAB = b"MATLAB 5.0 MAT-file"  # Begin of a file of MATLAB before version 7.3
ELEMENTS = {*range(1, 8), 9, *range(12, 19)}  # Types of the elements of a MATLAB file (MAT-file format, table 1-1)
COMPRESSED, MATRIX = 15, 14  # Those that hold elements themselves (the same table)
DEEPEST, MOST_NODES = 20, 20_000  # Levels and names that are looked at. Set by hand: bounds time on a damaged file.
OBJECTS = "a table, timetable, datetime or timeseries, which only MATLAB reads; save its columns as vectors of a struct"
VALUES = ("values", "data", "value", "signals")  # Names of the values in a struct with a time


@dataclass(frozen=True)
class Vectors:
    """Columns of one length: header -> (N,) and units, below the name of their struct or group."""

    name: str
    columns: dict[str, np.ndarray]
    units: dict[str, str]


def is_hdf5(content: bytes) -> bool:
    """Whether ``content`` begins a file of HDF5, which MATLAB 7.3 and netCDF 4 write as well."""
    return any(content[at : at + len(HDF5)] == HDF5 for at in HDF5_AT)


def read_arrays(path: Path, chosen: ImportMap) -> list[RawTable]:
    """The tables of the MATLAB, HDF5 or netCDF file ``path``. chosen: the map. Raises UserError where h5py is missing,
    for a damaged file, and for one without vectors of one length."""
    import pandas as pd

    content = read_bytes(path)
    accounts: list[Account] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of scipy, of byte orders
            if is_hdf5(content[:4096]):
                h5py = needed("h5py", f"{path}: HDF5, also of MATLAB 7.3,")
                with h5py.File(io.BytesIO(content), "r") as file:  # bytes in memory: links to other files lead nowhere
                    tree = _group(file, accounts, h5py)
            elif content.startswith(b"CDF"):
                tree = _classic(content)
            else:
                tree = _matlab(path, content, accounts)
        groups = list(_vectors(tree, "", accounts))
    except UserError:
        raise
    except Exception as error:  # both libraries raise many kinds for damaged files
        raise Unreadable(
            f"{path}: is cut off, damaged or no file of MATLAB, HDF5 or netCDF ({reason(error)})"
        ) from None
    if not groups:
        words = "; ".join(f"{a.what} is {a.why}" for a in accounts[:3])
        raise TooFewData(f"{path}: holds no vectors of one length{': ' + words if words else ''}")
    if sum(len(one.columns) * len(next(iter(one.columns.values()))) for one in groups) > MOST_CELLS:
        raise OutOfRange(f"{path}: more than {MOST_CELLS} cells; divide it")
    tables = []
    for one in groups:
        name = f"{path}, group '{one.name}'" if len(groups) > 1 else str(path)
        frame = pd.DataFrame(dict(enumerate(one.columns.values())))
        tables.append(raw_table(path, name, list(one.columns), [one.units.get(h, "") for h in one.columns], frame, []))
    joined = _parts_of_one_log(path, [one.name for one in groups], tables, chosen, accounts)
    return joined or [replace(table, accounts=tuple(accounts)) for table in tables]


def _parts_of_one_log(
    path: Path, groups: list[str], tables: list[RawTable], chosen: ImportMap, accounts: list[Account]
) -> list[RawTable]:
    """One table of those of the groups; none where columns of the same name make each of them a log of its own."""
    said = chosen.columns_of(path).get("t")
    series, clocks, names = [], [], Counter[str]()
    for group, table in zip(groups, tables, strict=True):
        means = {h: meaning(h) for h in table.headers}
        time = next((h for h in table.headers if (h == said.header if said else means[h].quantity == "t")), "")
        others = [h for h in table.headers if h != time]
        names.update(others)
        if len(tables) < 2 or not time or max(names.values(), default=0) > 1:  # a name again: runs of one layout
            return []
        clocks.append(clock_of(table, time, said.unit if said else "", None, chosen.zone_hours))
        columns = {h: table.numbers(h) for h in others if table.numeric(h)}
        units = dict(zip(table.headers, table.units, strict=True))
        with_units = {h: replace(means[h], unit=units[h] or means[h].unit) for h in columns}
        series.append(SourceSeries(group, clocks[-1].t, columns, with_units))
    if len({clock.absolute for clock in clocks}) > 1:
        raise BadValue(f"{path}: its groups count time from different beginnings; leave some out in the map (ignore)")
    words = Message(f"{len(series)} parts of {path.name} joined on time", "joined")
    return [table_of_series(path, series, chosen, clocks[0], [words], accounts)]


def _vectors(tree: Mapping[str, Any], name: str, accounts: list[Account], depth: int = 0) -> Iterator[Vectors]:
    """The tables of a struct or group and of those in it."""
    if depth > DEEPEST or len(accounts) > MOST_NODES:
        raise OutOfRange(f"'{name}' holds more names or levels than are read")
    series = _one_series(name, tree)
    if series is not None:
        yield series
        return
    vectors: dict[int, dict[str, Array]] = {}
    for key, array in tree.items():
        below = f"{name}/{key}".strip("/")
        parts = [array] if isinstance(array, Mapping) else array if isinstance(array, list) else []
        for number, part in enumerate(parts, 1):
            if isinstance(part, Mapping):
                yield from _vectors(part, f"{below}{number if len(parts) > 1 else ''}", accounts, depth + 1)
        if not isinstance(array, Array):
            continue
        values = array.values.squeeze()  # MATLAB has no vectors, only matrices of one row or column
        if values.dtype.names:
            fields = {f: values[f] for f in values.dtype.names}
            yield Vectors(below, {f: v for f, v in fields.items() if v.ndim == 1 and v.dtype.kind in "iufSU"}, {})
        elif values.ndim == 1 and values.dtype.kind in "iufMOSU" and len(values) > 1:  # one value is a setting
            vectors.setdefault(len(values), {})[key] = replace(array, values=values)
        elif values.ndim == 2 and values.dtype.kind in "iuf":
            yield _matrix(below, values, array.names or _names_for(tree, min(values.shape)))
        else:
            accounts.append(Account(below, int(values.size), (), f"of shape {array.values.shape}"))
    for length, arrays in vectors.items():
        if len(arrays) > 1:
            units = {key: array.unit for key, array in arrays.items()}
            yield Vectors(name or "top", {key: array.values for key, array in arrays.items()}, units)
        else:
            accounts.append(Account(f"{name}/{next(iter(arrays))}".strip("/"), length, (), "no other has its length"))


def _one_series(name: str, tree: Mapping[str, Any]) -> Vectors | None:
    """The values of a struct with a time, as of timeseries and of Simulink's structures with time; else None."""
    time = next((tree[k] for k in tree if k.lower() in ("time", "t") and isinstance(tree[k], Array)), None)
    key = next((k for k in tree if k.lower() in VALUES), "")
    if time is None or not key or time.values.squeeze().ndim != 1:
        return None
    t, label = time.values.squeeze(), name.rpartition("/")[2]
    columns, units = {"time": t}, {"time": time.unit or "s"}
    for number, part in enumerate(tree[key] if isinstance(tree[key], list) else [tree[key]], 1):
        if isinstance(part, Mapping):  # of Simulink: values, label, dimensions
            label = str(part.get("label") or f"{name.rpartition('/')[2]} {number}")
            part = part.get("values")
        values = part.values.squeeze() if isinstance(part, Array) else np.zeros((0, 0, 0))
        if values.ndim not in (1, 2) or len(t) not in values.shape:
            return None
        for i, column in enumerate(np.atleast_2d(values.T if len(values) == len(t) else values), 1):
            header = label if values.ndim == 1 else f"{label} {i}"
            columns[header], units[header] = column, part.unit
    return Vectors(name, columns, units)


def _matrix(name: str, values: np.ndarray, names: tuple[str, ...]) -> Vectors:
    """The columns of a matrix."""
    rows = values if values.shape[0] >= values.shape[1] else values.T  # a log has more samples than channels
    headers = names if len(names) == rows.shape[1] else tuple(f"column {i + 1}" for i in range(rows.shape[1]))
    return Vectors(name, {h: rows[:, i] for i, h in enumerate(headers)}, {})


def _names_for(tree: Mapping[str, Any], width: int) -> tuple[str, ...]:
    """Names of columns that lie beside a matrix, as many as it has."""
    lists = [v for v in tree.values() if isinstance(v, list) and len(v) == width and all(isinstance(x, str) for x in v)]
    return tuple(lists[0]) if len(lists) == 1 else ()


@dataclass(frozen=True)
class Array:
    """Values of any shape, their unit or "", and names of columns that the file says of them."""

    values: np.ndarray
    unit: str = ""
    names: tuple[str, ...] = ()


def _matlab(path: Path, content: bytes, accounts: list[Account]) -> dict[str, Any]:
    """The variables of a MATLAB file before version 7.3: structs as dicts, arrays of them as lists."""
    from scipy.io import loadmat, whosmat

    if content[126:128] != b"IM":  # "MI" in the order of the machine that wrote it (MAT-file format)
        raise ValueError("written by a machine of another byte order")
    _check_elements(content[128:])  # behind the header of 128 bytes
    for name, shape, kind in whosmat(str(path), appendmat=False):  # sizes are known before anything is unpacked
        if math.prod(shape) > (MOST_NODES if kind in ("struct", "cell") else MOST_CELLS):
            raise OutOfRange(f"{path}: variable '{name}' of shape {shape} is larger than what is read")
        if kind in ("object", "opaque", "function", "unknown"):
            accounts.append(Account(name, 1, (), OBJECTS))
    loaded = loadmat(str(path), appendmat=False, simplify_cells=True, chars_as_strings=True)
    # "__header__" and others are scipy's own; "None" is what it calls a variable without a name.
    return {k: v for k, v in _as_tree(loaded).items() if not k.startswith("__") and k != "None"}


def _check_elements(content: bytes, depth: int = 0) -> None:
    """Raises ValueError for elements of a MATLAB file that are none: scipy ends the process at types it does not know.
    content: elements, each a tag (type and size, or both in four bytes) and its data (MAT-file format, 1-9)."""
    if depth > DEEPEST:
        raise ValueError("structs lie too deep")
    at = 0
    while at < len(content):
        kind, size = struct.unpack_from("<II", content, at)
        short = kind >> 16  # size of a small element, whose data follow in the four bytes of the tag
        begin, size = (at + 4, short) if short else (at + 8, size)
        kind &= 0xFFFF
        if kind not in ELEMENTS or begin + size > len(content) or short > 4:
            raise ValueError(f"element of type {kind} and {size} bytes at {at}")
        if kind == COMPRESSED:  # the bound keeps a bomb from memory
            _check_elements(zlib.decompressobj().decompress(content[begin : begin + size], 8 * LARGEST), depth + 1)
        elif kind == MATRIX:
            _check_elements(content[begin : begin + size], depth + 1)
        at = begin + size + (0 if kind == COMPRESSED else -(begin + size) % 8)  # others are padded to 64 bits


def _as_tree(value: Any, depth: int = 0) -> Any:
    if depth > DEEPEST:
        return None
    if isinstance(value, dict):
        return {str(key): _as_tree(one, depth + 1) for key, one in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in "OU":
        return [_as_tree(one, depth + 1) for one in value.ravel().tolist()]
    if isinstance(value, list | tuple):
        return [_as_tree(one, depth + 1) for one in value]
    return Array(value) if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" else value


def _group(group: Any, accounts: list[Account], h5py: Any, depth: int = 0) -> dict[str, Any]:
    """The groups of an HDF5 file as dicts."""
    tree: dict[str, Any] = {}
    for name in group:
        if depth > DEEPEST or len(accounts) > MOST_NODES:
            raise OutOfRange(f"{group.name} holds more names or levels than are read")
        if name.startswith("#") or group.get(name, getlink=True).__class__ is not h5py.HardLink:
            continue  # references of MATLAB, and links that may lead out of the file
        node = group[name]
        if isinstance(node, h5py.Group):
            tree[name] = _group(node, accounts, h5py, depth + 1)
        elif _text(node.attrs.get("MATLAB_class")) in ("table", "timetable", "datetime", "timeseries", "categorical"):
            accounts.append(Account(node.name.strip("/"), 1, (), OBJECTS))
        elif node.size and node.size <= MOST_CELLS and node.dtype.kind in "iuf":
            tree[name] = _dataset(node[()], node.attrs)
        elif node.size and node.size <= MOST_CELLS and node.dtype.names:
            tree[name] = Array(node[()])
        else:
            accounts.append(Account(node.name.strip("/"), int(node.size or 0), (), f"of type {node.dtype}"))
    return tree


def _classic(content: bytes) -> dict[str, Any]:
    """The variables of a file of netCDF before version 4."""
    from scipy.io import netcdf_file

    with netcdf_file(io.BytesIO(content), mmap=False) as file:
        found = {name: (np.array(one.data), vars(one)) for name, one in file.variables.items()}
    return {
        name: _dataset(values.astype(values.dtype.newbyteorder("=")), attributes)
        for name, (values, attributes) in found.items()
        if values.dtype.kind in "iuf"
    }


def _dataset(values: np.ndarray, attributes: Mapping[str, Any]) -> Array:
    """Numbers of a dataset with its attributes: fill values are NaN, packed numbers are unpacked, and times "seconds
    since ..." of netCDF are counted from 1970 (CF conventions 1.10, 2.5.1, 8.1 and 4.4)."""
    import pandas as pd

    unit, fill = _text(attributes.get("units", attributes.get("unit", ""))), attributes.get("_FillValue")
    if fill is not None and np.size(fill) == 1:
        values = np.where(values == np.ravel(fill)[0], np.nan, values)
    if "scale_factor" in attributes or "add_offset" in attributes:
        values = values * float(attributes.get("scale_factor", 1.0)) + float(attributes.get("add_offset", 0.0))
    if since := re.fullmatch(r"(\w+) since (.+)", unit.strip()):
        with contextlib.suppress(ValueError):  # other words are no unit of times, and refused as such
            factor, begin = pd.Timedelta(f"1 {since[1].lower()}"), pd.Timestamp(since[2])
            values, unit = values * factor.total_seconds() + begin.timestamp(), "s"
    names = next((attributes[key] for key in ("columns", "names", "headers") if key in attributes), ())
    listed = np.ravel(names).tolist() if np.size(names) > 1 else _text(names).split(",") if np.size(names) else []
    return Array(values, unit, tuple(_text(n).strip() for n in listed))


def _text(value: Any) -> str:
    value = np.ravel(value)[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value) if value is not None else ""
