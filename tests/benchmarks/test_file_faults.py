"""The plant of the benchmark behaves as a ship, and its faults are judged as they should be."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.file_faults.__main__ import broken, judged
from benchmarks.file_faults.faults import FAULTS
from benchmarks.file_faults.plant import SETS, Hull, Plant, Weather, circle, drawn, run

NAME = "7 m tanker, mild, 2 Hz"


def test_the_plant_turns_to_starboard_drifts_outward_and_mirrors() -> None:
    hull = Hull(100.0, 16.0, 6.0, 0.75, 7.0, 2.0, 0.05)
    sides = []
    for side in (1.0, -1.0):
        plant = Plant(hull, Weather(), np.random.default_rng(0))
        sides.append(run(plant, circle(side * 35, 0.0, 30.0), 400.0, 1.0, 0.0))
    starboard, port = sides
    assert starboard["r"][-1] > 0 > starboard["v"][-1] and starboard["u"][-1] < 0.9 * hull.speed
    assert np.allclose(starboard["y"], -port["y"], atol=1e-3 * hull.length)


@pytest.mark.slow
def test_sound_files_are_quiet_and_a_fault_of_one_file_is_named() -> None:
    truth = drawn(NAME, 5)
    assert judged(truth, truth, None)[0] == "quiet"
    title = "one file: earth-fixed"
    assert judged(broken(truth, FAULTS[title], NAME, 5, title), truth, FAULTS[title])[0] == "named"


def test_there_are_30_faults_or_more_and_8_sets() -> None:
    assert len(FAULTS) >= 30 and len(SETS) == 8
    lengths = [some.hull.length for some in SETS.values()]
    assert min(lengths) == pytest.approx(3.0) and max(lengths) == pytest.approx(320.0)
