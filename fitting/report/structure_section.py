"""The part of a page that says how the structure of a model was chosen, from ``selection.json`` beside the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from fitting.report.plot_style import figures_of

SELECTION = "selection.json"
WORDS = {"as given": "the ship as given", "mmg calibrated": "the ship calibrated", "chosen": "the chosen model"}
"""What the keys of the test's errors mean."""


class ShownCandidate(BaseModel):
    """A candidate; errors are None where it ran away."""

    model_config = ConfigDict(allow_inf_nan=False)
    name: str
    words: str
    unknowns: int
    validation: float | None
    training: float | None
    stable: int
    sequences: int
    left_out: str


class ShownStability(BaseModel):
    """Random harbour sequences of the chosen model, those that diverged, and the largest speed [m/s]."""

    sequences: int
    diverged: int
    speed: float


class ShownChoice(BaseModel):
    """What the page shows of ``selection.json``."""

    chosen: str
    candidates: list[ShownCandidate]
    test: dict[str, float | None]
    stability: ShownStability


def structure_section(folder: Path) -> dict[str, Any] | None:
    """What the template shows of the choice in a run ``folder``; None where there was none, or it cannot be read."""
    try:
        found = ShownChoice.model_validate(json.loads((folder / SELECTION).read_text(encoding="utf-8")))
    except (OSError, ValueError, ValidationError):
        return None
    rows = sorted(found.candidates, key=lambda row: (bool(row.left_out), row.validation is None, row.validation or 0.0))
    captions = {
        "structures": "Unknowns against the error of trials that no candidate was fitted to. The filled point is the "
        "chosen model; with fewer unknowns a model is easier to trust beyond its trials.",
        "learning": "Error during learning, on subsequences of the trials of the fit and of those it was chosen by.",
    }
    listed = [
        {"file": f"{name}.png", "title": title, "caption": captions[name]}
        for name, title in (("structures", "Complexity and error"), ("learning", "Learning curves"))
        if (folder / "figures" / f"{name}.png").is_file()
    ]
    return {
        "chosen": found.chosen,
        "words": next((row.words for row in rows if row.name == found.chosen), ""),
        "rows": rows,
        "test": [(WORDS.get(name, name), error) for name, error in found.test.items()],
        "stability": found.stability,
        "figures": figures_of(folder, listed),
    }
