"""The page of a fleet: one self-contained file over all ships."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from fitting.report.page import environment
from fitting.report.page import write_page as write_text
from fitting.report.plot_style import FigureFolder, dress, figures_of, literal, new_figure
from fitting.report.run_folder import versions
from fitting.report.words import plus_minus
from mmg_ident.fleet.run import DIAGNOSIS, SHIPS, Fleet, SisterGroup

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = "fleet.html"
SHOWN = 12
"""Coefficients in the table of a group of sisters, and of a ship in what moved."""
MOST_COLUMNS = 24
"""Coefficients in the figure of what moved."""
ALIKE = 0.01
"""Probability below which a ship does not seem to be drawn from the distribution of her sisters."""


def write_page(fleet: Fleet, folder: Path) -> None:
    """Write the page of ``fleet`` and its figure into its ``folder``; what cannot be made is a warning."""
    figures = FigureFolder(folder / "figures")
    done = [row for row in fleet.rows if row["coefficients"]]
    if symbols := _moved_symbols(done):
        words = "Estimate less start, in standard deviations of the start. A dot marks a change that is beyond chance."
        figures.write("moved", lambda: _moved_figure(done, symbols), "Coefficients against their start", words)
    with figures.making(PAGE):
        text = environment("mmg_ident.fleet").get_template("fleet.html.j2").render(
            fleet=fleet,
            rows=[_shown(row, folder) for row in fleet.rows],
            groups=[_group(group) for group in fleet.groups],
            figures=figures_of(folder, figures.rows),
            version=versions()["mmg-ident"],
        )  # fmt: skip
        write_text(text, folder / PAGE)


def _moved_symbols(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Coefficients that moved in any ship of ``rows``, those that moved in most ships first."""
    moved = [symbol for row in rows for symbol in row["moved"]]
    return sorted(dict.fromkeys(moved), key=lambda s: -moved.count(s))[:MOST_COLUMNS]


def _moved_figure(rows: Sequence[Mapping[str, Any]], symbols: Sequence[str]) -> Figure:
    """By how many standard deviations of the start each of the ``symbols`` moved in each ship of ``rows``."""
    values = [[row["coefficients"].get(symbol, {}).get("moved") for symbol in symbols] for row in rows]
    figure = new_figure(0.24 * len(rows) + 1.7)
    ax = figure.subplots()
    image = ax.imshow(np.array(values, dtype=float), cmap="RdBu_r", vmin=-3, vmax=3, aspect="auto")
    for i, row in enumerate(rows):
        beyond_chance = [k for k, symbol in enumerate(symbols) if symbol in row["moved"]]
        ax.plot(beyond_chance, [i] * len(beyond_chance), ".", color="black", markersize=4)
    dress(ax)
    ax.grid(False)
    ax.set_xticks(range(len(symbols)), [literal(s) for s in symbols], rotation=60, ha="right", fontsize=7.5)
    ax.set_yticks(range(len(rows)), [literal(row["name"]) for row in rows], fontsize=8)
    bar = figure.colorbar(image, ax=ax, fraction=0.03, pad=0.01)
    bar.ax.tick_params(labelsize=8)
    bar.set_label("std of the start", fontsize=8)
    return figure


def _shown(row: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A row as the page shows it."""
    pages = {
        words: f"{SHIPS}/{quote(row['name'])}/{below}report.html"
        for words, below in (("calibration", ""), ("diagnosis", f"{DIAGNOSIS}/"))
        if (folder / SHIPS / row["name"] / below / "report.html").exists()
    }
    score = row["scores"].get("held_out") or row["scores"].get("training") or {}
    return dict(row) | {
        "pages": pages,
        "moved_words": _distances(row, row["moved"][:SHOWN], "moved"),
        "apart_words": _distances(row, row["moved_against_sisters"], "from_others"),
        "score": score,
        "score_of": "held out" if "held_out" in row["scores"] else "training" if score else "",
        "strange": row["p_alike"] is not None and row["p_alike"] < ALIKE,
    }


def _distances(row: Mapping[str, Any], symbols: Sequence[str], key: str) -> str:
    """Coefficients of a ``row`` in words, each with the distance that its ``key`` holds."""
    return ", ".join(f"{s} {row['coefficients'][s][key]:+.1f}".replace("-", "−") for s in symbols)


def _group(group: SisterGroup) -> dict[str, Any]:
    """A group of sisters as the page shows it: coefficients by width, widest first, and each sister's distance."""
    w = group.widths
    mean, error = w.centre + w.unit * w.mean, w.unit * np.sqrt(np.diag(w.mean_covariance))
    values, errors = w.centre + w.unit * w.estimate, w.unit * w.std
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
             "values": [plus_minus(v, e) for v, e in zip(values[:, i], errors[:, i], strict=True)]}
            for i in np.argsort(-w.width)[:SHOWN] if w.width[i] > 0
        ],
        "sisters": [
            {"name": name, "rms": float(np.sqrt(np.mean(used[k] ** 2))), "p": w.p_alike[k],
             "strange": w.p_alike[k] < ALIKE,
             "far": ", ".join(f"{w.symbols[i]} {used[k, i]:+.1f}".replace("-", "−") for i in far[k])}
            for k, name in enumerate(group.ships)
        ],
    }  # fmt: skip
