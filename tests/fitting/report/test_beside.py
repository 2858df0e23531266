"""Figures drawn by another process are those drawn here, and nothing that befalls it loses one."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from fitting.parallel import ProcessBeside, helper
from fitting.record import FitRecord
from fitting.report.beside import FigureProcess
from fitting.report.drawn_ahead import ask_figures, ask_the_rest
from fitting.report.plot_style import FigureFolder, new_figure, png_of
from tests.support.calibrated import small_result


def line(slope: float) -> Figure:
    """A straight line."""
    figure = new_figure(2.0)
    figure.subplots().plot([0.0, 1.0], [0.0, slope])
    return figure


def nothing() -> None:
    """What the process does first."""


def wrong() -> Figure:
    """A figure that cannot be drawn."""
    raise ValueError("no such figure")


def ended() -> Figure:
    """A figure that only ends the process that is to draw it, but not the one that asked."""
    if multiprocessing.parent_process() is not None:
        os._exit(1)
    return line(3.0)


def slow() -> Figure:
    """A figure that takes a while."""
    time.sleep(0.5)
    return line(1.0)


@pytest.fixture
def process() -> Iterator[FigureProcess]:
    with helper(nothing) as executor:
        yield FigureProcess(ProcessBeside(executor))


def test_figures_are_those_drawn_here_and_in_order(process: FigureProcess, tmp_path: Path) -> None:
    for slope in (1.0, 2.0):
        process.write(f"slope_{slope:g}", partial(line, slope), "title", "caption")
    folder = FigureFolder(tmp_path / "figures")
    folder.take(process.asked)
    assert [row["file"] for row in folder.rows] == ["slope_1.png", "slope_2.png"]
    assert (tmp_path / "figures" / "slope_2.png").read_bytes() == png_of(partial(line, 2.0))


def test_what_cannot_be_handed_over_is_drawn_here(process: FigureProcess) -> None:
    process.write("local", lambda: line(1.5), "", "")
    assert process.asked[0].png() == png_of(partial(line, 1.5))


def test_the_last_figures_are_drawn_here_while_the_first_are_drawn_there(
    process: FigureProcess, tmp_path: Path
) -> None:
    process.write("slow", slow, "", "")
    for slope in (1.0, 2.0):
        process.write(f"slope_{slope:g}", partial(line, slope), "", "")
    folder = FigureFolder(tmp_path / "figures")
    folder.take(process.asked)
    assert [row["file"] for row in folder.rows] == ["slow.png", "slope_1.png", "slope_2.png"]
    assert not process.asked[2].awaited.there.done() and process.asked[0].awaited.there.done()


def test_a_process_that_ends_loses_no_figure(process: FigureProcess) -> None:
    process.write("ended", ended, "", "")
    process.write("after", partial(line, 1.0), "", "")
    assert [each.png() for each in process.asked] == [png_of(ended), png_of(partial(line, 1.0))]


def test_a_figure_that_cannot_be_drawn_is_a_warning_and_the_others_are_there(
    process: FigureProcess, tmp_path: Path
) -> None:
    process.write("wrong", wrong, "", "")
    process.write("right", partial(line, 1.0), "", "")
    folder = FigureFolder(tmp_path / "figures")
    folder.take(process.asked)
    assert [str(m) for m in folder.failures] == ["figure wrong could not be made (ValueError: no such figure)"]
    assert [row["file"] for row in folder.rows] == ["right.png"]


def test_the_process_ends_with_its_context() -> None:
    with helper(nothing) as executor:
        number = executor.submit(os.getpid).result()
        (child,) = [child for child in multiprocessing.active_children() if child.pid == number]
    child.join(30)
    assert not child.is_alive()


@pytest.mark.slow
def test_a_result_saved_with_drawn_figures_has_the_same_ones(process: FigureProcess, tmp_path: Path) -> None:
    result = small_result()
    assert result.objects
    content = {k: v for k, v in vars(result).items() if k in {field.name for field in fields(FitRecord)}}
    ask_figures(process, content, result.objects)
    objects = ask_the_rest(process, content, result.objects)
    assert len(objects.drawn) >= 5
    result.save(tmp_path / "here")
    replace(result, objects=objects).save(tmp_path / "beside")
    here, beside = (sorted((tmp_path / name / "figures").iterdir()) for name in ("here", "beside"))
    assert [p.name for p in here] == [p.name for p in beside]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(here, beside, strict=True))


def test_where_the_process_has_ended_the_figures_are_left_to_the_saving(process: FigureProcess, tmp_path: Path) -> None:
    result = small_result()
    assert result.objects
    content = {k: v for k, v in vars(result).items() if k in {field.name for field in fields(FitRecord)}}
    assert process.process.executor.submit(os._exit, 1).exception()
    ask_figures(process, content, result.objects)
    objects = ask_the_rest(process, content, result.objects)
    assert not objects.drawn
    saved = replace(result, objects=objects).save(tmp_path / "run")
    assert len(list((tmp_path / "run" / "figures").iterdir())) == len(saved.figures) >= 5
