"""Events: stretches together are the whole, and what stops, swings or turns shows; chance does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis.estimation.kalman import DrivenColumns
from diagnosis.estimation.linearisation import linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import LinearModel
from diagnosis.hypotheses.dictionary import AFTER_RUDDER, DELAYS, Dictionary
from diagnosis.hypotheses.events import (
    AT_TIMES,
    LATE,
    MOST,
    SWINGING,
    TURNS,
    Events,
    EventSlopes,
    event_slopes,
    swing_backgrounds,
)
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unnamed import UnnamedForms, unnamed_forms
from tests.support.diagnosis_cases import acted_windows, fitted_to, problem_of, pushed_problem, pushed_trials, quiet

DELTA, POSITION = "delay of delta at times", "sensor of position at times"


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


def of(trials: list[Trial]) -> UnnamedForms:
    problem, null = problem_of(trials)
    return unnamed_forms(problem.steps, problem.data, null)


def test_chance_shows_no_events() -> None:
    problem, null = calm()
    found = unnamed_forms(problem.steps, problem.data, null)
    other = [value for kind, value in found.by_kind.items() if kind == AFTER_RUDDER or kind.endswith(" s")]
    assert len(other) == len(TURNS) + 1
    assert found.evidence < ODDS and max(found.by_kind[DELTA], found.by_kind[POSITION], *other) < 2


def test_a_stream_that_turns_within_each_run_shows() -> None:
    """By 3 cm/s with a period of 50 s and another phase in each run, while the mean of each run is no stream."""
    steps = calm()[0].steps
    x, y = (steps.ship.symbols.index(f"current.{a}") for a in "xy")

    def turned(k: int, z: np.ndarray, force: np.ndarray, theta: np.ndarray) -> None:
        phase = 2 * np.pi * k * steps.h / 50.0 + np.arange(z.shape[1])
        theta[x], theta[y] = 0.03 * np.sin(phase), 0.02 * np.cos(phase)

    found = unnamed_forms(*fitted_to(calm()[0], acted_windows(calm()[0], 1, turned)))
    assert found.evidence > ODDS
    assert max(found.by_kind, key=found.by_kind.__getitem__).endswith(" 48 s")  # the nearest of TURNS


def test_a_roll_that_swings_after_turns_shows() -> None:
    """An oscillator with a period of 7 s and 5 % of the critical damping, driven by speed and turn rate, not by the
    rudder, that pushes the hull to the side and turns it."""
    steps, omega, heel = calm()[0].steps, 2 * np.pi / 7.0, np.zeros((2, calm()[0].data.inputs.shape[1]))

    def rolled(k: int, z: np.ndarray, force: np.ndarray, theta: np.ndarray) -> None:
        for _ in range(10):
            h = steps.h / 10
            heel[1] += h * (omega**2 * (10 * z[3] * z[5] - heel[0]) - 0.1 * omega * heel[1])
            heel[0] += h * heel[1]
        force[1] -= 2.0 * heel[0]
        force[2] += 6.0 * heel[0]

    found = unnamed_forms(*fitted_to(calm()[0], acted_windows(calm()[0], 1, rolled)))
    assert found.evidence > ODDS and found.by_kind[AFTER_RUDDER] > 3


@pytest.mark.slow
def test_a_position_that_is_off_for_a_while_shows() -> None:
    """By 15 cm in the second third of each run, as where a building throws the signals back."""
    off = []
    for t in pushed_trials(1, how=quiet(X=0.3, Y=0.6, N=0.4)):
        third = (t.t - t.t[0]) * 3 // (t.t[-1] - t.t[0] + 1e-9)
        off.append(t.with_columns(x=t["x"] + 0.15 * (third == 1)))
    found = of(off)
    assert found.evidence > ODDS and max(found.by_kind, key=found.by_kind.__getitem__) == POSITION


@pytest.mark.slow
def test_a_rudder_that_comes_late_now_and_then_shows() -> None:
    """By 4 s in every other stretch of 10 s, and as early in the others."""
    late = []
    for i, t in enumerate(pushed_trials(1, how=quiet(X=0.1, Y=0.2, N=0.1))):
        way = np.where((t.t + 7 * i) % 20 < 10, 4.0, -4.0)
        late.append(t.with_columns(delta=np.interp(t.t + way, t.t, t["delta"])))
    found = of(late)
    assert found.evidence > ODDS and found.by_kind[DELTA] > 5


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
