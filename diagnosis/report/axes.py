"""Figures of a diagnosis on axes, for notebooks: each function returns the axes, and none writes a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from diagnosis.findings import Findings
from diagnosis.report.words import budget_parts
from fitting.report.plot_style import AFTER, BEFORE, GREY, dress, own_axes
from mmg.errors import Missing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Of a cause, of what is not explained, and of what no model could predict.
COLOURS = {"part": AFTER, "rest": BEFORE, "floor": GREY}


@dataclass(frozen=True, repr=False)
class DiagnosisAxes:
    """The figures of ``findings``. ax: where to draw, None: new axes."""

    findings: Findings

    def budget(self, ax: Axes | None = None) -> Axes:
        """The squared error of windows of the test trials as a bar: what each cause has of it, what is not explained,
        and the floor. Raises UserError where no budget is known."""
        if self.findings.budget is None:
            raise Missing("budget: the diagnosis has none; it needs test trials, or runs that could be left out")
        ax, left = dress(own_axes(ax, height=1.6), "share of the squared error"), 0.0
        for part in budget_parts(self.findings.budget):
            ax.barh([0], [part["share"]], left=left, color=COLOURS[part["kind"]], alpha=0.8, edgecolor="white")
            ax.text(
                left + part["share"] / 2, 0.0, f"{part['name']}\n{part['short']}", ha="center", va="center", fontsize=8
            )
            left += part["share"]
        ax.set_yticks([])
        ax.set_xlim(0, max(left, 1.0))
        return ax
