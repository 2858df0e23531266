from __future__ import annotations

import pytest

from benchmarks.file_faults.simulated import FAULTS, contradictions
from cases.checks import check
from cases.criteria.standard_runs import simulated_trial
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial


@pytest.fixture(scope="module")
def mild() -> list[Trial]:
    ship = load_ship("kvlcc2_l7")
    return [simulated_trial(ship, maneuver, None, None, True, 5, 0.5) for maneuver in ("zigzag:5/5", "zigzag:10/10")]


def test_mild_runs_are_not_contradictory(mild: list[Trial]) -> None:
    assert contradictions(mild) == []


@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_is_named_and_nothing_else(fault: str, mild: list[Trial]) -> None:
    make, codes = FAULTS[fault]
    said = contradictions([make(trial) for trial in mild])
    assert said and set(said) <= set(codes)


def test_a_remedy_names_the_file_and_the_line(mild: list[Trial]) -> None:
    wrong = FAULTS["psi, v, r mirrored"][0]
    reports = check([wrong(t) for t in mild])
    texts = [f.text for report in reports for f in report.findings if f.level == "contradictory"]
    assert len(texts) == len(mild)
    assert all("trials.toml, [default]: sign = { psi = -1, v = -1, r = -1 }" in text for text in texts)


def test_one_wrong_file_of_a_folder_is_corrected_alone(mild: list[Trial]) -> None:
    reports = check([mild[0], FAULTS["velocities earth-fixed"][0](mild[1])])
    assert reports[0].verdict == "ok"
    text = next(f.text for f in reports[1].findings if f.level == "contradictory")
    assert mild[1].name in text
