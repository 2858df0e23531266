"""What both generators of months have in common: what changes, the autopilot, and writing the parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

DAY = 86400
UNITS = {"t": "s", "x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s", "n": "rps", "delta": "rad",
         "wind_speed": "m/s", "wind_direction": "rad"}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """A parameter that goes from 0 to ``size``, straight from the day ``begin`` to the day ``end``."""

    begin: float
    end: float
    size: float

    def at(self, days: np.ndarray) -> np.ndarray:
        """Its value at these ``days``, any shape."""
        if self.end <= self.begin:
            return self.size * (days >= self.begin)
        return self.size * np.clip((days - self.begin) / (self.end - self.begin), 0.0, 1.0)


@dataclass(frozen=True)
class Month:
    """What is generated: days, seed of the month, seed of the ship, and what changes by name of the parameter
    ("fouling.share")."""

    days: int = 30
    seed: int = 0
    ship: int = 1
    changes: Mapping[str, Change] = field(default_factory=dict)

    def value(self, name: str, days: np.ndarray) -> np.ndarray:
        """The parameter ``name`` at these ``days``."""
        return self.changes[name].at(days) if name in self.changes else np.zeros_like(days)


def slow(rng: np.random.Generator, count: int, step: float, time: float, size: float) -> np.ndarray:
    """(count,) of an Ornstein-Uhlenbeck process of this correlation ``time`` and ``size``, every ``step`` [s]."""
    keep = math.exp(-step / time)
    start = rng.standard_normal()
    noise = rng.standard_normal(count) * math.sqrt(1 - keep**2)
    return size * lfilter([1.0], [1.0, -keep], noise, zi=[keep * start])[0]


def late(values: np.ndarray, T: np.ndarray, step: float) -> np.ndarray:
    """``values`` (N,) behind a first-order lag of T (N,) [s], which may change; exact for values that run straight from
    one to the next, so that what is logged is late by T."""
    if not T.any():
        return values
    out, past, before = np.empty_like(values), float(values[0]), float(values[0])
    for k, (value, time) in enumerate(zip(values.tolist(), T.tolist(), strict=True)):
        if time <= 0:
            past = value
        else:
            behind = time * (value - before) / step
            past = value - behind + (past - before + behind) * math.exp(-step / time)
        out[k], before = past, value
    return out


def steered(wanted: np.ndarray, psi: np.ndarray, r: np.ndarray, gains: tuple[float, float], most: float) -> np.ndarray:
    """Rudder (M,) that brings the heading to ``wanted``; gains: of heading [-] and turn rate [s]; most: angle [rad]."""
    off = np.remainder(wanted - psi + np.pi, 2 * np.pi) - np.pi
    return np.clip(gains[0] * off - gains[1] * r, -most, most)


def legs(rng: np.random.Generator, seconds: int, least: float, most: float, turns: Callable[[], float]) -> np.ndarray:
    """Wanted headings (seconds,): constant for ``least`` to ``most`` seconds, then changed by ``turns``."""
    out, at, heading = np.empty(seconds), 0, rng.uniform(0, 2 * np.pi)
    while at < seconds:
        until = at + int(rng.uniform(least, most))
        out[at:until], at = heading, until
        heading += turns()
    return out


def write_parts(folder: Path, columns: Mapping[str, np.ndarray], edges: Sequence[int], hive: bool = True) -> None:
    """Write rows between ``edges`` as parts below ``folder``, a folder a day (``hive``) or files beside each other."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = {name: f"{name} [{UNITS[name]}]" for name in columns}
    for k, (first, last) in enumerate(pairwise(edges)):
        path = folder / (f"day={k + 1:02d}/part-0.parquet" if hive else f"log_{k + 1:04d}.parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = {names[name]: values[first:last] for name, values in columns.items()}
        pq.write_table(pa.table(rows), path, row_group_size=50_000, write_page_checksum=True)
