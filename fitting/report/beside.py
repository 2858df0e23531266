"""Figures drawn in the process beside this one, while this one computes what they do not show.

What it cannot draw, for whatever reason, is drawn by this process, which also says why where that fails too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from fitting.parallel import Awaited, ProcessBeside
from fitting.report.plot_style import new_figure, png_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureAhead:
    """A figure that was asked for: its name, title and caption, and the PNG that is to come."""

    name: str
    title: str
    caption: str
    awaited: Awaited[bytes]

    def png(self) -> bytes:
        """The PNG, drawn here where the other process could not. Raises what drawing it raises."""
        return self.awaited.value


@dataclass
class FigureProcess:
    """Takes figures as a ``FigureFolder`` does, for the ``process`` to draw; asked: those that it was given, in order;
    complete: none could not be asked for."""

    process: ProcessBeside
    asked: list[FigureAhead] = field(default_factory=list)
    complete: bool = True

    def write(self, name: str, draw: Callable[[], Figure], title: str, caption: str) -> None:
        """Ask for the figure ``name`` that ``draw`` gives, which must be picklable, with ``title`` and ``caption``."""
        self.asked.append(FigureAhead(name, title, caption, self.process.begin(partial(png_of, draw))))


def prepare_figures() -> None:
    """Load what figures need, fonts too."""
    import fitting.report.plot_identifiability
    import fitting.report.plots  # noqa: F401

    png_of(_first)


def _first() -> Figure:
    figure = new_figure(1.0)
    figure.subplots().set_title("0")
    return figure
