"""Finished parts of a long run, kept as they finish: what ``--resume`` continues from.

A folder with ``settings.json`` (what the run was asked to do) and, per part, NAME.safetensors (numbers, exactly) and
NAME.json (words; written last, so that a part with it is complete).
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from cases.io.files import read_json
from cases.shipfiles.ship_file import dump_ship
from cases.trial import Trial
from fitting.report.run_folder import plain, write_json
from mmg.errors import Conflict, Missing, NotWritable, UserError, writing
from mmg.ship import Ship

SETTINGS = "settings.json"


@dataclass(frozen=True)
class Store:
    """Finished parts in ``folder``, of the run that ``about`` describes by plain values. resume: the folder is there,
    of an interrupted run; else it is made."""

    folder: Path
    about: Mapping[str, Any]
    resume: bool = False

    def open(self) -> None:
        """Create the folder, or compare it with ``about``. UserError where it is of another run or unwritable."""
        path = self.folder / SETTINGS
        if self.resume and path.exists():
            self._compare(path)
            return
        with writing(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            others = [p for p in self.folder.iterdir() if not p.name.startswith(".")]
            if self.resume:  # of a run that was killed before it began, there is nothing but this folder
                others += [p for p in self.folder.parent.iterdir() if p != self.folder]
            if others:
                raise Missing(f"{self.folder.parent}: holds no interrupted run to resume; choose another --out")
            write_json(path, self.about)

    def part(self, name: str) -> Store:
        """The store ``name`` of a stage of the same run, in a folder of this one."""
        folder = self.folder / name
        return Store(folder, self.about, self.resume and (folder / SETTINGS).is_file())

    def _compare(self, path: Path) -> None:
        """UserError where the settings in ``path`` are not those of ``about``, with the first that differs."""
        where = self.folder.parent
        try:
            earlier = read_json(path)
        except UserError:
            raise Missing(f"{where}: holds no interrupted run to resume; choose another --out") from None
        for name, value in plain(dict(self.about)).items():
            before = earlier.get(name)
            if before == value:
                continue
            words = ""
            if isinstance(value, dict) and isinstance(before, dict):
                first = next(key for key in {**before, **value} if before.get(key) != value.get(key))
                words = f" ({first}: {_short(value.get(first))}, then {_short(before.get(first))})"
            raise Conflict(f"{where}: --resume needs the same {name} as the interrupted run{words}")

    @property
    def has_parts(self) -> bool:
        """Whether it, or a store of one of its stages, holds a finished part."""
        return any(path.name != SETTINGS for path in self.folder.glob("**/*.json"))

    def discard(self) -> None:
        """Remove what a run that ended with an error has begun, unless it was there before or holds finished parts."""
        parts = (self.load(path.stem) for path in self.folder.glob("*.json"))
        kept = any(part is not None and part[0].get("status") != "diverged" for part in parts)
        if self.resume or kept or not self.folder.is_dir():
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        if not any(self.folder.parent.iterdir()):
            self.folder.parent.rmdir()

    def save(self, name: str, words: Mapping[str, Any], arrays: Mapping[str, np.ndarray] = {}) -> None:
        """Keep a finished part. Raises UserError where it cannot be written."""
        scratch = self.folder / f".{name}.part"
        try:  # the words last: a part with them is complete
            save_file({k: np.ascontiguousarray(a, dtype=float) for k, a in arrays.items()}, scratch)
            scratch.chmod(0o644)
            os.replace(scratch, self.folder / f"{name}.safetensors")
            write_json(self.folder / f"{name}.json", words)
        except (OSError, SafetensorError) as error:
            raise NotWritable(f"{self.folder}: cannot be written ({error})") from None

    def load(self, name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """A finished part; None where there is none or it cannot be read, so that it is made again."""
        try:
            words = read_json(self.folder / f"{name}.json")
            return words, dict(load_file(self.folder / f"{name}.safetensors"))
        except (OSError, UserError, ValueError, SafetensorError):
            return None


def _short(value: Any) -> str:
    """A setting in at most 40 letters."""
    text = "none" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def hash_of_ship(ship: Ship) -> str:
    """Text that differs where ``ship`` differs in anything a ship file holds."""
    return hashlib.sha256(dump_ship(ship.without_network()).encode()).hexdigest()


def hashes_of_trials(trials: Sequence[Trial]) -> list[str]:
    """Per trial of ``trials`` a text that differs where a name or a number does, by the file or by its sidecar."""
    result = []
    for trial in trials:
        content = hashlib.sha256(trial.name.encode())
        for name, column in sorted(trial.columns.items()):
            content.update(name.encode())
            content.update(np.ascontiguousarray(column, dtype=float).tobytes())
        result.append(content.hexdigest())
    return result
