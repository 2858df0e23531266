"""Which figures of a calibration are drawn beside the work that they do not wait for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from fitting.record import FitObjects, FitRecord
from fitting.report.beside import FigureProcess
from fitting.report.plot_identifiability import write_identifiability_figures
from fitting.report.plots import write_figures


def ask_figures(process: FigureProcess, content: Mapping[str, Any], objects: FitObjects) -> None:
    """Let the ``process`` draw what does not wait for the next trial.

    content: of the calibration, as ``FitRecord.of`` takes it; objects: what stands behind it.
    """
    with _noted(process):
        write_figures(process, FitRecord.of(content), objects)


def ask_the_rest(process: FigureProcess, content: Mapping[str, Any], objects: FitObjects) -> FitObjects:
    """As ``ask_figures``, what waited for the next trial; returns the ``objects`` with all figures that are drawn.

    process: what draws; content, objects: as of ``ask_figures``.
    """
    with _noted(process):
        write_identifiability_figures(process, FitRecord.of(content), objects)
    return replace(objects, drawn=tuple(process.asked)) if process.complete else objects


@contextmanager
def _noted(process: FigureProcess) -> Iterator[None]:
    """An error loses no result: figures are then drawn when it is saved, where what fails is a warning."""
    try:
        yield
    except Exception:
        process.complete = False
