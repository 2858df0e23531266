"""Ships of the literature: figures of their sources."""

from __future__ import annotations

import math

import pytest

from benchmarks.literature import FIGURES, SHIPS
from cases.criteria.imo import REFERENCES


def test_the_tanker_turns_tighter_than_starting_ships_used_to() -> None:
    """Tactical diameter at 35 degrees 3.1 L; the first starting ship had 4.3."""
    found = next(ship.figures for ship in SHIPS if ship.name == "Esso tanker 190 000 tdw")
    assert found["turning:35", "tactical_diameter"] == pytest.approx(3.13, abs=0.06) and set(found) == set(FIGURES)


def test_measured_figures_precede_those_of_models() -> None:
    kvlcc2 = SHIPS[0]
    known = REFERENCES["kvlcc2_l7"]
    both = 0.5 * (known["turning:35", "advance"] + known["turning:-35", "advance"])
    assert kvlcc2.figures["turning:35", "advance"] == pytest.approx(both, rel=1e-5)
    assert all(set(ship.figures) <= set(FIGURES) for ship in SHIPS)
    assert all(ship.source and math.isfinite(ship.speed) for ship in SHIPS)
