"""Words and numbers of the report: the headline, warnings, particulars with their units, rounding."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fitting.prediction.score import is_worse
from mmg.ship import Ship


def plus_minus(value: float | None, std: float | None) -> str:
    """ "value ± std" rounded to two figures of the std, with true minus signs."""
    if value is None or not math.isfinite(value):
        return "–"
    if std is None or not math.isfinite(std) or std <= 0:
        return f"{value:.4g}".replace("-", "−")
    decimals = 1 - int(f"{std:.1e}".split("e")[1])  # of the rounded one: 0.0996 is 0.10
    if decimals > 6 or decimals < -3:
        power = math.floor(math.log10(max(abs(value), std)))
        scale = 10.0**power
        digits = max(0, decimals + power)
        words = f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{power}"
    else:
        words = f"{value:.{max(0, decimals)}f} ± {std:.{max(0, decimals)}f}"
    return words.replace("-", "−")


def change(before: float | None, after: float | None) -> str:
    """How an error changed from ``before`` to ``after``, in words."""
    if after is None:
        return "could not be computed: the prediction diverges"
    if before is None:
        return f"is {after:.3g} (that of the ship before diverges)"
    numbers = f"from {before:.3g} to {after:.3g}"
    if is_worse(before, after):
        return f"ROSE {numbers}"
    if not is_worse(after, before):
        return f"stayed at {before:.3g}"
    return f"fell {numbers} ({f'{before / after:.3g} times smaller' if after > 0 else 'to nothing'})"


def headline(result: dict) -> dict[str, str]:
    """Sentences by name on ``result`` (content of result.json): what was calibrated, how much better, convergence."""
    data, scores = result["data"], result["scores"]
    if scaling := result.get("scaling"):
        return _scaled_headline(result, scaling)
    free, seconds = len(result["coefficients"]), sum(row["duration_s"] for row in data)
    what = f"{free} coefficient{'s' * (free != 1)} of {result['ship']} calibrated on {len(data)} trial"
    what += f"{'s' * (len(data) != 1)} ({seconds:,.0f} s)."
    better = "No scores: the trials hold no positions, so predictions could not be judged."
    if pair := scores.get("validation") or scores.get("training"):
        before, after, count = pair["before"], pair["after"], len(pair["after"]["trials"])
        where = f"{count} held-out trial{'s' * (count != 1)}" if "validation" in scores else "the training trials"
        better = (
            f"On {where} the mean squared normalised error [-] of 30 s predictions "
            f"{change(before['window'], after['window'])}; "
        )
        restarts = any(t.get("restarts", True) for t in after["trials"])  # of older versions the number is not known
        over = f"with restarts every 100 s it {change(before['paper'], after['paper'])}."
        better += over if restarts else "there is nothing to score over 100 s."
    iterations = sum(p["iterations"] for p in result["passes"])
    state = f"Converged ({result['status']}) after {iterations} iterations."
    if not result["converged"]:
        advice = result["advice"] or "the best iterate is kept"
        state = f"NOT CONVERGED ({result['status']}) after {iterations} iterations: {advice}."
    return {"what": what, "better": better, "state": state}


def _scaled_headline(result: dict, scaling: dict) -> dict[str, str]:
    """``headline`` of a ship that was scaled from a model."""
    model = scaling["model"]
    what = f"{result['ship']}: {model['ship']} of {model['length_m']:g} m scaled to {scaling['length_m']:g} m."
    trials = len(model["trials"])
    known = f"calibrated on {trials} trial{'s' * (trials != 1)}" if trials else "known by its priors alone"
    better = f"The model is {known}; no trial of the ship herself took part, so no score says how good she is."
    state = "Scaled." if result["converged"] else f"THE CALIBRATION OF THE MODEL DID NOT CONVERGE ({result['status']})."
    return {"what": what, "better": better, "state": state}


def report_warnings(result: dict) -> list[str]:
    """The own warnings of ``result`` (content of result.json) and those that follow from its scores.

    Convergence has its own place in the report.
    """
    words = [m["text"] for m in result["messages"] if m["level"] == "warning" and m["code"] != "not_converged"]
    if "validation" not in result["scores"] and not result.get("scaling"):
        words.append(
            "no held-out trials were scored: the fit was judged, if at all, on the trials it was made from, which "
            "says little about other manoeuvres; give some with --validate"
        )
    for name, label in (("validation", "held-out"), ("training", "training")):
        pair = result["scores"].get(name, {"before": {"trials": []}, "after": {"trials": []}})
        rows = list(zip(pair["before"]["trials"], pair["after"]["trials"], strict=True))
        worse = [
            f"{b['name']} ({b['window']:.3g} to {a['window']:.3g})"
            for b, a in rows
            if b["window"] is not None and a["window"] is not None and is_worse(b["window"], a["window"])
        ] + [f"{b['name']} (diverges)" for b, a in rows if b["window"] is not None and a["window"] is None]
        if worse:
            words.append(
                f"30 s predictions became worse on {len(worse)} of {len(rows)} {label} trials: {', '.join(worse)}"
            )
    trained = {row["sha256"] for row in result["data"] if row["sha256"]}
    twice = [row["name"] for row in result["validation_data"] if row["sha256"] in trained]
    if twice:
        words.append(f"not held out at all, the same file was used in the calibration: {', '.join(twice)}")
    return words


def not_in_model(ship: Ship) -> list[str]:
    """What the model of ``ship`` leaves out, and where it goes instead."""
    no_wind = "wind: no wind model in this ship; its forces are absorbed like those of current"
    return [
        *([] if ship.feels_wind else [no_wind]),
        "current, waves, shallow water and banks: where present in the trials, their mean effect is absorbed by the "
        "coefficients, the rest shows in the residuals",
        "heel, trim and squat: three degrees of freedom (surge, sway, yaw)",
        "actuator dynamics: rudder and revolutions act as logged",
        *(["propeller: no propeller model in this ship"] if "propeller" not in ship.components else []),
    ]


def setting_rows(settings: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The ``settings`` in result.json by their keys, as a file of settings has them."""
    return [(key, _shown(value)) for key, value in settings.items()]


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(f"{v:g}" if isinstance(v, (int, float)) else str(v) for v in value) or "none"
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, (int, float)) else str(value) or "none"
