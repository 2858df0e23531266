"""Entries of a comparison kept as they finish: what ``mmg compare --resume`` continues from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.prediction.score import Score, TrialScore


@dataclass(frozen=True)
class Subset:
    """Part of the training data: a share of its blocks, with or without runs of random manoeuvres."""

    fraction: float = 1.0
    random: bool = True

    @property
    def words(self) -> str:
        return f"{self.fraction:.0%}" + ("" if self.random else " without random")


def name_of(model: str, subset: Subset, seed: int | None) -> str:
    """Name of the file of the entry of a ``model`` trained on a ``subset`` from a ``seed``."""
    data = f"{subset.fraction:g}" + ("" if subset.random else "_no_random")
    return f"{model}_{data}" + ("" if seed is None else f"_seed_{seed}")


def words_of(entry: Any) -> dict[str, Any]:
    """What of an ``entry`` is no array."""
    score = entry.score
    return {
        "status": entry.status,
        "scored": score is not None,
        "trials": [t.name for t in score.trials] if score else [],
        "windows": [t.windows for t in score.trials] if score else [],
        "sigma_from": score.sigma_from if score else "",
        "notes": list(score.notes) if score else [],
    }


def arrays_of(entry: Any) -> dict[str, np.ndarray]:
    """The numbers of an ``entry`` as arrays, such as growth (horizons, 2), to the last bit."""
    numbers = {"growth": entry.growth, "times": np.array([entry.seconds, entry.took, entry.held_out])}
    if entry.score:
        rows = [[t.paper, *t.paper_by_state, t.window, *t.window_by_state] for t in entry.score.trials]
        numbers |= {"rows": np.array(rows), "sigma": entry.score.sigma}
        numbers["pooled"] = np.array([entry.score.paper, entry.score.window])
    return numbers


def filled(blank: Any, words: dict[str, Any], arrays: dict[str, np.ndarray]) -> Any:
    """The entry of these ``words`` and ``arrays``, (of any shape, such as (N, 6)), from a ``blank`` one."""
    seconds, took, held_out = arrays["times"].tolist()
    score = None
    if words["scored"]:
        trials = tuple(
            TrialScore(name, float(row[0]), row[1:7], float(row[7]), row[8:14], count)
            for name, row, count in zip(words["trials"], arrays["rows"], words["windows"], strict=True)
        )
        paper, window = arrays["pooled"].tolist()
        score = Score(trials, paper, window, arrays["sigma"], words["sigma_from"], tuple(words["notes"]))
    found = {"status": words["status"], "seconds": seconds, "took": took, "held_out": held_out}
    return replace(blank, **found, score=score, growth=arrays["growth"])
