"""What the report says of the use of a calibrated ship: conditions of its trials, figures for IMO, limits, advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cases.criteria.assessment import imo_figures
from cases.criteria.imo import Row
from cases.criteria.standard_runs import approach_speed
from cases.shipfiles.effects import calm_and_deep
from cases.trial import Trial
from fitting.prediction.bands import correlation_in
from fitting.prediction.envelope import trial_envelope
from fitting.prediction.figure_intervals import DRAWS, JudgedFigures, with_intervals
from fitting.report.imo_form import FormSide, FormValue, ImoForm, imo_form
from fitting.report.plot_maneuvers import maneuver_figure
from fitting.report.plot_style import figure_entry, png_of
from fitting.report.trial_files import trial_rows, trials_again
from fitting.report.use import Condition, condition_rows, limit_rows, use_rows
from mmg.errors import UserError
from mmg.messages import Message, has_code
from mmg.ship import Ship

LATER = "mmg report RUN adds it (without --no-imo): its figures are simulated with draws of the coefficients."
FASTER = 1.05
"""Test speed over the largest speed of the trials above which the figures count as extrapolated."""


@dataclass(frozen=True)
class FigureSection:
    """What the template shows. count: ships drawn; rows: cells of the table, by column; outside: sentences on
    manoeuvres that leave the trials; image: of the tracks, as the macro ``figure`` takes it."""

    count: int
    rows: tuple[dict[str, str], ...]
    outside: tuple[str, ...]
    image: dict[str, Any]


def standard_figures(result: Mapping[str, Any], ship: Ship) -> JudgedFigures:
    """The standard manoeuvres of a ship with the draws of which a page shows intervals, the same as ``mmg imo``.

    result: content of result.json; ship: the calibrated or hybrid ship of which it speaks. Where no covariance is known
    or none can be drawn there are no draws, and a notice says why. Raises UserError when no manoeuvre reaches its
    event.
    """
    found = imo_figures(ship)
    why = "no covariance of the coefficients is known"
    if correlation_in(result) is not None:
        try:
            return with_intervals(found, ship, result, DRAWS)
        except UserError as error:
            why = str(error)
    return JudgedFigures(replace(found, notices=(*found.notices, Message(f"no intervals: {why}", "no_covariance"))), {})


def figure_section(judged: JudgedFigures) -> FigureSection | None:
    """The figures of the standard manoeuvres with intervals, ``judged`` as of ``standard_figures``; None where there
    are no draws."""
    if not judged.scatter:
        return None
    found = judged.assessment
    clouds = {name: one.shown for name, one in judged.scatter.items()}
    image = figure_entry(
        png_of(partial(maneuver_figure, found.runs, found.heading, clouds)), "maneuvers",
        "Standard manoeuvres with drawn trials",
        "Lines: the ship as calibrated. Thin and grey: single trials of ships that the trials allow.",
    )  # fmt: skip
    rows = tuple(_cells(row) for row in found.rows if row.interval_90 is not None)
    outside = tuple(str(note) for note in found.notices if has_code([note], "outside_the_trials"))
    return FigureSection(DRAWS, rows, outside, image)


def _cells(row: Row) -> dict[str, str]:
    """The cells of one line of the table."""
    digits = 1 if row.unit == "deg" else 2

    def ends(pair: Sequence[float] | None) -> str:
        return " to ".join(f"{x:.{digits}f}" if x < float("inf") else "never" for x in pair) if pair else "–"

    return {
        "run": row.run,
        "figure": f"{row.figure.replace('_', ' ')} [{row.unit}]",
        "value": "–" if row.value is None else f"{row.value:.{digits}f}",
        "interval": ends(row.interval_90),
        "trial": ends(row.interval_90_trial),
        "limit": "–" if row.limit is None else f"{row.limit:.3g}",
        "chance": "–" if row.probability is None else f"{100 * row.probability:.0f} %",
        "inside": {None: "not known", True: "no", False: "yes"}[row.extrapolated],
    }


@dataclass(frozen=True)
class Delivered:
    """What a page needs beside the record of a run.

    trials: those at hand; absent: sentences on the others; form: None where it was not asked for or cannot be made,
    with the reason in ``no_form``; full_load: draught [m] of the fully loaded ship, None where it is not known;
    figures: with 90 % intervals, None where none are known.
    """

    trials: tuple[Trial, ...] = ()
    absent: tuple[str, ...] = ()
    form: ImoForm | None = None
    no_form: str = LATER
    full_load: float | None = None
    figures: FigureSection | None = None


def delivered(result: Mapping[str, Any], ship: Ship, full_load: float | None = None, imo: bool = True) -> Delivered:
    """Trials read again and the form for IMO of a run, of whose calibrated or hybrid ``ship`` the ``result`` speaks.

    result: content of result.json; full_load: draught [m] of the fully loaded ship; imo: with the form. Raises
    UserError for a draught that the model cannot be carried to.
    """
    found, absent = trials_again(trial_rows(result))
    trials = tuple(trial for _, trial in found)
    if not imo:
        return Delivered(trials, tuple(absent), full_load=full_load)
    figures = None
    try:
        model = standard_figures(result, ship)
        form, why = imo_form(ship, trials, model, result, full_load), ""
        figures = figure_section(model)
    except UserError as error:
        if full_load is not None and "--full-load-draught" in str(error):
            raise
        form, why = None, f"It cannot be made: {error}."
    return Delivered(trials, tuple(absent), form, why, full_load, figures)


def delivery_sections(result: Mapping[str, Any], ship: Ship, known: Delivered) -> dict[str, Any]:
    """What the template shows of a ``result`` and its ``ship`` in the sections on use.

    result: content of result.json; known: beside it.
    """
    envelope: Mapping[str, Sequence[float]] = result.get("envelope") or trial_envelope(ship, known.trials)
    good, bad = use_rows(envelope, ship, any(row.get("has_wind") for row in result["data"]))
    conditions = condition_rows(ship, known.trials, known.full_load) if known.trials else []
    return {
        "conditions": conditions,
        "absent": known.absent,
        "limits": limit_rows(envelope, ship.particulars["L"]),
        "hybrid_form": ship.network is not None,
        "good": good,
        "bad": bad,
        "form": known.form,
        "no_form": known.no_form,
        "intervals": known.figures,
        **(_form_sections(ship, known.form, conditions, envelope) if known.form else {}),
    }


def _form_sections(
    ship: Ship, form: ImoForm, conditions: Sequence[Condition], envelope: Mapping[str, Sequence[float]]
) -> dict[str, Any]:
    """Head, groups and columns of the form."""
    parts = [("tested", form.tested), ("model", True), ("corrected", form.corrected)]
    shown = [name for name, there in parts if there]
    words = {
        "tested": "tested",
        "model": "model, calm and deep" + (" [90 %]" if form.intervals else ""),
        "corrected": "corrected to full load" + (" [90 %]" if form.intervals else ""),
    }
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in form.rows:
        groups.setdefault(row.group, []).append({
            "name": row.name,
            "unit": row.unit,
            "limit": "–" if row.limit is None else f"{row.limit:.3g}" + (" to 20" if row.group == "Stopping" else ""),
            "cells": [[_words(getattr(side, name), row.unit) for side in row.sides] for name in shown],
            "verdicts": [_verdict(side) for side in row.sides],
        })  # fmt: skip
    speed, _ = approach_speed(calm_and_deep(ship)[0])
    fastest = max(map(abs, envelope.get("u", [np.inf])))
    cover = "which widens their intervals" if form.widened else "and their intervals do not cover that"
    too_fast = (
        f"The model runs at {speed:.3g} m/s, the trials at {fastest:.3g} m/s at most: the figures of the model are "
        f"extrapolated in speed, {cover if form.intervals else 'and no interval covers that'}."
    )
    return {
        "form_groups": list(groups.items()),
        "form_columns": [words[name] for name in shown],
        "form_head": _head(ship, form, conditions, speed),
        "too_fast": too_fast if speed > FASTER * fastest else "",
    }


def _words(value: FormValue | None, unit: str) -> str:
    """A value with its interval, to the figures that the form asks for."""
    if value is None:
        return "–"
    digits = 1 if unit == "deg" else 2
    text = f"{value.value:.{digits}f}"
    if value.interval:
        low, high = (f"{end:.{digits}f}" if end < np.inf else "never" for end in value.interval)
        text += f" [{low}, {high}]"
    return f"{text} ({value.count} runs)" if value.count > 1 else text


def _verdict(side: FormSide) -> str:
    return {"-": "no limit"}.get(side.verdict, side.verdict)


def _head(ship: Ship, form: ImoForm, conditions: Sequence[Condition], speed: float) -> list[tuple[str, str]]:
    """Ship data and trials data of the form; what no file says is "not stated"."""
    p = ship.particulars
    L, B, d = p["L"], p.get("B"), p["d"]
    area = p.get("A_R")
    loading = "full load not stated"
    if form.full_load is not None:
        loading = f"draught {d:g} m of {form.full_load:g} m at full load"
    rows = [
        ("administration, reference no., ship type, engine type", "not stated in the ship file"),
        ("L/V", f"{L / speed:.3g} s"),
        ("L/B, B/T, C_B", f"{L / B:.3g}, {B / d:.3g}, {p['C_b']:.3g}" if B and "C_b" in p else "not stated"),
        ("rudder: model, total area / (L T)", f"{ship.components.get('rudder', 'none')}, "
         + (f"{area / (L * d):.3g}" if area else "not stated")),
        ("propeller: model", ship.components.get("propeller", "none")),
        ("loading condition of the tests", loading),
    ]  # fmt: skip
    named = {c.name: c.found for c in conditions}
    asked = (("water depth / trial draught", "water depth"), ("wind", "wind"), ("waves: sea state", "waves"))
    return [*rows, *((words, named.get(name, "not known")) for words, name in asked)]
