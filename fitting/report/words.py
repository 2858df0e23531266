"""Words and numbers of the report: the headline, warnings, particulars with their units, rounding."""

from __future__ import annotations

import math

from mmg.ship import Ship


def plus_minus(value: float | None, std: float | None) -> str:
    """ "value ± std" rounded to two figures of the std, with true minus signs."""
    if value is None or not math.isfinite(value):
        return "–"
    if std is None or not math.isfinite(std) or std <= 0:
        return f"{value:.4g}".replace("-", "−")
    decimals = 1 - math.floor(math.log10(std))
    if float(f"{std:.1e}") >= 10 ** (2 - decimals):  # 0.0996 rounds up to 0.10
        decimals -= 1
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
    if before is None or after is None:
        return "could not be computed"
    numbers = f"from {before:.3g} to {after:.3g}"
    if after < before:
        factor = f"{before / after:.2g} times smaller" if after > 0 else "to nothing"
        return f"fell {numbers} ({factor})"
    return f"ROSE {numbers}" if after > before else f"stayed at {before:.3g}"


def headline(result: dict) -> dict[str, str]:
    """Sentences by name on ``result`` (content of result.json): what was calibrated, how much better, convergence."""
    data, scores = result.get("data", []), result.get("scores") or {}
    free = len(result["coefficients"])
    seconds = sum(row.get("duration_s") or 0 for row in data)
    what = f"{free} coefficient{'s' * (free != 1)} of {result.get('ship', '?')} calibrated on {len(data)} trial"
    what += f"{'s' * (len(data) != 1)} ({seconds:,.0f} s)."
    name = "validation" if "validation" in scores else "training" if "training" in scores else ""
    if not name:
        better = "No scores: the trials hold no positions, so predictions could not be judged."
    else:
        before, after = scores[name]["before"], scores[name]["after"]
        count = len(after["trials"])
        where = {"validation": f"{count} held-out trial{'s' * (count != 1)}", "training": "the training trials"}[name]
        better = (
            f"On {where} the error of 30 s predictions {change(before['window'], after['window'])}; "
            f"with restarts every 100 s it {change(before['paper'], after['paper'])}."
        )
    iterations = sum(p.get("iterations", 0) for p in result.get("passes") or [])
    iterations = iterations or result.get("iterations") or 0
    if result.get("converged"):
        state = f"Converged ({result.get('status', '')}) after {iterations} iterations."
    else:
        advice = result.get("advice") or "the best iterate is kept"
        state = f"NOT CONVERGED ({result.get('status', '')}) after {iterations} iterations: {advice}."
    return {"what": what, "better": better, "state": state}


def report_warnings(result: dict) -> list[str]:
    """The own warnings of ``result`` (content of result.json) and those that follow from its scores.

    Convergence has its own place in the report.
    """
    words = [m["text"] for m in result["messages"] if m["level"] == "warning" and m["code"] != "not_converged"]
    scores = result.get("scores") or {}
    if "validation" not in scores:
        words.append(
            "no held-out trials were scored: the fit was judged, if at all, on the trials it was made from, which "
            "says little about other manoeuvres; give some with --validate"
        )
    for name, label in (("validation", "held-out"), ("training", "training")):
        pair = scores.get(name)
        if not pair:
            continue
        rows = list(zip(pair["before"]["trials"], pair["after"]["trials"], strict=True))
        worse = [
            f"{b['name']} ({b['window']:.3g} to {a['window']:.3g})"
            for b, a in rows
            if b["window"] is not None and a["window"] is not None and a["window"] > b["window"]
        ]
        if worse:
            words.append(
                f"30 s predictions became worse on {len(worse)} of {len(rows)} {label} trials: {', '.join(worse)}"
            )
    trained = {row.get("sha256") for row in result.get("data", []) if row.get("sha256")}
    twice = [row["name"] for row in result.get("validation_data", []) if row.get("sha256") in trained]
    if twice:
        words.append(f"not held out at all, the same file was used in the calibration: {', '.join(twice)}")
    return words


def not_in_model(ship: Ship) -> list[str]:
    """What the model of ``ship`` leaves out, and where it goes instead."""
    words = [
        "current, waves, shallow water and banks: where present in the trials, their mean effect is absorbed by the "
        "coefficients, the rest shows in the residuals",
        "heel, trim and squat: three degrees of freedom (surge, sway, yaw)",
        "actuator dynamics: rudder and revolutions act as logged",
    ]
    if "wind" not in ship.components:
        words.insert(0, "wind: no wind model in this ship; its forces are absorbed like those of current")
    if "propeller" not in ship.components:
        words.append("propeller: no propeller model in this ship")
    return words


LABELS = {
    "window": "window length [s]",
    "step": "integration and sampling step [s]",
    "interval": "steps per shooting interval",
    "passes": "solves, noise re-estimated between them",
    "starts": "starts",
    "seed": "seed",
    "tolerance": "tolerance of IPOPT",
    "max_iterations": "iteration limit per solve",
    "time_limit": "time limit [s]",
    "sigma": "given residual sigma (x, y, psi, u, v, r)",
    "compiled": "C compiler allowed",
    "seeds": "trainings, from seeds one apart",
    "workers": "processes",
    "width": "neurons of each hidden layer",
    "symmetric": "port and starboard alike",
    "penalty": "weight of the penalty on the residual or the weights",
    "rate": "first learning rate of Adam",
    "last_rate": "last learning rate",
    "clip": "largest norm of a gradient",
    "batch": "windows per gradient step",
    "epochs": "passes over the windows",
    "curriculum": "length of rollouts [s], share of the epochs",
    "stride": "seconds between windows",
    "jitter": "noise added to the states, in that of the instruments",
    "block": "length of blocks where there are few runs [s]",
}


def setting_rows(result: dict) -> list[tuple[str, str]]:
    """Settings of ``result`` (content of result.json) in words."""
    rows = []
    for key, value in (result.get("settings") or {}).items():
        shown = {None: "none", True: "yes", False: "no"}.get(value) if not isinstance(value, list) else None
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            shown = f"{value:g}"
        if isinstance(value, list):
            shown = ", ".join(f"{v:g}" if isinstance(v, (int, float)) else str(v) for v in value)
        rows.append((LABELS.get(key, key), shown if shown is not None else str(value)))
    return rows


def per_run_table(result: dict) -> dict | None:
    """Table of the constants of each run in ``result`` (content of result.json), None where runs have none."""
    table = result.get("per_run")
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
