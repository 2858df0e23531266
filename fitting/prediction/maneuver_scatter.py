"""One manoeuvre of many ships that the trials allow, as ``mmg simulate --scatter`` prints it.

The draws are those of ``figure_intervals``, which ``mmg imo`` uses, so that both give the same intervals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cases.criteria.imo import NONE, OPEN, assess
from cases.criteria.scatter import ManeuverScatter, ScatterRow, scatter
from cases.criteria.standard_runs import Run, planned_run
from cases.maneuvers.definitions import STOPS, Maneuver
from fitting.prediction.envelope import outside_words
from fitting.prediction.figure_intervals import JUDGED, FigureScatter, correlation_in, drawn_figures
from mmg.effects import EFFECTS
from mmg.messages import Message
from mmg.rollout import Simulator
from mmg.ship import Ship


def maneuver_scatter(
    ship: Ship, plan: Maneuver, content: Mapping[str, Any], count: int, seed: int = 0, dt: float | None = None
) -> tuple[ManeuverScatter, Run | None, FigureScatter | None]:
    """A manoeuvre ``plan`` of ``count`` ships drawn about one, with medians, intervals and criteria of its figures.

    ship: as it is, without her instruments; content: of the result.json of her calibration, {} where she has none: her
    coefficients alone are drawn then, but in a stop also its deceleration, as for a manoeuvre that is none of
    ``figure_intervals.JUDGED``; seed: of the draws; dt: sampling interval [s]. Returns the scatter, and where the draws
    are those of ``figure_intervals`` the manoeuvre of the ship as it is and the draws behind it.
    Raises UserError as ``cases.criteria.scatter.scatter``.
    """
    judged = plan.kind in (JUDGED if content else STOPS)
    if judged:
        ship = _seen_exactly(ship)
    found = scatter(ship, plan, count, seed, correlation_in(content), dt)
    if not judged:
        return found, None, None
    run = planned_run(ship, plan)
    drawn, trials = drawn_figures(Simulator(ship), plan, found.coefficients, content, seed, dt, count)
    notices = list(found.notices)
    if drawn.outside:
        notices.append(Message(outside_words(plan.name, plan.kind, drawn.outside, drawn.widened), "outside_the_trials"))
    criteria = {
        row.figure: row
        for row in assess(run, ship.particulars.get("scale"))
        if row.limit is not None and row.verdict not in (OPEN, NONE)
    }
    limits = {name: row.limit * (run.length if row.unit == "L" else math.radians(1.0)) for name, row in criteria.items()
              if row.limit is not None}  # fmt: skip
    rows = tuple(_row(row, drawn, limits.get(row.figure)) for row in found.rows)
    kept = np.isfinite(trials.states).all(axis=(0, 1))
    trials = replace(trials, states=trials.states[:, :, kept], inputs=trials.inputs[:, :, kept], last=trials.last[kept])
    return replace(found, rows=rows, notices=tuple(notices), values=drawn.ship, trials=trials), run, drawn


def _seen_exactly(ship: Ship) -> Ship:
    """The ``ship`` without effects of her instruments: figures are those of the motion."""
    for name in ship.effects:
        ship = ship.without_effect(name) if EFFECTS[name].measures else ship
    return ship


def _row(row: ScatterRow, drawn: FigureScatter, limit: float | None) -> ScatterRow:
    """The ``row`` of a figure by the draws of the ship and of single trials, and its ``limit``, SI and rad."""
    if row.figure not in drawn.ship:
        return row
    # a draw that never comes so far lies beyond every value
    never, once = (np.where(np.isfinite(x), x, np.inf) for x in (drawn.ship[row.figure], drawn.trial[row.figure]))
    low, middle, high = (float(q) for q in np.quantile(never, (0.05, 0.5, 0.95), method="inverted_cdf"))
    first, last = (float(q) for q in np.quantile(once, (0.05, 0.95), method="inverted_cdf"))
    chance = None if limit is None else float((never <= limit).mean())
    share = float(np.isfinite(drawn.ship[row.figure]).mean())
    return replace(
        row, median=middle, interval_90=(low, high), share=share, interval_90_trial=(first, last),
        limit=limit, probability=chance,
    )  # fmt: skip
