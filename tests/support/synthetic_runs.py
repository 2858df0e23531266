"""Small synthetic calibrations shared by the tests of fitting."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.nlp.problem import Prior, Problem
from fitting.nlp.shooting import Kernels
from fitting.nlp.windows import cut
from mmg.model import assemble

SIGMA = np.array([0.05, 0.05, 0.01, 0.01, 0.01, 0.002])


@lru_cache(maxsize=2)
def runs(seed: int = 5) -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """Training and held-out trials of the hidden ship of the demo."""
    train, held_out = demo_trials(seed)
    return tuple(train), tuple(held_out)


@lru_cache(maxsize=4)
def kernel(free: tuple[str, ...] | None = None, compiled: bool = True):  # type: ignore[no-untyped-def]
    """Derivative kernels of ESSO OSAKA for these free coefficients (default all)."""
    ship = load_ship("esso_osaka_3m")
    chosen = free or ship.symbols
    return Kernels(assemble(ship), np.array([ship.symbols.index(s) for s in chosen]), compiled)


def problem(K: int = 5, window: float = 40.0, trials: tuple[Trial, ...] | None = None) -> Problem:
    """A problem over the first three training runs with step 1 s."""
    ship = load_ship("esso_osaka_3m")
    segments = cut(trials or runs()[0][:3], 1.0, window, K)
    return Problem(ship, Prior.of(ship), kernel(), segments, SIGMA)
