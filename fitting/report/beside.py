"""Figures drawn in a process of their own, while this one computes what they do not show.

The process is started before anything is read, so that its libraries are there when the first figure is asked for. What
it cannot draw, for whatever reason, is drawn by this process, which also says why where that fails too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fitting.parallel import cores, helper
from fitting.report.plot_style import new_figure, png_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureAhead:
    """A figure that was asked for: its name, what draws it, title and caption, and the PNG that is to come."""

    name: str
    draw: Callable[[], Figure]
    title: str
    caption: str
    future: Future[bytes]

    def png(self) -> bytes:
        """The PNG, drawn here where the other process could not. Raises what drawing it raises."""
        try:
            return self.future.result()
        except Exception:
            return png_of(self.draw)


@dataclass
class FigureProcess:
    """Takes figures as a ``FigureFolder`` does; asked: those that it was given, in order; complete: none could not be
    asked for."""

    executor: Executor
    asked: list[FigureAhead] = field(default_factory=list)
    complete: bool = True

    def write(self, name: str, draw: Callable[[], Figure], title: str, caption: str) -> None:
        """Ask for the figure ``name`` that ``draw`` gives, which must be picklable, with ``title`` and ``caption``."""
        self.asked.append(FigureAhead(name, draw, title, caption, self.executor.submit(png_of, draw)))


@contextmanager
def figures_beside() -> Iterator[FigureProcess | None]:
    """A process for figures that ends with this context; None where there is but one core."""
    if cores() < 2:
        yield None
        return
    with helper(_prepare) as executor:
        yield FigureProcess(executor)


def _prepare() -> None:
    """Load what figures need, fonts too."""
    import fitting.report.plot_identifiability
    import fitting.report.plots  # noqa: F401

    png_of(_first)


def _first() -> Figure:
    figure = new_figure(1.0)
    figure.subplots().set_title("0")
    return figure
