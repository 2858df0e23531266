"""Stopping distances of full-scale ships, beside the estimate of MSC/Circ.1053 and with its coefficients.

python -m benchmarks.stopping: the ships of the library and those scaled from models, crash stop and coasting from their
test speed. The estimate is S = A ln(1 + B) + C ship lengths (MSC/Circ.1053, appendix 3): resistance proportional to
u^2, astern thrust constant and that of the stopped ship, C the way until it begins. A = m U^2 / (2 R L) and
B = astern thrust / R are those of each ship: it checks the integration and shows what a simple model leaves out.
"""

from __future__ import annotations

import argparse
import math

from benchmarks.record import record, table
from cases.criteria.batch_figures import figures_of_each
from cases.maneuvers.definitions import Maneuver, parse_maneuver
from cases.maneuvers.self_propulsion import surge_balance
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate_batch import SimulatedRuns, simulate_batch
from delivery.full_scale.scaled_ship import Scaling, scaled_ship
from mmg.ship import Ship


def ships() -> dict[str, Ship]:
    """Laden ships of 320 m and 325 m by name."""
    return {
        "KVLCC2 of the library, 320 m": load_ship("kvlcc2_full"),
        "KVLCC2 scaled from 7 m, 320 m": scaled_ship(load_ship("kvlcc2_l7"), Scaling(320.0)).ship,
        "ESSO OSAKA scaled from 3 m (priors), 325 m": scaled_ship(load_ship("esso_osaka_3m"), Scaling(325.0)).ship,
    }


def estimate(ship: Ship, plan: Maneuver, run: SimulatedRuns) -> tuple[float, float, float, float]:
    """A, B, C and S [ship lengths] of MSC/Circ.1053 for the ``run`` of the crash stop ``plan`` of a ``ship``."""
    own, L = plan.ship_of(ship), ship.particulars["L"]
    surge, (u, n) = surge_balance(own), (plan.speed, run.inputs[:, 0, 0])
    decelerated = -surge(u, 0.0)
    reversed_at = int((n < 0).argmax())
    rows = slice(0, int(run.last[0]) + 1)
    astern = -surge(1e-3 * u, float(n[rows].min()))
    A, B = u * u / (2 * decelerated * L), astern / decelerated
    begun = u * (run.t[reversed_at] - plan.parameters["order_time"]) / L
    return A, B, begun, A * math.log(1 + B) + begun


def rows_of(named: dict[str, Ship]) -> list[list[str]]:
    """A row per ship: revolutions, reach and time of the crash stop and of coasting, and the estimate."""
    found = []
    for name, ship in named.items():
        plan = parse_maneuver("crash-stop", ship)
        L = ship.particulars["L"]
        run = simulate_batch(ship, plan, dt=2.0)
        (stop,) = figures_of_each(run, plan)
        A, B, C, S = estimate(ship, plan, run)
        coast = parse_maneuver("coasting:0.3", ship, duration=6000.0)
        (way,) = figures_of_each(simulate_batch(ship, coast, dt=2.0), coast)
        found.append([
            name, f"{plan.speed:.2f}", f"{plan.n:.2f}",
            f"{stop['track_reach'] / L:.1f}", f"{stop['head_reach'] / L:.1f}",
            f"{stop['stopping_time'] / 60:.1f}", f"{A:.1f}", f"{B:.2f}", f"{C:.1f}", f"{S:.1f}",
            f"{way['track_reach'] / L:.1f}", f"{way['stopping_time'] / 60:.0f}",
        ])  # fmt: skip
    return found


def main() -> None:
    """Record the table."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "").parse_args()
    head = (
        "ship", "U [m/s]", "n [1/s]", "track reach [L]", "head reach [L]", "time [min]", "A", "B", "C",
        "A ln(1 + B) + C [L]", "coasting to 0.3 U [L]", "time [min]",
    )  # fmt: skip
    record("Stopping of full-scale ships", "python -m benchmarks.stopping", table(list(head), rows_of(ships())))


if __name__ == "__main__":
    main()
