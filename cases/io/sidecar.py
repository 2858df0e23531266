"""The sidecar ``trials.toml``: what the trial files beside it leave unsaid.

::

    [default]                         # for every file of the folder ([all] means the same)
    rudder_positive = "port"          # "starboard" (the house) or "port"
    wind_direction = "to"             # "from" (the house) or "to"; true and apparent wind
    velocity_frame = "earth"          # "body" (the house) or "earth": u north, v east
    reference_point = { x = 1.2, y = 0.0, applies_to = "both" }
                                      # measured point from midship [m], x forward, y starboard;
                                      # applies_to "position", "velocity" or "both"
    columns = { u = "SOG long", n = "RPM" }         # canonical name = header in the file
    units = { u = "kn", n = "rpm", t = "s" }        # canonical name = unit, wins over the header
    sign = { psi = -1, r = -1 }                     # canonical name = 1 or -1
    kind = "zigzag"
    role = "train"                                  # "train", "validate" or "test"

    [files."run_07.csv"]              # the same keys for one file, added to or replacing the default
    name = "zigzag 20/20, second"

An unknown key is an error. Tables (columns, units, sign) of a file are merged into those of the default.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from cases.io.units import is_canonical, to_si
from mmg.errors import UserError

NAME = "trials.toml"

CHOICES = {
    "rudder_positive": ("starboard", "port"),
    "wind_direction": ("from", "to"),
    "velocity_frame": ("body", "earth"),
    "role": ("train", "validate", "test"),
}
TABLES = ("columns", "units", "sign")


@dataclass(frozen=True)
class Settings:
    """What is known about one trial file beside its header; defaults are the conventions of the house.

    columns: canonical name -> header in the file. units: canonical name -> unit. sign: canonical name ->
    +1 or -1. reference_point: (x, y) of the measured point from midship [m]; applies_to says whether the
    positions, the velocities or both belong to it. source: where the settings come from, for messages.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    sign: Mapping[str, int] = field(default_factory=dict)
    rudder_positive: str = "starboard"
    wind_direction: str = "from"
    velocity_frame: str = "body"
    reference_point: tuple[float, float] = (0.0, 0.0)
    applies_to: str = "both"
    kind: str = ""
    role: str = ""
    name: str = ""
    source: str = ""


KEYS = tuple(f.name for f in fields(Settings) if f.name not in ("source", "applies_to"))


def read_sidecar(path: Path) -> dict[str, Any]:
    """The parsed sidecar, structure checked: {"default": {...}, "files": {name: {...}}}.

    Raises UserError for unreadable TOML, unknown sections or keys, and values out of range.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:  # pragma: no cover
        import tomli as tomllib
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: not a readable TOML file ({_one_line(error)})") from None
    unknown = sorted(set(data) - {"default", "all", "files"})
    if unknown:
        raise UserError(f'{path}: unknown section [{unknown[0]}]; use [default] and [files."NAME.csv"]')
    if "default" in data and "all" in data:
        raise UserError(f"{path}: both [default] and [all]: they mean the same, keep one")
    default = _checked(data.get("default", data.get("all", {})), f"{path}: [default]")
    entries = data.get("files", {})
    if not isinstance(entries, dict):
        raise UserError(f'{path}: files must be tables such as [files."run_07.csv"]')
    files = {name: _checked(entry, f'{path}: [files."{name}"]') for name, entry in entries.items()}
    return {"default": default, "files": files}


def settings_for(trial: Path) -> Settings:
    """The settings that ``trials.toml`` beside a trial file gives it; the house defaults without one."""
    path = trial.parent / NAME
    if not path.is_file():
        return Settings()
    data = read_sidecar(path)
    entry = data["files"].get(trial.name, data["files"].get(trial.stem, {}))
    return make_settings({**data["default"], **_merged(data["default"], entry)}, source=str(path))


def make_settings(values: Mapping[str, Any], source: str = "settings") -> Settings:
    """Settings from a plain mapping with the keys of the sidecar. Raises UserError as the sidecar does."""
    known = _checked(dict(values), source)
    point = known.pop("reference_point", None)
    if point is not None:
        x, y, applies = _point(point, source)
        known.update(reference_point=(x, y), applies_to=applies)
    return Settings(**known, source=source)


def _merged(default: Mapping[str, Any], entry: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of a file, its tables merged into those of the default."""
    return {key: {**default.get(key, {}), **value} if key in TABLES else value for key, value in entry.items()}


def _checked(section: Any, where: str) -> dict[str, Any]:
    """One section with every key and value checked."""
    if not isinstance(section, dict):
        raise UserError(f"{where}: must be a table")
    for key, value in section.items():
        if key not in KEYS:
            raise UserError(f"{where}: unknown key '{key}'; known: {', '.join(KEYS)}")
        if key in CHOICES and value not in CHOICES[key]:
            raise UserError(f"{where}: {key} = {value!r}; must be one of {', '.join(CHOICES[key])}")
        if key in ("kind", "name") and not isinstance(value, str):
            raise UserError(f"{where}: {key} must be text")
        if key in TABLES:
            _check_table(key, value, where)
        if key == "reference_point":
            _point(value, where)
    return dict(section)


def _check_table(key: str, table: Any, where: str) -> None:
    """columns, units and sign: canonical names on the left, the right kind of value on the right."""
    if not isinstance(table, dict):
        raise UserError(f"{where}: {key} must be a table such as {key} = {{ u = ... }}")
    for column, value in table.items():
        if not is_canonical(column):
            raise UserError(f"{where}: {key}: '{column}' is not a canonical column (t, psi, u, ...)")
        if key == "sign" and value not in (1, -1):
            raise UserError(f"{where}: sign.{column} = {value!r}; must be 1 or -1")
        if key != "sign" and not isinstance(value, str):
            raise UserError(f"{where}: {key}.{column} must be text")
        if key == "units":
            to_si(column, value, f"{where}: units.{column}")


def _point(value: Any, where: str) -> tuple[float, float, str]:
    """(x, y, applies_to) of a reference point written as [x, y] or {x = , y = , applies_to = }."""
    if isinstance(value, (list, tuple)):
        value = dict(zip(("x", "y"), value, strict=False)) if len(value) == 2 else None
    if not isinstance(value, dict) or set(value) - {"x", "y", "applies_to"}:
        raise UserError(f"{where}: reference_point must be {{ x = 1.2, y = 0.0 }} in m from midship")
    x, y, applies = value.get("x", 0.0), value.get("y", 0.0), value.get("applies_to", "both")
    if not all(isinstance(c, (int, float)) and not isinstance(c, bool) for c in (x, y)):
        raise UserError(f"{where}: reference_point x and y must be numbers in m")
    if applies not in ("position", "velocity", "both"):
        raise UserError(f"{where}: reference_point.applies_to must be position, velocity or both")
    return float(x), float(y), applies


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
