"""The trials that a run used, read again from the files that its result.json names, if they are as they were."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cases.io.files import file_hash
from cases.io.read import read_trial
from cases.io.trial_table import LARGEST_CSV
from cases.trial import Trial

ROLES = {"data": "calibration", "validation_data": "held out", "test": "test"}
"""Key of result.json -> what its trials were used for."""


def trial_rows(result: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """(role, row) of every trial that a ``result``, the content of a result.json, names."""
    return [(role, row) for key, role in ROLES.items() for row in result.get(key) or [] if isinstance(row, Mapping)]


def unique_rows(rows: Iterable[tuple[str, Mapping[str, Any]]]) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """Those of ``rows`` by the hash of their file, each file once."""
    known: dict[str, tuple[str, Mapping[str, Any]]] = {}
    for role, row in rows:
        known.setdefault(str(row.get("sha256") or row.get("name")), (role, row))
    return known


def trials_again(rows: Iterable[tuple[str, Mapping[str, Any]]]) -> tuple[list[tuple[str, Trial]], list[str]]:
    """(role, trial) of those ``rows`` whose file is there with the same hash, and a sentence for each of the others.

    Raises UserError for a file that is as it was and still cannot be read.
    """
    found, absent = [], []
    for key, (role, row) in unique_rows(rows).items():
        path = Path(str(row["path"])) if row.get("path") else None
        if path is None or not path.is_file():
            absent.append(f"{row.get('name')} ({'no file is named' if path is None else f'{path} is not there'})")
        elif file_hash(path, LARGEST_CSV) != key:
            absent.append(f"{row.get('name')} ({path} has changed since)")
        else:
            found.append((role, read_trial(path)))
    return found, absent
