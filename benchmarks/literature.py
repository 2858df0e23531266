"""How far ``mmg ships --new`` can be trusted: ships of the literature from their particulars alone.

Run from the repository root: python -m benchmarks.literature [--hull NAME] [--record]
Each ship is made from her particulars, as the command makes her, and turns and zigzags as she did. The factors on a few
of her coefficients (``cases/shipfiles/new_ship.py``) were determined from these ships; 5f878e7 has the script, which
also left each ship out in turn.

A figure of literature.toml is one that was published for the ship or her model, or that of a published mathematical
model, simulated at 411ed8c. Port and starboard are averaged: a starting ship has no sides. UNVERIFIED: from
recollection or second hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.record import Figure, parser_of, report, table
from benchmarks.toml import tables
from cases.criteria.standard_runs import figures_of_each
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.new_ship import HULLS, new_ship
from cases.simulation.simulate_batch import draw_coefficients, simulate_batch
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

DRAWS, SEED = 200, 0
"""Of the intervals of a figure."""
Key = tuple[str, str]

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


def figures(ship: Ship, real: LiteratureShip, given: Mapping[str, np.ndarray], count: int) -> dict[Key, np.ndarray]:
    """(Manoeuvre, figure) -> (count,) of ``ship`` with the coefficients ``given``, symbol -> (count,), in the
    manoeuvres that are known of the ``real`` one; NaN where a figure is not reached."""
    L, simulator, known = real.particulars["L"], Simulator(ship), real.figures
    found = {key: np.full(count, np.nan) for key in known}
    for text in dict.fromkeys(text for text, _ in known):
        longest = {"duration": 60 * L / real.speed} if text == "turning:15" else {}
        plan = parse_maneuver(text, ship, speed=real.speed, rudder_rate=math.radians(real.rudder_rate), **longest)
        runs = simulate_batch(simulator, plan, given, 0.25 * time_scale(L))
        for m, reached in enumerate(figures_of_each(runs, plan)):
            for figure, value in in_ship_units(reached, L).items():
                if (text, figure) in found:
                    found[text, figure][m] = value
    return found


def judged(real: LiteratureShip, hull: str) -> tuple[dict[Key, float], int]:
    """Errors (logarithms) of the figures of a starting ship with this hull, and how many of the known ones lie in their
    90 % intervals over draws of her priors."""
    ship, known = new_ship("start", {**real.particulars, "U_0": real.speed}, hull), real.figures
    plain = {s: np.array([c.value]) for s, c in ship.coefficients.items()}
    errors = {key: float(np.log(v[0] / known[key])) for key, v in figures(ship, real, plain, 1).items()}
    inside = 0
    for key, values in figures(ship, real, draw_coefficients(ship, DRAWS, SEED), DRAWS).items():
        whole = np.where(np.isfinite(values), values, np.inf)
        low, high = np.quantile(whole, (0.05, 0.95), method="nearest")
        inside += bool(low <= known[key] <= high)
    return errors, inside


def main() -> None:
    """Prints the errors of each ship and, if asked, records their sizes."""
    parser = parser_of("literature", __doc__)
    parser.add_argument("--hull", choices=HULLS, default=HULLS[0])
    given = parser.parse_args()
    rows, errors, inside, count = [], dict[str, list[float]](), 0, 0
    for real in SHIPS:
        found, hits = judged(real, given.hull)
        rows.append([real.name, *(f"{math.exp(found[k]) - 1:+.0%}" if k in found else "-" for k in FIGURES)])
        inside, count = inside + hits, count + len(found)
        for (_, figure), error in found.items():
            errors.setdefault("overshoot" if "overshoot" in figure else "length", []).append(error)
    print("\n".join(table(["ship", *(f"{text} {figure}" for text, figure in FIGURES)], rows)))
    made = {"literature_inside": Figure("figures of known ships inside the 90 % interval of a starting ship",
                                        inside, of=count)}  # fmt: skip
    for what, values in errors.items():
        size = math.sqrt(float(np.nanmean(np.square(values))))
        made[f"literature_{what}"] = Figure(f"root mean square error of a starting ship: {what}s", size, "%")
    report(made, f"literature --hull {given.hull}", given.record)


if __name__ == "__main__":
    main()
