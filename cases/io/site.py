"""``site.toml`` beside the trials: what is roughly known of the place, for the effects ``bank`` and ``shallow_water``.

::

    [bank]                    # a straight bank along the line y = -6 m, water where y is greater
    y = -6.0                  # or x = ...; m, in the frame of the trials (x north, y east)
    water_side = "greater"    # or "less"
    decay = 1.5               # m, optional: over this length the suction fades

    [shelf]                   # shallow water where x is greater than 10 m
    x = 10.0                  # or y = ...
    shallow_side = "greater"  # or "less"
    width = 1.5               # m, optional: over this length the bottom rises

    [water]
    depth = 2.0               # m; with a shelf, the depth upon it

An unknown key is an error. The numbers become parameters of the effects: where a line lies is held, a depth is only
where the search for draught / depth starts.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from cases.trial import Trial
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.ship import Ship

NAME = "site.toml"

SIDES = ("greater", "less")

KEYS = {
    "bank": ("x", "y", "water_side", "decay"),
    "shelf": ("x", "y", "shallow_side", "width"),
    "water": ("depth",),
}
"""Section -> its keys."""

FURTHEST = 1e5
"""m; a line that lies further from the origin of the trials is a slip."""

Values = dict[str, dict[str, float]]
"""Effect -> parameter -> value, SI and radians."""


class Site(NamedTuple):
    """What a site file says, in the parameters of the effects; all empty without a file.

    held: parameters to hold, of ``bank`` (distance, bearing, decay if given) and ``shallow_water`` (line, bearing,
    width if given). start: starting values of free ones (``shallow_water``: d_h). notices: sentences on what was
    assumed.
    """

    held: Values
    start: Values
    notices: tuple[str, ...] = ()


def read_site(places: Iterable[Trial | Path | str], ship: Ship, explicit: Path | None = None) -> Site:
    """The site of trials, given as trials, their files or folders; ``explicit`` names one file for them all.

    The file lies beside the trials, or one folder above (as of folders train and test). Raises UserError for an
    unreadable or wrong file, and for folders whose files say different things.
    """
    if explicit is not None:
        if not explicit.is_file():
            raise UserError(f"{explicit}: no such file")
        return _parsed(explicit, ship)
    folders = _folders([places] if isinstance(places, str | Path) else places)
    folders = [f.resolve().parent if not (f / NAME).is_file() and _above(f).is_file() else f for f in folders]
    folders = list(dict.fromkeys(folders))
    found = [folder / NAME for folder in folders if (folder / NAME).is_file()]
    if not found:
        return Site({}, {})
    sites = [_parsed(path, ship) for path in found]
    for path, site in zip(found[1:], sites[1:], strict=True):
        if site != sites[0]:
            raise UserError(f"{found[0]} and {path} describe different sites; diagnose the trials of each on their own")
    bare = [str(folder) for folder in folders if folder / NAME not in found]
    notices = (f"{found[0]} is taken to hold for {', '.join(bare)} as well",) if bare else ()
    return sites[0]._replace(notices=notices)


def _above(folder: Path) -> Path:
    """The site file in the folder above."""
    return folder.resolve().parent / NAME


def _folders(places: Iterable[Trial | Path | str]) -> list[Path]:
    """The folders of trials or files, each once, in their order; a trial that was not read from a file has none."""
    folders: list[Path] = []
    for place in places:
        path = place.path if isinstance(place, Trial) else Path(place)
        if path is None:
            continue
        folder = path if path.is_dir() else path.parent
        if folder not in folders:
            folders.append(folder)
    return folders


def _parsed(path: Path, ship: Ship) -> Site:
    """One file in the parameters of the effects."""
    data = _read(path)
    held: Values = {}
    start: Values = {}
    if "bank" in data:
        where, section = f"{path}: [bank]", data["bank"]
        bearing = _bearing(section, "water_side", where) + math.pi
        held["bank"] = {"distance": _along(section, bearing), "bearing": _wrapped(bearing)}
        held["bank"].update(_length(section, "decay", "bank", ship, where))
    if "shelf" in data:
        where, section = f"{path}: [shelf]", data["shelf"]
        bearing = _bearing(section, "shallow_side", where)
        held["shallow_water"] = {"line": _along(section, bearing), "bearing": _wrapped(bearing)}
        held["shallow_water"].update(_length(section, "width", "shallow_water", ship, where))
    if "water" in data:
        start["shallow_water"] = {"d_h": _ratio(data["water"], ship, f"{path}: [water]")}
    return Site(held, start)


def _read(path: Path) -> dict[str, dict[str, Any]]:
    """The sections of a file, names of sections and keys checked."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:  # pragma: no cover
        import tomli as tomllib
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: not a readable TOML file ({' '.join(str(error).split())})") from None
    for name, section in data.items():
        if name not in KEYS:
            raise UserError(f"{path}: unknown section {name!r}; use {', '.join(f'[{s}]' for s in KEYS)}")
        if not isinstance(section, dict):
            raise UserError(f"{path}: {name} must be a table, [{name}]")
        unknown = [key for key in section if key not in KEYS[name]]
        if unknown:
            raise UserError(f"{path}: [{name}]: unknown key {unknown[0]!r}; known: {', '.join(KEYS[name])}")
    return data


def _bearing(section: dict[str, Any], side: str, where: str) -> float:
    """Direction [rad, clockwise from north] square to the line, towards its ``side``; checks line and side."""
    given = [axis for axis in ("x", "y") if axis in section]
    if len(given) != 1:
        raise UserError(f"{where}: give either x or y of the line in m, {'not both' if given else 'it has neither'}")
    value = _number(section, given[0], where)
    if abs(value) > FURTHEST:
        raise UserError(f"{where}: {given[0]} = {value:g}; must be m in the frame of the trials, below {FURTHEST:g}")
    if side not in section:
        raise UserError(f'{where}: {side} is missing; say {side} = "greater" or "less" than {given[0]} = {value:g}')
    if section[side] not in SIDES:
        raise UserError(f"{where}: {side} = {section[side]!r}; must be one of {', '.join(SIDES)}")
    axis = 0.0 if given[0] == "x" else 0.5 * math.pi
    return axis if section[side] == "greater" else axis + math.pi


def _along(section: dict[str, Any], bearing: float) -> float:
    """Distance [m] of the line from the origin in direction ``bearing``, negative where it lies behind."""
    axis = "x" if "x" in section else "y"
    value = float(section[axis])
    along = math.cos(bearing) if axis == "x" else math.sin(bearing)
    return value * round(along)


def _wrapped(angle: float) -> float:
    """The angle [rad] in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def _length(section: dict[str, Any], key: str, effect: str, ship: Ship, where: str) -> dict[str, float]:
    """{key: length in m} where the section has it, within the bounds of the effect's parameter."""
    if key not in section:
        return {}
    value = _number(section, key, where)
    rows = EFFECTS[effect].parameters(ship.namespace, dict(ship.components))
    row = next(p for p in rows if p.symbol == key)
    if not row.lower <= value <= row.upper:
        raise UserError(f"{where}: {key} = {value:g}; must be from {row.lower:g} to {row.upper:g} m")
    return {key: value}


def _ratio(section: dict[str, Any], ship: Ship, where: str) -> float:
    """Draught over depth, below the largest that the effect takes."""
    if "depth" not in section:
        raise UserError(f"{where}: depth is missing; give it in m, such as depth = 2.0")
    depth = _number(section, "depth", where)
    rows = EFFECTS["shallow_water"].parameters(ship.namespace, dict(ship.components))
    draught = ship.particulars["d"]
    least = draught / next(p.upper for p in rows if p.symbol == "d_h")
    if depth <= least:
        raise UserError(f"{where}: depth = {depth:g}; must be above {least:.3g} m for a draught of {draught:g} m")
    return draught / depth


def _number(section: dict[str, Any], key: str, where: str) -> float:
    value = section[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise UserError(f"{where}: {key} = {value!r}; must be a number in m")
    return float(value)
