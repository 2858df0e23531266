"""What a choice of structure has found: a row for each candidate, and the chosen one."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from fitting.result import FitResult
from fitting.selection.stability import Stability
from fitting.selection.subsequences.learned import Learned


@dataclass(frozen=True)
class Tried:
    """One candidate and what became of it.

    unknowns: free coefficients; validation, training: mean squared error of 30 s windows, by the variance of the
    trials; stable: sequences of ``stability`` that did not diverge, of those simulated; left_out: why it was not tried.
    """

    name: str
    words: str
    unknowns: int
    terms: int
    validation: float = float("nan")
    training: float = float("nan")
    converged: bool = False
    seconds: float = 0.0
    stable: int = 0
    sequences: int = 0
    left_out: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, NaN as None."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


@dataclass(frozen=True)
class StructureChoice:
    """The chosen candidate, calibrated; the table of all; errors on the test trials of some models; its stability; by
    candidate its runs on the objective of the paper, if there were any."""

    chosen: str
    result: FitResult
    table: tuple[Tried, ...]
    test: dict[str, float]
    stability: Stability
    runs: dict[str, tuple[Learned, ...]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Content of selection.json."""
        test = {name: value if np.isfinite(value) else None for name, value in self.test.items()}
        keys = ("name", "seed", "objective", "training", "validation", "evaluations", "seconds")
        learned = [{k: getattr(run, k) for k in keys} | {"terms_left_out": len(run.vanished)}
                   for some in self.runs.values() for run in some]  # fmt: skip
        return {
            "chosen": self.chosen,
            "candidates": [row.to_dict() for row in self.table],
            "test": test,
            "stability": asdict(self.stability),
            **({"learned": learned} if learned else {}),
        }
