"""What the model lacks and no effect of the library is: each kind shows by its form, and chance shows none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cases.trial import Trial
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.hypotheses.dictionary import AFTER_RUDDER
from diagnosis.hypotheses.events import TURNS
from diagnosis.hypotheses.forward_selection import ODDS, select_effects
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.unnamed import UnnamedForms, unnamed_forms
from diagnosis.judgement.verdict import verdict_of
from tests.support.diagnosis_cases import (
    Act,
    acted_windows,
    fitted_to,
    problem_of,
    pushed_by,
    pushed_problem,
    pushed_trials,
    quiet,
)
from tests.support.quick import first_quick

LARGE, MIDDLE = quiet(X=0.3, Y=0.6, N=0.4), quiet(X=0.1, Y=0.2, N=0.1)
"""Random forces large against the sensors, and less so."""
DELTA, POSITION = "delay of delta at times", "sensor of position at times"


def calm(seed: int = 1) -> tuple[SearchProblem, Estimate]:
    """Trials without effects in which the random forces are large."""
    return pushed_problem(seed, how=LARGE)


def of(trials: list[Trial]) -> UnnamedForms:
    problem, null = problem_of(trials)
    return unnamed_forms(problem.steps, problem.data, null)


def of_acted(act: Act) -> UnnamedForms:
    """Of windows in which ``act`` pushes the ship beside large random forces."""
    return unnamed_forms(*fitted_to(calm()[0], acted_windows(calm()[0], 1, act)))


def stream_that_turns() -> UnnamedForms:
    """By 3 cm/s with a period of 50 s and another phase in each run, while the mean of each run is no stream."""
    steps = calm()[0].steps
    x, y = (steps.ship.symbols.index(f"current.{a}") for a in "xy")

    def turned(k: int, z: np.ndarray, force: np.ndarray, theta: np.ndarray) -> None:
        phase = 2 * np.pi * k * steps.h / 50.0 + np.arange(z.shape[1])
        theta[x], theta[y] = 0.03 * np.sin(phase), 0.02 * np.cos(phase)

    return of_acted(turned)


def roll_after_turns() -> UnnamedForms:
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

    return of_acted(rolled)


def position_off_for_a_while() -> UnnamedForms:
    """By 15 cm in the second third of each run, as where a building throws the signals back."""
    off = []
    for t in pushed_trials(1, how=LARGE):
        third = (t.t - t.t[0]) * 3 // (t.t[-1] - t.t[0] + 1e-9)
        off.append(t.with_columns(x=t["x"] + 0.15 * (third == 1)))
    return of(off)


def rudder_late_now_and_then() -> UnnamedForms:
    """By 4 s in every other stretch of 10 s, and as early in the others."""
    late = []
    for i, t in enumerate(pushed_trials(1, how=MIDDLE)):
        way = np.where((t.t + 7 * i) % 20 < 10, 4.0, -4.0)
        late.append(t.with_columns(delta=np.interp(t.t + way, t.t, t["delta"])))
    return of(late)


def force_of(axis: int, form: str, size: float) -> UnnamedForms:
    """A single force that the ship lacks."""
    return unnamed_forms(*pushed_by(pushed_problem(1, h=1.0)[0], 1, axis, form, size))


SHOWN: list[tuple[Callable[..., UnnamedForms], tuple[object, ...], str, bool]] = [
    (stream_that_turns, (), f"stream that turns in {TURNS[2]:.3g} s", True),  # the nearest
    (roll_after_turns, (), AFTER_RUDDER, False),
    (position_off_for_a_while, (), POSITION, True),
    (rudder_late_now_and_then, (), DELTA, False),
    (force_of, (1, "nn", 0.5), "sway force", True),
    (force_of, (2, "cos", 0.4), "yaw force", True),
    (force_of, (2, "sin 2", 0.4), "yaw force", True),
]
"""How the trials come about, with what, the begin of the kind that shows it, and whether that shows most."""


@pytest.mark.parametrize(("made", "given", "kind", "is_most"), first_quick(SHOWN))
def test_what_has_no_name_shows_by_its_kind(
    made: Callable[..., UnnamedForms], given: tuple[object, ...], kind: str, is_most: bool
) -> None:
    found = made(*given)
    assert found.evidence > ODDS
    if is_most:
        assert max(found.by_kind, key=found.by_kind.__getitem__).startswith(kind)
    assert max(value for name, value in found.by_kind.items() if name.startswith(kind)) > 3
    assert found.mixture == pytest.approx(np.log(np.mean(np.exp(list(found.by_kind.values())))), rel=1e-6)


@pytest.mark.parametrize("seed", first_quick([1, 2, 3]))
def test_chance_shows_no_kind(seed: int) -> None:
    """Also where the random forces are large against the sensors."""
    problem, null = calm(seed)
    found = unnamed_forms(problem.steps, problem.data, null)
    assert found.evidence < ODDS
    events = [value for kind, value in found.by_kind.items() if kind == AFTER_RUDDER or kind.endswith((" s", "times"))]
    assert len(events) > len(TURNS) + 2 and max(events) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(("column", "by"), [("r", 0.002), ("v", 0.015)])
def test_a_fault_of_a_sensor_without_a_name_is_unknown_or_leaves_a_remainder(column: str, by: float) -> None:
    """A constant error of turn rate or sway velocity is no effect of the library."""
    problem, null = problem_of([t.with_columns(**{column: t[column] + by}) for t in pushed_trials(2)])
    before = unnamed_forms(problem.steps, problem.data, null)
    assert before.mixture > 20 and max(before.by_kind, key=before.by_kind.__getitem__) == f"sensor of {column}"
    found = select_effects(problem, null)
    left = [unnamed_forms(problem.steps, problem.data, fit).evidence for fit in found.fits]
    verdict, _, is_left = verdict_of(found.evidence, left.__getitem__, [c.measures for c in found.effects])
    assert verdict == "unknown" or is_left
