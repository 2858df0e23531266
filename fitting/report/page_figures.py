"""Figures of a run folder as a page holds them."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

PNG = b"\x89PNG\r\n\x1a\n"


def figures_of(folder: Path, listed: Any) -> list[dict]:
    """The figures ``listed`` in result.json with their content, from ``folder``/figures, as a data URI.

    ``image`` is None for one that is missing.
    """
    figures = []
    for entry in listed or []:
        path = folder / "figures" / Path(str(entry.get("file", ""))).name
        try:
            content = path.read_bytes()
        except OSError:
            content = b""
        good = content.startswith(PNG)
        uri = "data:image/png;base64," + base64.b64encode(content).decode() if good else None
        size = (int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")) if good else (0, 0)
        figures.append(
            {"title": entry.get("title", path.stem), "caption": entry.get("caption", ""), "image": uri,
             "name": path.stem, "file": path.name, "width": size[0], "height": size[1]}
        )  # fmt: skip
    return figures
