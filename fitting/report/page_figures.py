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
        title, caption = entry.get("title", path.stem), entry.get("caption", "")
        figures.append(figure_entry(content, path.stem, title, caption, path.name))
    return figures


def figure_entry(content: bytes, name: str, title: str, caption: str, file: str = "") -> dict[str, Any]:
    """One figure as the template takes it, with ``image`` None where ``content`` is no PNG file.

    name: by which it finds its section; title, caption: in words; file: its name in the run folder.
    """
    good = content.startswith(PNG)
    uri = "data:image/png;base64," + base64.b64encode(content).decode() if good else None
    size = (int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")) if good else (0, 0)
    return {"title": title, "caption": caption, "image": uri, "name": name, "file": file,
            "width": size[0], "height": size[1]}  # fmt: skip
