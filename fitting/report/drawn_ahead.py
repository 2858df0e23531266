"""Which figures of a calibration are drawn beside the work that they do not wait for."""

from __future__ import annotations

from collections.abc import Mapping
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
    write_figures(process, FitRecord.of(content), objects)


def ask_the_rest(process: FigureProcess, content: Mapping[str, Any], objects: FitObjects) -> FitObjects:
    """As ``ask_figures``, what waited for the next trial; returns the ``objects`` with all figures that are drawn.

    process: what draws; content, objects: as of ``ask_figures``.
    """
    write_identifiability_figures(process, FitRecord.of(content), objects)
    return replace(objects, drawn=tuple(process.asked))
