"""Writing and reading run folders (``fitting.result`` says what is in them): plain values, JSON, whole folders.

A folder appears whole or not at all: it is written beside its place under another name and renamed. Finished parts of
a long run are kept as they finish, for ``--resume`` to continue from: in a folder with ``settings.json`` (what the run
was asked to do) and, per part, NAME.safetensors (numbers, exactly) and NAME.json (words; written last, so that a part
with it is complete).
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import math
import os
import platform
import re
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, TypeAdapter
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from cases.io.files import alone, file_hash, read_json, replace_text
from cases.io.read import read_trial
from cases.io.trial_table import LARGEST_CSV
from cases.shipfiles.ship_file import dump_ship
from cases.trial import Trial
from fitting.solvers.control import LEFT_OUT
from mmg.effects import with_present_names
from mmg.errors import BadValue, Conflict, Missing, NotWritable, TargetExists, Unreadable, UserError, writing
from mmg.messages import Message
from mmg.ship import Ship

RESULT, SHIP, START, ITERATE = "result.json", "ship.toml", "start.toml", "iterate.safetensors"
LOSS = "loss.safetensors"
FIGURES, PAGE = "figures", "report.html"
SCHEMA_VERSION = 1  # Of every result file; it grows when an older reader would misread them (docs/releasing.md)
MODEL = "model"  # Folder in the run of a scaled ship that holds the run of its model
# Keys of a calibration's result.json that tell of predictions by her ship: what is made of her has them too.
OF_PREDICTIONS = (
    "coefficients", "correlation", "uncertainty", "per_run", "campaigns", "bands", "adaptation", "random_force",
)  # fmt: skip
NOT_INSTALLED = "not installed"  # Version of a package that is not there
# Warning of a run folder that is whole but for these; it is gone when they are made.
PENDING = Message("figures and report.html are missing; the same command with --resume makes them", LEFT_OUT)
# A number as it is read; JSON holds null where it is not finite (``plain``).
Real = Annotated[float, BeforeValidator(lambda value: math.nan if value is None else value)]


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """What reads plain values as a ``kind``; to make one takes long."""
    return TypeAdapter(kind)


def versions() -> dict[str, str]:
    """Versions of the program, of Python and of the libraries that decide the numbers."""
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in ("mmg-ident", "casadi", "numpy", "scipy", "pandas"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = NOT_INSTALLED
    return versions


def check_target(folder: Path) -> None:
    """UserError unless ``folder`` is free and can be created."""
    if folder.exists():
        raise TargetExists(f"{folder}: already exists; choose another --out, continue an interrupted run with --resume")
    check_place(folder)


def check_place(target: Path) -> None:
    """UserError unless ``target`` can come to be where it is to be."""
    parent = target.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise NotWritable(f"{target}: cannot be written ({parent} is not a writable folder); choose another --out")


def write_whole(folder: Path, fill: Callable[[Path], None], replace: bool = False) -> None:
    """Create ``folder``: ``fill`` writes into a temporary one beside it, which is renamed; on failure nothing is left.

    ``replace`` allows an existing folder, which is swapped out only once the new one is complete. Raises UserError
    where nothing can be written.
    """
    folder = folder.absolute()
    scratch = folder.parent / f".{folder.name}.{secrets.token_hex(4)}"
    old = scratch.with_name(f"{scratch.name}.old")
    with _held(folder, "writing"), writing(folder):
        _remove_leftovers(folder)
        try:
            scratch.mkdir()
            fill(scratch)
            scratch.chmod(0o755)
            if replace and folder.exists():  # a folder that is not empty cannot be renamed over
                old.mkdir()
                os.replace(folder, old / "run")  # killed here: _remove_leftovers puts it back
                os.replace(scratch, folder)
                shutil.rmtree(old, ignore_errors=True)
            else:
                os.replace(scratch, folder)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def reserved(folder: Path) -> Iterator[None]:
    """While it lasts, no other process that asks for it works on the run ``folder``. Raises UserError where one does,
    or nothing can be written there."""
    folder = folder.absolute()
    new = [parent for parent in folder.parents if not parent.exists()]  # the innermost first
    try:
        with _held(folder, "lock"):
            yield
    finally:
        with contextlib.suppress(OSError):  # parents in which nothing came to be
            for parent in new:
                parent.rmdir()


@contextmanager
def _held(folder: Path, purpose: str) -> Iterator[None]:
    """While it lasts, and the process lives, no other one has the run ``folder`` for this ``purpose``."""
    with contextlib.ExitStack() as stack:
        with writing(folder):
            folder.parent.mkdir(parents=True, exist_ok=True)
            mine = stack.enter_context(alone(folder.parent / f".{folder.name}.{purpose}"))
        if not mine:
            raise Conflict(f"{folder}: another process is working on it; wait, or choose another --out")
        yield


def _remove_leftovers(folder: Path) -> None:
    """Remove what processes that were killed while they wrote a run folder have left beside it. It must be held."""
    for path in folder.parent.glob(f".{glob.escape(folder.name)}.*"):
        if not re.fullmatch(r"[0-9a-f]{8}(\.old)?", path.name[len(folder.name) + 2 :]):  # a name of write_whole
            continue
        with contextlib.suppress(OSError):
            if (path / "run").is_dir() and not folder.exists():  # killed between two renames
                os.replace(path / "run", folder)
        shutil.rmtree(path, ignore_errors=True)


def write_json(path: Path, data: Any) -> None:
    """Write ``data`` as JSON to ``path``, atomically, numbers that are not finite as null."""
    replace_text(path, json.dumps(plain(data), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """``value`` as JSON knows it: objects as dicts, arrays as lists, numbers that are not finite as null."""
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if is_dataclass(value):
        return plain(vars(value))
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (bool, np.bool_)):  # before the numbers: a bool is an int
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return str(value) if isinstance(value, str) else value  # a Message is a str with fields of its own


def data_rows(trials: Sequence[Trial]) -> list[dict]:
    """Returns name, file, hash, length and rate of each of ``trials``."""
    return [
        {
            "name": t.name,
            "path": str(t.path) if t.path else None,
            "sha256": t.sha256,
            "samples": len(t),
            "duration_s": t.duration,
            "dt_s": t.dt,
            "kind": t.kind,
            "has_position": t.has_position,
            "has_wind": t.has_wind,
            "notices": list(t.notices),
        }
        for t in trials
    ]


def read_result(folder: Path) -> dict[str, Any]:
    """The content of result.json in a run ``folder``: an object of some kind. Raises UserError when there is none."""
    path = folder / RESULT
    if not path.exists():
        raise Missing(f"{folder}: is no run folder (no {RESULT} in it)")
    content = with_present_names(read_json(path))
    if not isinstance(content.get("kind"), str):
        raise BadValue(f"{path}: has no kind, so it is not from this program, or incomplete; make the run again")
    if (version := content.get("schema_version", SCHEMA_VERSION)) != SCHEMA_VERSION:
        words = f"schema_version = {version!r}, this version of mmg-ident reads {SCHEMA_VERSION}"
        raise BadValue(f"{path}: {words}; update mmg-ident, or make the run again")
    return content


def of_predictions(content: Mapping[str, Any]) -> dict[str, Any]:
    """What the ``content`` of a result.json tells of predictions by the ship, by key."""
    return {key: content[key] for key in OF_PREDICTIONS if key in content}


def described_in(folder: Path) -> Path:
    """The folder whose result.json tells of the ship in ``folder``: itself, or the training that keeps her there as
    the one that it does not recommend. Raises UserError where that result.json cannot be read."""
    run = folder.absolute().parent
    inside = not (folder / RESULT).exists() and (folder / SHIP).exists() and (run / RESULT).exists()
    return run if inside and read_result(run).get("other") == folder.absolute().name else folder


def content_on(folder: Path) -> dict[str, Any]:
    """The content of the result.json that tells of the ship in ``folder``; empty where there is none. Raises UserError
    where it cannot be read."""
    where = described_in(folder)
    return read_result(where) if (where / RESULT).is_file() else {}


def trial_rows(folder: Path) -> list[dict[str, Any]]:
    """The rows of ``data_rows`` in the result.json of a run ``folder``, [] where it has none. Raises UserError where
    they are no such rows."""
    rows = read_result(folder).get("data", [])
    for row in rows if isinstance(rows, list) else [None]:
        if not isinstance(row, dict) or not all(isinstance(row.get(k), (str, type(None))) for k in ("sha256", "path")):
            raise BadValue(f"{folder / RESULT}: data holds no rows on trials with sha256 and path; make the run again")
    return rows


def read_iterate(folder: Path) -> dict[str, np.ndarray]:
    """What a fit in ``folder`` can be resumed from: p (P,), nodes (B, S), sigma (6,) and more
    (``fitting.calibration.Calibration.iterate``).

    Raises UserError when it cannot be read or holds numbers that are not finite.
    """
    path = folder / ITERATE
    try:
        arrays = dict(load_file(path))
    except Exception as error:  # of a damaged file anything may be raised
        raise Unreadable(f"{path}: cannot be read ({error}); start again without --resume") from None
    if not all(a.dtype == float and np.isfinite(a).all() for a in arrays.values()):
        raise BadValue(f"{path}: holds numbers that are not finite; start again without --resume")
    return arrays


# Key of result.json -> what its trials were used for.
ROLES = {"data": "calibration", "validation_data": "held out", "test": "test"}


def rows_by_role(result: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """(role, row) of every trial that a ``result``, the content of a result.json, names."""
    return [(role, row) for key, role in ROLES.items() for row in result.get(key) or [] if isinstance(row, Mapping)]


def unique_rows(rows: Iterable[tuple[str, Mapping[str, Any]]]) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Those of ``rows`` by the hash of their file, each file once."""
    unique: dict[str, tuple[str, Mapping[str, Any]]] = {}
    for role, row in rows:
        unique.setdefault(str(row.get("sha256") or row.get("name")), (role, row))
    return unique


def trials_again(rows: Iterable[tuple[str, Mapping[str, Any]]]) -> tuple[list[tuple[str, Trial]], list[str]]:
    """(role, trial) of those ``rows`` whose file is there with the same hash, and a sentence for each of the others.
    Raises UserError for a file that is as it was and still cannot be read."""
    trials, absent = [], []
    for key, (role, row) in unique_rows(rows).items():
        path = Path(str(row["path"])) if row.get("path") else None
        if path is None or not path.is_file():
            absent.append(f"{row.get('name')} ({'no file is named' if path is None else f'{path} is not there'})")
        elif file_hash(path, LARGEST_CSV) != key:
            absent.append(f"{row.get('name')} ({path} has changed since)")
        else:
            trials.append((role, read_trial(path)))
    return trials, absent


SETTINGS = "settings.json"  # Of a folder of parts


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
                both = ("none" if some.get(first) is None else str(some[first]) for some in (value, before))
                now, then = (text if len(text) <= 40 else f"{text[:37]}..." for text in both)
                words = f" ({first}: {now}, then {then})"
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
