"""What the cases hold: kinds, effects and strengths, dealt from the seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.blind.generator.effect import LEVELS, Drawn, Effect
from benchmarks.blind.generator.foreign import STRANGERS
from benchmarks.blind.generator.library import LIBRARY, SIDES

KINDS = ("null", "library", "strangers", "pair")
DECOYS = 0.25
"""Share of the cases with a site file that explains nothing."""


Hand = tuple[tuple[Effect, str], ...]
"""What one case holds: effects with their strengths."""


def _cycled(pool: list[Any], count: int, rng: np.random.Generator) -> list[Any]:
    """``count`` items of the pool, each as often as any other but one, in random order."""
    out: list[Any] = []
    while len(out) < count:
        out += [pool[i] for i in rng.permutation(len(pool))]
    return out[:count]


def deal(kind: str, count: int, rng: np.random.Generator, without: Sequence[str] = ()) -> list[Hand]:
    """The hands of ``count`` cases; without: names of effects that the ship cannot have."""
    library, strangers = ([e for e in pool if e.name not in without] for pool in (LIBRARY, STRANGERS))
    if kind == "null":
        return [()] * count
    if kind == "library":
        # every block of twenty holds each effect once, and three blocks each of its strengths once
        first = {effect.name: int(rng.integers(3)) for effect in library}
        blocks = [_cycled(library, len(library), rng) for _ in range(-(-count // len(library)))]
        dealt = [(effect, LEVELS[(first[effect.name] + b) % 3]) for b, block in enumerate(blocks) for effect in block]
        return [(one,) for one in dealt[:count]]
    if kind == "strangers":
        pool = [(effect, level) for effect in strangers for level in LEVELS[1:]]
        return [(one,) for one in _cycled(pool, count, rng)]
    pairs = [(a, b) for i, a in enumerate(library) for b in library[i + 1 :]]
    return [tuple((effect, "medium") for effect in pair) for pair in _cycled(pairs, count, rng)]


def decoy(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """A site file of a place whose bank, shelf or depth plays no part."""
    axis, way, greater, less = SIDES[int(rng.integers(4))]
    which = rng.choice(("bank", "shelf", "water"))
    if which == "bank":
        return {"bank": {axis: round(way * rng.uniform(8.0, 15.0), 1), "water_side": less}}
    if which == "shelf":
        return {"shelf": {axis: round(way * rng.uniform(-4.0, 4.0), 1), "shallow_side": greater}}
    return {"water": {"depth": round(float(rng.uniform(2.0, 4.0)), 2)}}


def site_of(drawn: list[tuple[Effect, Drawn]], rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Tables of the site file of a case; perhaps a decoy where no effect has one; {} for no file."""
    site = {name: table for _, draw in drawn for name, table in draw.site.items()}
    hidden = decoy(rng) if rng.uniform() < DECOYS else {}
    return site or hidden
