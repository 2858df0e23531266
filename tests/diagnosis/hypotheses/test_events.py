"""Events: stretches together are the whole, and what stops, swings or turns shows; chance does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.estimation.kalman import DrivenColumns
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.hypotheses.dictionary import DELAYS, Dictionary
from diagnosis.hypotheses.events import (
    AT_TIMES,
    LATE,
    MOST,
    SWINGING,
    Events,
    EventSlopes,
    event_slopes,
    swing_backgrounds,
)
from diagnosis.hypotheses.refit import SearchProblem
from tests.support.diagnosis_cases import pushed_problem, quiet

DELTA = "delay of delta at times"


def calm() -> tuple[SearchProblem, Estimate]:
    """Trials without effects in which the random forces are large."""
    return pushed_problem(1, how=quiet(X=0.3, Y=0.6, N=0.4))


def test_all_stretches_together_are_the_delay_of_the_dictionary() -> None:
    """Responses, slopes of the log determinant, and so the slope of the likelihood, exactly."""
    problem, null = calm()
    steps, data = problem.steps, problem.data
    active = active_states(steps, null.free.symbols, null.theta)
    forms, made = Dictionary(steps, data, null, active), []

    def columns(linear: LinearModel) -> list[DrivenColumns]:
        made.append(Events.of(data, forms, linear, 3.0))
        return [*forms.columns(linear), *made[0].columns]

    at = linearise_and_filter(steps, data, null, active, columns)
    place, first = forms.labels.index(("delay of delta", "4 s")), len(null.p)
    own = np.array([kind == DELTA for kind in made[0].kinds])
    white = at.white[..., first + len(forms.kinds) : -1][..., own]
    np.testing.assert_allclose(white.sum(axis=3), at.white[..., first + place], atol=1e-9)
    along = made[0].logdet_gradient(at)[:, own]
    assert along.sum() == pytest.approx(forms.logdet_gradient(at)[place], rel=1e-9)
    assert 0 < own.sum() * len(data.run) <= 2 * MOST

    every = [*range(first), *(first + len(forms.kinds) + np.flatnonzero(own)), at.white.shape[3] - 1]
    logdet = at.logdet_gradient.sum(axis=0)[:first]
    kinds = tuple(kind for kind in made[0].kinds if kind == DELTA)
    found = event_slopes(at.white[..., every], logdet, null.p, along, kinds)[DELTA]
    flat = at.white[..., [*range(first), first + place, -1]].reshape(-1, first + 2)
    gram, known = flat.T @ flat, np.eye(first)
    taken = np.linalg.solve(gram[:first, :first] + known, gram[:first, first])
    slope = -(gram[:-1, -1] + np.append(logdet, forms.logdet_gradient(at)[place])) - np.append(null.p, 0.0)
    assert found.g.sum() == pytest.approx(slope[-1] - taken @ slope[:-1], rel=1e-6, abs=1e-6)
    assert found.S.sum() == pytest.approx(gram[first, first] - gram[first, :first] @ taken, rel=1e-6)


def swings(level: float, line: float = 1.0) -> dict[str, EventSlopes]:
    """Forces that swing at twelve rates, of unit information: slopes of this variance, of ``line`` times it at one."""
    rng, found = np.random.default_rng(3), {}
    for i in range(12):
        g = np.sqrt(level * (line if i == 6 else 1.0)) * rng.standard_normal(400)
        found[f"{SWINGING} {i} times a length"] = EventSlopes(g, np.eye(400))
    return found | {"sensor of position at times": EventSlopes(9.0 * np.ones(4), np.eye(4))}


@pytest.mark.parametrize(("level", "expected"), [(0.7, 1.0), (1.0, 1.0), (1.5, 1.5)])
def test_what_is_strong_at_all_rates_is_no_swing_and_a_line_does_not_hide_itself(level: float, expected: float) -> None:
    for line in (1.0, 5.0):
        ratios = swing_backgrounds(swings(level, line))
        assert len(ratios) == 12 and all(name.startswith(SWINGING) for name in ratios)
        np.testing.assert_allclose(list(ratios.values()), expected, rtol=0.1)


def test_the_time_of_a_movement_between_two_samples_is_not_known() -> None:
    """A delay of one second, over a whole run, as each of the dictionary's delays has it; and what of it is nothing."""
    problem, null = calm()
    steps, data = problem.steps, replace(problem.data, sample=0.4)
    forms, made = Dictionary(steps, data, null, active_states(steps, null.free.symbols, null.theta)), []

    def columns(linear: LinearModel) -> list[DrivenColumns]:
        scaled = zip(forms.actions, forms.scaled(linear, forms.actions), strict=True)
        made.append((Events.of(data, forms, linear, 3.0), dict(scaled)))
        return []

    linearise_and_filter(steps, data, null, forms.active, columns)
    events, actions = made[0]
    x = data.inputs[..., steps.model.controls.index("delta")]
    action, size = actions["delta"]
    for late, delayed, part in zip(DELAYS, action.delayed, action.per_second, strict=True):
        m = max(1, round(late / data.h))
        np.testing.assert_allclose((part * delayed * data.h).sum(axis=0), x[0] - x[-m:].mean(axis=0), atol=1e-9)
    of_a_second = action.per_second[DELAYS.index(LATE)] / size
    assert events.allowed[DELTA] == pytest.approx(0.4 / 12**0.5 * of_a_second)
    throughout = events.allowed["delay of delta"] * size / action.per_second  # seconds, of each of the delays
    assert 0.4 / 12**0.5 <= np.sqrt((throughout**2).sum()) < 2 * 0.4 / 12**0.5
    assert set(events.allowed) == {f"delay of {name}{end}" for name in forms.actions for end in ("", AT_TIMES)}
