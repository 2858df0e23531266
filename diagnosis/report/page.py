"""The report on a diagnosis: figures and one self-contained HTML page that a naval architect reads in two minutes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnosis.findings import Findings
from diagnosis.groups.between import table_rows
from diagnosis.location.regions import CHANNELS
from diagnosis.report import where_words, words
from diagnosis.report.figures import figures_for
from fitting.report.page import environment, write_page
from fitting.report.plot_style import FigureFolder, figures_of
from fitting.report.run_folder import versions

REPORT, FIGURES = "report.html", "figures"


def write_report(d: Findings, folder: Path) -> FigureFolder:
    """Make the figures and ``report.html`` of ``d`` in ``folder``. Returns what was made and what could not be made."""
    written = FigureFolder(folder / FIGURES)
    for name, draw, title, caption in figures_for(d):
        written.write(name, partial(draw, d), title, caption)
    for row in written.rows:
        row["file"] = f"{FIGURES}/{row['file']}"
    with written.making("the report"):
        write_page(build_report(d, folder, written.rows), folder / REPORT)
    return written


def build_report(d: Findings, folder: Path, listed: Sequence[Mapping[str, str]]) -> str:
    """The page on ``d``; listed: rows of the figures that lie in ``folder``."""
    templates, order = environment("diagnosis.report"), [words.plain(e.name) for e in d.effects]
    templates.filters["sentence"] = words.sentence
    rows = words.ranking(d)
    channels = [{"name": name, **row} for name, row in d.where.get("channels", {}).items()]
    return templates.get_template("diagnosis.html.j2").render(
        d=d,
        words=words,
        where=where_words,
        figures={f["name"]: f for f in figures_of(folder, listed)},
        version=versions()["mmg-ident"],
        between=table_rows(d.between) if d.between else [],
        held=held_rows(d),
        rows=sorted(rows, key=lambda row: order.index(row["name"]) if row["name"] in order else len(order)),
        channels=channels,
        later=any("force_rms_after" in row for row in channels),
        details=_details(d.where),
    )


def _details(where: Mapping[str, Any]) -> list[tuple[str, str, list[dict[str, Any]], str, str]]:
    """Tables of where the gap lies: title, what a row is of, rows, what the last column says, what the second number of
    a channel is."""
    bands = [row | {"band": where_words.band_words(row)} for row in where.get("bands", [])]
    bands += (
        [row | {"band": "all", "channel": name} for name, row in where.get("channels", {}).items()] if bands else []
    )
    phases = [row | {"more": where_words.percent(row["share_of_time"])} for row in where.get("phases", [])]
    earth = {
        row["run"]: f"{row['force']:.2g} {row['unit']} to {round(math.degrees(row['towards'])) % 360:03d}°"
        for row in where.get("earth", [])
    }
    runs = [row | {"more": earth.get(row["run"], "")} for row in where.get("runs", [])]
    return [
        ("By frequency", "missing force with", _by_channel(bands, "band"), "", "energy"),
        ("By phase of the manoeuvre", "phase", _by_channel(phases, "phase"), "of the time", "mean"),
        ("By training trial", "trial", _by_channel(runs, "run"), "mean in the earth frame", "mean"),
    ]


def _by_channel(rows: Sequence[Mapping[str, Any]], key: str) -> list[dict[str, Any]]:
    """Rows by channel joined to one per phase or run, in the order in which they come."""
    cells: dict[str, dict[str, Any]] = {}
    for row in rows:
        cells.setdefault(row[key], {})[row["channel"]] = row
    return [
        {"name": name, "more": own[CHANNELS[0]].get("more", ""), "cells": [own[c] for c in CHANNELS]}
        for name, own in cells.items()
    ]


def held_rows(d: Findings) -> list[dict[str, Any]]:
    """Errors of the test trials of ``d`` before and after, the total last."""
    if d.held_out is None:
        return []
    every = [*d.held_out.by_run.items(), ("all windows", (d.held_out.mse_before, d.held_out.mse_after))]
    return [{"name": name, "before": a, "after": b, "worse": b > a, "change": _change(a, b)} for name, (a, b) in every]


def _change(before: float, after: float) -> str:
    """By how much an error grows, in percent."""
    if before <= 0:
        return "–"
    share = after / before - 1
    return f"{words.signed(100 * share, f'.{where_words.places(share)}f')} %"
