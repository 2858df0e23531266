"""The documentation as a site: ``sphinx-build -W docs site``. The tutorial is executed while it is built."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

project = "mmg-ident"
author = project_copyright = "The mmg-ident authors"
extensions = ["myst_nb", "sphinx.ext.autodoc"]
html_theme = "furo"
html_title = "mmg-ident"
exclude_patterns = ["_build"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True
autodoc_member_order = "groupwise"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
suppress_warnings = ["myst.xref_missing", "ref.python"]  # pages outside docs are reached in the repository


def _as_plain_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain sentences: stars, bars and indents in them are no markup, arguments are set as code."""
    kept = [line.strip() for line in lines if line.strip() not in ("Attributes", "-" * len("Attributes"))]
    text = "\n".join(kept).replace("*", "\\*").replace("|", "\\|")
    lines[:] = re.sub(r"(?m)(^|; )(\w+(?:, \w+)*): ", lambda m: f"{m[1]}``{m[2]}``: ", text).splitlines()


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", _as_plain_text)
