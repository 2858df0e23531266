"""The report on a diagnosis: figures and one self-contained HTML page that a naval architect reads in two minutes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnosis.findings import Findings, RandomSizes
from diagnosis.groups.between import table_rows
from diagnosis.location.regions import CHANNELS
from diagnosis.report import where_words as report_where
from diagnosis.report import words
from diagnosis.report.figures import figures_for
from diagnosis.report.where_words import likeness
from fitting.report.page import environment, write_page
from fitting.report.plot_style import FigureFolder, figures_of
from fitting.report.run_folder import versions

REPORT, FIGURES = "report.html", "figures"
REGIONS = 12
"""Regions in the table."""
FAINT = 0.05
"""Share of the energy up to which the regions of a channel are left to diagnosis.json."""


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
    figures = {f["name"]: f for f in figures_of(folder, listed)}
    return (
        environment("diagnosis.report")
        .get_template("diagnosis.html.j2")
        .render(
            d=d,
            words=words,
            where=report_where,
            figures=figures,
            version=versions()["mmg-ident"],
            what_words=_what(d),
            between=table_rows(d.between) if d.between else [],
            held=held_rows(d),
            likelihood=_likelihood(d),
            **_candidates(d),
            **_tables_of_where(d),
        )
    )


def _what(d: Findings) -> str:
    """What is missing where no effect is named."""
    if d.verdict == "none":
        return "The residuals look like chance."
    what = "The cause is not in the library of effects, or several act at once."
    for best in words.ranking(d)[:1]:
        what += f" The nearest is {best['name']}: {best['meaning'][:1].lower()}{best['meaning'][1:]}"
    return what + (likeness(d.unnamed.before) if d.unexplained_force is not None else "")


def _candidates(d: Findings) -> dict[str, Any]:
    """The named effects, and the candidates in two tables: those refitted, and the others."""
    order = {words.plain(e.name): i for i, e in enumerate(d.effects)}
    rows = sorted(words.ranking(d), key=lambda row: order.get(row["name"], len(order)))
    refitted = {words.plain(c.name) for c in d.candidates if c.delta_bic is not None} | set(order)
    return {
        "named": [row for row in rows if row["name"] in order],
        "refitted": [row for row in rows if row["name"] in refitted],
        "others": [row for row in rows if row["name"] not in refitted],
    }


def _tables_of_where(d: Findings) -> dict[str, Any]:
    """Tables of where the gap lies and of what is random."""
    where = d.where
    channels = [{"name": name, **row} for name, row in where.get("channels", {}).items()]
    regions = [
        {"words": report_where.region_words(row), **row}
        for row in where.get("regions", [])
        if where["channels"][row["channel"]]["share"] > FAINT
    ]
    fits = [("random force, rms, without any effect", d.noise.force_N_N_Nm)]
    if d.effects and d.final is not None:
        fits.append(("with what was named", RandomSizes.of(d.final).force_N_N_Nm))
    earth = {
        row["run"]: f"{row['force']:.2g} {row['unit']} to {round(math.degrees(row['towards'])) % 360:03d}°"
        for row in where.get("earth", [])
    }
    return {
        "channels": channels,
        "later": any("force_rms_after" in row for row in channels),
        "regions": regions[:REGIONS],
        "bands": _by_channel([row | {"band": report_where.band_words(row)} for row in where.get("bands", [])], "band"),
        "phases": _by_channel(where.get("phases", []), "phase"),
        "runs": _by_channel(where.get("runs", []), "run"),
        "earth": earth,
        "fits": fits,
    }


def held_rows(d: Findings) -> list[dict[str, Any]]:
    """Errors of the test trials of ``d`` before and after, the total last."""
    if d.held_out is None:
        return []
    return [
        {
            "name": name,
            "before": before,
            "after": after,
            "worse": after > before,
            "change": _change(before, after),
        }
        for name, (before, after) in d.held_out.all_runs
    ]


def _change(before: float, after: float) -> str:
    """By how much an error grows, in percent."""
    if before <= 0:
        return "–"
    share = after / before - 1
    return f"{words.signed(100 * share, f'.{report_where.places(share)}f')} %"


def _likelihood(d: Findings) -> str:
    """The gain of the one-step predictions of the test trials in words."""
    h = d.held_out
    if h is None or h.likelihood_gain is None:
        return ""
    text = f"One step at a time, the log likelihood of the test trials changes by {words.signed(h.likelihood_gain)}"
    if h.likelihood_interval_90 is not None:
        low, high = h.likelihood_interval_90
        text += f" (90 % interval {words.signed(low)} to {words.signed(high)}; above 0 is better)"
    return text + "."


def _by_channel(rows: Sequence[Mapping[str, Any]], key: str) -> list[dict[str, Any]]:
    """Rows by channel joined to one per phase or run, in the order in which they come."""
    cells: dict[str, dict[str, Any]] = {}
    for row in rows:
        cells.setdefault(row[key], {})[row["channel"]] = row
    return [
        {
            "name": name,
            "time": report_where.percent(own[CHANNELS[0]].get("share_of_time")),
            "cells": [own[c] for c in CHANNELS],
        }
        for name, own in cells.items()
    ]
