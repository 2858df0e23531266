"""The report on a training: one self-contained HTML page from run folders of ``mmg train``, without torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, nan, sqrt
from pathlib import Path
from typing import Any

from fitting.prediction.score import in_words
from fitting.report.delivered import Delivered, delivery_sections
from fitting.report.page import citations_of, environment, score_sets
from fitting.report.plot_style import figures_of
from fitting.report.use import shown_quantity
from fitting.report.words import setting_rows
from mmg.ship import Ship
from residual.decide import MINIMUM_GAIN

TROUBLE = 0.2
"""Share of validation rows outside the training range from which on the report warns."""


def page_of(runs: Sequence[tuple[str, Path, Mapping[str, Any], Ship | None]], known: Sequence[Delivered] = ()) -> str:
    """One self-contained HTML page on trainings.

    runs: of each its name, the folder that holds its figures, the content of its result.json, and the ship that it
    recommends, None of a black box. known: of each its trials and its form for IMO; none by default.
    """
    deliveries = [*known, *(Delivered() for _ in runs[len(known) :])]
    shown = [_run(*run[:3], number + 1) | _use(*run[2:], deliveries[number]) for number, run in enumerate(runs)]
    states = [(run.get("name", run["result"]["ship"]), run["title"], run["headline"]["state"]) for run in shown]
    titles = [f"{ship}: {title}" + (f" ({state})" if state else "") for ship, title, state in states]
    return environment().get_template("training.html.j2").render(runs=shown, titles=titles, percent=percent)


def _run(label: str, folder: Path, result: Mapping[str, Any], number: int) -> dict[str, Any]:
    """All that the template shows of one training."""
    hybrid, outside = "decision" in result, result["outside"].get("trials", {})
    settings = {k: v for k, v in result["settings"].items() if hybrid or k != "symmetric"}
    return {
        "id": f"run{number}",
        "label": label,
        "result": result,
        "hybrid": hybrid,
        "title": "learned residual" if hybrid else f"black box {result['model']}",
        "before": "calibrated ship" if hybrid else "ship model",
        "after": "with residual" if hybrid else "black box",
        "headline": headline(result),
        "warnings": _warnings(result, outside),
        "criteria": criteria(result),
        "judged": judged_table(result),
        "seeds": [f"seed {row['seed']}" for row in result["per_seed"]],
        "scores": score_sets(dict(result)),
        "figures": {f["name"]: f for f in figures_of(folder, result["figures"])},
        "size": result.get("residual_size") or {},
        "envelope": envelope_rows(result),
        "outside": outside,
        "settings": setting_rows(settings),
        "citations": citations_of(dict(result)),
    }


def _use(result: Mapping[str, Any], ship: Ship | None, known: Delivered) -> dict[str, Any]:
    """What the template shows on the use of a ``ship``, in sections that follow the eight others."""
    if ship is None:
        return {"use": False}
    usable = (result.get("calibration") or {}).get("converged") is not False
    numbers = {"first": 9, "numbered": False, "usable": usable}
    return {
        "use": True,
        "name": ship.called,
        "about": ship.title if ship.mark else "",
        **numbers,
        **delivery_sections(result, ship, known),
    }


def _warnings(result: Mapping[str, Any], outside: Mapping[str, float]) -> list[str]:
    """Its own warnings and those that follow from its numbers; outside: share of the rows of each trial."""
    words = list(result["warnings"])
    far = ", ".join(f"{name} ({percent(share, False)})" for name, share in outside.items() if share > TROUBLE)
    if far:
        words.append(f"much of these validation trials lies outside the network's training range: {far}")
    if "decision" not in result and not result["validation_data"]:
        words.append("no trials were held out: the scores are those of the training trials; give some with --validate")
    restarted = [str(row["seed"]) for row in result["per_seed"] if row["restarts"] and row["status"] != "diverged"]
    if restarted:
        words.append(f"diverged at first and trained again at a lower rate: seed(s) {', '.join(restarted)}")
    return words


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
    data, decision = result["data"], result.get("decision")
    seconds = sum(row["duration_s"] for row in data)
    what = f"{len(result['per_seed'])} training(s) on {len(data)} trial(s), {seconds:,.0f} s"
    if not decision:
        return {"sentence": _box_sentence(result), "state": "", "what": f"{what}."}
    return {
        "sentence": _sentence(decision, result["kept"]),
        "state": "kept" if result["kept"] else "declined",
        "what": f"{what}; judged by {'the validation trials' if result['validation_data'] else 'parts in turn'}.",
    }


def _sentence(decision: Mapping[str, Any], kept: bool) -> str:
    """Kept or declined, by how much, and why."""
    gain, far = decision["improvement"], decision["restarts"]
    if gain is None:
        return "The residual is declined and the calibrated ship stays as it is: every training diverged."
    chance = [f"{percent(decision['spread'], False)} among the trainings"]
    ends = decision.get("lowest"), decision.get("highest")
    if None not in ends:
        chance.append(f"on other runs {percent(ends[0])} to {percent(ends[1])}, 90 %")
    longer = "" if far is None else f"; 100 s predictions {changed(far)}"
    figures = f"30 s predictions of windows it had never seen {changed(gain)} (chance: {', '.join(chance)}){longer}"
    if decision["kept"]:
        return f"The residual is kept: {figures}."
    why = decision["reason"] or "it does not pay"
    if kept:
        return f"The residual is declined by the decision, but recommended by --keep always; {why}: {figures}."
    return f"The residual is declined and the calibrated ship stays as it is, because {why}: {figures}."


def _box_sentence(result: Mapping[str, Any]) -> str:
    """How a black box does on held-out trials, beside the ship that it was trained for."""
    scores, model = result["scores"], f"The black box {result['model']}"
    name = next((n for n in ("validation", "training") if n in scores), "")
    if not name:
        return f"{model} was trained; the trials hold no positions, so its predictions could not be scored."
    before, after = scores[name]["before"], scores[name]["after"]
    where = "on held-out trials" if name == "validation" else "on the trials it was trained on"
    restarts = any(t.get("restarts", True) for t in after["trials"])
    trained, ship = ([in_words(score[key]) for key in ("window", "paper")] for score in (after, before))
    over = f"over 100 s {trained[1]} and {ship[1]}" if restarts else "there is nothing to score over 100 s"
    return (
        f"{model} has an error of {trained[0]} in 30 s predictions {where}, the ship model beside it "
        f"({result['beside']}) {ship[0]}; {over}."
    )


def criteria(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a residual has to fulfil to be kept: name, what ``result`` found, what is needed, whether it is so."""
    d = result.get("decision")
    if not d or d["improvement"] is None:
        return []
    found = {name: nan if value is None else value for name, value in d.items()}
    gain, spread, far = (found[name] for name in ("improvement", "spread", "restarts"))
    chance = gain - found.get("lowest", nan)
    count = sum(row["status"] != "diverged" for row in result["per_seed"])
    allowed = -found["restarts_spread"] / sqrt(max(1, count))
    rows = [("30 s predictions improve", gain, MINIMUM_GAIN, gain >= MINIMUM_GAIN, "at least")]
    rows.append(("by more than the standard deviation among the trainings", gain, spread, gain > spread, "more than"))
    if isfinite(chance):
        rows.append(("by more than chance by the choice of runs (95 %)", gain, chance, gain > chance, "more than"))
    if isfinite(far):
        words = "100 s predictions become no worse than by their standard error"
        rows.append((words, far, allowed, not far < allowed, "at least"))
    table = [
        {"words": w, "found": percent(value), "needed": f"{relation} {percent(need)}", "good": good}
        for w, value, need, good, relation in rows
    ]
    if d["reason"] and all(row["good"] for row in table):
        table.append({"words": "nothing else speaks against it", "found": d["reason"], "needed": "", "good": False})
    return table


def judged_table(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Per judging run of ``result``: windows, errors before and after over the seeds it judged, changes."""
    seeds = [row["seed"] for row in result["per_seed"]]
    runs: dict[str, dict[int, dict]] = {}
    for row in result["per_seed"]:
        for part in row["judged_runs"] if row["status"] != "diverged" else []:
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


def _change(part: Mapping[str, Any] | None) -> str:
    if not part or not part["before"] or part["after"] is None:
        return ""
    return percent(part["after"] / part["before"] - 1)


def envelope_rows(result: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Range of each feature in the training rows of ``result``, and in the validation rows with the share outside."""
    beyond, rows = result["outside"].get("features", {}), []
    for name, (low, high) in result["envelope"].items():
        words, unit, factor = shown_quantity(name)
        own = beyond.get(name)
        if own:
            own = {**own, "lowest": factor * own["lowest"], "highest": factor * own["highest"]}
        both = {"low": factor * low, "high": factor * high}
        rows.append({"name": name, "words": words, "unit": unit, **both, "own": own})
    return rows
