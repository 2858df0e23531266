"""What trials cover: samples in each sub-model and against the unknowns of a generated model, and range of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from fitting.selection.candidates import StructureCandidate
from mmg.components.expansion.series import STALL
from mmg.components.expansion.words import Word, parse_monomial
from mmg.motion.froude import reference_speed
from mmg.ship import Ship

LEAST = 20
"""Fewest samples in a sub-model from which anything is fitted."""

BEYOND = 1.1
"""Factor on the motions of the trials up to which a polynomial is used as it is."""
SMALL = 0.01
"""Least range of a motion, by sqrt(g L), of the yaw rate by sqrt(g / L)."""


def bounded(ship: Ship, trials: Sequence[Trial]) -> Ship:
    """A generated ``ship`` whose polynomial is bounded to the motions of the ``trials`` (``expansion/series``)."""
    found = {}
    L = ship.particulars["L"]
    for name, sign, column in (("u_ahead", 1, "u"), ("u_astern", -1, "u"), ("v_most", 0, "v"), ("r_most", 0, "r")):
        values = np.concatenate([t[column] for t in trials])
        most = np.nanmax(np.abs(values) if sign == 0 else sign * values, initial=0.0)
        least = SMALL * reference_speed(L) / (L if column == "r" else 1.0)
        found[name] = float(f"{BEYOND * max(most, least):.4g}")
    return replace(ship, particulars={**ship.particulars, **found})


def fault(candidate: StructureCandidate, trials: Sequence[Trial]) -> str:
    """Why ``trials`` cannot determine a ``candidate``, with the counts; "" where they may.

    There must be as many samples as unknowns, and LEAST samples in which the conditions of each sub-model hold.
    """
    samples = sum(len(t) for t in trials)
    if candidate.unknowns > samples:
        return f"{candidate.name} has {candidate.unknowns} unknowns, but the trials hold only {samples} samples"
    sets = {parse_monomial(text).conditions for text in candidate.ship.monomials.values()}
    limit = candidate.ship.particulars.get("delta_stall", STALL)
    lacking = []
    for conditions in sorted(sets, key=str):
        held = sum(int(np.all([_holds(c, t, limit) for c in conditions], axis=0).sum()) for t in trials if conditions)
        if conditions and held < LEAST:
            lacking.append(f"'{' '.join(map(str, conditions))}' ({held} samples)")
    if not lacking:
        return ""
    return (
        f"{candidate.name} ({candidate.submodels}) has sub-models that the trials hardly enter: {', '.join(lacking)} "
        f"of {samples}, {LEAST} are needed; add such trials or take fewer sub-models"
    )


def _holds(condition: Word, trial: Trial, limit: float) -> np.ndarray:
    """Where a condition holds in a trial, (N,) bool."""
    columns = [trial[part.name] for part in condition.parts if part.name in trial]
    if condition.name in ("ahead", "astern"):
        return (trial["u"] >= 0) == (condition.name == "ahead")
    if condition.name in ("driving", "reversing"):
        mean = np.mean(columns, axis=0) if columns else np.zeros(len(trial))
        return (mean >= 0) == (condition.name == "driving")
    beyond = np.any([np.abs(x) > limit for x in columns], axis=0) if columns else np.zeros(len(trial), dtype=bool)
    return beyond == (condition.name == "stalled")
