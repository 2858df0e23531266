"""Wide worlds: every case draws its own noise, memory, sampling, number of runs and spread of the truth.

For the claim that false alarms stay rare not only in the conditions by which a limit was chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.blind.generator.world import World

RANGES = {
    "force": (0.1, 10.0),
    "sensors": (0.1, 10.0),
    "memory": (1.0, 20.0),
    "sample": (0.05, 1.0),
    "runs": (2.0, 40.0),
    "spread": (0.02, 0.15),
}
"""What a case draws, each log-uniform: factors of the random force and of the sensors' noise, memory of the random
force and time between rows [s, of the ship in the files], runs (training and held out), spread of the truth."""
APART = 2.0
"""Each sensor's own factor lies within this of the case's, and within the range."""
TOTAL, LONGEST = 2000.0, 150.0
"""Most seconds of all runs together, and of one run; of the ship in the files and of the one that is integrated."""
STEP = 0.05
"""Longest step of the integration [s]; a whole number of them lies between two rows."""
TRAINING = 7 / 12
"""Share of the runs that are for training; one run at least is, and one is held out."""
SENSORS = ((0, 1), (2,), (3, 4), (5,))
"""Columns of x, y; psi; u, v; r: each sensor has its own factor."""


def own_world(world: World, rng: np.random.Generator) -> tuple[World, dict[str, float]]:
    """The world of one case of a wide ``world``, and what was drawn for it (names of ``RANGES``)."""
    drawn = {name: float(np.exp(rng.uniform(*np.log(limits)))) for name, limits in RANGES.items()}
    drawn["runs"] = float(round(drawn["runs"]))
    apart = np.exp(rng.uniform(-np.log(APART), np.log(APART), len(SENSORS)))
    factors = np.clip(drawn["sensors"] * apart, *RANGES["sensors"])
    noise = np.array(world.noise)
    for columns, factor in zip(SENSORS, factors, strict=True):
        noise[list(columns)] *= factor
    clock = np.sqrt(world.scale)
    sample, memory = drawn["sample"] / clock, drawn["memory"] / clock
    step = sample / np.ceil(sample / STEP)
    duration = sample * np.floor(min(LONGEST, TOTAL / clock / drawn["runs"]) / sample)
    own = replace(
        world,
        spread=drawn["spread"],
        force=tuple(drawn["force"] * np.array(world.force)),
        memory=(memory, memory),
        noise=tuple(noise),
        sample=float(sample),
        step=float(step),
        duration=float(duration),
    )
    return own, drawn


def own_runs(
    kinds: tuple[Sequence[str], Sequence[str]], drawn: Mapping[str, float], rng: np.random.Generator
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Kinds of the runs for training and held out: as many as were drawn, of the given ones in random order."""
    count = int(drawn["runs"])
    training = min(max(round(TRAINING * count), 1), count - 1)
    dealt = []
    for pool, wanted in zip(kinds, (training, count - training), strict=True):
        order = [k for _ in range(-(-wanted // len(pool))) for k in rng.permutation(pool)]
        dealt.append(tuple(str(k) for k in order[:wanted]))
    return dealt[0], dealt[1]
