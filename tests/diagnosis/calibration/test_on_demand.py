"""A calibration names its second estimator without reading the modules of a diagnosis."""

from __future__ import annotations

import subprocess
import sys

from diagnosis.calibration.filter_estimate import filter_estimate
from diagnosis.calibration.on_demand import second_estimate
from tests.support.diagnosis_cases import FEW, pushed_trials


def test_it_is_the_estimate_by_a_filter() -> None:
    trials = pushed_trials(7)[:2]
    assert second_estimate(FEW, trials) == filter_estimate(FEW, trials)


def test_the_modules_of_a_diagnosis_are_not_read_to_name_it() -> None:
    words = "import sys, diagnosis.calibration.on_demand; print('diagnosis.prepare' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", words], capture_output=True, text=True).stdout.split() == ["False"]
