"""Unnamed forms: slopes of the marginal likelihood, limits by chance; their force is that which acted."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.stats import multivariate_normal

import mmg.effects
from cases.shipfiles.effects import with_effects
from diagnosis.estimation.gridded_trials import GriddedTrials, grid_trials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Point, Trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import NO_PRIORS
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.dictionary import Dictionary
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.next_test import telling_test
from diagnosis.hypotheses.refit import SearchProblem
from diagnosis.hypotheses.score_test import dispersion
from diagnosis.hypotheses.unexplained_force import ForceEstimate, estimated_force, unexplained_force
from diagnosis.hypotheses.unnamed import MULTIPLES, SIZES, log_bayes, unnamed_forms, unnamed_slopes
from diagnosis.report.words import unexplained_hint
from mmg.effects import Effect, Parameter
from mmg.motion.flow import Flow, Force
from tests.support.diagnosis_cases import (
    FEW,
    SHIP,
    WHITE,
    full_model,
    problem_of,
    pushed_by,
    pushed_problem,
    pushed_trials,
    quiet,
)

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
        data = grid_trials(trials, ship.inputs, LENGTH, steps.h)
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


def without_effects() -> tuple[SearchProblem, Estimate]:
    """Trials without effects in which the random forces are large."""
    return pushed_problem(1, how=quiet(X=0.3, Y=0.6, N=0.4))


@pytest.mark.slow
def test_residuals_correlated_in_time_are_less_news() -> None:
    """White sensors: hardly any dispersion. Errors of v with a memory of 2 s: the slopes of its sensor vary more."""
    plain = unnamed_slopes(*_parts(*without_effects())).dispersion
    assert max(plain.values()) < 1.35
    trials = pushed_trials(1, how=quiet(X=0.3, Y=0.6, N=0.4))
    rng = np.random.default_rng(0)
    rough = []
    for t in trials:
        error = np.zeros(len(t.t))
        for k in range(1, len(error)):
            left = np.exp(-(t.t[k] - t.t[k - 1]) / 2.0)
            error[k] = left * error[k - 1] + np.sqrt(1 - left**2) * rng.standard_normal()
        rough.append(t.with_columns(v=t["v"] + 0.008 * error))
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


def information_of_unlike_directions() -> tuple[np.ndarray, np.ndarray]:
    """Information S (12, 12) from 1 to 1e5 along the columns of an orthogonal matrix, and a square root of it."""
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((12, 12)))[0]
    sizes = 10 ** np.linspace(0, 5, 12)
    return turn * sizes @ turn.T, turn * np.sqrt(sizes)


def test_a_force_of_many_small_parts_is_seen_though_each_is_seen_unlike_well() -> None:
    S, root = information_of_unlike_directions()
    g, every = root @ np.resize([2.3, -2.3], 12), np.ones(12, dtype=bool)  # 2.3 standard errors in each direction
    assert log_bayes(g, S, every) < 5 < 9 < log_bayes(g, S, every, multiples=MULTIPLES)


def test_what_is_kept_of_compared_times_alone_says_the_same() -> None:
    """Rows of times at which nothing is compared are zero, so that sums, smoothing and dispersion do without them."""
    problem, null = without_effects()
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
def pushed() -> tuple:
    steps, seen, null = pushed_by(pushed_problem(1)[0], 1, 1, "cos", SIZE)
    unnamed = unnamed_forms(steps, seen, null)
    return seen, null, unnamed, estimated_force(unnamed)


@pytest.mark.slow
def test_the_force_is_that_which_acted() -> None:
    data, null, unnamed, found = pushed()
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
    _, null, _, found = pushed()
    assert "--maneuver" in telling_test(pushed_problem(1)[0], null, found, SHIP)
    nothing = ForceEstimate(0 * found.mean, found.covariance, found.dictionary, 0 * found.sizes, found.taken)
    assert "--maneuver" not in telling_test(pushed_problem(1)[0], null, nothing, SHIP)
