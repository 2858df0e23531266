"""Do the logged revolutions give the logged speed with the ship's propeller?"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cases.maneuvers.self_propulsion import revolutions_for
from cases.trial import Trial
from mmg.errors import UserError
from mmg.messages import Message
from mmg.ship import Ship

STRAIGHT = math.radians(5.0)
"""Rudder angle within which a ship goes about straight ahead."""
TURN = 0.1
"""Yaw rate within which she does, made dimensionless by speed and length."""
FASTEST = 0.5
"""Share of her greatest speed from which she is under way."""
STEADY = 0.03
"""Share of the speed by which it may change over half a ship length."""
LEAST = 0.5
"""Ship lengths that must be made so."""
TWICE = 1.6
"""Ratio of the revolutions that the ship needs to those that were logged, or the other way round, from which they do
not fit: wider than fouling, wind and a poor guess of the resistance make it."""


def steady_ahead(trial: Trial, length: float) -> tuple[float, float] | None:
    """Median revolutions [1/s] and speed [m/s] of a ``trial`` where the ship of this ``length`` [m] goes straight ahead
    at a steady speed, or None."""
    if "delta" not in trial and "delta_port" not in trial:
        return None
    delta, n, u, r = (np.asarray(x, dtype=float) for x in (trial.rudder, trial["n"], trial["u"], trial["r"]))
    if not np.isfinite(u).any():
        return None
    fast = FASTEST * float(np.nanquantile(u, 0.95))
    rows = max(1, round(0.5 * FASTEST * length / max(fast, 1e-3) / trial.dt))
    with np.errstate(invalid="ignore"):
        ahead = (np.abs(delta) < STRAIGHT) & (u > max(fast, 1e-3)) & (n > 0) & (np.abs(r) * length < TURN * u)
        for values in (u, n):
            later = np.concatenate([values[rows:], np.full(min(rows, len(values)), np.nan)])
            ahead &= np.abs(later - values) < STEADY * values
    if float(u[ahead].sum()) * trial.dt < LEAST * length:
        return None
    return float(np.median(n[ahead])), float(np.median(u[ahead]))


def doubtful_revolutions(ship: Ship, trials: Sequence[Trial]) -> list[Message]:
    """A sentence, code "revolutions", where the revolutions of ``trials`` do not give their speeds with the propeller
    of the ``ship``; or none."""
    if "n" not in ship.actuators:
        return []
    found = [row for t in trials if "n" in t and (row := steady_ahead(t, float(ship.particulars["L"]))) is not None]
    ratios = []
    for n, u in found:
        try:
            ratios.append(revolutions_for(ship, u) / n)
        except UserError:
            continue
    if not ratios or 1 / TWICE < np.median(ratios) < TWICE:
        return []
    n, u = found[int(np.argsort(ratios)[len(ratios) // 2])] if len(ratios) == len(found) else found[0]
    words = (
        f"the propeller does not fit: at {u:.3g} m/s straight ahead {ship.name} needs {revolutions_for(ship, u):.3g} "
        f"revolutions per second, the trials have {n:.3g}; check the unit of n, a gear ratio, D_P and pitch_ratio"
    )
    return [Message(words, "revolutions")]
