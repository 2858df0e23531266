"""The page of a fleet: one self-contained file over all ships."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from fitting.report.page import environment
from fitting.report.page import write_page as write_text
from fitting.report.plot_style import FigureFolder, figures_of
from fitting.report.run_folder import versions
from fitting.report.sections import plus_minus
from mmg_ident.fleet.figures import moved_figure, moved_symbols, sister_figure
from mmg_ident.fleet.job import DIAGNOSIS, SHIPS
from mmg_ident.fleet.run import ALPHA, Fleet, SisterGroup

PAGE = "fleet.html"
SHOWN = 12
"""Coefficients in the table of a group of sisters, and of a ship in that of what moved."""
ALIKE = 0.01
"""Probability below which a ship does not seem to be drawn from the distribution of her sisters."""


def write_page(fleet: Fleet, folder: Path) -> None:
    """Write the page of ``fleet`` and its figures into its ``folder``; what cannot be made is a warning."""
    figures = FigureFolder(folder / "figures")
    done = [row for row in fleet.rows if row["coefficients"]]
    if moved_symbols(done):
        words = "Estimate less start, in standard deviations of the start. A dot marks a change that is beyond chance."
        figures.write("moved", lambda: moved_figure(done), "Coefficients against their start", words)
    for number, group in enumerate(fleet.groups):
        words = "Estimate of each sister and its standard error, against the mean of all; grey: the width of the prior."
        figures.write(f"sisters_{number}", partial(sister_figure, group), f"Sisters {group.name}", words)
    with figures.making(PAGE):
        write_text(_page(fleet, folder, figures), folder / PAGE)


def _page(fleet: Fleet, folder: Path, figures: FigureFolder) -> str:
    found = figures_of(folder, figures.rows)
    return (
        environment("mmg_ident.fleet")
        .get_template("fleet.html.j2")
        .render(
            fleet=fleet,
            rows=[_shown(row, folder) for row in fleet.rows],
            groups=[_group(group) for group in fleet.groups],
            figures=[f for f in found if not f["name"].startswith("sisters")],
            sister_figures={f["name"]: f for f in found},
            version=versions()["mmg-ident"],
            alpha=ALPHA,
        )
    )


def _shown(row: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A row as the page shows it."""
    coefficients = row["coefficients"]
    moved = [_moved(s, coefficients[s]) for s in row["moved"][:SHOWN]]
    place = f"{SHIPS}/{quote(row['name'])}"
    where = (("calibration", ""), ("diagnosis", f"{DIAGNOSIS}/"))
    pages = [(words, f"{place}/{name}report.html") for words, name in where]
    score = row["scores"].get("held_out") or row["scores"].get("training") or {}
    return dict(row) | {
        "pages": [(words, link) for words, link in pages if (folder / row_path(link, row, place)).exists()],
        "moved_rows": moved,
        "score": score,
        "score_of": "held out" if "held_out" in row["scores"] else "training" if score else "",
        "figure_errors": _figure_errors(score.get("figures", [])),
        "apart": [_apart(s, coefficients[s]) for s in row.get("moved_against_sisters", [])],
        "strange": row.get("p_alike") is not None and row["p_alike"] < ALIKE,
        "diagnosis_failed": row.get("diagnosis_failed", ""),
    }


def row_path(link: str, row: Mapping[str, Any], place: str) -> Path:
    """The file of a ``link`` to a page of the ship of a ``row``, whose links begin with ``place``."""
    return Path(SHIPS) / row["name"] / link[len(place) + 1 :]


def _moved(symbol: str, c: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "symbol": symbol,
        "description": c["description"],
        "unit": c["unit"],
        "start": plus_minus(c["start"], c["start_std"]),
        "value": plus_minus(c["value"], c["std"]),
        "moved": c["moved"],
    }


def _apart(symbol: str, c: Mapping[str, Any]) -> str:
    return f"{symbol} ({c['from_others']:+.1f})".replace("-", "−")


def _figure_errors(figures: list[Mapping[str, Any]]) -> str:
    """Errors of manoeuvring figures in words: the median of their shares, and the greatest."""
    share = [
        (abs(f["predicted"] - f["measured"]) / abs(f["measured"]), f)
        for f in figures
        if f["measured"] and f["predicted"] is not None and math.isfinite(f["predicted"])
    ]
    if not share:
        return ""
    worst, which = max(share, key=lambda pair: pair[0])
    name = which["figure"].replace("_", " ")
    return f"{np.median([s for s, _ in share]):.0%}, at most {worst:.0%} ({name})"


def _group(group: SisterGroup) -> dict[str, Any]:
    """A group of sisters as the page shows it: coefficients by width, widest first, and each sister's distance."""
    w = group.widths
    mean, error = w.centre + w.unit * w.mean, w.unit * np.sqrt(np.diag(w.mean_covariance))
    order = [i for i in np.argsort(-w.width) if w.width[i] > 0][:SHOWN]
    used = (w.estimate - w.mean) / w.used_width
    far = [sorted(range(len(w.symbols)), key=lambda i: -abs(row[i]))[:3] for row in used]
    return {
        "name": group.name,
        "ships": group.ships,
        "common": w.common,
        "common_90": w.common_90,
        "alike": int((w.width < 0.05).sum()),
        "count": len(w.symbols),
        "rows": [
            {"symbol": w.symbols[i], "mean": plus_minus(mean[i], error[i]), "width": w.unit[i] * w.width[i],
             "share": w.width[i],
             "values": [plus_minus(w.centre[i] + w.unit[i] * w.estimate[k, i], w.unit[i] * w.std[k, i])
                        for k in range(len(group.ships))]}
            for i in order
        ],
        "sisters": [
            {"name": name, "rms": float(np.sqrt(np.mean(used[k] ** 2))), "p": w.p_alike[k],
             "strange": w.p_alike[k] < ALIKE,
             "far": ", ".join(f"{w.symbols[i]} {used[k, i]:+.1f}".replace("-", "−") for i in far[k])}
            for k, name in enumerate(group.ships)
        ],
    }  # fmt: skip
