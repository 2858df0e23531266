"""Tables in TOML files, read by the standard library or, before Python 3.11, by tomli."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib


def tables(path: Path) -> dict[str, Any]:
    """The content of the file ``path``."""
    return tomllib.loads(path.read_text(encoding="utf-8"))
