"""Trial files that a plan lists by path, folder or pattern."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cases.io.read import SUFFIXES, trial_files
from mmg.errors import UserError


@dataclass(frozen=True)
class Listed:
    """Paths, folders and patterns as a plan lists them, and the campaign that they are of ("" where none is said)."""

    paths: Sequence[str]
    campaign: str


def listed_files(lists: Sequence[Listed], root: Path) -> tuple[dict[Path, str], list[str]]:
    """File -> campaign, in the order of the ``lists``, and a sentence on each path that is missing or listed twice.

    root: folder to which paths are relative. Files in ``trials`` that a campaign lists too are of that campaign.
    """
    found: dict[Path, str] = {}
    problems = []
    for each in lists:
        for text in dict.fromkeys(each.paths):
            files, wrong = _matching(text, root)
            problems += wrong
            for file in files:
                other = found.get(file, "")
                if other and other != each.campaign:
                    problems.append(f"{file.name} is of two campaigns, {other} and {each.campaign}")
                found[file] = each.campaign or other
    return found, problems


def _matching(text: str, root: Path) -> tuple[list[Path], list[str]]:
    """Files that a ``text`` of the plan stands for, and what is wrong with it."""
    if not text.strip():
        return [], ["an empty path"]
    path = root / Path(text).expanduser()
    if not glob.has_magic(text) or path.exists():
        if not path.exists():
            return [], [f"{text}: no such file or folder"]
        if path.is_file() and path.suffix.lower() not in SUFFIXES:
            return [], [f"{text}: not a trial file; expected .csv or .parquet"]
        matches = [path]
    else:
        matches = [Path(match) for match in sorted(glob.glob(str(path), recursive=True))]  # noqa: PTH207
        matches = [match for match in matches if match.is_dir() or match.suffix.lower() in SUFFIXES]
        if not matches:
            return [], [f"{text}: no trial file matches"]
    try:
        return [Path(file) for file in trial_files(matches)], []
    except UserError as error:
        return [], [str(error)]
