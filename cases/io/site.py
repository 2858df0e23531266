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
where the search for draught over depth starts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import Field, model_validator

from cases.io.toml_file import Section, checked, number, read_toml, refuse
from cases.trial import Trial
from mmg.effects import EFFECTS, Parameter
from mmg.errors import Conflict, Missing
from mmg.messages import Message
from mmg.ship import Ship

NAME = "site.toml"
Side = Literal["greater", "less"]


class Line(Section):
    """A straight line x = ... or y = ... [m] in the frame of the trials (x north, y east)."""

    x: float | None = number("m in the frame of the trials", None, ge=-1e5, le=1e5)  # larger: grid coordinates
    y: float | None = number("m in the frame of the trials", None, ge=-1e5, le=1e5)

    @model_validator(mode="after")
    def _one_axis(self) -> Line:
        if (self.x is None) == (self.y is None):
            both = "it has neither" if self.x is None else "not both"
            raise ValueError(f"give either x or y of the line in m, {both}")
        return self

    def towards(self, side: Side) -> tuple[float, float]:
        """Direction [rad, clockwise from north] square to the line towards its ``side``, and how far [m] the line
        lies in that direction from the origin."""
        sign = 1.0 if side == "greater" else -1.0
        if self.x is not None:
            return (0.0 if sign > 0 else math.pi), sign * self.x
        assert self.y is not None
        return sign * 0.5 * math.pi, sign * self.y


class BankLine(Line):
    """A straight bank."""

    water_side: Side = Field(description='say water_side = "greater" or "less" than the x or y of the line')
    decay: float | None = number("m", None)


class Shelf(Line):
    """Shallow water beyond a straight line."""

    shallow_side: Side = Field(description='say shallow_side = "greater" or "less" than the x or y of the line')
    width: float | None = number("m", None)


class Water(Section):
    """Depth [m] of the water, upon the shelf if there is one."""

    # No sea is deeper than 12 km.
    depth: float = Field(description="give it in m, such as depth = 2.0", json_schema_extra={"unit": "m"}, le=12000.0)


class SiteFile(Section):
    """A whole site file."""

    bank: BankLine | None = None
    shelf: Shelf | None = None
    water: Water | None = None


Values = dict[str, dict[str, float]]  # Effect -> parameter -> value, SI and radians


class Site(NamedTuple):
    """What a site file says, in the parameters of the effects; all empty without a file.

    held: parameters to hold, of ``bank`` (distance, bearing, decay if given) and ``shallow_water`` (line, bearing,
    width if given). start: starting values of free ones (``shallow_water``: d_h). notices: sentences on what was
    assumed.
    """

    held: Values
    start: Values
    notices: tuple[Message, ...] = ()


def read_site(places: Iterable[Trial | Path | str], ship: Ship, explicit: Path | None = None) -> Site:
    """The site of trials, for a ``ship``.

    places: trials, their files or folders; the site file lies beside them or one folder above (as of folders train
    and test). explicit: one file for them all instead. Raises UserError for an unreadable or wrong file, and for
    folders whose files say different things.
    """
    if explicit is not None:
        if not explicit.is_file():
            raise Missing(f"{explicit}: no such file")
        return _parsed(explicit, ship)
    given = [places] if isinstance(places, str | Path) else places
    paths = [place.path if isinstance(place, Trial) else Path(place) for place in given]
    folders = list(dict.fromkeys(_folder(path) for path in paths if path is not None))
    files = [folder / NAME for folder in folders if (folder / NAME).is_file()]
    if not files:
        return Site({}, {})
    sites = [_parsed(path, ship) for path in files]
    for path, site in zip(files[1:], sites[1:], strict=True):
        if site != sites[0]:
            raise Conflict(f"{files[0]} and {path} describe different sites; diagnose the trials of each on their own")
    without = [str(folder) for folder in folders if folder / NAME not in files]
    text = f"{files[0]} is taken to hold for {', '.join(without)} as well"
    return sites[0]._replace(notices=(Message(text, "site_shared"),) if without else ())


def _folder(path: Path) -> Path:
    """The folder of a trial file, or the one above where only that holds a site file."""
    folder = path if path.is_dir() else path.parent
    above = folder.resolve().parent
    return above if (above / NAME).is_file() and not (folder / NAME).is_file() else folder


def _parsed(path: Path, ship: Ship) -> Site:
    """One file in the parameters of the effects: a bank lies in its bearing, a shelf extends in it."""
    content, problems = checked(SiteFile, read_toml(path))
    held: Values = {}
    start: Values = {}
    lengths: list[tuple[str, str, float | None, str]] = []
    if content and content.bank:  # the effect's bearing points from the water to the bank
        bearing, along = content.bank.towards("less" if content.bank.water_side == "greater" else "greater")
        held["bank"] = {"distance": along, "bearing": bearing}
        lengths.append(("bank", "decay", content.bank.decay, "[bank]"))
    if content and content.shelf:
        bearing, along = content.shelf.towards(content.shelf.shallow_side)
        held["shallow_water"] = {"line": along, "bearing": bearing}
        lengths.append(("shallow_water", "width", content.shelf.width, "[shelf]"))
    for effect, symbol, value, place in lengths:
        p = _parameter(ship, effect, symbol)
        if value is not None:
            held[effect][symbol] = value
            if not p.lower <= value <= p.upper:
                problems.append(f"{place} {symbol} = {value:g}: must be from {p.lower:g} to {p.upper:g} m")
    if content and content.water:
        depth, draught = content.water.depth, ship.particulars["d"]
        least = draught / _parameter(ship, "shallow_water", "d_h").upper  # d_h: draught over depth
        if depth <= least:
            problems.append(f"[water] depth = {depth:g}: must be above {least:.3g} m for a draught of {draught:g} m")
        else:
            start["shallow_water"] = {"d_h": draught / depth}
    refuse(str(path), problems)
    return Site(held, start)


def _parameter(ship: Ship, effect: str, symbol: str) -> Parameter:
    return next(p for p in EFFECTS[effect].parameters(ship.namespace, dict(ship.components)) if p.symbol == symbol)
