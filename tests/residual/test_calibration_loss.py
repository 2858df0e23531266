"""What trains a network is what calibrated the ship: value, gradient, the windows of a split, its file."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch

from cases.shipfiles.ship_file import load_ship
from cases.simulation.demo_trials import demo_trials
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.prior import ByCampaign
from fitting.nlp.problem import Problem
from fitting.nlp.windows import pieces_of
from fitting.settings import Settings
from fitting.solvers.reduced import ReducedProblem
from fitting.solvers.rollout_loss import RolloutLoss
from mmg.errors import BadValue, Unreadable
from residual.hybrid import HYBRID_KIND, Hybrid, Residual
from residual.physics import Physics
from residual.pipeline import loss_of
from residual.settings import TrainSettings
from residual.system import RolloutBatch, calibration_loss, rollout
from residual.train import tasks_of, train_one
from residual.windows import by_campaign, calibration_windows, campaign_symbols, windows
from tests.support.calibrated import FREE
from tests.support.small_fleets import DAYS, fleet

ESSO = load_ship("esso_osaka_3m").fixing([s for s in load_ship("esso_osaka_3m").symbols if s not in FREE])
SHIPS = ("plain", "student", "campaigns")


@lru_cache(maxsize=3)
def calibrated(kind: str) -> tuple[Calibration, list[Trial]]:
    """A calibration by squares, by Student's t, or with a lag of the gyro by campaign."""
    if kind != "campaigns":
        trials, loss = list(demo_trials(3, dt=0.5)[0][:4]), "student" if kind == "student" else "gaussian"
        return estimate_coefficients(ESSO, trials, Settings(passes=2, loss=loss)), trials
    lags = {day: [f"gyro:T={lag}"] for day, lag in zip(DAYS, (0.0, 0.9), strict=False)}
    trials = fleet(ESSO, lags, ("zigzag:20/20",), 5, 10.0, 60.0)
    own = ByCampaign(("gyro.T",), DAYS[:2], (0, 1))
    return estimate_coefficients(ESSO.with_effect("gyro"), trials, Settings(passes=2), per_run=own), trials


def cost_of_samples(problem: Problem, x: np.ndarray) -> float:
    """The objective at ``x`` (n,) less the prior and the memory of the first states."""
    nodes, p = problem.split(x)
    memory = 0.5 * (problem.memory_weight * (nodes - problem.measured_nodes)[:, 6:] ** 2).sum()
    return float(problem.objective(x) - 0.5 * p @ p - memory)


def still(found: Calibration, symbols: tuple[str, ...]) -> Hybrid:
    """A network of zeros on the ship that was fitted, whose values of ``symbols`` are inputs."""
    physics = Physics(found.ship, symbols=symbols)
    F = len(found.ship.features)
    return Hybrid(physics, Residual.drawn(np.ones(F), np.ones(3), 4), np.ones((F, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", SHIPS)
def test_value_and_gradient_are_those_of_the_calibration(kind: str) -> None:
    """Prior and memory of the first states apart, to 1e-9 of the value and 1e-6 of the gradient."""
    found, _ = calibrated(kind)
    problem, prior = found.problem, found.problem.prior
    reduced = ReducedProblem(problem, found.solution.x)
    for p in (reduced.start, reduced.start + 0.3 * reduced.scale):
        _, slope = reduced.objective(p)
        x = reduced.best_states(p)
        assert x is not None
        _, scaled = problem.split(x)
        loss = RolloutLoss.of(problem, x)
        theta = torch.tensor(prior.mean + prior.std * scaled, requires_grad=True)
        values = theta[torch.as_tensor(problem.columns.at[problem.columns.window].T)]
        controls = torch.as_tensor(loss.controls)
        controls = torch.cat([controls, values.expand(len(controls), *values.shape)], dim=1)
        targets, weights, starts = (torch.as_tensor(a) for a in (loss.targets, loss.weights, loss.starts))
        batch = RolloutBatch(loss.h, controls, targets, weights, states=starts)
        hybrid = still(found, prior.local)
        # single operators: the compiled loop has no gradient to its inputs
        hybrid.fused.library = None
        value = calibration_loss(hybrid, batch, loss.cost)
        value.backward()
        assert float(value.detach()) == pytest.approx(cost_of_samples(problem, x), rel=1e-9)
        assert theta.grad is not None
        off = theta.grad.numpy() * prior.std - (slope * prior.std - scaled)
        assert np.linalg.norm(off) < 1e-6 * np.linalg.norm(slope * prior.std - scaled)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SHIPS)
def test_a_training_sees_the_value_of_the_calibrated_ship_by_compiled_rollouts(kind: str) -> None:
    found, trials = calibrated(kind)
    loss = RolloutLoss.of_calibration(found, trials)
    assert loss is not None and loss.symbols == campaign_symbols(found.ship)
    pieces = pieces_of(trials, loss.h, found.ship.inputs)
    batch = calibration_windows(loss, pieces)
    assert batch is not None and len(batch) == len(found.segments.run)
    value = float(calibration_loss(still(found, loss.symbols), batch, loss.cost).detach())
    assert value == pytest.approx(cost_of_samples(found.problem, found.solution.x), rel=1e-6)
    np.testing.assert_array_equal(RolloutLoss.of(found.problem, found.solution.x).weights, loss.weights)


def test_windows_count_only_where_a_split_trains() -> None:
    found, trials = calibrated("plain")
    loss = RolloutLoss.of_calibration(found, trials)
    assert loss is not None
    first = [p for p in pieces_of(trials, loss.h, found.ship.inputs) if p.run == 0]
    half = replace(first[0], last=first[0].first + 40)
    batch = calibration_windows(loss, [half])
    assert batch is not None
    assert float(batch.mask.sum()) < loss.weights[..., loss.run == 0].sum()
    beyond = batch.mask[41:, :, 0]
    assert not beyond.any() and bool(batch.mask[:41].any())
    assert calibration_windows(loss, []) is None


@pytest.mark.slow
def test_windows_from_the_measurement_take_the_instruments_of_their_campaign() -> None:
    found, trials = calibrated("campaigns")
    pieces = by_campaign(pieces_of(trials, 0.5, found.ship.inputs), found.ship, trials)
    own = [found.ship.campaigns[day]["gyro.T"] for day in DAYS[:2]]
    assert [float(p.record.controls[0, -1]) for p in pieces] == own
    system, other = still(found, ("gyro.T",)), pieces[0].record.controls.copy()
    other[:, -1] = own[1]
    changed = replace(pieces[0], record=replace(pieces[0].record, controls=other))
    late = []
    for piece in (pieces[0], changed):
        batch = windows([piece], 0.5, 20, 1000)
        assert batch is not None
        late.append(float(rollout(system, batch).detach()[-1, 5, 0]))
    assert abs(late[0] - late[1]) > 1e-6


def test_a_training_takes_the_loss_of_these_trials_and_says_where_it_cannot() -> None:
    found, trials = calibrated("plain")
    loss, asked = RolloutLoss.of_calibration(found, trials), TrainSettings(loss="calibration")
    assert loss is not None
    turned = trials[::-1]
    settings, used, said = loss_of(asked, lambda: loss, found.ship, turned)
    assert settings == asked and used is not None and not said
    assert [turned[k] for k in used.run] == [trials[k] for k in loss.run]
    for read, some in ((lambda: loss, trials[:1]), (lambda: None, trials)):
        settings, used, said = loss_of(asked, read, found.ship, some)
        assert settings.loss == "state" and used is None and [m.code for m in said] == ["loss_of_states"]


@pytest.mark.slow
def test_a_network_is_trained_by_it() -> None:
    """Its history has the length of the windows of the calibration, and the error of the stop windows falls."""
    found, trials = calibrated("plain")
    lacking = found.ship.with_values({"N_r": 0.5 * found.ship.coefficients["N_r"].value})
    loss = RolloutLoss.of_calibration(found, trials)
    settings = TrainSettings(seeds=1, epochs=12, width=8, rate=1e-2, penalty=0.001, batch=8, loss="calibration")
    (task,) = tasks_of(HYBRID_KIND, lacking, trials, settings, loss=loss)
    trained = train_one(task)
    assert {row[1] for row in trained.history[1:]} == {loss.h * len(loss.controls)} if loss else False
    assert min(row[3] for row in trained.history) < 0.95 * trained.history[0][3]


@pytest.mark.slow
def test_its_file_comes_back_and_another_version_is_refused(tmp_path: Path) -> None:
    found, trials = calibrated("campaigns")
    loss = RolloutLoss.of_calibration(found, trials)
    assert loss is not None
    file = tmp_path / "loss.safetensors"
    loss.save(file)
    again = RolloutLoss.load(file)
    for name, value in vars(loss).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, name), value)
        elif name != "cost":
            assert getattr(again, name) == value
    assert again.cost.name == loss.cost.name and (again.cost.tau == loss.cost.tau).all()
    file.write_bytes(file.read_bytes().replace(b'"schema":"1"', b'"schema":"9"'))
    with pytest.raises(BadValue):
        RolloutLoss.load(file)
    file.write_bytes(b"no such file")
    with pytest.raises(Unreadable):
        RolloutLoss.load(file)
