"""Fused rollouts: the same as a loop in Python, for any number of points, inputs, steps and effects."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from cases.shipfiles.effects import with_effects as effects_of
from cases.shipfiles.ship_file import load_ship
from mmg.compile.batch import compile_rollout
from mmg.compile.cache import compiler
from mmg.compile.codegen import LANES
from mmg.effects import effect
from mmg.model import columns
from mmg.rollout import Simulator
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship
from tests.support.networks import random_network

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
ESSO = load_ship("esso_osaka_3m")
N = 12


def with_effects(*names: str) -> Ship:
    """ESSO with effects at their typical values."""
    ship = ESSO
    for name in names:
        rows = effect(name).parameters(ship.namespace, dict(ship.components))
        ship = ship.with_effect(name, {row.symbol: row.neutral + row.typical for row in rows if not row.held})
    return ship


SHIPS = {
    "plain": ESSO,
    "with memory": with_effects("rudder_lag", "hull_memory", "control_delay"),
    "that feels where it is": with_effects("current", "bank"),
    "with two rudders": load_ship("vectwin_3m"),
    "with a network": ESSO.with_network(random_network(ESSO, members=2)),
}


@pytest.fixture(scope="module", params=SHIPS)
def simulator(request: pytest.FixtureRequest) -> Simulator:
    return Simulator(SHIPS[request.param])


def case(simulator: Simulator, M: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start (S, M), inputs at N + 1 nodes (N + 1, C, M), coefficients (P, M): all scattered."""
    rng = np.random.default_rng(seed)
    six = rng.uniform(-0.2, 0.2, (6, M))
    six[3] += 0.4
    names = simulator.model.controls
    size = np.array([10.0 if name.startswith("n") else 0.0 if name.startswith("wind") else 0.3 for name in names])
    controls = size[:, None] * rng.uniform(0.3, 1.0, (N + 1, len(names), M))
    values = simulator.ship.values
    theta = values[:, None] * (1 + 0.02 * rng.standard_normal((len(values), M)))
    return simulator.start(six, controls[0], theta), controls, theta


def loop(f, start, inputs, steps, theta, method: str) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The integration written out, with one call of the rates f per stage."""
    z, out = start, [start]
    for c, h in zip(inputs, steps, strict=True):
        k1 = f(z, c, theta)
        if method == "euler":
            z = z + h * k1
        else:
            k2 = f(z + 0.5 * h * k1, c, theta)
            k3 = f(z + 0.5 * h * k2, c, theta)
            z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(z + h * k3, c, theta))
        out.append(z)
    return np.array(out)


@pytest.mark.parametrize("M", [1, 3, LANES, LANES + 3])
@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_a_run_is_the_loop_of_its_steps(simulator: Simulator, M: int, method: str) -> None:
    start, nodes, theta = case(simulator, M)
    steps = np.random.default_rng(1).uniform(0.1, 0.5, (N, M))
    got = simulator.run(start, nodes[:-1], steps, theta, method)
    assert got.shape == (N + 1, *start.shape)
    expected = loop(simulator.rates, start, nodes[:-1], steps, theta, method)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-14)


def test_without_a_compiler_the_result_is_the_same(simulator: Simulator, monkeypatch: pytest.MonkeyPatch) -> None:
    start, nodes, theta = case(simulator, 3)
    keep = np.arange(1, N + 1) % 4 == 0
    expected = simulator.run(start, nodes[:-1], 0.2, theta, keep=keep)
    monkeypatch.setenv("MMG_CC", "none")
    alone = Simulator(simulator.ship)
    got = alone.run(start, nodes[:-1], 0.2, theta, keep=keep)
    assert alone.interpreted_because
    np.testing.assert_allclose(got, expected, rtol=1e-11, atol=1e-13)


def test_a_ship_moves_the_same_whoever_sails_beside_her(simulator: Simulator) -> None:
    start, nodes, theta = case(simulator, 2 * LANES + 3)
    together = simulator.run(start, nodes[:-1], 0.3, theta)
    for m in (0, LANES, 2 * LANES + 2):
        alone = simulator.run(start[:, [m]], nodes[:-1, :, [m]], 0.3, theta[:, [m]])
        np.testing.assert_array_equal(together[:, :, [m]], alone)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("M", [1, LANES + 1])
def test_what_is_shared_counts_for_every_point(compiled: bool, M: int) -> None:
    simulator = Simulator(ESSO, compiled)
    start, nodes, _ = case(simulator, M)
    theta, inputs, steps = ESSO.values, nodes[:-1, :, 0], np.linspace(0.1, 0.3, N)
    each = simulator.run(
        start, np.repeat(inputs[:, :, None], M, axis=2), np.repeat(steps[:, None], M, axis=1),
        np.repeat(theta[:, None], M, axis=1),
    )  # fmt: skip
    np.testing.assert_array_equal(simulator.run(start, inputs, steps, theta), each)
    np.testing.assert_array_equal(simulator.run(start, inputs, steps[:, None]), each)
    even = simulator.run(start, inputs, 0.2)
    np.testing.assert_array_equal(even, simulator.run(start, inputs, np.full((N, M), 0.2)))


@pytest.mark.parametrize("compiled", [True, False])
def test_only_the_steps_that_are_kept_come_back(compiled: bool) -> None:
    simulator = Simulator(ESSO, compiled)
    start, nodes, theta = case(simulator, LANES + 1)
    whole = simulator.run(start, nodes[:-1], 0.2, theta)
    for keep in (np.arange(N) % 3 == 1, np.arange(N) == N - 1, np.zeros(N, dtype=bool)):
        got = simulator.run(start, nodes[:-1], 0.2, theta, keep=keep)
        np.testing.assert_array_equal(got, whole[np.concatenate([[True], keep])])


@pytest.mark.parametrize("compiled", [True, False])
def test_six_rows_are_settled(compiled: bool) -> None:
    simulator = Simulator(SHIPS["with memory"], compiled)
    start, nodes, theta = case(simulator, 2)
    assert len(start) > 6
    got = simulator.run(start[:6], nodes[:-1], 0.2, theta)
    np.testing.assert_array_equal(got, simulator.run(start, nodes[:-1], 0.2, theta))


@pytest.mark.parametrize("compiled", [True, False])
def test_nothing_to_do_gives_the_start_or_nothing(compiled: bool) -> None:
    simulator = Simulator(ESSO, compiled)
    start, nodes, _ = case(simulator, 2)
    np.testing.assert_array_equal(simulator.run(start, nodes[:0], 0.2), start[None])
    assert simulator.run(start[:, :0], nodes[:-1, :, :0], 0.2).shape == (N + 1, 6, 0)


def test_what_does_not_fit_is_refused() -> None:
    simulator = Simulator(ESSO)
    start, nodes, theta = case(simulator, 3)
    inputs = nodes[:-1]
    for name, wrong in (
        ("start", (start[:5], inputs, 0.1, theta)),
        ("controls", (start, inputs[:, :, :2], 0.1, theta)),
        ("dt", (start, inputs, np.full(3, 0.1), theta)),
        ("theta", (start, inputs, 0.1, theta[:-1])),
    ):
        with pytest.raises(ValueError, match=f"^{name} "):
            simulator.run(*wrong)
    with pytest.raises(ValueError):
        simulator.run(start, inputs, 0.1, keep=np.ones(N + 1, dtype=bool))
    with pytest.raises(ValueError, match="'heun'"):
        simulator.run(start, inputs, 0.1, method="heun")


# The generated code


def shuffled_rates() -> ca.Function:
    """Rates whose rows are constants, inputs, coefficients and mixtures of them, one used twice."""
    q, c, p = ca.SX.sym("q", 3), ca.SX.sym("c", 2), ca.SX.sym("p", 2)
    both = ca.sin(c[0] * p[0])
    rows = ca.vertcat(1.5, p[1], c[1], both * q[1] + ca.sqrt(p[1]), both + p[0] * q[2])
    return ca.Function("f", [q, c, p], [ca.densify(rows)])


@needs_compiler
def test_rows_may_depend_on_anything_or_nothing() -> None:
    rates, rng = shuffled_rates(), np.random.default_rng(3)
    start, controls, p = rng.random((5, LANES)), rng.random((4, 2, LANES)), rng.random((2, LANES))
    rollout = compile_rollout(rates, 2)
    assert rollout is not None
    got = rollout(start, controls, np.asarray(0.5), p, np.ones(4, dtype=bool), True)
    z = start
    for k in range(4):
        z = z + 0.5 * np.array(rates(z[2:], controls[k], p))
        np.testing.assert_allclose(got[k + 1], z, rtol=1e-14)


@needs_compiler
def test_equations_without_c_are_said_once(caplog: pytest.LogCaptureFixture) -> None:
    q, c, p = (ca.SX.sym(name) for name in "qcp")
    for _ in range(2):
        assert compile_rollout(ca.Function("f", [q, c, p], [ca.asinh(q)]), 0, "such equations") is None
    assert len([r for r in caplog.records if "such equations" in r.message]) == 1


@pytest.mark.parametrize("by_point", [False, True])
def test_logged_columns_of_many_states_are_those_of_the_model_one_by_one(by_point: bool) -> None:
    ship = effects_of(ESSO, ["velocity_filter:tau=0.3", "gyro:share=0.02", "antenna_offset"])
    simulator, rng = Simulator(ship), np.random.default_rng(0)
    states = rng.normal(size=(7, len(simulator.model.states), 5))
    theta = ship.values
    if by_point:
        theta = theta[:, None] * rng.uniform(0.9, 1.1, (len(theta), 5))
    every = theta if by_point else np.tile(theta[:, None], (1, 5))
    expected = np.array([
        np.hstack([np.array(simulator.model.columns(z[:, k], every[:, k])) for k in range(5)]) for z in states
    ])  # fmt: skip
    assert np.abs(expected[:, 5] - states[:, 5]).max() > 1e-3  # the gyro's share is seen
    for found in (simulator.columns(states, theta), columns(simulator.model, states, theta)):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


# The one Runge-Kutta step serves every kind of array, and has the order it claims
def test_the_step_has_fourth_order() -> None:
    errors = []
    for h in (0.2, 0.1):
        z = np.array([1.0])
        for k in range(round(1 / h)):
            z = rk4_step(lambda state, at, begin=k * h, h=h: state * np.cos(begin + at * h), z, h)
        errors.append(abs(float(z[0]) - np.exp(np.sin(1.0))))
    assert 12 < errors[0] / errors[1] < 20
