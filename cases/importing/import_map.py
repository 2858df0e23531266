"""The map of an import: which column of the logs is which quantity, as a person says it or as the import understood."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from cases.importing.raw_table import NUMBERED
from cases.importing.vocabulary import factor, known_units
from cases.io.sidecar import ReferencePoint
from cases.io.toml_file import Name, Section, as_toml, number, read_toml, validated
from cases.quantities import QUANTITIES, is_canonical
from mmg.errors import BadValue

NAME = "import.toml"
POINT = "FORWARD STARBOARD"  # An answer that stands for two numbers [m]


@dataclass(frozen=True)
class Question:
    """What the log ``file`` leaves open, in ``words``: answer -> what the map then says of the file, as in FileMap;
    without a ``file``, of all files, as in ImportMap."""

    file: Path
    words: str
    choices: Mapping[str, Mapping[str, Any]]

    def __str__(self) -> str:
        lines = (f"{answer}: {line_of(change)}" for answer, change in self.choices.items())
        return f"{self.file}: {self.words}; say in the map {', or '.join(lines)}"


class OpenQuestion(BadValue):
    """A log that may mean one of several things; the text has the line of the map for each."""

    def __init__(self, file: Path, words: str, choices: Mapping[str, Mapping[str, Any]]) -> None:
        self.question = Question(file, words, choices)
        super().__init__(self.question)


def line_of(change: Mapping[str, Any]) -> str:
    """The lines of a map, in one, that say a ``change`` of FileMap."""
    out = []
    for key, value in change.items():
        if key == "columns":
            out += [f"[columns] {name} = {as_toml(column)}" for name, column in value.items()]
        else:
            out.append(f"{key} = {as_toml(value)}")
    return " and ".join(out)


def _quantity(name: str) -> str:
    if not is_canonical(name) and name not in QUANTITIES:
        raise ValueError(f"'{name}' is no quantity of a log (t, psi, u, n, delta, latitude, longitude, sog, cog, ...)")
    return name


Quantity = Annotated[str, AfterValidator(_quantity)]
# The header of a column, or its number where it has none, from 1; a bool is an int of Python.
Header = Annotated[
    str, BeforeValidator(lambda v: f"{NUMBERED} {v}" if isinstance(v, int) and not isinstance(v, bool) else v)
]
# The tags keep messages on the one meaning that was tried: a plain union of pydantic names the faults of both.
Antenna = Annotated[
    Annotated[ReferencePoint, Tag("[point]")] | Annotated[Literal["unknown"], Tag("[word]")],
    Discriminator(lambda value: "[word]" if value == "unknown" else "[point]"),
]


class ColumnMap(Section):
    """Where a quantity comes from: the header (``from``), or the number of a column without one; unit and sign."""

    header: Header = Field(alias="from")
    unit: str = ""
    sign: Literal[1, -1] = 1


# Quantity -> its column, for which its header alone may stand.
OneColumn = Annotated[ColumnMap, BeforeValidator(lambda v: {"from": v} if isinstance(v, str | int) else v)]
Columns = dict[Quantity, OneColumn]


class FileMap(Section):
    """What holds for one file: columns over those for all; clock_offset [s] is added to its clock, and clock_drift
    [s per s] times the time since its first row; run: its run; ignore: headers of columns that are not used; rows:
    header -> cells of the rows that are used; decimal: what is written before parts of a whole."""

    columns: Columns = Field(default_factory=dict)
    clock_offset: float = number("s", 0.0, ge=-1e6, le=1e6)
    clock_drift: float = number("s/s", 0.0, ge=-0.5, le=0.5)
    run: Name = ""
    skip: bool = False
    ignore: list[str] = Field(default_factory=list)
    rows: dict[str, list[str]] = Field(default_factory=dict)
    decimal: Literal["", ".", ","] = ""


class ImportMap(Section):
    """A whole map; what is left out is found by the words of the headers.

    rudder_positive, wind_direction, velocity_frame: as in ``trials.toml``, and inputs, which are those that sensors
    measured at each sample where it is not said; orders are held. axes: of ROS messages whose frames do not say them.
    reference_point: where positions and velocities were measured, from midship, or "unknown"; length: of the ship [m],
    for the lever arm of an unknown one. zone_hours: time zone of stamps without one, ahead of UTC, where it is said.
    sentinels: further numbers that stand for nothing. origin: latitude and longitude [deg] of the local frame.
    separate: every file is a run of its own. variation: of the compass, positive to the east, by which magnetic
    headings are true. step: of the rows that are written [s]. ignore: headers of columns, and topics or sources, that
    are not used in any file. rows, decimal: as of FileMap. files: by name, or with as much of the path before it as
    tells them apart.
    """

    columns: Columns = Field(default_factory=dict)
    rudder_positive: Literal["starboard", "port"] = "starboard"
    wind_direction: Literal["from", "to"] = "from"
    velocity_frame: Literal["body", "earth"] = "body"
    inputs: Literal["held", "sampled"] = "sampled"
    axes: Literal["enu", "ned"] = "enu"
    reference_point: Antenna | None = None
    length: float | None = number("m", None, ge=0.5, le=600.0)
    zone_hours: float | None = number("h", None, ge=-14.0, le=14.0)
    variation: float | None = number("deg", None, ge=-180.0, le=180.0)
    sentinels: list[float] = Field(default_factory=list)
    origin: list[float] = Field(default_factory=list, max_length=2)
    separate: bool = False
    step: float | None = number("s", None, gt=1e-4, le=60.0)
    ignore: list[str] = Field(default_factory=list)
    rows: dict[str, list[str]] = Field(default_factory=dict)
    decimal: Literal["", ".", ","] = ""
    files: dict[str, FileMap] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _units(self) -> ImportMap:
        for columns in (self.columns, *(file.columns for file in self.files.values())):
            for name, column in columns.items():
                units = known_units(name)
                if column.unit and units and factor(name, column.unit) is None and name != "t":  # clocks count in more
                    raise ValueError(f"unit '{column.unit}' does not belong to {name}; known: {', '.join(units)}")
        if self.origin and len(self.origin) != 2:
            raise ValueError("origin must be [latitude, longitude] in degrees")
        return self

    def of(self, file: Path) -> FileMap:
        """What holds for ``file``, by the end of its path, its name or its stem."""
        path = f"/{file.as_posix().lstrip('/')}"
        keys = [key for key in self.files if path.endswith(f"/{key}")]
        return self.files[max(keys, key=len)] if keys else self.files.get(file.stem, FileMap())

    def ignored_in(self, file: Path) -> set[str]:
        """Headers of ``file`` that are not used."""
        return {*self.ignore, *self.of(file).ignore}

    def answered(self, name: str, change: Mapping[str, Any]) -> ImportMap:
        """The map in which ``change`` is said of the file called ``name``. Raises UserError for no value."""
        content = self.model_dump(exclude_unset=True, by_alias=True)
        entry = dict(content.setdefault("files", {}).get(name, {}))
        for key, value in change.items():  # one answer after another: tables and lists grow
            old = entry.get(key)
            entry[key] = (
                [*old, *value] if isinstance(old, list) else old | dict(value) if isinstance(old, dict) else value
            )
        content["files"][name] = entry
        return validated(ImportMap, content, "answers")

    def rows_of(self, file: Path) -> dict[str, list[str]]:
        """Header -> cells of the rows of ``file`` that are used."""
        return {**self.rows, **self.of(file).rows}

    def columns_of(self, file: Path) -> dict[str, ColumnMap]:
        """The columns of ``file``: its own over those for all."""
        return {**self.columns, **self.of(file).columns}


def names_apart(paths: Iterable[Path]) -> dict[Path, str]:
    """For each of the ``paths`` its name, with as many folders before it as tell it from the others."""
    every, out = dict.fromkeys(paths), {}
    for path in every:
        ends = (path.parts[-count:] for count in range(1, len(path.parts) + 1))
        apart = (end for end in ends if sum(other.parts[-len(end) :] == end for other in every) == 1)
        out[path] = "/".join(next(apart, path.parts))
    return out


def read_map(path: Path) -> ImportMap:
    """The map at ``path``. Raises UserError, in one line, for all that is wrong with it."""
    return validated(ImportMap, read_toml(path), str(path))
