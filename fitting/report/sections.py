"""What the sections of a report show of the content of result.json: identifiability, scores, errors in units, tables of
coefficients and constants, and how a structure was chosen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cases.io.files import read_json
from cases.trial import UNITS
from fitting.identifiability.analysis import KINDS
from fitting.prediction.score import WINDOW
from fitting.report.plot_style import figures_of
from fitting.report.plots import component_of, determination, grouped, kinds_of
from fitting.report.words import plus_minus
from mmg.errors import UserError
from mmg.ship import Ship
from mmg.states import STATES

LARGE = 1e12
"""Condition number of the information beyond which the numbers themselves are in doubt (MuJoCo's limit)."""


def section(result: dict, most_options: int = 10) -> dict[str, Any] | None:
    """What the template shows of identifiability in ``result`` (content of result.json), None where it is missing.

    most_options: trials of the library shown at most.
    """
    content = result.get("identifiability")
    if not isinstance(content, dict) or not isinstance(content.get("coefficients"), dict):
        return None
    rows = [
        {"kind": "unknown", "cause": "", "advice": ""} | row | {"symbol": s, "share": capped(row.get("prior_share"))}
        for s, row in content["coefficients"].items()
    ]
    rank = {kind: i for i, kind in enumerate(reversed(KINDS))}
    trial = content.get("next_trial") or {}
    options = sorted(trial.get("options", []), key=lambda o: o.get("mean_prior_share") or 2.0)[:most_options]
    return {
        "rows": sorted(rows, key=lambda r: (rank.get(r["kind"], 0), -(r["share"] or 0.0))),
        "counts": [(KINDS[kind], sum(r["kind"] == kind for r in rows)) for kind in KINDS],
        "clusters": content.get("clusters", []),
        "condition": content.get("condition_number"),
        "condition_with_prior": content.get("condition_number_with_prior"),
        "ill": content.get("condition_number") is None or content["condition_number"] > LARGE,
        "duration": trial.get("duration_s"),
        "before": trial.get("mean_prior_share"),
        "worth": trial.get("worth"),
        "options": options,
        "plan": trial.get("plan", []),
        "left_out": trial.get("left_out", []),
    }


def score_sets(result: dict) -> list[dict]:
    """The sets of trials scored in ``result`` (content of result.json), before and after, ready for the table."""
    sets = []
    for name, pair in result["scores"].items():
        before, after = pair["before"], pair["after"]
        sigma = [f"{s} {v:.4g} {UNITS[s]}" for s, v in after["sigma"].items() if v is not None]
        sets.append({
            "name": {"validation": "Held-out trials", "training": "Training trials"}.get(name, name),
            "key": name,
            "rows": [_score_row(b["name"], b, a) for b, a in zip(before["trials"], after["trials"], strict=True)],
            "pooled": _score_row("all rows pooled", before, after),
            "sigma": ", ".join(sigma),
            "sigma_from": after["sigma_from"],
            "notes": after["notes"],
            "units": unit_section(pair),
            "by_state": [{when: _pooled(pair[when]["trials"], s) for when in ("before", "after")} for s in STATES],
        })  # fmt: skip
    return sets


def _score_row(name: str, before: dict, after: dict) -> dict:
    row = {"name": name, "windows": after.get("windows")}
    for key in ("window", "paper"):
        b, a = before.get(key), after.get(key)
        row[key] = {"before": b, "after": a, "gain": b / a if a and b is not None else None}
    return row


def _pooled(trials: list[dict], state: str) -> float | None:
    """One state's part of the 30 s-window error, pooled by the number of windows."""
    parts = [(t["window_by_state"][state], t["windows"]) for t in trials if t.get("windows")]
    total = sum(count for _, count in parts)
    good = total and all(value is not None for value, _ in parts)
    return sum(value * count for value, count in parts) / total if good else None


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


DECIDED = {
    "determined": "data",
    "partly": "data in part",
    "shared": "shared with others",
    "prior": "prior",
    "silent": "prior (not excited)",
    "strained": "in conflict with the prior",
    "bound": "bound",
    "unknown": "unknown",
}
"""Kind of a finding in the table of coefficients: what decided."""


def coefficient_groups(result: dict, ship: Ship) -> list[dict]:
    """Rows for the coefficient table by component of the ``ship``, and fixed coefficients of the same component.

    result: content of result.json.
    """
    kinds = kinds_of(result)
    rows: dict[str, Any] = dict.fromkeys(ship.coefficients) | result["coefficients"]
    tests = {symbol: test for test in result.get("effects", []) for symbol in test["parameters"]}
    return [
        {
            "name": group,
            "rows": [
                _coefficient(symbol, rows[symbol], kinds.get(symbol, "")) | {"test": tests.get(symbol)}
                for symbol in symbols
                if rows[symbol]
            ],
            "fixed": [f"{s} = {ship.coefficients[s].value:.6g}" for s in symbols if not rows[s]],
        }
        for group, symbols in grouped(rows, component_of(ship))
    ]


def _coefficient(symbol: str, row: dict, found: str) -> dict:
    share = row["prior_share"]
    kind = found if found in KINDS else determination(share)
    return row | {
        "symbol": symbol,
        "prior": plus_minus(row["prior_value"], row["prior_std"]),
        "estimate": plus_minus(row["value"], row["std"]),
        "shift": (row["value"] - (row["prior_value"] or 0.0)) / (row["prior_std"] or math.nan),
        "share": capped(share),
        "kind": kind,
        "decided": DECIDED[kind],
        "limits": f"{shown_number(row['lower'])} to {shown_number(row['upper'])}",
    }


def correlated_pairs(result: dict, most: int = 12, least: float = 0.7) -> list[tuple[str, str, float]]:
    """Pairs of coefficients in ``result`` whose estimates are correlated by at least ``least``, strongest first;
    at most ``most``."""
    symbols = result["correlation"]["symbols"]
    pairs = [
        (symbols[i], symbols[j], value)
        for i, row in enumerate(result["correlation"]["matrix"])
        for j, value in enumerate(row[:i])
        if value is not None and abs(value) >= least
    ]
    return sorted(pairs, key=lambda p: -abs(p[2]))[:most]


def capped(share: float | None) -> float | None:
    """A ``share`` within 0 and 1; None stays None."""
    return None if share is None else min(max(share, 0.0), 1.0)


def shown_number(value: Any, digits: int = 3) -> str:
    """A ``value`` with this many ``digits`` and a true minus sign, a dash where there is none; texts as they are."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−") if isinstance(value, (int, float)) else str(value)


def per_run_table(result: dict) -> dict | None:
    """Table of the constants of each run in ``result`` (content of result.json), None where runs have none."""
    return _constants(result.get("per_run"))


def campaign_section(result: dict) -> dict | None:
    """What the template shows of campaigns in ``result`` (content of result.json), None where trials are of one."""
    content = result.get("campaigns")
    if not content:
        return None
    left_out = content.get("left_out") or {}
    return {
        "runs": list(content["runs"].items()),
        "sentences": content["sentences"],
        "table": _constants(content["values"]),
        "without": left_out.get("without"),
        "own": left_out.get("with"),
        "tried": [
            row | {"measured": row.get("measured"), "chance": _chance(row.get("chance"))} for row in content["tried"]
        ],
    }


def _chance(p: float | None) -> str:
    """A probability in two digits."""
    return "" if p is None else "< 0.0001" if p < 1e-4 else f"{p:.2g}"


def _constants(table: dict | None) -> dict | None:
    """Names, rows and prior of constants by run or campaign; None for none."""
    if not table:
        return None
    first = next(iter(table.values()))
    return {
        "names": [f"{symbol} [{row['unit']}]" if row["unit"] else symbol for symbol, row in first.items()],
        "rows": [
            (run, [plus_minus(row["value"], row["std"]) for row in cells.values()]) for run, cells in table.items()
        ],
        "prior": [plus_minus(row["prior_value"], row["prior_std"]) for row in first.values()],
    }


SELECTION = "selection.json"
SHOWN = ("name", "words", "unknowns", "validation", "training", "stable", "sequences", "left_out")
"""Keys of a candidate in selection.json that the page shows; errors are None where it ran away."""
TESTED = {"as given": "the ship as given", "mmg calibrated": "the ship calibrated", "chosen": "the chosen model"}
"""What the keys of the test's errors mean."""
CHOICE_FIGURES = {
    "structures": (
        "Complexity and error",
        "Unknowns against the error of trials that no candidate was fitted to. The filled point is the chosen model; "
        "with fewer unknowns a model is easier to trust beyond its trials.",
    ),
    "learning": (
        "Learning curves",
        "Error during learning, on subsequences of the trials of the fit and of those it was chosen by.",
    ),
}
"""Title and caption of each figure of a choice."""


def structure_section(folder: Path) -> dict[str, Any] | None:
    """What the template shows of the choice in a run ``folder``; None where there was none, or it cannot be read."""
    try:
        content = read_json(folder / SELECTION)
        rows = [{key: row[key] for key in SHOWN} for row in content["candidates"]]
        rows.sort(key=lambda row: (bool(row["left_out"]), row["validation"] is None, row["validation"] or 0.0))
        stability = {key: float(content["stability"][key]) for key in ("sequences", "diverged", "speed")}
        test = [(TESTED.get(name, name), error) for name, error in content["test"].items()]
        chosen = content["chosen"]
    except (OSError, UserError, LookupError, TypeError, ValueError, AttributeError):
        return None
    listed = [
        {"file": f"{name}.png", "title": title, "caption": caption}
        for name, (title, caption) in CHOICE_FIGURES.items()
        if (folder / "figures" / f"{name}.png").is_file()
    ]
    return {
        "chosen": chosen,
        "words": next((row["words"] for row in rows if row["name"] == chosen), ""),
        "rows": rows,
        "test": test,
        "stability": stability,
        "figures": figures_of(folder, listed),
    }
