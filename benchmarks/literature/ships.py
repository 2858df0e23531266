"""Ships with public manoeuvring data: main particulars, figures and where they come from.

A figure is one that was published for the ship or her model, or that of a published mathematical model of her (library
ship, or plant of this folder), simulated here. Port and starboard are averaged: a starting ship has no sides.
UNVERIFIED: from recollection or second hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

from benchmarks.literature import container, tanker
from benchmarks.literature.plants import Plant
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
    rate [rad/s] of her manoeuvres; model: name of a ship of the library, or a plant, None where only figures are
    known; published: figures that precede those of the model; group: ships that are the same hull; source; doubts.
    """

    name: str
    kind: str
    particulars: Mapping[str, float]
    speed: float
    rudder_rate: float
    source: str
    group: str
    model: str | Plant | None = None
    published: Mapping[tuple[str, str], float] = field(default_factory=dict)
    doubts: str = ""


def _both_sides(known: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    """Means over port and starboard of figures keyed by (manoeuvre, figure)."""
    sides: dict[tuple[str, str], list[float]] = {}
    for (text, figure), value in known.items():
        sides.setdefault((text.replace("-", ""), figure), []).append(value)
    return {key: sum(values) / len(values) for key, values in sides.items()}


_KVLCC2 = {"C_b": 0.81, "pitch_ratio": 0.721}

SHIPS = (
    LiteratureShip(
        "KVLCC2, 7 m model", "full",
        {"L": 7.0, "B": 1.27, "d": 0.455, **_KVLCC2, "D_P": 0.216, "A_R": 0.0539, "aspect_ratio": 2.208, "x_G": 0.245},
        1.179, math.radians(15.8),
        "free-running tests of MARIN (SIMMAN 2008), 35 degrees and zigzags; at 15 degrees the model of Yasukawa & "
        "Yoshimura (2015)", "kvlcc2", "kvlcc2_l7", _both_sides(REFERENCES["kvlcc2_l7"]),
    ),
    LiteratureShip(
        "ESSO OSAKA, 3 m model", "full",
        {"L": 3.0, "B": 0.48925, "d": 0.20114, "C_b": 0.83, "D_P": 0.084, "pitch_ratio": 0.7151, "A_R": 0.01063,
         "aspect_ratio": 1.539, "x_G": 0.09357},
        0.384, math.radians(20.0),
        "mathematical model from captive tests, Miyauchi et al. (2022)", "esso_osaka", "esso_osaka_3m",
    ),
    LiteratureShip(
        "ESSO OSAKA, ship", "full",
        {"L": 325.0, "B": 53.0, "d": 21.73, "C_b": 0.831, "D_P": 9.1, "pitch_ratio": 0.715, "A_R": 119.817,
         "x_G": 10.3},
        4.0, math.radians(2.3),
        "trials in deep water, Crane (1979), SNAME Transactions 87:251-283, as quoted in secondary literature; "
        "particulars Abkowitz (1980)", "esso_osaka", None,
        {("turning:35", "advance"): 3.1, ("turning:35", "tactical_diameter"): 2.85},
        "figures UNVERIFIED: the paper could not be read",
    ),
    LiteratureShip(
        "Esso tanker 190 000 tdw", "full",
        {"L": 304.8, "B": 47.17, "d": 18.46, "C_b": 0.83}, 8.23, math.radians(2.33),
        "mathematical model, van Berlekom & Goddard (1972), SNAME Transactions 80:264-298, appendix A", "tanker_190",
        tanker.PLANT, doubts="C_b from displacement 220 000 m3; propeller and rudder not published: by default",
    ),
    LiteratureShip(
        "Mariner, cargo ship", "fine",
        {"L": 160.93, "B": 23.17, "d": 7.47, "C_b": 0.597, "D_P": 6.7, "A_R": 30.0, "x_G": -3.7}, 7.7175,
        math.radians(5.0),
        "mathematical model from captive tests, Chislett & Stroem-Tejsen (1965), Hy-A report Hy-5", "mariner",
        "mariner", doubts="B, d, D_P, A_R UNVERIFIED",
    ),
    LiteratureShip(
        "SR 108, container ship", "fine",
        {"L": 175.0, "B": 25.4, "d": 8.5, "C_b": 0.559, "D_P": 6.533, "A_R": 33.0376, "aspect_ratio": 1.8219}, 7.0,
        math.radians(5.0),
        "mathematical model with roll, Son & Nomoto (1982), Naval Architecture and Ocean Engineering 20:73-83",
        "sr108", container.PLANT,
    ),
)  # fmt: skip
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
    if isinstance(ship.model, Plant):
        return in_ship_units(ship.model.figures(text), length)
    model = load_ship(str(ship.model))
    given = {} if str(ship.model) == "mariner" else {"speed": ship.speed}
    plan = parse_maneuver(text, model, rudder_rate=ship.rudder_rate, **given)
    found = figures_of(simulate(model, plan), plan)
    return in_ship_units({k: v for k, v in found.items() if (text.split(":")[0], k)}, length)
