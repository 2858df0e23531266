"""Figures of a diagnosis on axes, for notebooks: each function returns the axes, and none writes a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from diagnosis.findings import Findings, MissingForce
from diagnosis.report.words import budget_parts
from fitting.report.plot_style import AFTER, BEFORE, DASHES, GREY, dress, own_axes
from mmg.errors import Missing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Of a cause, of what is not explained, and of what no model could predict.
COLOURS = {"part": AFTER, "rest": BEFORE, "floor": GREY}


@dataclass(frozen=True, repr=False)
class DiagnosisAxes:
    """The figures of ``findings``; forces: the missing force by trial. ax: where to draw, None: new axes."""

    findings: Findings
    forces: dict[str, MissingForce]

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

    def force(self, ax: Axes | None = None, component: str = "N", trial: str | None = None) -> Axes:
        """The force that the model lacks along a training ``trial`` (its name, default the first): ``component`` X, Y
        [N] or N [N m], body axes. Raises UserError for another name."""
        known = {"X": "X [N]", "Y": "Y [N]", "N": "N [N m]"}
        name = trial if trial is not None else next(iter(self.forces), "")
        if component not in known:
            raise Missing(f"component: {component!r} is none of X, Y, N")
        if name not in self.forces:
            raise Missing(f"trial: no missing force of {name!r}; known are {', '.join(self.forces) or 'none'}")
        ax, one = dress(own_axes(ax), "time from the first sample [s]", known[component], name), self.forces[name]
        ax.plot(one.t, one.force[:, list(known).index(component)], color=AFTER, lw=1.2, ls=DASHES[0])
        ax.axhline(0.0, color=GREY, lw=0.7)
        return ax
