"""Ships with public manoeuvring data: main particulars, figures and where they come from.

A figure is one that was published for the ship or her model, or that of a published mathematical model of her, which
was simulated once or is a ship of the library. Port and starboard are averaged: a starting ship has no sides.
UNVERIFIED: from recollection or second hand.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

from cases.criteria.imo import REFERENCES
from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate

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
    rate [rad/s] of her manoeuvres; model: name of a ship of the library, None where only figures are known; published:
    figures that precede those of the model; group: ships that are the same hull; source; doubts.
    """

    name: str
    kind: str
    particulars: Mapping[str, float]
    speed: float
    rudder_rate: float
    source: str
    group: str
    model: str | None = None
    published: Mapping[tuple[str, str], float] = field(default_factory=dict)
    doubts: str = ""


def _both_sides(known: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    """Means over port and starboard of figures keyed by (manoeuvre, figure)."""
    sides: dict[tuple[str, str], list[float]] = {}
    for (text, figure), value in known.items():
        sides.setdefault((text.replace("-", ""), figure), []).append(value)
    return {key: sum(values) / len(values) for key, values in sides.items()}


def _ships() -> Iterator[LiteratureShip]:
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    for row in tomllib.loads(text)["ship"]:
        published = {tuple(key.split(" ")): value for key, value in row.pop("published", {}).items()}
        if row.get("model") in REFERENCES:
            published = _both_sides(REFERENCES[row["model"]])
        row["rudder_rate"] = math.radians(row["rudder_rate"])
        yield LiteratureShip(**row, published=published)


SHIPS = tuple(_ships())
"""In the order of the tables."""


def in_ship_units(figures: Mapping[str, float], length: float) -> dict[str, float]:
    """Lengths in L and angles in deg of ``figures`` [SI, rad]; length [m]."""
    return {
        name: math.degrees(value) if name.startswith("overshoot") else value / length for name, value in figures.items()
    }


@cache
def known_figures(name: str) -> dict[tuple[str, str], float]:
    """(Manoeuvre, figure) -> value, lengths in L, angles in deg, of the ship of this name. KeyError if unknown."""
    ship = {one.name: one for one in SHIPS}[name]
    found: dict[tuple[str, str], float] = {}
    for text in dict.fromkeys(text for text, _ in FIGURES) if ship.model is not None else ():
        kind, _, angles = text.partition(":")
        for side in (angles, f"-{angles}"):
            found |= {(f"{kind}:{side}", figure): value for figure, value in _simulated(ship, f"{kind}:{side}").items()}
    known = _both_sides(found) | dict(ship.published)
    return {key: known[key] for key in FIGURES if key in known}


def _simulated(ship: LiteratureShip, text: str) -> dict[str, float]:
    """Figures of the ship's mathematical model, in ship units."""
    length = ship.particulars["L"]
    model = load_ship(str(ship.model))
    given = {} if str(ship.model) == "mariner" else {"speed": ship.speed}
    plan = parse_maneuver(text, model, rudder_rate=ship.rudder_rate, **given)
    found = figures_of(simulate(model, plan), plan)
    return in_ship_units({k: v for k, v in found.items() if (text.split(":")[0], k)}, length)
