"""Mathematical models of the literature as plants: balance, sides, and figures of their sources."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.literature import container, tanker
from benchmarks.literature.ships import FIGURES, SHIPS
from cases.criteria.imo import REFERENCES


def test_the_tanker_runs_16_knots_at_her_nominal_80_revolutions_per_minute() -> None:
    assert 60 * tanker.PLANT.approach()[1] == pytest.approx(80, rel=0.005)


def test_the_tanker_turns_tighter_than_starting_ships_used_to() -> None:
    """Tactical diameter at 35 degrees 3.1 L; the first starting ship had 4.3."""
    found = tanker.PLANT.figures("turning:35")
    assert found["tactical_diameter"] / tanker.LENGTH == pytest.approx(3.13, abs=0.03)


def test_the_container_ship_is_the_same_to_both_sides() -> None:
    one, other = (container.PLANT.figures(f"turning:{angle}") for angle in ("35", "-35"))
    for name, value in one.items():
        assert value == pytest.approx(other[name], rel=1e-9), name
    assert 3 < one["tactical_diameter"] / container.LENGTH < 5


@pytest.mark.parametrize("plant", [tanker.PLANT, container.PLANT])
def test_a_plant_turns_to_the_side_of_the_rudder(plant) -> None:
    start, n = plant.approach()
    for delta in (0.2, -0.2):
        assert np.sign(plant.rates(start, delta, n)[5]) == np.sign(delta)
        assert plant.rates(start, delta, n)[3] < 0


def test_measured_figures_precede_those_of_models() -> None:
    kvlcc2 = SHIPS[0]
    known = REFERENCES["kvlcc2_l7"]
    both = 0.5 * (known["turning:35", "advance"] + known["turning:-35", "advance"])
    assert kvlcc2.published["turning:35", "advance"] == pytest.approx(both)
    assert set(kvlcc2.published) <= {*FIGURES, ("turning:35", "transfer")} | set(kvlcc2.published)
    assert all(ship.source and math.isfinite(ship.speed) for ship in SHIPS)
