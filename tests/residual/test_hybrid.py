"""The residual: zero at rest, bounded, exact gradients, finds a missing force, declines noise, never runs away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

import mmg_ident as mi
from cases.shipfiles.ship_file import load_ship
from delivery.c.source import c_files
from fitting.nlp.windows import Stretch, pieces_of
from mmg.errors import TooFewData
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual, Symmetric, hybrid_scales, layers_of, to_network
from residual.physics import Physics
from residual.pipeline import train
from residual.settings import BlackBoxSettings, TrainSettings
from residual.splits import Split
from residual.system import TrainableSystem, squares
from residual.train import Task, train_one
from residual.windows import Scales, windows
from tests.support import hybrids
from tests.support.c_products import product

QUICK = TrainSettings(seeds=2, epochs=25, width=12, penalty=0.001, rate=1e-2, step=1.0, stride=5.0)


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
@pytest.mark.parametrize("settings", [QUICK, BlackBoxSettings(seeds=1, step=1.0)])
def test_too_little_data_is_one_clear_sentence(seconds: int, settings: TrainSettings | BlackBoxSettings) -> None:
    with pytest.raises(TooFewData):
        train(hybrids.ship(), hybrids.trials(hybrids.ship(), 1, seconds), settings=settings)


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


# A torch module and a loss of a user train a residual, which is then in the ship as any other


SHIP = hybrids.ship()
F = len(SHIP.features)
BRIEF = TrainSettings(seeds=1, epochs=2, step=1.0, stride=10.0, rate=1e-2, batch=4096)


def three_hidden() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(
        nn.Linear(F, 6), nn.Tanh(), nn.Sequential(nn.Linear(6, 5, bias=False), nn.Tanh()), nn.Linear(5, 3)
    )


@pytest.mark.parametrize("symmetric", [False, True])
def test_it_is_the_module_less_its_value_at_the_origin_whatever_its_depth_and_biases(symmetric: bool) -> None:
    rng, module, scale = np.random.default_rng(0), three_hidden().double(), np.array([1e-3, 2e-3, 5e-4])
    residual = Residual(np.linspace(0.1, 2.0, F), scale, layers_of(module))
    q = torch.as_tensor(rng.normal(size=(F, 20)))
    x = q * residual.feature_scale[:, None]
    assert (residual(x) == 0).all()
    with torch.no_grad():
        residual.W3.copy_(module[-1].weight)
        made = (module(q.T) - module(torch.zeros(1, F, dtype=torch.float64))).T
    own = Symmetric(residual, SHIP.actuators) if symmetric else residual
    found = to_network([own], SHIP.actuators, -np.ones(F), np.ones(F)).accelerations(x.numpy())
    np.testing.assert_allclose(found, own(x).detach().numpy(), rtol=1e-12, atol=1e-17)
    if not symmetric:
        np.testing.assert_allclose(found, scale[:, None] * made.numpy(), rtol=1e-12, atol=1e-17)


def test_two_layers_of_one_width_go_through_the_compiled_loop() -> None:
    two = nn.Sequential(nn.Linear(F, 6), nn.Tanh(), nn.Linear(6, 6), nn.Tanh(), nn.Linear(6, 3))
    for module, fused in ((two, True), (three_hidden(), False)):
        residual = Residual(np.ones(F), np.ones(3), layers_of(module))
        assert (Hybrid(Physics(SHIP), residual, np.ones((F, 1))).fused is not None) == fused


@pytest.mark.slow
def test_trained_with_an_own_loss_it_is_in_the_ship_that_is_saved_and_exported(tmp_path: Path) -> None:
    seen = []

    def absolute(errors: torch.Tensor) -> torch.Tensor:
        seen.append(tuple(errors.shape))
        return errors.abs().mean()

    trials = hybrids.trials(SHIP, 2, 120)
    result = mi.train(SHIP, trials, settings=BRIEF, keep="always", network=three_hidden(), loss=absolute)
    assert result.network is not None and [len(m.biases) for m in result.network.members] == [2]
    assert seen and all(shape[1] == 6 for shape in seen)
    result.save(tmp_path / "run", report=False)
    again = mi.load_ship(tmp_path / "run")
    assert again.network is not None
    x = np.ones((F, 1))
    np.testing.assert_array_equal(again.network.accelerations(x), result.network.accelerations(x))
    assert c_files(product(again))


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"network": 3}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 3))}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 8), nn.ReLU(), nn.Linear(8, 3))}, "ReLU"),
        ({"network": nn.Sequential(nn.Linear(F + 1, 8), nn.Tanh(), nn.Linear(8, 3))}, "network"),
        ({"network": nn.Sequential(nn.Linear(F, 8), nn.Tanh(), nn.Linear(7, 3))}, "network"),
        ({"loss": 3}, "loss"),
        ({"loss": lambda errors: 3.0}, "loss"),
        ({"loss": lambda errors: errors}, "loss"),
        ({"loss": lambda errors: errors.mean(), "settings": TrainSettings(loss="acceleration")}, "loss"),
        ({"loss": lambda errors: errors.mean(), "settings": BlackBoxSettings()}, "loss"),
    ],
)
def test_a_network_or_loss_that_cannot_be_is_refused(changed: dict[str, Any], word: str) -> None:
    with pytest.raises(mi.UserError) as caught:
        mi.train(SHIP, hybrids.trials(SHIP, 2, 120), **{"settings": BRIEF, **changed})
    assert word in str(caught.value) and "\n" not in str(caught.value)
