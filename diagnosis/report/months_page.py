"""The run folder of a study of months: ship, numbers, windows, one figure and one page."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cases.shipfiles.ship_file import dump_ship
from diagnosis.groups.months import MonthStudy, parameter_of
from diagnosis.groups.over_time import DatedChange
from fitting.report.page import rendered, write_page
from fitting.report.plot_style import AFTER, BEFORE, FigureFolder, dress, figures_of, new_figure
from fitting.report.run_folder import SHIP, plain, write_json, write_whole
from fitting.result import FitResult

SHOWN = 4  # Candidates in the figure where fewer changed. Set by hand.
CAPTION = "Estimates of each candidate in spells of six hours, one by one, and the best change."


def write_study(study: MonthStudy, result: FitResult | None, folder: Path) -> None:
    """Write the run ``folder`` of ``study``, with the calibration ``result`` where there is one; it must not exist."""
    import pandas as pd

    def numbers(scratch: Path) -> None:
        write_json(scratch / "months.json", study.to_dict())
        rows = pd.DataFrame(dict(study.by_window))
        rows.to_parquet(scratch / "windows.parquet", engine="pyarrow", write_page_checksum=True)

    def fill(scratch: Path) -> None:
        (scratch / SHIP).write_text(dump_ship(study.ship, f"{study.ship.title}, as it was given."), encoding="utf-8")
        numbers(scratch)

    if result:
        result.save(folder, attach=numbers)
    else:
        write_whole(folder, fill)
    figures = FigureFolder(folder / "figures")
    if shown(study):
        figures.write("changes", partial(changes_figure, study), "What changed", CAPTION)
    with figures.making("the page"):
        sentences, drawn = [study.words(row) for row in study.changes.named], figures_of(folder, figures.rows)
        content = plain(study.to_dict())
        page = rendered("months", "diagnosis.report", s=study, content=content, sentences=sentences, figures=drawn)
        write_page(page, folder / "months.html")


def shown(study: MonthStudy) -> list[DatedChange]:
    """Candidates in the figure of ``study``: those that changed, then those with the largest gains."""
    named = {row.name for row in study.changes.named}
    rest = sorted(study.changes.tested, key=lambda row: -row.gain)
    return [*study.changes.named, *[row for row in rest if row.name not in named]][: max(SHOWN, len(named))]


def changes_figure(study: MonthStudy) -> Figure:
    """Estimates in spells and the best change of the ``shown`` candidates of ``study``."""
    rows, named = shown(study), {id(row) for row in study.changes.named}
    figure = new_figure(1.7 * len(rows) + 0.4)
    for ax, row in zip(np.atleast_1d(figure.subplots(len(rows), 1, sharex=True)), rows, strict=True):
        changed = id(row) in named
        ax.plot(row.day, row.estimate, ".", color="#8A8A8A", markersize=4)
        level = float(np.median(row.estimate - row.size * row.profile))
        ax.plot(row.day, level + row.size * row.profile, color=AFTER if changed else BEFORE,
                linestyle="-" if changed else (0, (4, 1.5)))  # fmt: skip
        if changed:
            ax.axvspan(*row.begin_90, color=AFTER, alpha=0.15, linewidth=0)
        low, high = np.quantile(row.estimate, (0.02, 0.98))
        ax.set_ylim(low - 0.3 * (high - low), high + 0.3 * (high - low))
        unit = parameter_of(study.ship, row.name).unit
        company = any(row.name in other.company for other in study.changes.named)
        what = "changed" if changed else "changes with what is named" if company else "no change found"
        dress(ax, "", f"[{unit or '-'}]", f"{row.name}: {what}")
    ax.set_xlabel("days since the log began", fontsize=9)
    return figure
