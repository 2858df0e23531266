"""What a ship that is followed sample by sample carries as random states, and of which size.

Forces X, Y, N and a uniform current are random states of first order that fade in a forecast; chosen coefficients are
constants that are not known exactly. ``mmg_ident.Tracker`` and its exports (``delivery.c.tracker``) share them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from diagnosis.estimation.noise_sizes import initial_noise
from diagnosis.estimation.transition_model import FORCE
from mmg.errors import Conflict, Missing, UnknownName, by_name, finite, unknown
from mmg.motion.froude import time_scale
from mmg.ship import Ship

if TYPE_CHECKING:
    import pandas as pd

CURRENT = ("current.x", "current.y")
# Standard deviation of a current [m/s] of a 3 m model. On 22 records of Train-TZRB+ that the calibration had not seen,
# errors over a minute are 1 % less with .005 and 9 % more with .02. Without a current they are 14 % more on hold-outs
# of the tanker, 2 % on runs of a full-scale ship, 8 % on trials of another generator (world "pond" of
# ``benchmarks/blind``). So it was measured.
SIZE = 0.01
FADES = 120.0  # Time in which a current fades [s of a 3 m model], that of ``fitting.prediction.stretches``
# Longest step of the equations [s] of a 3 m model, that of a calibration of one; and the time over which samples share
# their errors: twice as long is the same within 1 %, and with errors of their own samples every .3 s forecast 5 % worse
# than every .5 s (those records). So it was measured.
LONGEST = 1.0
# Step of the differences by which the first covariance is made [SI]. Set by hand: it needs no more digits.
DIFFERENCE = 1e-4


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the random forces X, Y, N (3,) [N, N, N m] with the time ``memory`` [s] in which they
    fade, of the current north and east [m/s], and of the errors of logged x, y, psi, u, v, r (6,).

    interval: samples nearer than this [s] share their errors, so that many of them tell no more than one (0: none do).
    """

    force: np.ndarray
    memory: float
    sensors: np.ndarray
    current: float
    interval: float

    @classmethod
    def of(cls, estimated: Any, ship: Ship) -> Noise:
        """Usual sizes for a ``ship``, with forces as her calibration ``estimated`` them: "X", "Y", "N" and "memory_s",
        as under ``random_force`` in result.json; anything else is none."""
        k, usual = time_scale(ship.particulars["L"]), initial_noise(ship)
        force, memory = usual.force, usual.tau
        with suppress(KeyError, TypeError, ValueError):
            *sizes, memory = (float(estimated[name]) for name in ("X", "Y", "N", "memory_s"))
            force = np.array(sizes)
        return cls(force, memory, usual.white, SIZE * k, LONGEST * k)


@dataclass(frozen=True)
class RandomStates:
    """``names`` of coefficients that are random states: FORCE, CURRENT, then chosen ones; their standard deviations
    ``sizes`` (K,) [SI] and the times ``memories`` (K,) [s] in which they fade, infinite for a constant.
    """

    names: tuple[str, ...]
    sizes: np.ndarray
    memories: np.ndarray

    @classmethod
    def of(cls, ship: Ship, noise: Noise, stds: Mapping[str, float]) -> RandomStates:
        """Of a ``ship``, the ``noise`` of her surroundings and the ``stds`` of chosen coefficients."""
        fades = FADES * time_scale(ship.particulars["L"])  # [s]
        sizes = [*noise.force, noise.current, noise.current, *stds.values()]
        memories = [noise.memory] * len(FORCE) + [fades] * len(CURRENT) + [math.inf] * len(stds)
        return cls((*FORCE, *CURRENT, *stds), np.array(sizes), np.array(memories))


def disturbed(ship: Ship) -> Ship:
    """A ``ship`` with the effects whose coefficients are random states."""
    for name in ("tow", "current"):
        ship = ship if name in ship.effects else ship.with_effect(name, {})
    return ship


def deviations(chosen: Iterable[str] | Mapping[str, float] | pd.Series[float], ship: Ship) -> dict[str, float]:
    """Standard deviations of the ``chosen`` coefficients, those of the ``ship`` where they are not given.

    Raises UserError for an unknown coefficient, for one that is a random state anyway and for one without deviation.
    """
    stds, chosen = dict[str, float](), by_name(chosen)
    for symbol in [chosen] if isinstance(chosen, str) else chosen:
        if symbol in (*FORCE, *CURRENT):
            raise Conflict(f"coefficients: {symbol} is a random state of every tracker; leave it out")
        if symbol not in ship.symbols:
            raise UnknownName(f"coefficients: {unknown('coefficient', str(symbol), ship.symbols)}")
        std = chosen[symbol] if isinstance(chosen, dict) else ship.coefficients[symbol].std
        stds[symbol] = finite(f"coefficients: {symbol}", std)
        if not stds[symbol] > 0:
            raise Missing(f"coefficients: {symbol} has no standard deviation; give {{'{symbol}': deviation}}")
    return stds
