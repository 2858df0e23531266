"""One step of the ship with all effects and its derivatives, against the simulator and finite differences."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from cases.shipfiles.generated_ship import generated_ship, structure_of
from cases.shipfiles.ship_file import load_ship
from diagnosis.estimation.candidates import ship_with_all_effects
from diagnosis.estimation.kalman import DrivenColumns
from diagnosis.estimation.transition_model import FORCE, LinearModel, TransitionModel
from mmg.effects import EFFECTS
from mmg.model import assemble
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.support.diagnosis_cases import OFF_NEUTRAL, SHIP, full_model, full_steps, off_neutral, states_about

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


def D_of(linear: LinearModel) -> np.ndarray:
    """What all columns add to the logged ones, (K + 1, R, 6, P)."""
    return DrivenColumns(linear.G, linear.observed, linear.observing).dense_observed


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


@pytest.mark.slow
@pytest.mark.parametrize("where", ["neutral", "off neutral"])
def test_derivatives_of_what_is_logged_are_those_of_finite_differences(steps: TransitionModel, where: str) -> None:
    theta = values(steps, where)
    states, inputs, force = path(steps, 2)
    columns = every_column(steps)
    linear = steps.linearise(states, inputs, theta, force, columns, np.arange(steps.S))
    flat = states.reshape(-1, steps.S).T

    def seen(z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        simulator, own = on_board(steps, theta)
        return simulator.columns(z, own).T.reshape(*states.shape[:2], 6)

    np.testing.assert_allclose(linear.logged, seen(flat, theta), rtol=1e-12, atol=1e-13)
    H = slopes(lambda flat: seen(flat, theta), flat, range(steps.S), 1e-6, 1e-2)
    D = slopes(lambda theta: seen(flat, theta), theta, steps.at, 1e-6, 1e-2)
    close(linear.H, H, 1e-6)
    close(D_of(linear), D, 1e-6)


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


def test_passive_memory_is_simulated_along_the_path(steps: TransitionModel) -> None:
    theta = steps.ship.values
    z, c = states_about(steps, 3, 8)
    K = 12
    inputs = np.repeat(c.T[None], K, axis=0)
    inputs[5:, :, steps.model.controls.index("delta")] += 0.2
    force = 0.05 * np.ones((K + 1, 3, 3))
    path = np.repeat(steps.settled(z[:6], c, theta).T[None], K + 1, axis=0)
    for k in range(K):
        path[k + 1] = steps.advance(path[k].T, inputs[k].T, steps.coefficients(theta, force[k].T)).T
    spoilt = path.copy()
    spoilt[..., 6:] = 99.0
    back = steps.with_passive_states(spoilt, inputs, theta, force, np.arange(6, steps.S))
    np.testing.assert_allclose(back, path, rtol=1e-10, atol=1e-12)


def test_steps_travel_to_another_process(steps: TransitionModel) -> None:
    again = pickle.loads(pickle.dumps(steps))
    assert again.symbols == steps.symbols and again.h == steps.h
    z, c = states_about(steps, 5, 9)
    theta = off_neutral(steps)
    assert np.array_equal(again.advance(z, c, theta), steps.advance(z, c, theta))


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
