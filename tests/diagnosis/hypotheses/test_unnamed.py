"""Unnamed forms: slopes of the marginal likelihood, limits by chance; their force is that which acted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.stats import multivariate_normal

import mmg.effects
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.kalman import DrivenColumns, NoiseModel
from diagnosis.estimation.linearisation import Point, Trajectory, initial_trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import NO_PRIORS, active_states
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from diagnosis.hypotheses.dictionary import DELAYS, Dictionary, ForceForms
from diagnosis.hypotheses.events import AT_TIMES, LATE, MOST, Events, event_slopes
from diagnosis.hypotheses.forward_selection import ODDS, select_effects
from diagnosis.hypotheses.next_test import telling_test
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import dispersion
from diagnosis.hypotheses.unexplained_force import ForceEstimate, estimated_force, unexplained_force
from diagnosis.hypotheses.unnamed import MULTIPLES, SIZES, UnnamedForms, log_bayes, unnamed_forms, unnamed_slopes
from diagnosis.judgement.verdict import verdict_of
from diagnosis.report.words import unexplained_hint
from mmg.effects import Effect, Parameter
from mmg.motion.flow import Flow, Force
from tests.support.diagnosis_cases import (
    FEW,
    SHIP,
    WHITE,
    full_model,
    full_steps,
    problem_of,
    pushed_by,
    pushed_problem,
    pushed_trials,
    quiet,
)
from tests.support.disturbed_trials import process
from tests.support.quick import first_quick

NOISE = NoiseModel(np.array([0.3, 0.6, 0.4]), 5.0, WHITE)
LENGTH = 3.0


class Probe(Effect):
    """Some forms of the dictionary as an effect, by which the model itself can be differentiated."""

    name, enters = "probe", "force"

    def parameters(self, p: SimpleNamespace, components: dict[str, str]) -> tuple[Parameter, ...]:
        names = ("ur", "cos", "vv", "over", "crosstalk")
        return tuple(Parameter(s, 0.0, 1.0, -9.0, 9.0, "", s) for s in names)

    def actuators(self, flow: Flow, memory: Any, e: Any, p: Any, s: Any) -> Flow:
        return flow.with_(delta=flow.delta + e.over * flow.u)

    def forces(self, parts: Any, flow: Flow, e: Any, at: Any) -> Any:
        N = e.ur * flow.u * flow.r * LENGTH
        return {**parts, "probe": Force(e.vv * flow.v**2, e.cos * ca.cos(flow.psi), N)}

    def columns(self, y: list[Any], flow: Flow, memory: Any, e: Any, p: Any) -> list[Any]:
        return [*y[:4], y[4] + e.crosstalk * y[5], y[5]]


@pytest.fixture(scope="module")
def probed() -> Any:
    """Steps of a ship with the probe, windows, a path, and log det F by the probe's parameters."""
    full_model()  # cached before the probe is one of the effects
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(mmg.effects.EFFECTS, "probe", Probe())
        probe = "probe:ur=0.0,cos=0.0,vv=0.0,over=0.0,crosstalk=0.0"
        ship = with_effects(FEW, ["tow:X=0.0,Y=0.0,N=0.0", "current:x=0.0,y=0.0", probe])
        steps = TransitionModel(ship, [*FEW.free], 0.5, compiled=False)
        trials = pushed_trials(3, runs=(("zigzag:20/20", 40.0), ("random:11", 28.0)))
        data = grid_trials(trials, ship, steps.h)
        z = [steps.settled(data.y[0].T, data.inputs[0].T, ship.values)]
        for held in data.inputs:
            z.append(steps.advance(z[-1], held.T, ship.values[:, None].repeat(held.shape[0], axis=1)))
        path = np.stack(z).swapaxes(1, 2)
        yield steps, data, Trajectory(path, np.zeros((*path.shape[:2], 3)))


def half_log_det(steps: TransitionModel, data: GriddedTrials, path: Any, symbol: str, value: float) -> float:
    theta = steps.ship.values.copy()
    theta[steps.ship.symbols.index(f"probe.{symbol}")] = value
    at = Point(theta, NO_PRIORS, np.zeros(0), path, NOISE)
    return 0.5 * float(linearise_and_filter(steps, data, at, np.arange(6)).filter.log_det.sum())


@pytest.mark.parametrize(
    ("symbol", "kind", "form"),
    [
        ("ur", "yaw force", "ur"),
        ("cos", "sway force", "cos"),
        ("vv", "surge force", "vv"),
        ("over", "action of delta", "u"),
        ("crosstalk", "sensor of v", "r"),
    ],
)
def test_the_slope_of_the_log_determinant_is_that_of_the_model(probed: Any, symbol: str, kind: str, form: str) -> None:
    steps, data, path = probed
    at = Point(steps.ship.values, NO_PRIORS, np.zeros(0), path, NOISE)
    words = Dictionary(steps, data, at, np.arange(6))
    linearised = linearise_and_filter(steps, data, at, np.arange(6), words.columns)
    place = words.labels.index((kind, form))
    found = words.logdet_gradient(linearised)[place]
    small = 1e-4
    ends = [half_log_det(steps, data, path, symbol, sign * small) for sign in (1, -1)]
    expected = (ends[0] - ends[1]) / (2 * small)
    *pushing, misread = [block for part in words.columns(linearised.linear) for block in part.blocks()]
    errors = np.zeros((*data.inside.shape, 6, len(misread.observing)))
    forcing = np.concatenate([*(block.forcing for block in pushing), errors], axis=3)
    observed = np.concatenate([*(block.dense_observed for block in pushing), misread.observed], axis=3)
    theta = steps.ship.values.copy()
    theta[steps.ship.symbols.index(f"probe.{symbol}")] = small
    moved = steps.linearise(path.z, data.controls, theta, path.force[:-1], np.zeros(0, dtype=int), np.arange(6))
    change = np.concatenate(
        [
            ((moved.end - linearised.linear.end)[..., :6] * data.inside[..., None]).ravel() / small,
            ((moved.logged - linearised.linear.logged) * data.good).ravel() / small,
        ]
    )
    column = np.concatenate(
        [(forcing[..., place] * data.inside[..., None]).ravel(), (observed[..., place] * data.good).ravel()]
    )
    unit = float(change @ column / (change @ change))  # of the column, in the probe's parameter
    np.testing.assert_allclose(column, unit * change, atol=0.05 * np.abs(column).max())
    size = float(np.linalg.norm(linearised.white[..., place]))  # standard deviation of the whole slope
    assert found == pytest.approx(unit * expected, rel=0.05, abs=0.02 * size)


@pytest.mark.slow
def test_residuals_correlated_in_time_are_less_news() -> None:
    """White sensors: hardly any dispersion. Errors of v with a memory of 2 s: the slopes of its sensor vary more."""
    plain = unnamed_slopes(*_parts(*calm())).dispersion
    assert max(plain.values()) < 1.35
    rng, trials = np.random.default_rng(0), pushed_trials(1, how=LARGE)
    rough = [t.with_columns(v=t["v"] + 0.008 * process(len(t.t), t.dt, 2.0, rng)) for t in trials]
    coloured = unnamed_slopes(*_parts(*problem_of(rough))).dispersion
    assert coloured["sensor of v"] > 1.5 * plain["sensor of v"]


def _parts(problem: SearchProblem, null: Estimate) -> tuple[TransitionModel, GriddedTrials, Estimate]:
    return problem.steps, problem.data, null


def covariance(count: int, seed: int = 0) -> np.ndarray:
    A = np.random.default_rng(seed).standard_normal((count, count))
    return 20.0 * (A @ A.T + 0.3 * np.eye(count))


@pytest.mark.parametrize(("tolerance", "multiples"), [(0.0, ()), (0.05, ()), (0.0, (0.25, 1.0))])
def test_log_bayes_is_the_ratio_of_the_marginal_likelihoods(tolerance: float, multiples: tuple[float, ...]) -> None:
    """Slopes g = S b + chance of covariance S, with b of covariance a^2, of multiples of S^-1, or of what a column may
    be off anyway."""
    S = covariance(4)
    g = np.random.default_rng(1).standard_normal(4) @ np.linalg.cholesky(S).T + S @ np.array([0.3, 0.0, -0.2, 0.1])
    some = np.array([True, False, True, True])
    g3, S3 = g[some], S[np.ix_(some, some)]

    def likelihood(of_b: np.ndarray) -> float:
        return float(multivariate_normal(np.zeros(3), S3 + S3 @ of_b @ S3).pdf(g3))

    every = [likelihood(a**2 * np.eye(3)) for a in SIZES if a > tolerance]
    every += [likelihood(m * np.linalg.inv(S3)) for m in multiples]
    expected = np.log(np.mean(every) / likelihood(tolerance**2 * np.eye(3)))
    assert log_bayes(g, S, some, tolerance, multiples) == pytest.approx(expected, rel=1e-9)
    assert log_bayes(np.zeros(4), S, some, tolerance) < 0
    assert log_bayes(np.zeros(4), np.zeros((4, 4)), some, tolerance) == pytest.approx(0.0, abs=1e-12)


def test_a_force_of_many_small_parts_is_seen_though_each_is_seen_unlike_well() -> None:
    """With information from 1 to 1e5 along orthogonal directions."""
    turn, sizes = np.linalg.qr(np.random.default_rng(5).standard_normal((12, 12)))[0], 10 ** np.linspace(0, 5, 12)
    S, root = turn * sizes @ turn.T, turn * np.sqrt(sizes)
    g, every = root @ np.resize([2.3, -2.3], 12), np.ones(12, dtype=bool)  # 2.3 standard errors in each direction
    assert log_bayes(g, S, every) < 5 < 9 < log_bayes(g, S, every, multiples=MULTIPLES)


def test_what_is_kept_of_compared_times_alone_says_the_same() -> None:
    """Rows of times at which nothing is compared are zero, so that sums, smoothing and dispersion do without them."""
    problem, null = calm()
    steps, data = problem.steps, problem.data.thinned(4)
    whole, brief = (linearise_and_filter(steps, data, null, is_brief=some) for some in (False, True))
    assert brief.rows is not None and len(brief.rows) < 0.4 * len(whole.white)
    np.testing.assert_array_equal(brief.white, whole.white[brief.rows])
    assert np.square(whole.white).sum() == pytest.approx(np.square(brief.white).sum(), rel=1e-12)
    assert brief.nll == whole.nll
    for one, other in zip(brief.smoothed(), whole.smoothed(), strict=True):
        np.testing.assert_array_equal(one, other)
    columns, residual = whole.white[..., :3], whole.white[..., -1]
    g, S = np.ones(3), 0.1 * np.einsum("krca,krcb->ab", columns, columns)  # so that it varies more than S says
    few = dispersion(columns[brief.rows], residual[brief.rows], g, S, 9, brief.rows)
    assert few == pytest.approx(dispersion(columns, residual, g, S, 9), rel=1e-12) and few > 1.0


SIZE = 0.6
"""Of a sway force SIZE cos(psi) [N] that no model has."""


@cache
def pushed_sideways() -> tuple:
    steps, seen, null = pushed_by(pushed_problem(1)[0], 1, 1, "cos", SIZE)
    unnamed = unnamed_forms(steps, seen, null)
    return seen, null, unnamed, estimated_force(unnamed)


@pytest.mark.slow
def test_the_force_is_that_which_acted() -> None:
    data, null, unnamed, found = pushed_sideways()
    row = unexplained_force(data, null, unnamed.evidence, found, SHIP)
    true = SIZE * np.cos(null.path.z[:-1, :, 2])[data.inside]
    mine = row.force[data.inside][:, 1]
    assert unnamed.evidence > ODDS
    assert np.corrcoef(mine, true)[0, 1] > 0.85
    assert row.channels["sway"].share > 0.9
    low, high = row.channels["sway"].interval_90
    assert low < np.sqrt((true**2).mean()) < 1.3 * high
    inside = np.abs(mine - true) < 1.64 * row.std[data.inside][:, 1]
    assert inside.mean() > 0.5  # the coefficients took a part of it
    # along the track of each channel's own trial
    assert {t.trial for t in row.times} <= set(data.trials) and row.times[0].channel == "sway"


@pytest.mark.slow
def test_nothing_is_estimated_where_nothing_acts() -> None:
    steps, seen, null = pushed_by(pushed_problem(1)[0], 4, 1, "cos", 0.0)
    found = estimated_force(unnamed_forms(steps, seen, null))
    row = unexplained_force(seen, null, 1.0, found, SHIP)
    assert max(channel.force_rms for channel in row.channels.values()) < 0.1
    nothing = ForceEstimate(0 * found.mean, 0 * found.covariance, found.dictionary, 0 * found.sizes, found.taken)
    none = unexplained_force(seen, null, 1.0, nothing, SHIP)
    assert none.times == () and none.follows == () and none.channels["sway"].interval_90 == (0.0, 0.0)
    assert unexplained_hint(none) == ""


@pytest.mark.slow
def test_a_manoeuvre_is_named_in_which_it_shows() -> None:
    _, null, _, found = pushed_sideways()
    assert "--maneuver" in telling_test(pushed_problem(1)[0], null, found, SHIP)
    nothing = ForceEstimate(0 * found.mean, found.covariance, found.dictionary, 0 * found.sizes, found.taken)
    assert "--maneuver" not in telling_test(pushed_problem(1)[0], null, nothing, SHIP)


LARGE, MIDDLE = quiet(X=0.3, Y=0.6, N=0.4), quiet(X=0.1, Y=0.2, N=0.1)
"""Random forces large against the sensors, and less so."""
DELTA, POSITION = "delay of delta at times", "sensor of position at times"


def calm(seed: int = 1) -> tuple[SearchProblem, Estimate]:
    """Trials without effects in which the random forces are large."""
    return pushed_problem(seed, how=LARGE)


def of(trials: list[Trial]) -> UnnamedForms:
    problem, null = problem_of(trials)
    return unnamed_forms(problem.steps, problem.data, null)


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
    events = [value for kind, value in found.by_kind.items() if kind.endswith("times")]
    assert len(events) > 2 and max(events) < 2.5


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


@pytest.fixture(scope="module")
def arranged() -> tuple:
    steps = full_steps(0.5)
    data = grid_trials(pushed_trials(3), steps.ship, steps.h)
    z = initial_trajectory(steps, data, steps.ship.values).z
    middle = 0.5 * (z[:-1] + z[1:])
    return steps, data, middle, ForceForms(steps, data, middle)


def test_gradients_are_those_of_finite_differences(arranged: tuple) -> None:
    _, data, middle, forms = arranged
    here = forms.on(data, middle)
    for s in range(2, 6):
        ends = []
        for sign in (1, -1):
            moved = middle.copy()
            moved[..., s] += sign * 1e-5
            ends.append(forms.on(data, moved).values)
        slope = (ends[0] - ends[1]) / 2e-5
        smooth = np.abs(middle[..., s]) > 1e-4  # a modulus has a kink at 0
        np.testing.assert_allclose(here.gradients[:, smooth, s], slope[:, smooth], atol=1e-4 * np.abs(slope).max())


def test_units_are_those_of_the_first_trials(arranged: tuple) -> None:
    """On other trials a form keeps its unit, so that a coefficient means the same force there."""
    _, data, middle, forms = arranged
    u = forms.on(data, middle).at("u")
    twice = middle.copy()
    twice[..., 3] *= 2
    np.testing.assert_allclose(forms.on(data, twice).values[u], 2 * forms.on(data, middle).values[u])


def test_a_ship_with_twin_rudders_and_a_thruster_has_forms_of_each_input() -> None:
    ship = with_effects(load_ship("vectwin_3m"), ["tow:X=0.0,Y=0.0,N=0.0"])
    steps = TransitionModel(ship, [], 0.5, compiled=False)
    trials = pushed_trials(3, runs=(("random:11", 40.0),), ship=load_ship("vectwin_3m"))
    data = grid_trials(trials, ship, steps.h)
    z = initial_trajectory(steps, data, ship.values).z
    middle = 0.5 * (z[:-1] + z[1:])
    names = ForceForms(steps, data, middle).on(data, middle).names
    assert {"delta_port", "delta_starboard|delta_starboard|"} <= set(names)
