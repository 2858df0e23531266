"""The page: one HTML file that holds its data, its style and its script, and may load and send nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from cases.io.files import replace_text
from delivery.view.motions import predictions, rows_per_run, run_content, safe_json
from delivery.view.sources import Campaign
from fitting.report.run_folder import versions
from mmg.errors import BadValue, NotWritable
from mmg.motion.flow import INPUTS

LENGTHS = (30.0, 100.0, 0.0)
"""Windows of a page [s]; 0 is the whole run."""
SCRIPTS = ("uplot/uPlot.iife.min.js", "data.js", "charts.js", "track.js", "forces.js", "main.js")
STYLES = ("uplot/uPlot.min.css", "view.css")
WIND = {"wind_north": ("velocity of the air towards north", "m/s"), "wind_east": ("and towards east", "m/s")}


def view_page(campaign: Campaign, lengths: Sequence[float] = LENGTHS) -> str:
    """The page on a ``campaign``; lengths: of the windows that it offers [s], 0 for the whole run.

    Raises UserError where a trial lacks an input of a model, and for lengths that make no sense.
    """
    if not lengths or any(not 0 <= length < float("inf") for length in lengths):
        raise BadValue("--window: give lengths in seconds, 0 for the whole run")
    trials = [view.trial for view in campaign.trials]
    predicted = [predictions(model, trials, lengths) for model in campaign.models]
    roles = [list(next(filter(None, p.forces), {})) for p in predicted]
    most = rows_per_run(campaign, lengths, roles)
    inputs = campaign.ship.inputs
    missing = campaign.found.missing if campaign.found else {}
    runs = [
        run_content(
            trial, inputs, [([w[k] for w in p.windows], p.forces[k]) for p in predicted], most, missing.get(trial.name)
        )
        for k, trial in enumerate(trials)
    ]
    return _rendered(campaign, safe_json(_header(campaign, lengths, roles)), [safe_json(run) for run in runs])


def _header(campaign: Campaign, lengths: Sequence[float], roles: Sequence[Sequence[str]]) -> dict[str, Any]:
    """What the script reads before any run: names, lengths, models, inputs, the diagnosis."""
    ship, found = campaign.ship, campaign.found
    p = ship.particulars
    L = p["L"]
    places = {"propeller": -0.5, "rudder": p.get("x_R", -0.5 * L) / L}
    places |= {"bow_thruster": p.get("x_BT", 0.4 * L) / L, "stern_thruster": p.get("x_ST", -0.4 * L) / L}
    return {
        "ship": ship.title,
        "length": p["L"],
        "breadth": p.get("B", p["L"] / 6),
        "lengths": list(lengths),
        "inputs": [
            {"name": name, "words": words, "unit": unit}
            for name in ship.inputs
            if name != "time"
            for words, unit in [(INPUTS | WIND)[name]]
        ],
        "models": [
            {"kind": m.kind, "label": m.label, "run": m.run, "band": m.bands is not None, "roles": list(names)}
            for m, names in zip(campaign.models, roles, strict=True)
        ],
        "places": places,
        "runs": [
            {
                "name": view.trial.name,
                "role": view.role,
                "kind": view.trial.kind,
                "duration": view.trial.duration,
                "samples": len(view.trial),
                "position": view.trial.has_position,
                "missing": bool(found and view.trial.name in found.missing),
            }
            for view in campaign.trials
        ],
        "diagnosis": {"folder": found.folder, "verdict": found.verdict, "sentence": found.sentence} if found else None,
        "notes": list(campaign.notes),
    }


def _asset(name: str) -> str:
    """The text of a file that comes with this package."""
    return resources.files("delivery.view").joinpath("assets").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """The source expression of a content security policy that allows an element with this ``text``."""
    return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"


def policy(scripts: Sequence[str], styles: Sequence[str]) -> str:
    """The content security policy of a page with these ``scripts`` and ``styles`` and nothing else."""
    parts = {
        "default-src": ["'none'"],
        "script-src": [_hash(text) for text in scripts],
        "style-src": [_hash(text) for text in styles],
        "base-uri": ["'none'"],
        "form-action": ["'none'"],
    }
    return "; ".join(" ".join([name, *sources]) for name, sources in parts.items())


def _rendered(campaign: Campaign, header: str, runs: Sequence[str]) -> str:
    """The template with policy, styles, data and scripts; what comes from files is escaped."""
    templates = Environment(
        loader=PackageLoader("delivery.view", "assets"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    scripts = [_asset(name).strip() for name in SCRIPTS]
    styles = [_asset(name).strip() for name in STYLES]
    return templates.get_template("view.html.j2").render(
        ship=campaign.ship.title, policy=policy(scripts, styles), scripts=scripts, styles=styles,
        licence=_asset("uplot/LICENSE").strip(), header=header, runs=runs, version=versions()["mmg-ident"],
    )  # fmt: skip


def write_view(campaign: Campaign, out: Path, lengths: Sequence[float] = LENGTHS) -> int:
    """Write the page on a ``campaign`` to the file ``out``, whole or not at all; returns its bytes.

    lengths: as of ``view_page``. Raises UserError as ``view_page`` does, and where the file cannot be written.
    """
    text = view_page(campaign, lengths)
    try:
        replace_text(out, text)
    except OSError as error:
        raise NotWritable(f"{out}: cannot be written ({error.strerror}); choose another --out") from None
    return len(text.encode())
