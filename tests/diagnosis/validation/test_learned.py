"""What a learned residual closes of the rest: found where there is something to learn, else said to be none."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

import diagnosis.validation.learned as module
from diagnosis.diagnose import DiagnosisOptions, with_learned
from diagnosis.findings import LearnedResidual
from diagnosis.validation.learned import measure_learned_residual as measure
from mmg.errors import TooFewData, UserError
from residual.settings import TrainSettings
from tests.diagnosis.report.test_report import case
from tests.support import hybrids

pytestmark = pytest.mark.usefixtures("blank_figures")
QUICK = TrainSettings(seeds=2, epochs=25, width=12, penalty=0.001, rate=1e-2)
OPTIONS = DiagnosisOptions()
FOUND = LearnedResidual(0.4, 0.3, 0.25, (0.1, 0.4), 40, True, "residual kept: because", "")


@pytest.mark.slow
def test_what_is_missing_and_can_be_learned_is_closed() -> None:
    true = hybrids.lacking()
    tests = hybrids.trials(true, 3, 200, seed=9)
    found = measure(hybrids.ship(), hybrids.trials(true), tests, settings=QUICK)
    assert found.interval_90 is not None and 0 < found.interval_90[0] < found.reduction < found.interval_90[1]
    assert found.reduction > 0.3 and found.kept
    assert found.mse_after == pytest.approx((1 - found.reduction) * found.mse_before)


@pytest.mark.slow
def test_nothing_missing_nothing_closed() -> None:
    ship = hybrids.ship()
    quick = replace(QUICK, epochs=6, penalty=0.3)
    found = measure(ship, hybrids.trials(ship), hybrids.trials(ship, 3, 200, seed=9), settings=quick)
    assert abs(found.reduction) < 0.03 and not found.kept


@pytest.mark.slow
def test_a_single_test_trial_gives_no_interval_and_no_claim() -> None:
    true, few = hybrids.lacking(), replace(QUICK, epochs=2)
    found = measure(hybrids.ship(), hybrids.trials(true, 2, 200), hybrids.trials(true, 1, 100, seed=9), settings=few)
    assert found.interval_90 is None and "closes" not in found.sentence


def test_too_little_data_is_said() -> None:
    ship = hybrids.ship()
    with pytest.raises(TooFewData):
        measure(ship, hybrids.trials(ship, 1, 60), hybrids.trials(ship, 1, 60, seed=9), settings=QUICK)
    with pytest.raises(UserError, match="30 s"):
        measure(ship, hybrids.trials(ship, 2, 200), hybrids.trials(ship, 1, 25, seed=9), settings=QUICK)


def test_only_what_has_no_name_is_learned_and_only_with_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def stub(ship: Any, trials: Sequence[Any], tests: Sequence[Any], *given: Any, **more: Any) -> LearnedResidual:
        asked.append(ship)
        return FOUND

    monkeypatch.setattr(module, "measure_learned_residual", stub)
    trials = hybrids.trials(hybrids.ship(), 1, 60)
    unknown, named, none = (replace(case(v), trials=trials, tests=trials) for v in ("unknown", "named", "none"))
    whole = replace(named, remainder=False)
    for untested in (replace(unknown, tests=[]), none, whole):
        assert with_learned(untested, OPTIONS).learned is None
    assert not asked
    after = hybrids.lacking()
    rest = with_learned(replace(named, ship=after), OPTIONS)
    assert rest.learned is FOUND and asked == [after] and "learned residual" in rest.timings
    assert with_learned(unknown, OPTIONS).learned is FOUND


def test_missing_torch_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    trials = hybrids.trials(hybrids.ship(), 1, 60)
    found = with_learned(replace(case("unknown"), trials=trials, tests=trials), OPTIONS)
    assert found.learned is None and found.verdict == "unknown"
