"""Units of revolutions and rudder angles that do not go with how quickly the ship turns, whatever her size.

Two numbers without dimension hardly depend on the ship: the revolutions that her propeller makes while her turn rate
changes, n tau, and how far she turns in this time per rudder angle, r tau / delta. From ships of 3 m to 320 m, models
and real ones, mild zigzags to berthing, they are 16 to 130 and 0.1 to 1.6. Factors of 60 and of 57 lie far outside.
"""

from __future__ import annotations

import math

import numpy as np

from cases.evidence.signals import STEPS, signals
from cases.trial import RUDDERS, Trial

REVOLUTIONS = (3.0, 600.0)
"""Least and greatest n tau of rightly labelled revolutions."""

RESPONSE = (0.025, 6.0)
"""Least and greatest r tau / delta of a rightly labelled rudder, of a ship that follows her rudder."""

FOLLOWS = 0.7
"""Correlation of turn rate and rudder from which a ship follows it."""

TURNS = 0.05
"""rad; a heading that varies less says nothing of how quickly the ship turns."""


def wrong_inputs(trial: Trial, turning: float | None) -> list[tuple[str, float, str]]:
    """(column, factor that makes it true, sentence) of revolutions and rudders of ``trial`` in a wrong unit.

    turning: correlation of the turn rate with the rudder, None where it is not known.
    """
    s = signals(trial)
    if s is None or not s.good.any() or float(np.std(s.psi[s.good])) < TURNS:
        return []
    span = STEPS * s.step
    use = s.good[STEPS:-STEPS]
    rate = (s.psi[STEPS:] - s.psi[:-STEPS]) / span
    change = (rate[STEPS:] - rate[:-STEPS]) / span
    known = use[: len(change)]
    if known.sum() < 10 or not float(np.mean(change[known] ** 2)) > 0:
        return []
    tau = float(np.std(rate) / np.sqrt(np.mean(change[known] ** 2)))
    return [*_revolutions(trial, tau), *_rudders(trial, tau * float(np.sqrt(np.mean(rate**2))), turning)]


def _revolutions(trial: Trial, tau: float) -> list[tuple[str, float, str]]:
    out = []
    for name in ("n", "n_2"):
        n = np.abs(trial[name][np.isfinite(trial[name])]) if name in trial else np.zeros(0)
        running = n[n > 0]
        if len(running) < 0.5 * max(len(n), 1) or not len(running):
            continue
        made = float(np.median(running)) * tau
        words = f"the propeller would turn {made:.3g} times ({name}) while the ship begins to turn"
        if made > REVOLUTIONS[1]:
            out.append((name, 1 / 60, f"{name} holds rpm but is labelled rps: {words}"))
        elif made < REVOLUTIONS[0]:
            out.append((name, 60.0, f"{name} holds rps but is labelled rpm: {words}"))
    return out


def _rudders(trial: Trial, turned: float, turning: float | None) -> list[tuple[str, float, str]]:
    size = float(np.sqrt(np.nanmean(trial.rudder**2))) if np.isfinite(trial.rudder).any() else 0.0
    if turning is None or abs(turning) < FOLLOWS or not size > 0:
        return []
    response = turned / size
    names = [name for name in RUDDERS if name in trial]
    if response < RESPONSE[0]:
        words = f"holds degrees but is labelled rad: the ship turns by {response:.2g} of it only"
        return [(name, math.pi / 180, f"{name} {words}") for name in names]
    if response > RESPONSE[1]:
        words = f"holds radians but is labelled deg: the ship turns by {response:.2g} times as much"
        return [(name, 180 / math.pi, f"{name} {words}") for name in names]
    return []
