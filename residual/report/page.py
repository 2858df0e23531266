"""The report on a training: one self-contained HTML page from run folders of ``mmg train``, without torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fitting.report.delivered import Delivered, delivery_sections
from fitting.report.page import citations_of, environment, score_sets
from fitting.report.plot_style import figures_of
from fitting.report.words import setting_rows
from mmg.ship import Ship
from residual.report.words import criteria, envelope_rows, headline, judged_table, percent

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
