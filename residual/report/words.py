"""Words of the report on a training: the one sentence that matters, the criteria of the decision, tables of runs."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite, nan, sqrt
from typing import Any

from residual.training.decision import MINIMUM_GAIN


def percent(share: float | None, sign: bool = True) -> str:
    """A ``share`` in per cent with a true minus sign, and a plus where ``sign`` is wanted."""
    if share is None or not isfinite(share):
        return "–"
    if abs(share) < 0.0005:
        return "0.0 %"
    return f"{share:{'+' if sign else ''}.1%}".replace("-", "−").replace("%", " %")


def changed(gain: float) -> str:
    """A ``gain`` as a share in words: "become 1.2 % better" or the like."""
    if abs(gain) < 0.0005:
        return "stay as they are"
    return f"become {percent(abs(gain), False)} {'better' if gain > 0 else 'worse'}"


def headline(result: Mapping[str, Any]) -> dict[str, str]:
    """The one sentence of a training ``result``, whether it was kept, and what was trained on what."""
    data = result.get("data", [])
    seconds = sum(row.get("duration_s") or 0 for row in data)
    what = f"{len(result['per_seed'])} training(s) on {len(data)} trial(s), {seconds:,.0f} s"
    decision = result.get("decision")
    if not decision:
        return {"sentence": _box_sentence(result), "state": "", "what": f"{what}."}
    return {
        "sentence": _sentence(decision, result),
        "state": "kept" if result.get("kept", decision["kept"]) else "declined",
        "what": f"{what}; judged by {'the validation trials' if result.get('validation_data') else 'parts in turn'}.",
    }


def _sentence(decision: Mapping[str, Any], result: Mapping[str, Any]) -> str:
    """Kept or declined, by how much, and why."""
    gain = decision.get("improvement")
    if gain is None:
        return "The residual is declined and the calibrated ship stays as it is: every training diverged."
    chance = [f"{percent(decision.get('spread'), False)} among the trainings"]
    if decision.get("runs_error") is not None:
        chance.append(f"{percent(decision['runs_error'], False)} by the choice of the judging runs")
    gained = f"30 s predictions of windows it had never seen {changed(gain)}"
    far = decision.get("restarts")
    longer = "" if far is None else f"; 100 s predictions {changed(far)}"
    figures = f"{gained} (chance: {', '.join(chance)}){longer}"
    if decision["kept"]:
        return f"The residual is kept: {figures}."
    why = decision.get("reason") or "it does not pay"
    if result.get("kept"):
        return f"The residual is declined by the decision, but recommended by --keep always; {why}: {figures}."
    return f"The residual is declined and the calibrated ship stays as it is, because {why}: {figures}."


def _box_sentence(result: Mapping[str, Any]) -> str:
    """How a black box does on held-out trials, beside the ship that it was trained for."""
    scores = result.get("scores") or {}
    name = "validation" if "validation" in scores else "training" if "training" in scores else ""
    model = f"The black box {result.get('model', '')}"
    if not name:
        return f"{model} was trained; the trials hold no positions, so its predictions could not be scored."
    pair = scores[name]
    where = "on held-out trials" if name == "validation" else "on the trials it was trained on"
    words = f"{model} has an error of {pair['after']['window']:.3g} in 30 s predictions {where}"
    if "before" in pair:
        words += f", the ship model beside it ({result.get('beside') or 'as given'}) {pair['before']['window']:.3g}"
    return f"{words}; over 100 s {pair['after']['paper']:.3g}" + (
        f" and {pair['before']['paper']:.3g}." if "before" in pair else "."
    )


def criteria(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a residual has to fulfil to be kept: name, what ``result`` found, what is needed, whether it is so."""
    d = result.get("decision")
    if not d or d.get("improvement") is None:
        return []
    gain, spread, runs, far = (_float(d.get(k)) for k in ("improvement", "spread", "runs_error", "restarts"))
    count = sum(row["status"] != "diverged" for row in result["per_seed"])
    allowed = -_float(d.get("restarts_spread")) / sqrt(max(1, count))
    rows = [("30 s predictions improve", gain, MINIMUM_GAIN, gain >= MINIMUM_GAIN, "at least")]
    rows.append(("by more than the standard deviation among the trainings", gain, spread, gain > spread, "more than"))
    if isfinite(runs):
        rows.append(("by more than the standard error by the choice of runs", gain, runs, gain > runs, "more than"))
    if isfinite(far):
        words = "100 s predictions become no worse than by their standard error"
        rows.append((words, far, allowed, not far < allowed, "at least"))
    return [
        {"words": w, "found": percent(found), "needed": f"{relation} {percent(need)}", "good": good}
        for w, found, need, good, relation in rows
    ]


def _float(value: Any) -> float:
    return nan if value is None else float(value)


def judged_table(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Per judging run of ``result``: windows, errors before and after over the seeds it judged, changes."""
    seeds = [row["seed"] for row in result["per_seed"]]
    runs: dict[str, dict[int, dict]] = {}
    for row in result["per_seed"]:
        for part in row.get("judged_runs", []) if row["status"] != "diverged" else []:
            runs.setdefault(part["run"], {})[row["seed"]] = part
    table = []
    for name, parts in sorted(runs.items()):
        before, after = (sum(p[k] or nan for p in parts.values()) / len(parts) for k in ("before", "after"))
        table.append(
            {
                "run": name, "windows": next(iter(parts.values()))["windows"], "before": before, "after": after,
                "change": percent(after / before - 1 if before else None), "worse": after > 1.0005 * before,
                "seeds": [_change(parts.get(seed)) for seed in seeds],
            }
        )  # fmt: skip
    return table


def _unit(name: str) -> tuple[str, float]:
    """Unit of a feature in the report, angles in degrees, and the factor from SI."""
    if name == "r":
        return "deg/s", degrees(1)
    if name.startswith(("delta", "azimuth")):
        return "deg", degrees(1)
    return ("m/s", 1.0) if name in ("u", "v", "a_x", "a_y") else ("rev/s", 1.0)


def _change(part: Mapping[str, Any] | None) -> str:
    if not part or not part["before"] or part["after"] is None:
        return ""
    return percent(part["after"] / part["before"] - 1)


def envelope_rows(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Range of each feature in the training rows of ``result``, and in the validation rows with the share outside."""
    beyond = (result.get("outside") or {}).get("features", {})
    words = {
        "u": "surge velocity through the water", "v": "sway velocity through the water", "r": "yaw rate",
        "a_x": "air relative to the hull, ahead", "a_y": "air relative to the hull, to starboard",
    }  # fmt: skip
    rows = []
    for name, (low, high) in result["envelope"].items():
        unit, factor = _unit(name)
        meaning = words.get(name) or ("rudder angle" if name.startswith("delta") else "revolutions")
        own = beyond.get(name)
        if own:
            own = {**own, "lowest": factor * own["lowest"], "highest": factor * own["highest"]}
        both = {"low": factor * low, "high": factor * high}
        rows.append({"name": name, "words": "" if name == "azimuth" else meaning, "unit": unit, **both, "own": own})
    return rows
