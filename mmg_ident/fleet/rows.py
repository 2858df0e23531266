"""What the table and the page of a fleet say of one ship, as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from diagnosis.groups.between import difference, nature
from fitting.report.run_folder import plain
from mmg.effects import EFFECTS

if TYPE_CHECKING:
    from diagnosis.groups.findings import Between
    from diagnosis.result import Diagnosis
    from fitting.prediction.score import ScorePair
    from fitting.result import FitResult
    from mmg_ident.fleet.plan import PlannedShip

ALIKE, CHANCE = 2.0, 0.01
"""Difference in log Bayes factor below which two names of a difference are alike; chance below which it is one."""
MOVED, SURE = 1.0, 2.576
"""A coefficient has moved against its start by so many standard deviations of that, and of its own (99 %)."""


def ship_row(
    ship: PlannedShip, result: FitResult, diagnosis: Diagnosis | None, left_out: Sequence[str]
) -> dict[str, Any]:
    """The row of a ``ship`` that was calibrated (``result``); diagnosis: of it, None for none; left_out: sentences on
    files. Returns plain values."""
    coefficients = _coefficients(ship, result)
    names = {"validation": "held_out", "training": "training"}
    told = result.campaigns or {}
    row: dict[str, Any] = {
        "name": ship.name,
        "sisters": ship.sisters,
        "status": "done" if result.converged else "not converged",
        "reason": "" if result.converged else result.advice or result.status,
        "start": ship.start.title,
        "length": ship.start.particulars["L"],
        "trials": len(result.data),
        "held_out": len(result.validation_data),
        "seconds_used": result.seconds_used,
        "loss": result.settings.loss,
        "weight": result.settings.weight,
        "campaigns": list(told.get("runs", {})),
        "scores": {key: _scores(result.scores[name]) for name, key in names.items() if name in result.scores},
        "coefficients": coefficients,
        "moved": sorted(
            (s for s, c in coefficients.items() if _has_moved(c)), key=lambda s: -abs(coefficients[s]["moved"])
        ),
        "instruments": [*left_out, *told.get("sentences", [])],
        "drifted": [],
        "warnings": list(result.warnings),
    }
    return plain(row | (_diagnosed(row, diagnosis) if diagnosis else {"verdict": "", "sentence": "", "effects": []}))


def _coefficients(ship: PlannedShip, result: FitResult) -> dict[str, dict[str, Any]]:
    """Estimate and start of each coefficient, and by how many standard deviations of the start it moved."""
    rows = {}
    for symbol, c in result.coefficients.items():
        start = ship.start.coefficients.get(symbol)
        value, std = (start.value, start.std) if start else (c.prior_value, c.prior_std)
        rows[symbol] = {
            "value": c.value,
            "std": c.std,
            "unit": c.unit,
            "description": c.description,
            "start": value,
            "start_std": std,
            "moved": (c.value - value) / std if value is not None and std else math.nan,
        }
    return rows


def _has_moved(c: Mapping[str, Any]) -> bool:
    change = abs(c["value"] - c["start"]) if c["start"] is not None else 0.0
    return abs(c["moved"]) >= MOVED and c["std"] is not None and change > SURE * c["std"]


def _scores(pair: ScorePair) -> dict[str, Any]:
    """Both metrics before and after, errors in units after, and errors of manoeuvring figures after."""
    found: dict[str, Any] = {
        name: {"before": getattr(pair.before, name), "after": getattr(pair.after, name)} for name in ("window", "paper")
    }
    units = pair.after.units
    if units:
        found["window_s"] = units.window_s
        found["position_m"] = units.pooled.position_m
        found["heading_deg"] = units.pooled.heading_deg
        found["figures"] = [
            {"run": run.name, "maneuver": m.title, "figure": f.figure, "unit": f.unit, "measured": f.measured,
             "predicted": f.predicted}
            for run in units.runs for m in run.maneuvers for f in m.figures
        ]  # fmt: skip
    return found


def _diagnosed(row: Mapping[str, Any], found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis adds to a row: verdict, effects, what drifted between campaigns, what instruments show."""
    between = found.between
    differences = between.differences if between else ()
    drifted = [
        {"name": d.name, "campaign": d.group, "p_value": d.p_value, "text": difference(d)}
        for d in differences
        if d.nature == "ship"
    ]
    drifted += one_of_several(between) if between else []
    other = [f"between campaigns: {difference(d)}" for d in differences if d.nature == "instrument"]
    named = [e for e in found.effects if nature(e.name) == "instrument"]
    instruments = [
        *row["instruments"],
        *(f"{e.name}: {_sizes(e.parameters)}" for e in named),
        *(fault.sentence for fault in found.instruments),
        *found.kinematics,
        *other,
    ]
    surroundings = [difference(d) for d in differences if d.nature == "surroundings"]
    return {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "effects": [{"name": e.name, "p_value": e.p_value, "text": _sizes(e.parameters)} for e in found.effects],
        "compared": list(between.groups) if between else [],
        "between": between.verdict if between else "",
        "between_sentence": _between_words(between.sentence, drifted, surroundings) if between else "",
        "drifted": drifted,
        "surroundings": surroundings,
        "instruments": list(dict.fromkeys(instruments)),
        "reduction": found.held_out.reduction if found.held_out else None,
        "warnings": [*row["warnings"], *found.warnings, *(between.warnings if between else ())],
    }


def one_of_several(between: Between) -> list[dict[str, Any]]:
    """What drifted by the comparison ``between`` campaigns where several names explain it equally well, of which one at
    least is of the ship. Returns rows, [] where there is none."""
    if between.verdict != "unknown" or not between.candidates:
        return []
    best = between.candidates[0]
    alike = [
        d
        for d in between.candidates
        if best.log_bayes - d.log_bayes < ALIKE and d.p_value < CHANCE and d.log_bayes > ALIKE
    ]
    if not any(d.nature == "ship" for d in alike):
        return []
    alike.sort(key=lambda d: d.name not in EFFECTS)  # causes before the coefficients that they change
    best = alike[0]
    rest = ", ".join(d.name for d in alike[1:])
    words = difference(best) + (f"; {rest} would explain it as well" if rest else "; it explains a part of it")
    return [
        {"name": " or ".join(d.name for d in alike), "campaign": best.group, "p_value": best.p_value, "text": words}
    ]


def _between_words(sentence: str, *named: Sequence[Any]) -> str:
    """The ``sentence`` of a comparison, about campaigns, where nothing is ``named``; else "" as rows say it."""
    return "" if any(named) else sentence.replace("groups by group", "campaigns")


def _sizes(parameters: Mapping[str, Any]) -> str:
    """Estimates of the parameters of an effect in words."""
    return ", ".join(f"{k} = {p.value:.3g} ± {p.std:.2g} {p.unit}".rstrip() for k, p in parameters.items())
