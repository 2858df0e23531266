"""The coefficients of a report: by component, with prior, estimate and what decided; correlated pairs."""

from __future__ import annotations

import math
from typing import Any

from fitting.identifiability.analysis import KINDS
from fitting.report.plots import component_of, determination, grouped, kinds_of
from fitting.report.words import plus_minus
from mmg.ship import Ship

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
