"""The torch operators of a ship give what CasADi gives, values and gradients, whatever runs them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
import torch

from cases.shipfiles.ship_file import library, load_ship
from mmg.compile.cache import compiler
from mmg.model import assemble
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual, Symmetric, to_network
from residual.physics import FusedRollout, Operator, Physics
from residual.system import TrainableSystem
from tests.mmg.test_rollout import with_effects
from tests.support.networks import random_network
from tests.support.quick import first_quick

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")
ESSO = load_ship("esso_osaka_3m")
SHIPS = {name: load_ship(name) for name in library()}
OTHERS = {
    "memory": with_effects("rudder_lag", "hull_memory", "control_delay"),
    "place": with_effects("current", "bank"),
    "measured": with_effects("antenna_offset", "log_scale"),
    "hybrid": ESSO.with_network(random_network(ESSO, members=2)),
}
WAYS = {"C": True, "interpreted": False}
"""Whether the operators are compiled."""


def points(ship: Ship) -> tuple[torch.Tensor, torch.Tensor]:
    """States (S, 33) and inputs (C, 33) from a settled start: at rest, astern, and scattered ahead and astern."""
    rng = np.random.default_rng(0)
    names, M = ship.inputs, 33
    speed = np.sqrt(ship.particulars["L"] / 3.0)
    six = rng.normal(size=(6, M)) * np.array([3.0, 3.0, 2.0, 0.5 * speed, 0.2 * speed, 0.1 / speed])[:, None]
    size = np.array(
        [10.0 / speed if name.startswith("n") else 2.0 if name.startswith("wind") else 0.4 for name in names]
    )
    controls = rng.normal(size=(len(names), M)) * size[:, None]
    six[:, 0], controls[:, 0] = 0.0, 0.0
    six[3, 1:6] = -np.abs(six[3, 1:6])
    for i, name in enumerate(names):
        if name in ("n", "n_2"):
            controls[i, 1:6] = -np.abs(controls[i, 1:6])
    states = Simulator(ship).start(six, controls)
    states[6:, 6:] *= 1 + 0.1 * rng.normal(size=(len(states) - 6, M - 6))
    return torch.as_tensor(states).contiguous(), torch.as_tensor(controls)


def close(found: torch.Tensor, expected: np.ndarray, relative: float = 1e-12) -> None:
    """Relative to the largest value of the row."""
    size = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1e-300)
    assert np.isfinite(found.detach().numpy()).all()
    np.testing.assert_array_less(np.abs(found.detach().numpy() - expected) / size, relative)


def physics_of(way: str):
    """How to make the operator of a ship in one of WAYS."""
    if way == "C" and compiler() is None:
        pytest.skip("no C compiler")
    return lambda ship: Physics(ship, WAYS[way])


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", [*SHIPS, *OTHERS])
def test_values_and_gradients_are_those_of_casadi(name, way):
    ship = {**SHIPS, **OTHERS}[name]
    z, c = points(ship)
    model = assemble(ship, ())
    zs, cs, seed = (ca.SX.sym(s, n) for s, n in (("z", len(z)), ("c", len(c)), ("seed", len(z))))
    rates = model.rates(zs, cs, [])
    products = [ca.densify(ca.jtimes(rates, x, seed, True)) for x in (zs, cs)]
    reference = ca.Function("reference", [zs, cs, seed], [ca.densify(rates), *products])
    seeds = torch.randn(z.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    expected = [np.array(a) for a in reference.map(z.shape[1])(z.numpy(), c.numpy(), seeds.numpy())]
    z.requires_grad_(), c.requires_grad_()
    found = physics_of(way)(ship).rates(z, c)
    gradients = torch.autograd.grad(found, (z, c), seeds)
    for one, other in zip((found, *gradients), expected, strict=True):
        close(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_features_and_columns_are_those_of_the_model(way):
    for ship in (OTHERS["measured"], OTHERS["place"], OTHERS["memory"]):
        z, c = points(ship)
        physics, model = physics_of(way)(ship), assemble(ship, ())
        seen = np.array(model.features.map(z.shape[1])(z.numpy(), c.numpy(), np.zeros((0, z.shape[1]))))
        close(physics.features(z, c), seen)
        close(physics.call("rates_and_features", z, c)[1], seen)
        close(physics.columns(z), Simulator(ship).columns(z.numpy()))
        logged = physics.columns(z)
        close(physics.columns(physics.start(logged, c)), logged.numpy(), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"), [("esso_osaka_3m", "euler"), ("memory", "rk4"), ("vectwin_3m", "rk4"), ("place", "rk4")]
)
def test_a_network_trained_in_torch_is_the_same_in_casadi(name, method):
    ship = {**SHIPS, **OTHERS}[name]
    network = random_network(ship, width=32)
    residual = Residual.of_network(network)
    hybrid = ship.with_network(to_network([residual], ship.actuators, network.lower, network.upper))
    z, c = points(ship)
    z = torch.cat([z[:, 1:9], z[:, 20:28]], dim=1).contiguous()
    inputs = torch.stack([torch.cat([c[:, 1:9], c[:, 20:28]], dim=1) * (1 + 0.05 * k) for k in range(20)])
    expected = Simulator(hybrid).run(z.numpy(), inputs.numpy(), 0.05, method=method)
    alone = Simulator(ship).run(z.numpy(), inputs.numpy(), 0.05, method=method)
    physics, states = Physics(ship), [z]
    system = Hybrid(physics, residual, np.zeros((len(ship.features), 1)))
    for controls in inputs:
        states.append(system.step(states[-1], controls, 0.05, method))
    np.testing.assert_allclose(torch.stack(states).detach().numpy(), expected, rtol=1e-9, atol=1e-9)
    assert np.abs(expected - alone).max() > 1e-3
    close(Physics(hybrid).rates(z, inputs[0])[3:6] - physics.rates(z, inputs[0])[3:6],
          residual(physics.features(z, inputs[0])).detach().numpy(), 1e-9)  # fmt: skip


@pytest.mark.slow
def test_smaller_types_and_other_layouts_come_out_the_same():
    physics = Physics(ESSO)
    z, c = points(ESSO)
    whole = physics.rates(z, c)
    torch.testing.assert_close(physics.rates(z.T.contiguous().T, c), whole, rtol=0, atol=0)
    for M in (1, 3, 8, 32):
        torch.testing.assert_close(physics.rates(z[:, :M], c[:, :M]), whole[:, :M], rtol=0, atol=0)
    single = z.float().requires_grad_()
    found = physics.rates(single, c)
    assert found.dtype == torch.float32
    found.sum().backward()
    assert single.grad is not None and single.grad.dtype == torch.float32
    torch.testing.assert_close(found.double(), whole, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_an_input_without_gradient_gets_none_and_nothing_is_kept_without_grad():
    physics = Physics(ESSO)
    z, c = points(ESSO)
    z.requires_grad_()
    physics.rates(z, c).sum().backward()
    assert z.grad is not None and c.grad is None
    with torch.no_grad():
        assert physics.rates(z, c).grad_fn is None


@pytest.mark.parametrize("shape", [(5, 33), (7, 33), (6, 32), (6,)])
def test_tensors_that_do_not_fit_are_refused(shape):
    _, c = points(ESSO)
    with pytest.raises(ValueError, match="needed"):
        Physics(ESSO).rates(torch.zeros(shape, dtype=torch.float64), c)


@pytest.mark.slow
def test_one_input_may_be_shared_by_all_points():
    x, h = ca.SX.sym("x", 2), ca.SX.sym("h")
    for compiled in (True, False):
        operator = Operator(ca.Function("scaled", [x, h], [h * x * x]), compiled)
        given = torch.randn(2, 5, dtype=torch.float64, requires_grad=True)
        (found,) = operator(given, torch.full((1, 1), 0.3, dtype=torch.float64))
        found.sum().backward()
        torch.testing.assert_close(found, 0.3 * given * given)
        torch.testing.assert_close(given.grad, 0.6 * given.detach())


FUSED = {"memory": OTHERS["memory"], "esso": ESSO, "vectwin": load_ship("vectwin_3m"), "hybrid": OTHERS["hybrid"]}
FUSED["symmetric"] = ESSO


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize("name", first_quick(FUSED))
def test_states_and_gradients_are_those_of_single_steps(name, method):
    ship = FUSED[name]
    residual = Residual.of_network(random_network(ship, width=10))
    layered = Symmetric(residual, ship.actuators) if name == "symmetric" else residual
    system = Hybrid(Physics(ship), layered, np.zeros((len(ship.features), 1)))
    z, c = (a[:, 6:19] for a in points(ship))
    inputs = torch.stack([c * (1 + 0.05 * k) for k in range(12)])
    draw = torch.Generator().manual_seed(0)
    weights = torch.randn((13, *z.shape), generator=draw, dtype=torch.float64)
    results = []
    for simulate in (system.simulate, lambda *given: TrainableSystem.simulate(system, *given)):
        start = z.clone().requires_grad_()
        states = simulate(start, inputs, 0.05, method)
        gradients = torch.autograd.grad((states * weights).sum(), [start, *residual.parameters()])
        results.append([states.detach(), *gradients])
    assert system.fused.library is not None
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-10 * float(other.abs().max()))
        assert other.abs().max() > 0


def test_shapes_that_do_not_fit_are_refused():
    z, c = points(ESSO)
    layers = Residual.of_network(random_network(ESSO)).plain()
    for width, inputs in ((8, c[None, :, :-1]), (9, c[None])):
        with pytest.raises(ValueError, match="fit"):
            FusedRollout(Physics(ESSO), width)(z, inputs, 0.1, layers)
