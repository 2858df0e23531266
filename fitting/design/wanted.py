"""What a planned trial is to make better known: coefficients, or figures of standard manoeuvres, as combinations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cases.criteria.standard_runs import figures_of
from cases.maneuvers.definitions import parse_maneuver
from cases.simulation.simulate_batch import simulate_batch
from fitting.nlp.prior import Prior
from mmg.components.catalogue import ROLES, coefficient_table
from mmg.errors import Conflict, NoSolution, UnknownName
from mmg.motion.froude import time_scale
from mmg.rollout import Simulator
from mmg.ship import Ship

FIGURES = {
    "advance": ("turning:35", "advance"),
    "transfer": ("turning:35", "transfer"),
    "tactical_diameter": ("turning:35", "tactical_diameter"),
    "first_overshoot_10": ("zigzag:10/10", "overshoot_1"),
    "second_overshoot_10": ("zigzag:10/10", "overshoot_2"),
    "first_overshoot_20": ("zigzag:20/20", "overshoot_1"),
    "track_reach": ("crash-stop", "track_reach"),
}
"""Figures that may be asked for: the manoeuvre, and its figure there."""

STEP, SAMPLE = 0.1, 0.25
"""Change of a coefficient [prior standard deviations] for a slope, and sampling of a manoeuvre [s of a 3 m model]."""


def coefficients_wanted(ship: Ship, free: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Those of ``free`` coefficients that ``names`` say: symbols, roles of the ``ship`` such as "hull", or "all".

    Raises UserError for a name that is neither, and for coefficients that the run did not fit.
    """
    chosen: list[str] = []
    for name in names:
        if name == "all":
            own = tuple(free)
        elif name in ship.components and name in ROLES:
            bare = {role: model for role, model in ship.components.items() if role == name}
            own = tuple(s for s in coefficient_table(bare, ship.particulars) if s in ship.coefficients and s in free)
            inertia = coefficient_table({}, ship.particulars)
            own = tuple(s for s in own if s not in inertia)
        elif name in ship.coefficients:
            own = (name,) if name in free else ()
        else:
            roles = ", ".join(ship.components)
            raise UnknownName(
                f"--coefficients {name}: {ship.called} has no such coefficient; give symbols (mmg ships RUN "
                f"lists them), all, or a part of her: {roles}"
            )
        if not own:
            raise Conflict(f"--coefficients {name}: not fitted in this run, so no trial can make it better known")
        chosen += own
    return tuple(dict.fromkeys(chosen))


def figure_slopes(simulator: Simulator, prior: Prior, names: Sequence[str]) -> np.ndarray:
    """Slopes (m, P) of the figures ``names`` on the free coefficients of ``prior``, by central differences.

    simulator: of the calibrated ship. Raises UserError for an unknown figure, and for one that she does not reach.
    """
    ship = simulator.ship
    for name in names:
        if name not in FIGURES:
            raise UnknownName(f"--figures {name}: unknown; known: {', '.join(FIGURES)}")
    at, P = prior.positions(ship), len(prior.symbols)
    theta = np.repeat(ship.values[:, None], 2 * P, axis=1)
    for i in range(P):
        theta[at[i], [i, P + i]] += np.array([STEP, -STEP]) * prior.std[i]
    slopes: dict[str, np.ndarray] = {}
    for text in dict.fromkeys(FIGURES[name][0] for name in names):
        maneuver = parse_maneuver(text, ship)
        runs = simulate_batch(simulator, maneuver, theta, SAMPLE * time_scale(ship.particulars["L"]))
        rows = [figures_of(runs.trial(m), maneuver) for m in range(2 * P)]
        for name in names:
            if FIGURES[name][0] == text:
                values = np.array([row.get(FIGURES[name][1], np.nan) for row in rows], dtype=float)
                slopes[name] = (values[:P] - values[P:]) / (2 * STEP)
    for name, slope in slopes.items():
        if not np.isfinite(slope).all() or not slope.any():
            raise NoSolution(
                f"--figures {name}: {ship.called} does not reach it in {FIGURES[name][0]}; ask for another"
            )
    return np.array([slopes[name] for name in names])
