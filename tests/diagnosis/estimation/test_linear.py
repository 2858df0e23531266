"""Steps on the grid of the trials: against the simulator and finite differences, with late inputs, by window."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from cases.shipfiles.generated_ship import generated_ship, structure_of
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from diagnosis.estimation.acting_inputs import acting, linearised
from diagnosis.estimation.candidates import Column, ship_with_all_effects
from diagnosis.estimation.gridded_trials import PARTS, GriddedTrials, can_divide, grid_trials
from diagnosis.estimation.linearisation import (
    TIMING,
    Point,
    initial_covariance,
    initial_trajectory,
    linearise_and_filter,
    timing_columns,
)
from diagnosis.estimation.noise_sizes import MOST, initial_noise, swallows
from diagnosis.estimation.parameters import NO_PRIORS, Priors, get_values, set_values
from diagnosis.estimation.residual_checks import finer_step
from diagnosis.estimation.transition_model import FORCE, TransitionModel
from mmg.effects import EFFECTS
from mmg.model import assemble
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.diagnosis_cases import (
    OFF_NEUTRAL,
    RUNS,
    SHIP,
    full_model,
    full_steps,
    off_neutral,
    path_near,
    pushed_problem,
    pushed_trials,
    short_data,
    states_about,
    theta_of,
)

POINTS = 6


@pytest.fixture(scope="module")
def steps() -> TransitionModel:
    return full_steps()


def values(steps: TransitionModel, where: str) -> np.ndarray:
    return steps.ship.values if where == "neutral" else off_neutral(steps)


def path(steps: TransitionModel, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States (2, M, S), inputs (1, M, C) and force (1, M, 3) of windows of one step."""
    z, c = states_about(steps, POINTS, seed)
    force = 0.1 * np.random.default_rng(seed + 50).standard_normal((1, POINTS, 3))
    after = steps.advance(z, c, steps.coefficients(steps.ship.values, force[0].T))
    return np.stack([z.T, after.T]), c.T[None], force


def on_board(steps: TransitionModel, theta: np.ndarray) -> tuple[Simulator, np.ndarray]:
    """A simulator of the ship without what makes its inputs late, which no step does, and its coefficients."""
    ship = steps.ship.without_effect("control_delay").without_effect("rudder_lag")
    return Simulator(ship), theta[[steps.ship.symbols.index(s) for s in ship.symbols]]


def every_column(steps: TransitionModel) -> np.ndarray:
    return np.arange(steps.P)


def close(found: np.ndarray, expected: np.ndarray, rtol: float) -> None:
    """Relative to the largest of each column."""
    scale = np.abs(expected).max(axis=tuple(range(expected.ndim - 1)), keepdims=True)
    assert np.isfinite(found).all()
    worst = np.abs(found - expected) / np.maximum(scale, 1e-4)
    assert worst.max() < rtol, np.unravel_index(worst.argmax(), worst.shape)


def test_every_effect_that_may_be_screened_is_on_board(steps: TransitionModel) -> None:
    screened = set(full_model().symbols)
    assert {c.effect for c in full_model().candidates} == set(EFFECTS)
    assert screened <= set(OFF_NEUTRAL) <= set(steps.symbols)
    assert set(FORCE) <= set(steps.symbols)


@pytest.mark.parametrize(
    "ship", [generated_ship(SHIP, structure_of(SHIP, 2, "SM-2")), load_ship("mariner")], ids=lambda ship: ship.name
)
def test_a_ship_without_propeller_and_rudder_models_gets_the_other_effects(ship: Ship) -> None:
    full = ship_with_all_effects(ship)
    named = {candidate.effect for candidate in full.candidates}
    assert {"current", "tow"} <= named and "rudder_stall" not in named
    model, bare = assemble(full.ship), assemble(ship)
    state = np.array(model.initial([0, 0, 0, 0.3, 0.02, 0.01], np.zeros(len(model.controls)), full.ship.values))
    rates = np.array(model.rates(state, np.zeros(len(model.controls)), full.ship.values))[3:6]
    own = np.array(bare.rates([0, 0, 0, 0.3, 0.02, 0.01], np.zeros(len(bare.controls)), ship.values))[3:6]
    np.testing.assert_allclose(rates, own, atol=1e-6)


@pytest.mark.parametrize("where", ["neutral", "off neutral"])
def test_one_step_ends_where_the_simulator_does(steps: TransitionModel, where: str) -> None:
    theta = values(steps, where)
    z, c = states_about(steps, POINTS, 1)
    simulator, own = on_board(steps, theta)
    expected = simulator.run(z, c[None], steps.h, own)[-1]
    np.testing.assert_allclose(steps.advance(z, c, theta), expected, rtol=1e-10, atol=1e-12)
    states, inputs, force = path(steps, 1)
    linear = steps.linearise(states, inputs, theta, force, every_column(steps), np.arange(steps.S))
    each = steps.coefficients(theta, force[0].T)
    np.testing.assert_allclose(linear.end[0].T, steps.advance(z, c, each), rtol=1e-12, atol=1e-13)


def slopes(
    function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, rows: Iterable[int], share: float, least: float
) -> np.ndarray:
    """Central differences of a function (...) of an array (n, ...) by each of its rows, behind the others.

    share: of the largest number of the row, but not of less than ``least``, by which it is moved.
    """
    found = []
    for j in rows:
        small = np.zeros_like(at)
        small[j] = size = share * max(least, float(np.abs(at[j]).max()))
        found.append((function(at + small) - function(at - small)) / (2 * size))
    return np.stack(found, axis=-1)


@pytest.mark.parametrize("where", ["neutral", "off neutral"])
def test_derivatives_of_a_step_are_those_of_finite_differences(steps: TransitionModel, where: str) -> None:
    theta = values(steps, where)
    states, inputs, force = path(steps)
    linear = steps.linearise(states, inputs, theta, force, every_column(steps), np.arange(steps.S))
    z, c, each = states[0].T, inputs[0].T, steps.coefficients(theta, force[0].T)
    F = slopes(lambda z: steps.advance(z, c, each).T, z, range(steps.S), 1e-5, 1e-2)
    G = slopes(lambda each: steps.advance(z, c, each).T, each, steps.at, 1e-5, 1e-2)
    B = slopes(lambda each: steps.advance(z, c, each).T, each, steps.force, 1e-5, 1.0)
    close(linear.F[0], F, 2e-6)
    close(linear.force[0], B, 2e-6)
    one_sided = [i for i, s in enumerate(steps.symbols) if where == "neutral" and one_sided_at_neutral(s)]
    kept = np.setdiff1d(every_column(steps), one_sided)
    close(linear.G[0][..., kept], G[..., kept], 5e-6)


def one_sided_at_neutral(symbol: str) -> bool:
    """Whether a parameter cannot be negative, so that a central difference at its neutral value says nothing."""
    name, _, parameter = symbol.partition(".")
    return bool(parameter) and any(
        p.symbol == parameter and p.lower >= p.neutral
        for p in EFFECTS[name].parameters(SHIP.namespace, dict(SHIP.components))
    )


def test_slopes_of_times_and_dead_bands_at_zero_point_into_what_they_allow(steps: TransitionModel) -> None:
    theta = steps.ship.values
    states, inputs, force = path(steps)
    columns = np.array([i for i, s in enumerate(steps.symbols) if one_sided_at_neutral(s)])
    assert len(columns) >= 6
    linear = steps.linearise(states, inputs, theta, force, columns, np.arange(steps.S))
    each = steps.coefficients(theta, force[0].T)
    G = np.empty_like(linear.G[0])
    for i, column in enumerate(columns):
        small = 1e-6 * (np.arange(len(theta)) == steps.at[column])[:, None]
        ends = [steps.advance(states[0].T, inputs[0].T, each + share * small) for share in (0, 1, 2)]
        G[..., i] = ((-1.5 * ends[0] + 2 * ends[1] - 0.5 * ends[2]) / 1e-6).T
    close(linear.G[0], G, 1e-3)


@pytest.mark.parametrize("where", ["neutral", "off neutral"])
def test_bend_is_the_slope_of_the_weighted_jacobian(steps: TransitionModel, where: str) -> None:
    """Of d rates / d (states, force) in the middle of the step, and of the logged columns by the states."""
    theta = off_neutral(steps) if where == "off neutral" else steps.ship.values
    states, inputs, force = path(steps, 4)
    rng = np.random.default_rng(5)
    S, columns = steps.S, every_column(steps)
    weight, logged = rng.standard_normal((1, POINTS, S, S + 3)), rng.standard_normal((2, POINTS, 6, S))
    found = steps.logdet_gradient(states, inputs, theta, force, weight, logged, columns, np.arange(S))
    middle = 0.5 * (states[0] + states[1]).T

    def total(theta: np.ndarray) -> np.ndarray:
        """(windows,)."""
        each = steps.coefficients(theta, force[0].T)
        result = np.zeros(POINTS)
        _, J = steps.rates(middle, inputs[0].T, each)
        result += np.einsum("mij,mij->m", weight[0], J)
        zero = np.zeros((2, POINTS, 3))
        H = steps.linearise(states, inputs, theta, zero[:1], columns[:1], np.arange(S)).H
        return result + np.einsum("kmij,kmij->m", logged, H)

    expected = slopes(total, theta, steps.at, 1e-5, 1e-1)
    for i, symbol in enumerate(steps.symbols):
        if where == "off neutral" or not one_sided_at_neutral(symbol):
            scale = max(1e-3, float(np.abs(expected[:, i]).max()))
            np.testing.assert_allclose(found[:, i] / scale, expected[:, i] / scale, atol=2e-4, err_msg=symbol)


@pytest.mark.slow
def test_a_wide_ship_at_neutral_values_moves_as_the_ship_itself(steps: TransitionModel) -> None:
    own = Simulator(SHIP)
    z, c = states_about(steps, 20, 7)
    at = [steps.model.controls.index(name) for name in own.model.controls]
    simulator, values = on_board(steps, steps.ship.values)
    found = simulator.rates(z, c, values)[:6]
    np.testing.assert_allclose(found, own.rates(z[:6], c[at]), rtol=1e-12, atol=1e-13)
    settled = steps.settled(z[:6], c, steps.ship.values)
    np.testing.assert_allclose(settled[:6], z[:6], rtol=0, atol=1e-13)
    end = steps.advance(settled, c, steps.ship.values)[:6]
    np.testing.assert_allclose(end, own.run(z[:6], c[at][None], steps.h)[-1], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("changes", [False, True])
def test_without_a_compiler_it_is_the_same(steps: TransitionModel, changes: bool) -> None:
    slow = full_steps(compiled=False)
    assert slow.interpreted_because and not steps.interpreted_because
    states, inputs, force = path(steps)
    inputs = np.concatenate([inputs, 0.3 * inputs[:, ::-1]], axis=2) if changes else inputs
    theta, count = off_neutral(steps), (np.arange(POINTS) != 2).astype(int)
    a, b, part = (
        s.linearise(states, inputs, theta, force, every_column(s), np.arange(s.S), n)
        for s, n in ((steps, None), (slow, None), (steps, count))
    )
    for name in ("end", "F", "G", "force", "logged", "H", "observed", "observing"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-8, atol=1e-10)
    for name in ("end", "F", "G", "force"):  # a step that does not exist is left out
        whole, found = getattr(a, name), getattr(part, name)
        assert not found[:, 2].any() and np.array_equal(found[:, count > 0], whole[:, count > 0])
    long, held = np.repeat(states[:1], 5, axis=0), np.repeat(inputs, 4, axis=0)
    whole = np.random.default_rng(0).random((4, POINTS)) < 0.5
    for given in ((), (np.arange(6, steps.S), whole)):
        fast, expected = (s.follow(long, held, theta, *given, force=np.repeat(force, 4, axis=0)) for s in (steps, slow))
        np.testing.assert_allclose(fast, expected, rtol=1e-9, atol=1e-11)
        if given:
            assert np.array_equal(fast[1:][~whole][:, :6], long[1:][~whole][:, :6]), "given states were overwritten"


H = 1.0


def moved(trial: Trial, delay: float) -> Trial:
    """The trial whose rudder and revolutions were moved ``delay`` seconds later."""
    later = {n: np.interp(trial.t - delay, trial.t, trial[n]) for n in ("n", "delta")}
    return replace(trial, columns={**trial.columns, **later})


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.3, 1.0, 2.7])
def test_a_delay_moves_the_record_of_all_windows_with_what_was_before_them(delay: float) -> None:
    steps = full_steps(H)
    trials = pushed_trials(3, runs=(("random:11", 700.0),))  # more than a window
    ship = full_model().ship
    data = grid_trials(trials, ship, H, straight=True)
    assert len(data.steps) > 1
    expected = grid_trials([moved(t, delay) for t in trials], ship, H, straight=True)
    found = acting(steps, data, theta_of(steps, {"control_delay.tau": delay}))
    delta = ship.inputs.index("delta")
    kept = data.inside
    error = (found.inputs - expected.inputs)[kept]
    assert np.abs(error[:, delta]).max() < 0.02 * np.ptp(data.inputs[kept][:, delta])
    assert np.abs((found.changes - expected.changes)[kept][:, delta]).max() < 0.1 * np.abs(expected.changes).max()
    wind = [ship.inputs.index(n) for n in ("wind_north", "wind_east")]
    np.testing.assert_array_equal(found.inputs[..., wind], data.inputs[..., wind])
    back = acting(steps, found, steps.ship.values)
    np.testing.assert_allclose(back.inputs, data.inputs, atol=1e-12)
    np.testing.assert_allclose(back.changes, data.changes, atol=1e-12)


def test_a_lag_answers_a_step_as_first_order_systems_do() -> None:
    step, T = 0.05, 0.7
    record = np.concatenate([np.zeros((10, 1, 1)), np.ones((200, 1, 1))])
    found = EFFECTS["rudder_lag"].acted(record, step, T)[10:, 0, 0]
    edges = step * np.arange(201)
    expected = 1 + T / step * np.diff(np.exp(-edges / T))  # mean over each part of 1 - exp(-t / T)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_nothing_is_late_at_neutral_values_and_windows_may_differ() -> None:
    steps, data = full_steps(H), short_data(H)
    assert acting(steps, data, steps.ship.values) is data
    theta = np.repeat(steps.ship.values[:, None], 2, axis=1)
    theta[steps.ship.symbols.index("rudder_lag.T"), 1] = 1.0
    found, alone = acting(steps, data, theta), acting(steps, data, theta[:, 1])
    np.testing.assert_array_equal(found.inputs[:, 0], data.inputs[:, 0])
    np.testing.assert_array_equal(found.inputs[:, 1], alone.inputs[:, 1])
    assert np.abs(alone.inputs[:, 0] - data.inputs[:, 0]).max() > 0.01


@pytest.mark.parametrize("symbol", ["control_delay.tau", "rudder_lag.T"])
@pytest.mark.parametrize("value", [0.0, 0.6])
def test_responses_of_a_step_are_those_of_finite_differences(symbol: str, value: float) -> None:
    steps, data = full_steps(H), short_data(H)
    theta = theta_of(steps, {symbol: value})
    path = path_near(steps, data, theta)
    force, every = path.force[:-1], np.arange(steps.S)
    at = steps.symbols.index(symbol)

    def end(changed: float) -> np.ndarray:
        there = theta_of(steps, {symbol: changed})
        return linearised(steps, data, there, path.z, force, [], every).end

    G = linearised(steps, data, theta, path.z, force, [steps.symbols.index("Y_v"), at], every).G[..., 1]
    small = H / PARTS
    low = value - small if value > 0 or EFFECTS[symbol.split(".")[0]].acts_before else value
    expected = (end(value + small) - end(low)) / (value + small - low)
    exist = data.inside
    np.testing.assert_allclose(G[exist], expected[exist], atol=1e-9 * np.abs(expected[exist]).max())
    assert np.abs(G[exist]).max() > 1e-3


def ramp(rate: float = 0.01, dt: float = 0.1) -> Trial:
    """A trial whose rudder rises at a ``rate`` [rad/s], sampled every ``dt`` [s]."""
    trial = pushed_trials(1, runs=(("zigzag:20/20", 40.0),))[0]
    t = np.arange(0.0, 40.0, dt)
    columns = {k: np.interp(t, trial.t, v) for k, v in trial.columns.items()} | {"t": t, "delta": rate * t}
    return replace(trial, columns=columns)


def test_an_input_that_rises_steadily_changes_over_a_step_by_its_rate() -> None:
    data = grid_trials([ramp()], SHIP, 1.0, straight=True)
    inside = data.inside[:, 0]
    i = SHIP.inputs.index("delta")
    np.testing.assert_allclose(data.changes[inside, 0, i], 0.01, rtol=0.03)
    assert data.controls.shape[2] == 2 * data.inputs.shape[2] and data.sample == pytest.approx(0.1)


def test_a_step_under_a_rising_input_is_that_of_many_short_ones() -> None:
    steps, short = full_steps(1.0), full_steps(0.1)
    theta, C = steps.ship.values, steps.C
    mean, rise = np.zeros((C, 1)), np.zeros((C, 1))
    n, delta = (steps.model.controls.index(name) for name in ("n", "delta"))
    mean[n], mean[delta], rise[delta] = 9.0, 0.2, 0.2
    z = steps.settled(np.array([[0.0, 0.0, 0.3, 0.4, 0.01, 0.005]]).T, mean, theta)
    whole, held, fine = steps.advance(z, np.vstack([mean, rise]), theta), steps.advance(z, mean, theta), z
    for k in range(10):
        fine = short.advance(fine, mean + rise * ((k + 0.5) / 10 - 0.5), theta)
    off, before = (np.abs(x - fine)[:6].max() for x in (whole, held))
    assert off < 0.1 * before


def test_quiet_sensors_ask_for_finer_steps_and_noisy_ones_do_not() -> None:
    problem, null = pushed_problem(1, h=1.0)
    assert finer_step(problem.steps, problem.data, null, 0.25) is None
    quieter = replace(null, noise=null.noise.with_(white=0.02 * null.noise.white))
    finer = finer_step(problem.steps, problem.data, quieter, 0.25)
    assert finer is not None and finer < 1.0 and finer % 0.25 == pytest.approx(0.0)
    # held over samples of 0.45 s, a random force passed for a memory of the hull where sensors were quiet
    assert finer_step(problem.steps, problem.data, quieter, 1.0) is None
    finer = finer_step(problem.steps, problem.data, quieter, 1.0, divisible=True)
    assert finer is not None and 1.0 / finer == pytest.approx(round(1.0 / finer)) and 0.25 <= finer < 0.9


def test_states_are_compared_where_they_were_measured_and_uneven_samples_are_not_divided() -> None:
    trial = ramp(dt=0.6)
    whole, parts = (grid_trials([trial], SHIP, h) for h in (0.6, 0.2))
    assert whole.steps_of_sample == 1 and parts.steps_of_sample == 3
    assert parts.measured[::3].all() and not parts.measured[1::3].any() and not parts.measured[2::3].any()
    np.testing.assert_allclose(parts.y[::3], whole.y, atol=1e-12)
    np.testing.assert_array_equal(parts.thinned(4).good[::3], whole.thinned(4).good)
    trial = ramp(dt=0.5)
    assert can_divide([trial], 0.5) and not can_divide([trial, ramp(dt=0.3)], 0.5)
    late = trial.t + 0.1 * np.sin(np.arange(len(trial.t)))
    assert not can_divide([replace(trial, columns={**trial.columns, "t": late})], 0.5)


def test_a_force_beyond_all_that_moves_the_ship_swallows_it() -> None:
    noise = initial_noise(SHIP)
    assert not swallows(noise, SHIP) and swallows(noise.with_(force=0.9 * MOST * noise.force), SHIP)


def test_timing_columns_are_what_a_late_input_does() -> None:
    """A rudder that acts TIMING of a sample late is behind by that share of its rate."""
    steps = full_steps(1.0)
    data = grid_trials([ramp(dt=0.5)], steps.ship, 1.0, straight=True)
    path = initial_trajectory(steps, data, steps.ship.values)
    point = Point(steps.ship.values, NO_PRIORS, np.zeros(0), path, initial_noise(steps.ship))
    found = timing_columns(steps, data, point, np.arange(6))
    i = steps.model.controls.index("delta")
    late = data.inputs.copy()
    late[..., i] -= 0.01 * TIMING * 0.5
    K, R = late.shape[:2]
    z = path.z[:-1].reshape(K * R, -1).T
    ends = [steps.advance(z, c.reshape(K * R, -1).T, steps.ship.values) for c in (late, data.inputs)]
    expected = (ends[0] - ends[1])[:6].T.reshape(K, R, 6)
    inside = data.inside
    np.testing.assert_allclose(found[inside][:, :, 1], expected[inside], atol=0.05 * np.abs(expected).max())


Y_V, CURRENT_0 = Column("Y_v"), Column("current.x", 0)


def three_windows() -> GriddedTrials:
    """Three windows of short runs without any effect, of which the first two are of one run."""
    data = grid_trials(pushed_trials(1, runs=tuple((m, 40.0) for m, _ in RUNS)), full_model().ship, H)
    return replace(data, run=np.array([0, 0, 1]), trials=data.trials[:2])


def test_values_placed_by_run_change_that_runs_windows_alone_and_are_read_again() -> None:
    data, ship = three_windows(), full_model().ship
    columns, values = (Y_V, CURRENT_0, Column("current.y", 1), Column("tow.X", 1)), np.array([-0.4, 0.03, -0.02, 0.5])
    theta = set_values(ship, data, ship.values, columns, values)
    assert theta.shape == (len(ship.symbols), 3)
    expected = np.repeat(ship.values[:, None], 3, axis=1)
    for symbol, value, windows in (
        ("Y_v", -0.4, [0, 1, 2]), ("current.x", 0.03, [0, 1]), ("current.y", -0.02, [2]), ("tow.X", 0.5, [2])
    ):  # fmt: skip
        expected[ship.symbols.index(symbol), windows] = value
    np.testing.assert_array_equal(theta, expected)
    np.testing.assert_allclose(get_values(ship, data, theta, columns), values, rtol=1e-15)
    # a symbol of the ship is its mean over the windows, and what was there is no longer where it is placed for all
    assert get_values(ship, data, theta, [Column("current.x")])[0] == pytest.approx(0.02)
    again = set_values(ship, data, theta, [Column("current.x"), Column("current.y", 0)], np.array([0.01, 0.04]))
    np.testing.assert_array_equal(again[ship.symbols.index("current.x")], 0.01)
    np.testing.assert_array_equal(again[ship.symbols.index("current.y")], [0.04, 0.04, -0.02])


def by_window() -> tuple[GriddedTrials, np.ndarray]:
    """Two windows, in one of which all effects act and in the other some of them otherwise: (all, 2) coefficients."""
    steps = full_steps(H)
    second = {k: -0.5 * v for k, v in OFF_NEUTRAL.items() if k.split(".")[0] in ("current", "tow", "antenna_offset")}
    second |= {"rudder_lag.T": 1.5, "control_delay.tau": 0.2, "hull_memory.T": 2.0, "Y_v": -0.3}
    return short_data(H), np.column_stack([off_neutral(steps), theta_of(steps, second)])


def test_a_likelihood_with_coefficients_by_window_is_the_sum_of_those_of_the_windows() -> None:
    steps, (data, theta) = full_steps(H), by_window()
    noise, every = initial_noise(steps.ship), np.arange(steps.S)
    path = initial_trajectory(steps, data, theta)
    columns = (Y_V, CURRENT_0, Column("tow.N", 1))
    free = Priors(columns, np.zeros(3), np.array([0.1, 0.02, 0.05]), np.full(3, -np.inf), np.full(3, np.inf))
    nowhere = np.zeros(3)
    both = linearise_and_filter(steps, data, Point(theta, free, nowhere, path, noise), every)
    start, total = initial_covariance(steps, data, path.z[0], theta, every), 0.0
    for r in range(2):
        own, w = data.windows(np.arange(2) == r), slice(r, r + 1)
        z = initial_trajectory(steps, own, theta[:, r])
        np.testing.assert_allclose(path.z[:, w], z.z, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(start[w], initial_covariance(steps, own, z.z[0], theta[:, r], every), rtol=1e-9)
        alone = linearise_and_filter(steps, own, Point(theta[:, r], free, nowhere, z, noise), every)
        np.testing.assert_allclose(both.white[:, w], alone.white, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(both.logdet_gradient[w], alone.logdet_gradient, rtol=1e-6, atol=1e-8)
        total += alone.nll
    assert both.nll == pytest.approx(total, rel=1e-10)
    for r, silent in ((0, 2), (1, 1)):  # the column of the other run
        assert not both.white[:, r, :, silent].any() and both.logdet_gradient[r, silent] == 0
        assert both.white[:, r, :, 3 - silent].any()
