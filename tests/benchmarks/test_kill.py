"""A fit that is ended at a random moment leaves a whole folder or none, and resumed it has the values of another."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from benchmarks.kill import SIGNALS, Ended, alone, ended, rows, trials, values


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="sends signals")
def test_a_sample_of_kills_leaves_nothing_half_written(tmp_path: Path) -> None:
    trials(tmp_path)
    whole, seconds = alone(tmp_path, "fit", "whole")
    draw = random.Random(3)
    found = [ended(tmp_path, "fit", number, draw.uniform(0.1, 0.9), whole, seconds) for number in SIGNALS]
    assert [e.faults for e in found] == [()] * 3


def test_times_are_no_values_and_faults_are_counted() -> None:
    assert values({"seconds": 1.0, "rows": [{"timings_s": {}, "x": 2}]}) == {"rows": [{"x": 2}]}
    found = [Ended("fit", "SIGINT", (), 0.1), Ended("fit", "SIGINT", ("other values",), 0.25)]
    assert rows(found) == [["fit", "SIGINT", "2", "1", "other values (at 0.250)"]]
