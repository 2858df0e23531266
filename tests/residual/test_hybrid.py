"""The residual: zero at rest, bounded, exact gradients, finds a missing force, declines noise, never runs away."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from cases.shipfiles.ship_file import load_ship
from fitting.nlp.windows import Stretch, pieces_of
from mmg.errors import TooFewData
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual, Symmetric, build_hybrid, hybrid_scales, to_network
from residual.physics import Physics
from residual.pipeline import train
from residual.settings import TrainSettings
from residual.splits import Split
from residual.system import TrainableSystem, acceleration_loss, squares, state_loss
from residual.train import Task, train_one
from residual.windows import Scales, windows
from tests.support import hybrids
from tests.support.differences import check_gradients

QUICK = TrainSettings(seeds=2, epochs=25, width=12, penalty=0.001, rate=1e-2, step=1.0, stride=5.0)
SIGMA = torch.tensor([1.0, 1.0, 0.3, 0.1, 0.05, 0.02], dtype=torch.float64)


def random_residual(seed: int = 0, width: int = 16, ship: Ship | None = None) -> Residual:
    """Random weights, the last layer included."""
    F = len((ship or hybrids.ship()).features)
    residual = Residual.drawn(np.linspace(0.1, 1.0, F), np.array([1e-3, 2e-3, 5e-4]), width, seed)
    with torch.no_grad():
        residual.W3.normal_(generator=torch.Generator().manual_seed(seed))
    return residual


def test_goes_to_casadi_and_back() -> None:
    residuals = [random_residual(0), random_residual(1)]
    network = to_network(residuals, hybrids.ship().actuators, -np.ones(7), np.ones(7))
    x = np.random.default_rng(0).normal(size=(7, 20))
    mean = sum(r(torch.as_tensor(x)) for r in residuals).detach().numpy() / 2
    np.testing.assert_allclose(network.accelerations(x), mean, rtol=0, atol=1e-16)
    again = Residual.of_network(network, 1)(torch.as_tensor(x)).detach().numpy()
    np.testing.assert_allclose(again, residuals[1](torch.as_tensor(x)).detach().numpy(), atol=1e-16)
    assert (np.abs(network.accelerations(1e3 * x)) <= network.bound[:, None]).all()


def hybrid_and_batch(h: float = 1.0, steps: int = 12):  # type: ignore[no-untyped-def]
    trials = hybrids.trials(hybrids.ship(), 2, 60)
    pieces = pieces_of(trials, h, hybrids.ship().inputs)
    physics = Physics(hybrids.ship(), compiled=False)
    batch = windows(pieces, h, steps, steps)
    assert batch is not None
    return Hybrid(physics, random_residual(), np.ones((7, 4))), batch


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_gradient_of_the_rollout_loss_agrees_with_finite_differences(method: str) -> None:
    hybrid, batch = hybrid_and_batch()

    def loss() -> torch.Tensor:
        a = acceleration_loss(hybrid, batch, torch.ones(3, dtype=torch.float64) * 1e-3)
        return state_loss(hybrid, batch, SIGMA, method) + hybrid.penalty() + 0.1 * a

    check_gradients(loss, hybrid.parameters())


def test_the_state_loss_is_equation_23() -> None:
    _, batch = hybrid_and_batch()
    predicted, sigma = batch.targets.clone(), torch.arange(1.0, 7.0, dtype=torch.float64)
    predicted[1:, 4] += 10.0
    assert squares(predicted, batch, sigma).numpy() == pytest.approx(np.full(len(batch), 4.0))


def test_windows_slide_and_never_leave_their_piece() -> None:
    (trial,) = hybrids.trials(hybrids.ship(), 1, 100)
    (piece,) = pieces_of([trial], 1.0, hybrids.ship().inputs)
    half = Stretch(piece.record, 40, 80)
    batch = windows([half], 1.0, 10, 5, past=3)
    assert batch is not None and batch.past is not None and len(batch) == 6
    np.testing.assert_allclose(batch.targets[0, :, 0].numpy(), piece.record.states[43])
    np.testing.assert_allclose(batch.past.logged[-1, :, 1].numpy(), piece.record.states[47])
    np.testing.assert_allclose(batch.targets[-1, :, -1].numpy(), piece.record.states[78])


class Exploding(TrainableSystem):
    """Ends in NaN after its first gradient step unless the learning rate is low."""

    def __init__(self) -> None:
        super().__init__()
        self.w = torch.nn.Parameter(torch.zeros(1, dtype=torch.float64))

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return z + torch.where(self.w.abs() > 1e-3, float("nan"), self.w + 1e-3)


def exploding(ship: object, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    return Exploding()


@pytest.mark.parametrize(("rate", "status", "restarts"), [(0.01, "finished", 2), (10.0, "diverged", 2)])
def test_a_diverging_training_starts_again_lower_and_then_gives_up(rate: float, status: str, restarts: int) -> None:
    ship = hybrids.ship()
    pieces = pieces_of(hybrids.trials(ship, 1, 100), 1.0, ship.inputs)
    scales = hybrid_scales(ship, pieces, hybrids.trials(ship, 1, 100), 1.0)
    training = TrainSettings(rate=rate, epochs=1, step=1.0, penalty=0.0, last_rate=1e-9, curriculum=((10.0, 1.0),))
    task = Task(exploding, ship, scales, training, 0, Split(pieces, pieces, pieces, 0))
    found = train_one(task)
    assert (found.status, found.restarts) == (status, restarts)
    assert found.rate == pytest.approx(rate * 0.04)


@pytest.mark.parametrize("seconds", [25, 60])
def test_too_little_data_is_one_clear_sentence(seconds: int) -> None:
    with pytest.raises(TooFewData):
        train(hybrids.ship(), hybrids.trials(hybrids.ship(), 1, seconds), settings=QUICK)


def test_the_seed_decides_everything() -> None:
    ship = hybrids.ship()
    trials = hybrids.trials(hybrids.lacking(), 2, 200)
    scales = hybrid_scales(ship, pieces_of(trials, 1.0, ship.inputs), trials, 1.0)
    first, again, other = (build_hybrid(ship, scales, QUICK, seed).residual.own.W1 for seed in (0, 0, 1))  # type: ignore
    assert torch.equal(first, again) and not torch.equal(first, other)


@pytest.mark.slow
def test_random_inputs_at_twice_the_range_do_not_diverge_in_1000_runs() -> None:
    trained = train(hybrids.ship(), hybrids.trials(hybrids.lacking()), settings=QUICK)
    assert trained.network is not None
    rng = np.random.default_rng(1)
    controls = hybrids.random_controls(rng, 1000, 1000, n=20.0, delta=1.2)
    start = np.zeros((6, 1000))
    start[3] = rng.uniform(-0.8, 0.8, 1000)
    out = Simulator(hybrids.ship().with_network(trained.network)).run(start, controls, 1.0)
    assert np.isfinite(out).all() and np.abs(out[:, 3:5]).max() < 3.0 and np.abs(out[:, 5]).max() < 0.5


@pytest.mark.parametrize("name", ["esso_osaka_3m", "vectwin_3m"])
def test_a_symmetric_residual_answers_mirrored_motion_by_mirrored_accelerations(name: str) -> None:
    ship = load_ship(name)
    limit = np.ones(len(ship.features))
    both, rng = Symmetric(random_residual(3, 8, ship), ship.actuators), np.random.default_rng(0)
    values = {feature: rng.normal(size=50) for feature in ship.features}
    turned = {feature: -a if feature in ("v", "r", "a_y", "n_bow") else a for feature, a in values.items()}
    for port, starboard in (("delta", "delta"), ("delta_port", "delta_starboard")):
        if port in values:
            turned |= {port: -values[starboard], starboard: -values[port]}
    one, other = (both(torch.as_tensor(np.array([v[f] for f in ship.features]))) for v in (values, turned))
    np.testing.assert_allclose(other.detach(), one.detach() * torch.tensor([[1.0], [-1.0], [-1.0]]), atol=1e-16)
    assert (one.abs().mean(dim=1) > 1e-6).all(), "symmetric because it is nothing"
    network = to_network([both], ship.actuators, -limit, limit)
    x = np.array([values[f] for f in ship.features])
    np.testing.assert_allclose(network.accelerations(x), one.detach().numpy(), atol=1e-16)


@pytest.mark.slow
def test_gradients_of_a_symmetric_residual_through_the_compiled_rollout() -> None:
    plain, batch = hybrid_and_batch()
    hybrid = Hybrid(plain.physics, Symmetric(random_residual(), hybrids.ship().actuators), np.ones((7, 4)))
    gradients = []
    for simulate in (hybrid.simulate, lambda *given: TrainableSystem.simulate(hybrid, *given)):
        hybrid.zero_grad()
        start = hybrid.start(batch.targets[0], batch.controls[0])
        error = (simulate(start, batch.controls, batch.h)[:, :6] - batch.targets) / SIGMA[:, None]
        (error**2).mean().backward()
        gradients.append([p.grad.clone() for p in hybrid.parameters()])  # type: ignore[union-attr]
    assert len(gradients[0]) == 5 and all(g.abs().max() > 0 for g in gradients[0])
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-12)
