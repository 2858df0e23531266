"""The sidecar ``trials.toml``: what the trial files beside it leave unsaid.

::

    [default]                         # for every file of the folder ([all] means the same)
    rudder_positive = "port"          # "starboard" (default) or "port"
    wind_direction = "to"             # "from" (default) or "to"; true and apparent wind
    velocity_frame = "earth"          # "body" (default) or "earth": u north, v east
    reference_point = { x = 1.2, y = 0.0, applies_to = "both" }
                                      # measured point from midship [m], x forward, y starboard;
                                      # applies_to "position", "velocity" or "both"
    columns = { u = "SOG long", n = "RPM" }         # canonical name = header in the file
    units = { u = "kn", n = "rpm", t = "s" }        # canonical name = unit, wins over the header
    sign = { psi = -1, r = -1 }                     # canonical name = 1 or -1
    heading_from = "east"                           # "north" (default) or "east": psi is counted from there
    lag = { u = 1.2, v = 1.2 }                      # canonical name = s by which the column is late
    inputs = "sampled"                              # "held" (default) or "sampled": actuators as they are at a sample
    sentinels = [-999.0]                            # numbers that stand for no value; [] keeps every number
    kind = "zigzag"
    role = "train"                                  # "train", "validate" or "test"
    day = "2026-11-22"                              # of the trial; default: the date in the file name
    group = "before docking"                        # any word, to compare groups of trials by
    campaign = "spring"                             # runs with the same instruments and loading; default: the day
    std = { u = 0.02, v = 0.02 }                    # standard errors of what was derived [m, rad, m/s, rad/s]
    derived = { r = ["psi"] }                       # columns that were not measured, and from which they were derived
    exclude = [[125.0, 140.0], [28.0, 30.0]]        # s on the clock of the file; [] keeps every row

    [files."run_07.csv"]              # the same keys for one file, added to or replacing the default
    name = "zigzag 20-20, second"             # plain words: it names files too

An unknown key is an error. Tables (columns, units, sign) of a file are merged into those of the default.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from cases.io.toml_file import Name, Section, number, read_toml, validated
from cases.quantities import is_canonical, to_si
from mmg.errors import UserError
from mmg.messages import Message, listed
from mmg.motion.flow import STATES

NAME = "trials.toml"
TABLES = ("columns", "units", "sign", "lag", "std", "derived")  # Of a file they are merged into those of the default


def _canonical(column: str) -> str:
    if not is_canonical(column):
        raise ValueError(f"'{column}' is not a canonical column (t, x, y, psi, u, v, r, n, delta, ...)")
    return column


def _state(column: str) -> str:
    if column not in STATES:
        raise ValueError(f"'{column}' is no state ({', '.join(STATES)})")
    return column


def _late(column: str) -> str:
    if _canonical(column) == "t":
        raise ValueError("lag.t: the clock cannot be late against itself; name the columns that are late")
    return column


def _iso(day: Any) -> str:
    try:
        return date.fromisoformat(str(day)).isoformat() if day else ""
    except ValueError:
        raise ValueError(f"{day!r} is not a day; write it as 2026-11-22") from None


def _campaign(name: str) -> str:
    return _iso(name) if re.fullmatch(r"\d{4}-\d{1,2}-\d{1,2}", name) else name


def _span(span: list[float]) -> list[float]:
    if len(span) != 2 or not span[0] < span[1]:
        raise ValueError(f"exclude holds pairs of begin and end in s, such as [125.0, 140.0]; {span} is none")
    return span


Column = Annotated[str, AfterValidator(_canonical)]
State = Annotated[str, AfterValidator(_state)]
Late = Annotated[str, AfterValidator(_late)]
Day = Annotated[str, BeforeValidator(_iso)]
Campaign = Annotated[Name, AfterValidator(_campaign)]
Span = Annotated[list[float], AfterValidator(_span)]


class ReferencePoint(Section):
    """The measured point from midship [m], x forward, y to starboard, and what was measured there."""

    x: float = number("m", 0.0, ge=-600.0, le=600.0)  # no ship is longer
    y: float = number("m", 0.0, ge=-600.0, le=600.0)
    applies_to: Literal["position", "velocity", "both"] = "both"

    @model_validator(mode="before")
    @classmethod
    def _pair(cls, value: Any) -> Any:
        if isinstance(value, list | tuple) and len(value) == 2:
            return dict(zip(("x", "y"), value, strict=True))
        if not isinstance(value, Mapping | ReferencePoint):
            raise ValueError("reference_point must be { x = 1.2, y = 0.0 } or [1.2, 0.0], in m from midship")
        return value


class SidecarEntry(Section):
    """What is known of one trial file beside its header; the defaults are the conventions of this product.

    Its keys are those of the module's text; sentinels: None for numbers that are well known; exclude: None leaves it to
    the checks.
    """

    columns: dict[Column, str] = Field(default_factory=dict)
    units: dict[Column, str] = Field(default_factory=dict)
    sign: dict[Column, Literal[1, -1]] = Field(default_factory=dict)
    rudder_positive: Literal["starboard", "port"] = "starboard"
    wind_direction: Literal["from", "to"] = "from"
    velocity_frame: Literal["body", "earth"] = "body"
    heading_from: Literal["north", "east"] = "north"
    lag: dict[Late, Annotated[float, Field(ge=-600.0, le=600.0)]] = Field(default_factory=dict)
    inputs: Literal["held", "sampled"] = "held"
    sentinels: list[float] | None = None
    reference_point: ReferencePoint = ReferencePoint()
    std: dict[State, Annotated[float, Field(ge=0.0, le=1e3)]] = Field(default_factory=dict)
    derived: dict[Column, list[str]] = Field(default_factory=dict)
    kind: str = ""
    role: Literal["", "train", "validate", "test"] = ""
    name: Name = ""
    day: Day = ""
    group: Name = ""
    campaign: Campaign = ""
    exclude: list[Span] | None = None

    @model_validator(mode="after")
    def _no_circle(self) -> SidecarEntry:
        for column in self.derived:
            ancestors, last = {column}, set[str]()
            while ancestors != last:
                last, ancestors = ancestors, ancestors | {a for b in ancestors for a in self.derived.get(b, ())}
            if any(column in self.derived.get(name, ()) for name in ancestors):
                raise ValueError(f"derived.{column}: {column} is derived from itself; name the measured columns")
        return self

    @field_validator("units")
    @classmethod
    def _units(cls, units: dict[str, str]) -> dict[str, str]:
        for column, unit in units.items():
            try:
                to_si(column, unit, column)
            except UserError as error:
                raise ValueError(str(error)) from None
        return units


class Sidecar(Section):
    """A whole sidecar: [default] (or [all]) for every file, [files."NAME.csv"] for one."""

    default: SidecarEntry | None = None
    all: SidecarEntry | None = None
    files: dict[str, SidecarEntry] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_default(self) -> Sidecar:
        if self.default is not None and self.all is not None:
            raise ValueError("both [default] and [all]: they mean the same, keep one")
        return self

    def entry(self, file: Path) -> SidecarEntry:
        """What it says of ``file``, by its name or its stem: that of the default, with that of the file over it."""
        of_file = self.files.get(file.name, self.files.get(file.stem, SidecarEntry()))
        values = (self.default or self.all or SidecarEntry()).model_dump(exclude_unset=True)
        for key, value in of_file.model_dump(exclude_unset=True).items():
            values[key] = {**values.get(key, {}), **value} if key in TABLES else value
        return SidecarEntry(**values)


def line_for(path: Path | None, name: str, line: str) -> str:
    """A ``line`` to add, with the sidecar and the table where it belongs: those of the trial file ``path``, or of one
    called ``name`` without a file."""
    file = path.name if path else f"{name}.csv"
    return f'{path.parent / NAME if path else NAME}, [files."{file}"]: {line}'


def read_sidecar(path: Path) -> Sidecar:
    """The sidecar at ``path``. Raises UserError, in one line, for all that is wrong with it."""
    return validated(Sidecar, read_toml(path), str(path))


def sidecar_entry(trial: Path, notices: list[Message] | None = None) -> SidecarEntry:
    """What ``trials.toml`` beside a ``trial`` file says of it; without one, the defaults. Entries of files that are not
    there are added to the ``notices``: a part of a folder is none of its mistakes. Raises UserError as ``read_sidecar``
    does."""
    path = trial.parent / NAME
    if not path.exists():
        return SidecarEntry()
    sidecar, present = read_sidecar(path), {name for file in trial.parent.iterdir() for name in (file.name, file.stem)}
    absent = [name for name in sidecar.files if name not in present]
    if absent and notices is not None:
        text = f"{path} says something of files that are not there: {listed(absent)}"
        notices.append(Message(text, "sidecar_file_absent"))
    return sidecar.entry(trial)
