"""Ships with public manoeuvring data: main particulars, figures and where they come from.

A figure is one that was published for the ship or her model, or that of a published mathematical model, simulated
at 411ed8c. Port and starboard are averaged: a starting ship has no sides. UNVERIFIED: from recollection or second hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.toml import tables

FIGURES = (
    ("turning:35", "advance"), ("turning:35", "tactical_diameter"), ("turning:15", "advance"),
    ("turning:15", "tactical_diameter"), ("zigzag:10/10", "overshoot_1"), ("zigzag:10/10", "overshoot_2"),
    ("zigzag:20/20", "overshoot_1"), ("zigzag:20/20", "overshoot_2"),
)  # fmt: skip
"""(Manoeuvre, figure): lengths in L, angles in deg."""


@dataclass(frozen=True)
class LiteratureShip:
    """One ship.

    name, kind: "full" or "fine" of form, in words; particulars [SI] as a user would give them; speed [m/s] and rudder
    rate [deg/s] of her manoeuvres; group: ships that are the same hull; figures: those of FIGURES that are known;
    source; doubts.
    """

    name: str
    kind: str
    particulars: Mapping[str, float]
    speed: float
    rudder_rate: float
    source: str
    group: str
    figures: Mapping[tuple[str, str], float]
    doubts: str = ""


SHIPS = tuple(
    LiteratureShip(**{**row, "figures": {tuple(key.split(" ")): value for key, value in row["figures"].items()}})
    for row in tables(Path(__file__).with_suffix(".toml"))["ship"]
)
"""In the order of the tables."""


def in_ship_units(figures: Mapping[str, float], length: float) -> dict[str, float]:
    """Lengths in L and angles in deg of ``figures`` [SI, rad]; length [m]."""
    return {
        name: math.degrees(value) if name.startswith("overshoot") else value / length for name, value in figures.items()
    }
