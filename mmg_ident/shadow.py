"""Another distribution, ``mmg`` of the package index, installs a package ``mmg`` too: it is found before it is used."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

OURS = '"""The symbolic ship'
"""How the first file of our ``mmg`` begins."""


def shadowing_mmg() -> str:
    """One line about a foreign package ``mmg`` that Python would import in place of ours; empty where there is none.

    Nothing of that package is executed.
    """
    spec = find_spec("mmg")
    origin = Path(spec.origin) if spec and spec.origin else None
    if origin is not None and origin.is_file() and origin.read_text(errors="replace").startswith(OURS):
        return ""
    where = f"{origin.parent} is another package 'mmg'" if origin else "the package 'mmg' is missing"
    return f"{where}, which stands before that of mmg-ident: install mmg-ident in a virtual environment of its own"
