"""The report's section on what the trials determine, from "identifiability" of result.json."""

from __future__ import annotations

from typing import Any

from fitting.identifiability.analysis import KINDS

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
        {
            "symbol": symbol,
            "kind": row.get("kind", "unknown"),
            "share": _within(row.get("prior_share")),
            "alone": _within(row.get("share_if_all_others_were_known")),
            "cause": row.get("cause", ""),
            "advice": row.get("advice", ""),
        }
        for symbol, row in content["coefficients"].items()
    ]
    rank = {kind: i for i, kind in enumerate(reversed(KINDS))}
    trial = content.get("next_trial") or {}
    options = sorted(trial.get("options", []), key=lambda o: o.get("mean_prior_share") or 2.0)[:most_options]
    return {
        "rows": sorted(rows, key=lambda r: (rank.get(r["kind"], 0), -(r["share"] or 0.0))),
        "counts": [(KINDS[kind], sum(r["kind"] == kind for r in rows)) for kind in KINDS],
        "clusters": content.get("clusters", []),
        "directions": [
            " ".join(f"{weight:+.2f} {symbol}" for symbol, weight in d.get("weights", {}).items()).replace("-", "−")
            for d in content.get("weak_directions", [])
        ],
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


def _within(share: float | None) -> float | None:
    return None if share is None else min(max(share, 0.0), 1.0)
