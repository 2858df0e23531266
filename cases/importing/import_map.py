"""The map of an import: which column of the logs is which quantity, as a person says it or as it was found."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cases.importing.vocabulary import known_units
from cases.io.toml_file import Name, Section, number, read_toml, validated
from cases.quantities import QUANTITIES, is_canonical

NAME = "import.toml"


def _quantity(name: str) -> str:
    if not is_canonical(name) and name not in QUANTITIES:
        raise ValueError(f"'{name}' is no quantity of a log (t, psi, u, n, delta, latitude, longitude, sog, cog, ...)")
    return name


Quantity = Annotated[str, AfterValidator(_quantity)]


class ColumnMap(Section):
    """Where a quantity comes from: the header (``from``), its unit and its sign."""

    header: str = Field(alias="from")
    unit: str = ""
    sign: Literal[1, -1] = 1


def _column(value: Any) -> Any:
    return {"from": value} if isinstance(value, str) else value


class FileMap(Section):
    """What holds for one file: columns over those for all; clock_offset [s] is added to its clock, and clock_drift
    [s per s] times the time since its first row; run: its run; ignore: headers of columns that are not used."""

    columns: dict[Quantity, Annotated[ColumnMap, BeforeValidator(_column)]] = Field(default_factory=dict)
    clock_offset: float = number("s", 0.0, ge=-1e6, le=1e6)
    clock_drift: float = number("s/s", 0.0, ge=-0.5, le=0.5)
    run: Name = ""
    skip: bool = False
    ignore: list[str] = Field(default_factory=list)


class ImportMap(Section):
    """A whole map; what is left out is found by the words of the headers.

    rudder_positive, wind_direction, velocity_frame: as in ``trials.toml``, and inputs, which are those that sensors
    measured at each sample where it is not said; orders are held. zone_hours: time zone of stamps without one,
    ahead of UTC, where it is said. sentinels: further numbers that stand for nothing. origin: latitude and longitude
    [deg] of the local frame. separate: every file is a run of its own. step: of the rows that are written [s]. ignore:
    headers of columns that are not used in any file. files: by name, or with as much of the path before it as tells
    them apart.
    """

    columns: dict[Quantity, Annotated[ColumnMap, BeforeValidator(_column)]] = Field(default_factory=dict)
    rudder_positive: Literal["starboard", "port"] = "starboard"
    wind_direction: Literal["from", "to"] = "from"
    velocity_frame: Literal["body", "earth"] = "body"
    inputs: Literal["held", "sampled"] = "sampled"
    zone_hours: float | None = number("h", None, ge=-14.0, le=14.0)
    sentinels: list[float] = Field(default_factory=list)
    origin: list[float] = Field(default_factory=list, max_length=2)
    separate: bool = False
    step: float | None = number("s", None, gt=1e-4, le=60.0)
    ignore: list[str] = Field(default_factory=list)
    files: dict[str, FileMap] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _units(self) -> ImportMap:
        for columns in (self.columns, *(file.columns for file in self.files.values())):
            for name, column in columns.items():
                units = known_units(name)
                if column.unit and units and column.unit not in units and name != "t":
                    raise ValueError(f"unit '{column.unit}' does not belong to {name}; known: {', '.join(units)}")
        if self.origin and len(self.origin) != 2:
            raise ValueError("origin must be [latitude, longitude] in degrees")
        return self

    def of(self, file: Path) -> FileMap:
        """What holds for ``file``, by the end of its path, its name or its stem."""
        path = f"/{file.as_posix().lstrip('/')}"
        keys = [key for key in self.files if path.endswith(f"/{key}")]
        return self.files[max(keys, key=len)] if keys else self.files.get(file.stem, FileMap())

    def clock_said(self, file: Path) -> bool:
        """Whether it says something of the clock of ``file``."""
        return bool({"clock_offset", "clock_drift"} & self.of(file).model_fields_set)

    def ignored_in(self, file: Path) -> set[str]:
        """Headers of ``file`` that are not used."""
        return {*self.ignore, *self.of(file).ignore}

    def columns_of(self, file: Path) -> dict[str, ColumnMap]:
        """The columns of ``file``: its own over those for all."""
        return {**self.columns, **self.of(file).columns}


def names_apart(paths: Iterable[Path]) -> dict[Path, str]:
    """For each of the ``paths`` its name, with as many folders before it as tell it from the others."""
    paths, out = list(paths), {}
    for path in paths:
        parts = path.parts
        for count in range(1, len(parts) + 1):
            end = parts[-count:]
            if sum(other.parts[-count:] == end for other in set(paths)) == 1:
                break
        out[path] = "/".join(end)
    return out


def read_map(path: Path) -> ImportMap:
    """The map at ``path``. Raises UserError, in one line, for all that is wrong with it."""
    return validated(ImportMap, read_toml(path), str(path))
