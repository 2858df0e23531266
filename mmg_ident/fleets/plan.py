"""The plan of a fleet: a TOML file that lists ships, their trials and campaigns, and which ships are sisters.

Everything that is wrong with it is said at once: keys, ships and files that do not exist, files that are listed twice.
Paths are relative to the folder of the plan; ``*``, ``?`` and ``**`` stand for many files, a folder for those in it.
"""

from __future__ import annotations

import glob
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import Field

from cases.io.files import file_hash, file_key
from cases.io.read import SUFFIXES, trial_files
from cases.io.toml_file import Section, checked, header, number, read_toml, refuse
from cases.shipfiles.effects import reduced_ship
from cases.shipfiles.new_ship import new_ship
from cases.shipfiles.ship_file import load_ship
from mmg.errors import BadValue, Conflict, Missing, UserError, name_fault
from mmg.ship import Ship


class FleetTable(Section):
    """[fleet]: what is done to all ships."""

    name: str = "fleet"
    seed: int = 0
    loss: Literal["gaussian", "huber", "student"] = "gaussian"
    diagnose: bool = True
    effects: list[str] = Field(default=[])
    without: list[str] = Field(default=[])
    time_limit: float | None = number("s", None, gt=0.0)
    unchecked: bool = False


class ShipTable(Section):
    """Give each ship a table [ships.NAME], with ship and trials."""

    ship: str | None = None
    particulars: dict[str, float] | None = None
    trials: list[str] = Field(default=[])
    campaigns: dict[str, list[str]] = Field(default={})
    held_out: list[str] = Field(default=[])
    effects: list[str] | None = None
    without: list[str] | None = None


class PlanFile(Section):
    """A plan: [fleet], [ships.NAME] and [sisters]."""

    fleet: FleetTable = FleetTable()
    ships: dict[str, ShipTable] = Field(description="add a table [ships.NAME] with ship and trials for each ship")
    sisters: dict[str, list[str]] = Field(default={})


@dataclass(frozen=True)
class PlannedShip:
    """One ship of a plan. start: from which she is calibrated; trials: file -> campaign, "" where the plan says none;
    held_out: files; hashes: SHA-256 of each file; sisters: name of the group, "" for none."""

    name: str
    start: Ship
    trials: Mapping[Path, str]
    held_out: tuple[Path, ...]
    hashes: Mapping[Path, str]
    sisters: str = ""


@dataclass(frozen=True)
class FleetPlan:
    """A plan that was checked. options: of all ships; ships: in the order of the plan; sisters: name of a group ->
    names of its ships."""

    options: FleetTable
    ships: tuple[PlannedShip, ...]
    sisters: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def read_plan(path: str | Path) -> FleetPlan:
    """The plan in the TOML file ``path``.

    Raises UserError, in one line, for all that is wrong with it: the file itself, keys, ships that do not exist, files
    that are missing or listed twice, sisters that are no ships of the plan or have other models.
    """
    path = Path(path)
    content, problems = checked(PlanFile, read_toml(path))
    if content is None or not content.ships:
        refuse(str(path), problems or ["no ships: add a table [ships.NAME] with ship and trials for each ship"])
        raise Missing(f"{path}: no ships")
    problems += _name_problems(content.ships)
    group = {name: key for key, names in content.sisters.items() for name in names}
    ships = []
    for name, table in content.ships.items():
        wrong: list[str] = []
        ships += _planned(name, table, content.fleet, path.absolute().parent, group.get(name, ""), wrong)
        problems += [f"{header('ships', name)} {sentence}" for sentence in wrong]
    problems += _shared_files(ships)
    problems += _sister_problems(content, {s.name: s for s in ships})
    if problems:
        count = f"{len(problems)} problems: " if len(problems) > 1 else ""
        raise BadValue(f"{path}: {count}{'; '.join(dict.fromkeys(problems))}")
    return FleetPlan(content.fleet, tuple(ships), {k: tuple(v) for k, v in content.sisters.items()})


@contextmanager
def _noted(problems: list[str]) -> Iterator[None]:
    """While it lasts, an error that a user meets is added to the ``problems``."""
    try:
        yield
    except UserError as error:
        problems.append(str(error))


def _name_problems(names: Iterable[str]) -> list[str]:
    """What is wrong with the ``names`` of ships, which become those of folders."""
    problems = []
    first: dict[str, str] = {}  # by the key of a file: file systems take names as equal that differ in case or accents
    for name in names:
        fault = name_fault(name) or ("must not begin with a dot" if name.startswith(".") else "")
        problems += [f"{header('ships', name)}: the name {fault}"] if fault or not name.strip() else []
        other = first.setdefault(file_key(name), name)
        if other != name:
            problems.append(f"{header('ships', name)} and {header('ships', other)} would be one folder: rename one")
    return problems


def _planned(
    name: str, table: ShipTable, fleet: FleetTable, root: Path, sisters: str, problems: list[str]
) -> list[PlannedShip]:
    """The ship of a ``table`` of the plan, none where she is not known; problems: to which what is wrong is added."""
    start = None
    with _noted(problems):
        start = _start(name, table, fleet, root)
    trials: dict[Path, str] = {}
    # a file of a campaign may also be among the trials without one, so that trials = ["all/*.csv"] can stand there
    for campaign, texts in [("", table.trials), *table.campaigns.items()]:
        for file in _files_of(texts, root, problems):
            other = trials.get(file, "")
            if other and other != campaign:
                problems.append(f"{file.name} is of two campaigns, {other} and {campaign}")
            trials[file] = campaign or other
    if not table.trials and not table.campaigns:
        problems.append('no trials: add trials = ["FOLDER or *.csv"], or campaigns')
    held_out = _files_of(table.held_out, root, problems)
    if both := [file.name for file in held_out if file in trials]:
        problems.append(f"held_out: {', '.join(both)} are trials as well; leave them out of one of the two")
    hashes = {}
    for file in dict.fromkeys([*trials, *held_out]):
        with _noted(problems):
            hashes[file] = file_hash(file)
    return [PlannedShip(name, start, trials, tuple(held_out), hashes, sisters)] if start else []


def _start(name: str, table: ShipTable, fleet: FleetTable, root: Path) -> Ship:
    """The ship from which the one of a ``table`` is calibrated. Raises UserError where there is none."""
    if (table.ship is None) == (table.particulars is None):
        words = "give ship (library name, ship file or run folder) or particulars (L, B, d, C_b, ...)"
        raise Conflict(f"{words}, not both" if table.ship else words)
    if table.particulars is not None:
        try:
            ship = new_ship(name, table.particulars)
        except UserError as error:  # in the words of a plan, not of the option of mmg ships
            raise type(error)(str(error).replace("--new: ", "particulars: ")) from None
    else:
        path = root / str(table.ship)
        ship = load_ship(path if path.exists() else str(table.ship))  # else one of the library
    without = fleet.without if table.without is None else table.without
    effects = fleet.effects if table.effects is None else table.effects
    return reduced_ship(ship.without_network(), without, effects)


def _shared_files(ships: Iterable[PlannedShip]) -> list[str]:
    """Files that two ships of the plan have, by path or by content, and copies among those of one ship."""
    first: dict[str, tuple[str, Path]] = {}  # SHA-256 -> the ship and file that have it first
    problems = []
    for ship in ships:
        for file, digest in ship.hashes.items():
            owner, other = first.setdefault(digest, (ship.name, file))
            if (owner, other) != (ship.name, file):
                names = f"{file.name} of {ship.name} and {other.name} of {owner}"
                problems.append(f"{names} are the same file; leave it out of one of them")
    return problems


def _sister_problems(content: PlanFile, ships: Mapping[str, PlannedShip]) -> list[str]:
    """What is wrong with the groups of sisters."""
    problems = []
    group_of: dict[str, str] = {}
    for group, names in content.sisters.items():
        place = f"[sisters] {group}"
        unknown = [name for name in names if name not in content.ships]
        problems += [f"{place}: {', '.join(unknown)}: no such ship in the plan"] if unknown else []
        twice = sorted({name for name in names if names.count(name) > 1})
        twice += [name for name in dict.fromkeys(names) if group_of.setdefault(name, group) != group]
        problems += [f"{place}: {', '.join(twice)}: listed twice among the sisters"] if twice else []
        if len(set(names)) < 2:
            problems.append(f"{place}: sisters are two ships at least")
        sisters = [ships[name] for name in names if name in ships]
        # the prior that sisters share is one of the same coefficients
        for one in sisters[1:]:
            if one.start.components != sisters[0].start.components or one.start.free != sisters[0].start.free:
                problems.append(f"{place}: {one.name} has another model than {sisters[0].name}; sisters share that")
    return problems


def _files_of(texts: Iterable[str], root: Path, problems: list[str]) -> list[Path]:
    """Files that paths, folders and patterns stand for, each once; problems: to which what is wrong is added."""
    files: list[Path] = []
    for text in dict.fromkeys(texts):
        with _noted(problems):
            files += _matching(text, root)
    return list(dict.fromkeys(files))


def _matching(text: str, root: Path) -> list[Path]:
    """Files that a ``text`` of the plan stands for. Raises UserError where there are none."""
    if not text.strip():
        raise Missing("an empty path")
    path = root / Path(text).expanduser()
    if path.exists() or not glob.has_magic(text):  # a file whose name has [ ] in it is that file, not a pattern
        if not path.exists():
            raise Missing(f"{text}: no such file or folder")
        if path.is_file() and path.suffix.lower() not in SUFFIXES:
            raise BadValue(f"{text}: not a trial file; expected .csv or .parquet")
        return trial_files([path])
    matches = [Path(match) for match in sorted(glob.glob(str(path), recursive=True))]  # noqa: PTH207
    matches = [match for match in matches if match.is_dir() or match.suffix.lower() in SUFFIXES]
    if not matches:
        raise Missing(f"{text}: no trial file matches")
    return trial_files(matches)
