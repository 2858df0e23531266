"""Exported C against the simulation: the largest difference over a minute of a zigzag, for each ship of the library.

Run from the repository root: python -m benchmarks.exports [--record]; needs a C compiler.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.record import Figure, keep
from cases.inputs import model_inputs
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate
from mmg.rollout import Simulator
from tests.support.c_products import compiled, library_product

SHIPS = ("esso_osaka_3m", "kvlcc2_l7", "kvlcc2_full", "mariner", "vectwin_3m")
STEPS, STEP = 600, 0.1
"""Of the comparison; seconds."""


def difference(name: str, folder: Path) -> float:
    """Largest difference of a state of the ship ``name`` by the range of that state."""
    ship = load_ship(name)
    trial = simulate(ship, parse_maneuver("zigzag:10/10", ship), STEP)
    made, simulator = compiled(library_product(name), folder), Simulator(ship)
    inputs = model_inputs(trial, simulator.model.controls).array[:STEPS]
    state = made.settle(trial.states[0], inputs[0])
    ours = simulator.run(state[:, None], inputs[:, :, None], STEP, ship.values)[:, :, 0]
    theirs = [state]
    for row in inputs[: len(ours) - 1]:
        theirs.append(made.step(theirs[-1], row, STEP)[0])
    return float((np.abs(np.array(theirs) - ours).max(axis=0) / np.maximum(np.ptp(ours, axis=0), 1e-9)).max())


def main() -> None:
    """Measure, print and, if asked, record."""
    with tempfile.TemporaryDirectory() as scratch:
        found = {}
        for name in SHIPS:
            (folder := Path(scratch) / name).mkdir()
            found[name] = difference(name, folder)
            print(f"{name}: {found[name]:.1e}", flush=True)
    if "--record" in sys.argv:
        what = f"exported C against the simulation over {STEPS * STEP:g} s, by the range of a state, {len(SHIPS)} ships"
        keep({"export_difference": Figure(what, max(found.values()))}, "python -m benchmarks.exports")


if __name__ == "__main__":
    main()
