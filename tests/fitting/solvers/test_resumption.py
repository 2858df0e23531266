"""A fit that was stopped and resumed ends with the values of one that was not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from fitting.calibrate import FitOptions, calibrate
from fitting.result import FitResult, read_fit
from fitting.settings import Settings
from fitting.solvers.control import INTERRUPTED, interrupts_noted
from mmg.progress import Progress
from tests.support.calibrated import FREE

pytestmark = pytest.mark.usefixtures("blank_figures")
TIMES = {"created", "command", "timings_s", "seconds"}


def fitted(settings: Settings, stop_at: int = 0, resume: FitResult | None = None, effect: str = "") -> FitResult:
    """Six coefficients on one run in 24 windows; Ctrl-C at the iterate ``stop_at`` of all."""
    ship = load_ship("esso_osaka_3m")
    ship = (ship.with_effect(effect) if effect else ship).fixing([s for s in ship.symbols if s not in FREE])
    seen: list[Progress] = []

    def press(event: Progress) -> None:
        seen.append(event)
        INTERRUPTED.requested = INTERRUPTED.requested or len(seen) == stop_at

    options = FitOptions(next_trial=False, instruments=(), resume=resume)
    with interrupts_noted():
        return calibrate(resume.start if resume else ship, demo_trials(3, dt=0.5)[0][:1], (), settings, options, press)


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in TIMES}
    return [without_times(v) for v in value] if isinstance(value, list) else value


SETTINGS = Settings(window=5.0)


@pytest.fixture(scope="module")
def whole() -> FitResult:
    return fitted(SETTINGS)


@pytest.mark.parametrize("stop_at", [10, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 4, 7, 9))])
def test_ctrl_c_at_any_iterate_changes_no_value(stop_at: int, whole: FitResult, tmp_path: Any) -> None:
    stopped = fitted(SETTINGS, stop_at)
    assert stopped.status == "User_Requested_Stop" and not stopped.converged
    stopped.save(tmp_path / "run")
    resumed = fitted(SETTINGS, resume=read_fit(tmp_path / "run"))
    assert without_times(resumed.to_dict()) == without_times(whole.to_dict())
    assert resumed.ship == whole.ship and resumed.iterate and whole.iterate
    for name, values in whole.iterate.items():
        np.testing.assert_array_equal(resumed.iterate[name], values)


@pytest.mark.slow
def test_a_wider_iteration_limit_gives_what_it_would_have_given(whole: FitResult) -> None:
    limited = fitted(Settings(window=5.0, max_iterations=2))
    assert not limited.converged
    resumed = fitted(SETTINGS, resume=limited)
    assert without_times(resumed.to_dict()) == without_times(whole.to_dict())


@pytest.mark.slow
def test_the_same_iteration_limit_goes_on_from_the_best_iterate(whole: FitResult) -> None:
    settings, found = Settings(window=5.0, max_iterations=4), None
    for _ in range(12):
        found = fitted(settings, resume=found)
        if found.converged:
            break
    assert found and found.converged and found.objective == pytest.approx(whole.objective, rel=0.02)
