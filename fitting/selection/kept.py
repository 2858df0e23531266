"""Finished parts of a choice in a folder beside the run folder, from which an interrupted choice goes on.

The folder is OUT.unfinished: a JSON file for each part, and ``choice.json`` with what was wanted of the choice. It goes
when the choice is done.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from cases.io.files import read_json
from cases.shipfiles.ship_file import dump_ship
from cases.trial import Trial
from fitting.report.run_folder import write_json
from mmg.errors import Conflict, NotWritable, TargetExists, Unreadable
from mmg.ship import Ship

ASKED = "choice.json"
T = TypeVar("T")


@dataclass(frozen=True)
class Kept:
    """Parts by name, in ``folder``; None: none are kept."""

    folder: Path | None = None

    def get(self, name: str, kind: type[T]) -> T | None:
        """What was kept of the part ``name``, a dataclass of this ``kind``; None where it is not finished. Raises
        UserError for a broken file."""
        path = self.folder / f"{name}.json" if self.folder else None
        if path is None or not path.exists():
            return None
        try:
            return TypeAdapter(kind).validate_python(read_json(path))
        except ValidationError as error:
            raise Unreadable(f"{path}: cannot be read ({error}); start without --resume") from None

    def put(self, name: str, part: Any) -> None:
        """Keeps a ``part``, a dataclass of plain values, under its ``name``."""
        if self.folder:
            write_json(self.folder / f"{name}.json", part)

    def done_if_empty(self) -> bool:
        """Removes the folder where it keeps no part yet; whether it is gone."""
        if self.folder and [path.name for path in self.folder.iterdir()] == [ASKED]:
            self.done()
        return self.folder is None or not self.folder.exists()

    def done(self) -> None:
        """Removes the folder."""
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)


def kept_beside(out: Path, wanted: dict[str, Any], resume: bool) -> Kept:
    """The parts kept beside the run folder ``out``.

    wanted: of the choice, plain values by name; resume: go on with what is there. Raises UserError for parts
    of another choice, for parts that are there without ``resume``, and where nothing can be written.
    """
    folder = out.parent / f"{out.name}.unfinished"
    path = folder / ASKED
    if folder.exists() and not resume:
        raise TargetExists(f"{folder}: an interrupted choice is there; add --resume to go on with it, or delete it")
    if path.exists():
        before = read_json(path)
        if other := [name for name in wanted if before.get(name) != wanted[name]]:
            raise Conflict(f"{folder}: --resume needs the same {', '.join(other)} as the interrupted choice")
        return Kept(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, wanted)
    except OSError as error:
        raise NotWritable(f"{folder}: cannot be written ({error.strerror or error}); choose another --out") from None
    return Kept(folder)


def fingerprint(ship: Ship, sets: Sequence[Sequence[Trial]]) -> dict[str, str]:
    """Hashes of a ``ship`` and of ``sets`` of trials, by which one choice is told from another."""
    found = hashlib.sha256()
    for some in sets:
        for trial in some:
            found.update(trial.name.encode())
            for name in sorted(trial.columns):
                found.update(name.encode() + np.ascontiguousarray(trial[name]).tobytes())
        found.update(b"next set")
    return {"ship": hashlib.sha256(dump_ship(ship).encode()).hexdigest(), "trials": found.hexdigest()}
