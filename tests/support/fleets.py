"""Synthetic trials of several days, whose instruments differ from day to day or do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.ship import Ship

DAYS = ("2026-03-02", "2026-03-09", "2026-04-20")


def fleet(
    ship: Ship, instruments: Mapping[str, Sequence[str]], maneuvers: Sequence[str], seed: int, n: float, duration: float
) -> list[Trial]:
    """Runs of ``ship`` with noise, one of each of ``maneuvers`` on each day; instruments: effects by day."""
    found = []
    for d, (day, effects) in enumerate(instruments.items()):
        logged = with_effects(ship, effects)
        for k, text in enumerate(maneuvers):
            run = simulate(logged, parse_maneuver(text, ship, n=n, duration=duration), 0.2)
            noisy = add_noise(run, SensorNoise.for_length(ship.particulars["L"]), seed + 100 * d + k)
            found.append(replace(noisy, name=f"{text.split(':')[0]}_{k}_{day}", meta={**noisy.meta, "day": day}))
    return found
