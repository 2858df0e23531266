"""What the report shows of errors in units: a table of runs before and after, and one of manoeuvring figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.prediction.score import WINDOW

COLUMNS = (
    ("position_m", "position [m]"),
    ("heading_deg", "heading [deg]"),
    ("u_m_s", "u [m/s]"),
    ("r_deg_s", "r [deg/s]"),
    ("share_of_change", "share [%]"),
)
"""Keys of an error in units and their heads in the table."""

ENDS = (("position", "position_end_m", "m"), ("heading", "heading_end_deg", "deg"))

LESS = 0.995
"""Share of the error before that one after may have without being worse, as in the score table (inverse)."""


def unit_section(pair: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the template shows of the errors in units of a ``pair`` of scores, None where it has none."""
    before, after = (pair[when].get("units") for when in ("before", "after"))
    if not before or not after:
        return None
    runs = list(zip(before["runs"], after["runs"], strict=True))
    rows = [_row(b, a) for b, a in runs] + [_row(before["pooled"], after["pooled"])]
    times = after["ship_times"]
    key, judged = "share_of_change", runs
    if after["window_s"] <= WINDOW:
        key, judged = "window", list(zip(pair["before"]["trials"], pair["after"]["trials"], strict=True))
    worse = [a["name"] for b, a in judged if None not in (b[key], a[key]) and b[key] < LESS * a[key]]
    return {
        "columns": [words for _, words in COLUMNS],
        "rows": rows,
        "window": f"{after['window_s']:g} s" + (f" ({times:.1f} L/U)" if times else ""),
        "ends": ", ".join(f"{name} {_change(before, after, key)} {unit}" for name, key, unit in ENDS),
        "figures": [row for b, a in runs for row in _figures(b, a)],
        "worse": worse,
        "count": len(runs),
    }


def _change(before: Mapping[str, Any], after: Mapping[str, Any], key: str) -> str:
    return " → ".join(_number(errors["pooled"][key]) for errors in (before, after))


def _row(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    cells = []
    for key, _ in COLUMNS:
        b, a = before.get(key), after.get(key)
        factor = 100.0 if key == "share_of_change" else 1.0
        worse = b is not None and a is not None and b < LESS * a
        cells.append({"before": _number(b, factor), "after": _number(a, factor), "worse": worse})
    return {"name": after["name"], "windows": after["windows"], "cells": cells}


def _figures(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[dict[str, str]]:
    """A row per manoeuvring figure of a run: measured, predicted before and after with their errors."""
    rows = []
    others = {(m["title"], f["figure"]): f for m in before["maneuvers"] for f in m["figures"]}
    for maneuver in after["maneuvers"]:
        for figure in maneuver["figures"]:
            old = others.get((maneuver["title"], figure["figure"]))
            rows.append({
                "run": after["name"],
                "title": maneuver["title"],
                "figure": figure["figure"].replace("_", " "),
                "unit": figure["unit"],
                "measured": _number(figure["measured"]),
                "before": f"{_number(old['predicted'])} ({old['error']:+.3g})" if old else "–",
                "after": f"{_number(figure['predicted'])} ({figure['error']:+.3g})",
                "worse": bool(old and abs(old["error"]) < LESS * abs(figure["error"])),
            })  # fmt: skip
    return rows


def _number(value: float | None, factor: float = 1.0) -> str:
    return "–" if value is None else f"{factor * value:.3g}".replace("-", "−")
