"""The report on a training: one self-contained HTML page from run folders of ``mmg train``, without torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

from fitting.prediction.score import in_words
from fitting.report.delivered import Delivered, delivery_sections
from fitting.report.page import citations_of, environment
from fitting.report.plot_style import figures_of
from fitting.report.use import shown_quantity
from mmg.ship import Ship
from residual.decide import percent

TROUBLE = 0.2
"""Share of validation rows outside the training range from which on the report warns. Set by hand."""


def page_of(runs: Sequence[tuple[str, Path, Mapping[str, Any], Ship | None]], known: Sequence[Delivered] = ()) -> str:
    """One self-contained HTML page on trainings.

    runs: of each its name, the folder that holds its figures, the content of its result.json, and the ship that it
    recommends, None of a black box. known: of each its trials and its form for IMO; none by default.
    """
    deliveries = [*known, *(Delivered() for _ in runs[len(known) :])]
    shown = [_run(*run, own, i) for i, (run, own) in enumerate(zip(runs, deliveries, strict=True), 1)]
    states = [(run.get("name", run["result"]["ship"]), run["title"], run["headline"]["state"]) for run in shown]
    titles = [f"{ship}: {title}" + (f" ({state})" if state else "") for ship, title, state in states]
    return environment().get_template("training.html.j2").render(runs=shown, titles=titles, percent=percent)


def _run(
    label: str, folder: Path, result: Mapping[str, Any], ship: Ship | None, known: Delivered, number: int
) -> dict[str, Any]:
    """All that the template shows of one training, and on the use of its ``ship``, in sections after the others."""
    hybrid, outside = "decision" in result, result["outside"].get("trials", {})
    settings = {k: v for k, v in result["settings"].items() if hybrid or k != "symmetric"}
    shown = {
        "id": f"run{number}",
        "label": label,
        "result": result,
        "hybrid": hybrid,
        "title": "learned residual" if hybrid else f"black box {result['model']}",
        "before": "calibrated ship" if hybrid else "ship model",
        "after": "with residual" if hybrid else "black box",
        "headline": headline(result),
        "warnings": _warnings(result, outside),
        "judged": judged_table(result),
        "seeds": [f"seed {row['seed']}" for row in result["per_seed"]],
        "figures": {f["name"]: f for f in figures_of(folder, result["figures"])},
        "size": result.get("residual_size") or {},
        "envelope": envelope_rows(result),
        "outside": outside,
        "settings": settings,
        "citations": citations_of(result),
        "use": ship is not None,
    }
    if ship is None:
        return shown
    usable = (result.get("calibration") or {}).get("converged") is not False
    shown |= {"name": ship.called, "about": ship.title if ship.mark else ""}
    shown |= {"first": 9, "numbered": False, "usable": usable}
    return shown | delivery_sections(result, ship, known)


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


def headline(result: Mapping[str, Any]) -> dict[str, str]:
    """The one sentence of a training ``result``, whether it was kept, and what was trained on what."""
    data, decision = result["data"], result.get("decision")
    seconds = sum(row["duration_s"] for row in data)
    what = f"{len(result['per_seed'])} training(s) on {len(data)} trial(s), {seconds:,.0f} s"
    if not decision:
        return {"sentence": _box_sentence(result), "state": "", "what": f"{what}."}
    always = " It is recommended by --keep always." if result["kept"] and not decision["kept"] else ""
    return {
        "sentence": decision["words"] + always,
        "state": "kept" if result["kept"] else "declined",
        "what": f"{what}; judged by {'the validation trials' if result['validation_data'] else 'parts in turn'}.",
    }


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
