"""The page of a fleet: one self-contained file over all ships."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from fitting.report.page import environment
from fitting.report.page import write_page as write_text
from fitting.report.plot_style import FigureFolder
from fitting.report.run_folder import versions
from fitting.report.sections import plus_minus
from mmg_ident.fleet.rows import Fleet, SisterGroup
from mmg_ident.fleet.run import DIAGNOSIS, SHIPS

PAGE = "fleet.html"
SHOWN = 12
"""Coefficients in the table of a group of sisters, and in what moved."""
ALIKE = 0.01
"""Probability below which a ship does not seem to be drawn from the distribution of her sisters. Set by hand."""


def write_page(fleet: Fleet, folder: Path) -> None:
    """Write the page of ``fleet`` into its ``folder``; what cannot be made is a warning."""
    moved = Counter(symbol for row in fleet.rows for symbol in row["moved"])
    with FigureFolder(folder).making(PAGE):
        text = environment("mmg_ident.fleet").get_template("fleet.html.j2").render(
            fleet=fleet,
            rows=[_shown(row, folder) for row in fleet.rows],
            groups=[_group(group) for group in fleet.groups],
            moved=", ".join(f"{symbol} ({count})" for symbol, count in moved.most_common(SHOWN)),
            version=versions()["mmg-ident"],
        )  # fmt: skip
        write_text(text, folder / PAGE)


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
