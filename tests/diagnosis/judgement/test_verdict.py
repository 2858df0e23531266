"""The five lines of the verdict, sizes that an effect cannot have, and what a diagnosis says of its own limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from cases.trial_set import TrialSet
from diagnosis.estimation.candidates import Candidate
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.linearisation import Point
from diagnosis.estimation.map_estimate import Estimate, estimate
from diagnosis.estimation.noise_sizes import least_noise
from diagnosis.estimation.parameters import priors_of_effects, set_values
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import TESTS, Budget
from diagnosis.hypotheses.forward_selection import ODDS, Selection, select_effects
from diagnosis.hypotheses.refit import SearchProblem, refit
from diagnosis.hypotheses.unexplained_force import estimated_force
from diagnosis.hypotheses.unnamed import unnamed_forms
from diagnosis.inputs import Case
from diagnosis.judgement.budget import budget_of, left_out_errors
from diagnosis.judgement.verdict import impossible_size, limits, verdict_of
from diagnosis.prepare import InputReading, Prepared
from diagnosis.validation.held_out import errors, window_length
from mmg.effects import EFFECTS
from tests.support.diagnosis_cases import candidate, full_model, pushed_by, pushed_problem, pushed_trials
from tests.support.quick import first_quick

RUNS = (("zigzag:20/20", 40.0), ("turning:-20", 40.0))


@cache
def ready() -> Prepared:
    problem, null = pushed_problem(1, runs=RUNS, h=1.0)
    trials, reading = TrialSet.of(pushed_trials(1, runs=RUNS)), InputReading(False, None, 0.1, 3.0)
    return Prepared(
        Case(problem.steps.ship, trials, trials), problem, full_model(), null, reading, 1, (), (1.0, float("inf"))
    )


@pytest.mark.parametrize(
    ("named", "left", "measures", "is_random", "expected"),
    [
        ([], [0.9 * ODDS], [], True, ("none", 0, False)),
        ([], [1.1 * ODDS], [], True, ("unknown", 0, False)),
        ([], [-1.0], [], False, ("unknown", 0, False)),
        ([4.0], [9.0, -0.1], [False], True, ("named", 1, False)),
        ([40.0], [50.0, 0.1], [False], True, ("named", 1, True)),
        ([40.0], [50.0, -1.0], [False], False, ("named", 1, True)),
        ([40.0], [50.0, 41.0], [False], True, ("unknown", 0, False)),  # a free force beside it explains more
        ([5.0, 40.0], [50.0, 45.0, -1.0], [False] * 2, True, ("named", 2, False)),  # the second explains the rest
        ([40.0, 5.0], [50.0, 9.0, 6.0], [False] * 2, True, ("named", 1, True)),
        ([5.0, 5.0], [50.0, 9.0, 6.0], [False] * 2, True, ("unknown", 0, False)),
        ([9.0, 9.0], [50.0, 9.0, -1.0], [True, True], True, ("none", 2, False)),  # instruments make no verdict
        ([9.0, 9.0], [50.0, 9.0, 1.1 * ODDS], [True, True], True, ("unknown", 2, False)),
        ([9.0, 9.0], [50.0, 9.0, 0.1], [True, False], True, ("named", 2, True)),
    ],
)
def test_the_verdict_follows_from_the_evidence(
    named: list[float], left: list[float], measures: list[bool], is_random: bool, expected: tuple[str, int, bool]
) -> None:
    assert verdict_of(named, left.__getitem__, measures, is_random) == expected


def said(null: Estimate, budget: object = SimpleNamespace(by=TESTS)) -> dict[str, str]:
    """Sentences on what these trials cannot tell, by code, with this fit without effects."""
    found = SimpleNamespace(searches=[SimpleNamespace(scores=())])
    rows = limits(replace(ready(), null=null), found, budget)  # type: ignore[arg-type]
    return {row.code: str(row) for row in rows}


@pytest.mark.slow
def test_a_fit_that_is_not_what_the_tests_take_it_for_is_doubted() -> None:
    null, least = ready().null, least_noise(ready().full.ship)
    sound = replace(null, noise=null.noise.with_(tau=5.0))
    assert said(sound) == {} and list(said(sound, None)) == ["tests_too_short"]
    p, white = null.p.copy(), null.noise.white.copy()
    p[1], white[[2, 5]] = -4.2, least.white[[2, 5]]
    far = said(replace(null, p=p))["far_from_prior"]
    assert f"{null.free.symbols[1]} (-4.2)" in far and null.free.symbols[0] not in far
    assert " psi, r, " in said(replace(null, noise=null.noise.with_(white=white)))["no_noise"]
    short = said(replace(null, noise=null.noise.with_(tau=20.0)))["short_trials"]
    assert "40" in short and "remembers 20 s" in short


@pytest.mark.slow
def test_a_refit_whose_first_values_make_the_ship_explode_begins_nearer_to_neutral(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    p, null, effect = ready().problem, ready().null, candidate("current")
    begun: list[float] = []
    advance = TransitionModel.linearise

    def exploding(
        self: TransitionModel, z: np.ndarray, inputs: np.ndarray, theta: np.ndarray, *rest: np.ndarray
    ) -> object:
        begun.append(float(theta[self.ship.symbols.index("current.x")]))
        if begun[-1] > 0.1:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return advance(self, z, inputs, theta, *rest)

    monkeypatch.setattr(TransitionModel, "linearise", exploding)
    found = refit(p, null, [effect], {effect.columns[0]: 0.3, effect.columns[1]: 0.0})
    assert begun[:2] == pytest.approx([0.3, 0.09]) and abs(found.value("current.x")) < 0.05


SIZES = [
    ("rudder_stall", (-0.144,), 0.02, True),
    ("rudder_stall", (-0.03,), 0.02, False),
    ("rudder_stall", (0.4,), 0.02, False),
    ("rudder_stall", (1.1,), 0.02, True),
    ("shallow_water", (-0.3,), 0.05, True),
    ("shallow_water", (-0.3,), 0.24, False),
    ("wind_force", (1.0, -0.5, 1.0), 0.1, True),
    ("wind_force", (1.0, 1.0, -0.5), 0.1, False),
    ("antenna_offset", (1.8, 0.0), 0.1, True),
    ("antenna_offset", (-1.4, 0.2), 0.01, False),
    ("fouling", (-0.3,), 0.1, True),
    ("fouling", (-0.15,), 0.1, False),
    ("draft", (-0.3,), 0.01, False),
    ("draft", (-0.6,), 0.03, True),  # where the range of a fit ends
    ("control_delay", (0.0,), 0.1, False),  # the end that is neutral
    ("current", (-0.3, 0.2), 0.01, False),
]
"""Effect, its parameters, their standard error, and whether no such effect is possible; for a ship of 3 m."""


def fit_with(effects: list[Candidate], values: list[float], std: float) -> Estimate:
    """A fit in which these parameters of the ``effects`` have these values, each with this standard error."""
    own, null = priors_of_effects(effects, 1.0), ready().null
    covariance = np.diag([*np.zeros(len(null.p)), *(std / own.std) ** 2])
    p = np.array([*null.p, *(np.array(values) - own.mean) / own.std])
    return replace(null, free=null.free + own, p=p, covariance=covariance)


@pytest.mark.parametrize(("effect", "values", "std", "expected"), SIZES)
def test_no_effect_is_surely_outside_what_it_can_be(
    effect: str, values: tuple[float, ...], std: float, expected: bool
) -> None:
    c = candidate(effect)
    words = impossible_size(full_model(), fit_with([c], list(values), std), c)
    assert bool(words) is expected and words.startswith(f"{effect} (" if expected else "")


@pytest.mark.parametrize(("share", "expected"), [(-0.45, False), (-0.75, True)])
def test_a_calibrated_ship_may_have_lost_the_fouling_that_she_had(share: float, expected: bool) -> None:
    ship = full_model().ship
    symbol = ship.free[0]
    row = ship.coefficients[symbol].with_(prior_std=1.0, prior_value=0.0)
    full, c = replace(full_model(), ship=ship.with_coefficients({symbol: row})), candidate("fouling")
    assert bool(impossible_size(full, fit_with([c], [share], 0.1), c)) is expected


def test_every_effect_can_be_absent() -> None:
    ship = full_model().ship
    for name, effect in EFFECTS.items():
        for p in effect.parameters(ship.namespace, dict(ship.components)):
            assert p.held or max(p.least, p.lower) <= p.neutral <= min(p.most, p.upper), (name, p.symbol)


H, TRUTH = 0.5, "current:x=0.03,y=-0.02"


def gridded(problem: SearchProblem, seed: int, effects: list[str]) -> GriddedTrials:
    return grid_trials(pushed_trials(seed, effects), problem.steps.ship, H)


def budget_for(problem: SearchProblem, found: Selection, tests: GriddedTrials | None) -> Budget:
    made = budget_of(replace(problem, tests=tests), found)
    assert made is not None
    return made


@cache
def streamed() -> tuple[SearchProblem, Selection]:
    """Trials in a current that the model lacks, and the selection."""
    problem, null = pushed_problem(1, TRUTH)
    return problem, select_effects(problem, null)


@pytest.mark.slow
@pytest.mark.parametrize("has_tests", [True, False])
def test_a_current_that_was_put_in_causes_the_avoidable_error(has_tests: bool) -> None:
    problem, found = streamed()
    made = budget_for(problem, found, gridded(problem, 2, [TRUTH]) if has_tests else None)
    (part,), rest = made.parts, made.unexplained
    assert rest is not None and made.by == ("test trials" if has_tests else "left-out runs")
    assert part.name == "current" and part.share > 0.8 and part.interval_90[0] <= part.share <= part.interval_90[1]
    assert part.share + rest.share == pytest.approx(1.0) and not made.matters
    before, after, floor = made.units["position_m"]
    assert before > 2 * after >= 2 * floor > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", first_quick([3, 4, 5]))
def test_where_nothing_is_missing_there_is_no_avoidable_error(seed: int) -> None:
    problem, null = pushed_problem(seed)
    made = budget_for(problem, Selection((), null, null, ()), gridded(problem, seed + 10, []))
    assert made.parts == () and made.unexplained is None and made.before == made.after >= made.floor


@pytest.mark.slow
def test_a_force_without_a_name_is_unexplained() -> None:
    problem, _ = pushed_problem(1)
    steps, data, null = pushed_by(problem, 1, 2, "cos", 0.6)
    missing = estimated_force(unnamed_forms(steps, data, null))
    made = budget_of(replace(problem, steps=steps, data=data, tests=data), Selection((), null, null, ()), missing)
    assert made is not None and made.unexplained is not None
    assert made.unexplained.share == 1.0 and made.matters and made.floor < 0.8 * made.before
    assert made.as_given is None


def test_a_ship_that_is_not_fitted_yet_errs_more_as_given() -> None:
    problem, null = pushed_problem(1)
    symbol = null.free.columns[0].symbol
    given = null.theta.copy()
    given[problem.steps.ship.symbols.index(symbol)] *= 3.0
    tests = replace(problem, tests=problem.data)
    made, same = (budget_of(tests, Selection((), null, null, ()), None, 0, theta) for theta in (given, null.theta))
    assert made is not None and made.as_given is not None and same is not None and same.as_given is not None
    assert made.as_given["error"] > made.before and made.as_given["position_m"] > made.units["position_m"][0]
    assert same.as_given["error"] == pytest.approx(same.before, rel=1e-12)
    problem, null = pushed_problem(1, runs=(("zigzag:20/20", 100.0),))  # a single run cannot be left out
    assert budget_of(problem, Selection((), null, null, ())) is None


@pytest.mark.slow
def test_a_run_is_left_out_as_by_a_fit_without_it() -> None:
    problem, found = streamed()
    fit, data = found.final, problem.data
    quick = left_out_errors(problem.steps, data, fit)
    run = data.run[0]
    rest = refitted(problem, fit, data.windows(data.run != run))
    own = data.windows(data.run == run)
    whole = errors(problem.steps, own, fit.theta, window_length(problem.steps.ship)).mean.mean()
    exact = errors(problem.steps, own, rest, window_length(problem.steps.ship)).mean.mean()
    assert quick.mean[quick.run == run].mean() == pytest.approx(exact, rel=0.1, abs=0.3 * abs(exact - whole))


def refitted(problem: SearchProblem, fit: Estimate, data: GriddedTrials) -> np.ndarray:
    """Coefficients fitted to some windows of the problem's trials, with the noise of the ``fit`` to all."""
    kept = np.isin(problem.data.run, data.run)
    path = replace(fit.path, z=fit.path.z[:, kept], force=fit.path.force[:, kept])
    start = Point(fit.theta, fit.free, fit.p, path, fit.noise)
    less = estimate(problem.steps, data, start, 10, fixed_noise=True)
    values = less.free.mean + less.free.std * less.p
    return set_values(problem.steps.ship, data, less.theta, less.free.columns, values)
