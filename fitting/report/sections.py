"""What the sections of a report show of the content of result.json that a template does not read by itself: rows of
coefficients by component, ranked trials, and how a structure was chosen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cases.io.files import read_json
from fitting.identifiability.analysis import KINDS
from mmg.components.catalogue import ROLES, coefficient_table
from mmg.errors import UserError
from mmg.ship import Ship

GROUPS = ("mass", *ROLES, "effects", "other")


def component_of(ship: Ship) -> dict[str, str]:
    """Component each coefficient of ``ship`` belongs to: "mass", the role of its force model, or "effects"."""
    components = dict.fromkeys(coefficient_table({}, ship.particulars), "mass")
    for role, name in ship.components.items():
        for symbol in coefficient_table({role: name}, ship.particulars):
            components.setdefault(symbol, role)
    components |= dict.fromkeys(ship.monomials, "expansion")  # terms of a generated polynomial
    prefixes = tuple(f"{name}." for name in ship.effects)
    return components | dict.fromkeys((s for s in ship.coefficients if s.startswith(prefixes)), "effects")


def coefficient_groups(result: Mapping[str, Any], ship: Ship) -> list[dict[str, Any]]:
    """Rows for the table of coefficients by component of the ``ship``, and its fixed coefficients.

    result: content of result.json. A row is what that holds, with symbol, kind of finding, its cause in words and the
    test of the effect that it belongs to.
    """
    findings = (result.get("identifiability") or {}).get("coefficients", {})
    tests = {symbol: test for test in result.get("effects", []) for symbol in test["parameters"]}
    components = component_of(ship)
    groups: dict[str, dict[str, Any]] = {name: {"name": name, "rows": [], "fixed": []} for name in GROUPS}
    for symbol in [*ship.coefficients, *(s for s in result["coefficients"] if s not in ship.coefficients)]:
        name, row = components.get(symbol, "other"), result["coefficients"].get(symbol)
        group = groups.setdefault(name, {"name": name, "rows": [], "fixed": []})
        if row is None:
            group["fixed"].append(f"{symbol} = {ship.coefficients[symbol].value:.6g}")
            continue
        finding = findings.get(symbol, {})
        kind = finding.get("kind", "unknown")
        more = {"symbol": symbol, "kind": kind, "cause": finding.get("cause", KINDS[kind]), "test": tests.get(symbol)}
        group["rows"].append({**row, **more})
    return [group for group in groups.values() if group["rows"] or group["fixed"]]


def identifiability_section(result: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the template shows of identifiability in ``result`` (content of result.json), None where it is missing."""
    content = result.get("identifiability")
    if not isinstance(content, dict) or not isinstance(content.get("coefficients"), dict):
        return None
    trial = {"overall": None, "left_out": [], "worth": None, "options": [], "best": {}} | (
        content.get("next_trial") or {}
    )
    helped: dict[str, list[str]] = {}
    for symbol, best in trial["best"].items():
        if best and best["variance_left"] is not None:
            helped.setdefault(best["name"], []).append(f"{symbol} (−{1 - best['variance_left'] ** 0.5:.0%})")
    ranked = sorted(trial["options"], key=lambda option: option.get("mean_prior_share") or 2.0)  # null: behind all
    shown = [row for i, row in enumerate(ranked) if i < 10 or row["name"] in helped]  # ten set by hand: display
    return {**content, "trial": trial, "options": shown, "helped": helped}


SELECTION = "selection.json"
# Keys of a candidate in selection.json that the page shows; errors are None where it ran away.
SHOWN = ("name", "words", "unknowns", "validation", "training", "stable", "sequences", "left_out")


def structure_section(folder: Path) -> dict[str, Any] | None:
    """What the template shows of the choice in a run ``folder``; None where there was none, or it cannot be read."""
    try:
        content = read_json(folder / SELECTION)
        rows = [{key: row[key] for key in SHOWN} for row in content["candidates"]]
        # the best first; then those that ran away, then those that were not tried
        rows.sort(key=lambda row: (bool(row["left_out"]), row["validation"] is None, row["validation"] or 0.0))
        stability = {key: float(content["stability"][key]) for key in ("sequences", "diverged", "speed")}
        test = list(content["test"].items())
        chosen = content["chosen"]
    except (OSError, UserError, LookupError, TypeError, ValueError, AttributeError):
        return None
    return {
        "chosen": chosen,
        "words": next((row["words"] for row in rows if row["name"] == chosen), ""),
        "rows": rows,
        "test": test,
        "stability": stability,
    }


def plus_minus(value: float | None, std: float | None) -> str:
    """ "value ± std" rounded to two figures of the std, with true minus signs."""
    if value is None or not math.isfinite(value):
        return "–"
    if std is None or not math.isfinite(std) or std <= 0:
        return f"{value:.4g}".replace("-", "−")
    decimals = 1 - int(f"{std:.1e}".split("e")[1])  # of the rounded one: 0.0996 is 0.10
    if decimals > 6 or decimals < -3:  # set by hand: longer numbers as powers of ten
        power = math.floor(math.log10(max(abs(value), std)))
        scale = 10.0**power
        digits = max(0, decimals + power)
        words = f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{power}"
    else:
        words = f"{value:.{max(0, decimals)}f} ± {std:.{max(0, decimals)}f}"
    return words.replace("-", "−")


def report_warnings(result: dict) -> list[str]:
    """The warnings of ``result`` (content of result.json), and one where no trials were held out. Convergence has its
    own place in the report."""
    words = [m["text"] for m in result["messages"] if m["level"] == "warning" and m["code"] != "not_converged"]
    if "validation" not in result["scores"] and not result.get("scaling"):
        words.append(
            "no held-out trials were scored: the fit was judged, if at all, on the trials it was made from, which "
            "says little about other manoeuvres; give some with --validate"
        )
    return words


def shown_number(value: Any, digits: int = 3) -> str:
    """A ``value`` with this many ``digits`` and a true minus sign, a dash where there is none; texts as they are."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    return f"{value:.{digits}g}".replace("-", "−") if isinstance(value, (int, float)) else str(value)


def shown_setting(value: Any) -> str:
    """The ``value`` of a setting in result.json in words."""
    if isinstance(value, list):
        return ", ".join(map(shown_setting, value)) or "none"
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, (int, float)) else str(value) or "none"
