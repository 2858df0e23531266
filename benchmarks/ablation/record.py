"""What was measured, line by line, by the state of the code that it was measured with."""

from __future__ import annotations

import hashlib
import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
MADE_BY = ("mmg", "cases", "fitting", "diagnosis")
"""Packages on which the figures depend."""


@cache
def code_version() -> str:
    """Twelve hex digits that change with any source file of MADE_BY."""
    digest = hashlib.sha256()
    for package in MADE_BY:
        for path in sorted((ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def commit() -> str:
    """The commit that is checked out, and its date."""
    words = ["git", "log", "-1", "--format=%h %cs"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


class Record:
    """Lines of JSON in a file, each with the code and the commit that made it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.rows: list[dict[str, Any]] = [json.loads(line) for line in lines]

    def of(self, **where: Any) -> list[dict[str, Any]]:
        """The rows with these values."""
        return [row for row in self.rows if all(row.get(k) == v for k, v in where.items())]

    def keep(self, **row: Any) -> None:
        """Add a row, of the present code."""
        made = {"code": code_version(), "commit": commit(), **row}
        self.rows.append(made)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(made) + "\n")
