"""The weight of a residual's penalty is chosen along a path, by windows that neither train nor judge."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.decide import decide
from residual.hybrid import HYBRID_KIND, hybrid_scales
from residual.pipeline import train
from residual.result import TrainResult
from residual.settings import PATH, TrainSettings
from residual.splits import pieces_of
from residual.system import TrainableSystem
from residual.train import (
    Adam,
    Outcome,
    Task,
    load_outcome,
    save_outcome,
    tasks_of,
    train_one,
    training_store,
    training_tasks,
)
from residual.windows import Scales, windows
from tests.residual.test_decide import Ballast, drifting
from tests.residual.test_hybrid import QUICK
from tests.support import hybrids

DEFAULT = replace(QUICK, penalty=None, epochs=15, rate=3e-3)
"""A small network with the default penalty and rate."""


@cache
def trained(penalty: float | None) -> TrainResult:
    """A training on the ship that lacks a force."""
    return train(hybrids.ship(), hybrids.trials(hybrids.lacking()), settings=replace(DEFAULT, penalty=penalty))


def error_on_fresh_runs(ship: Ship) -> float:
    """Mean square of the error of the turn rate over 30 s of runs that no training saw."""
    fresh = hybrids.trials(hybrids.lacking(), 2, 200, seed=9)
    batch = windows(pieces_of(fresh, 1.0, hybrids.ship().inputs), 1.0, 30, 15)
    assert batch is not None
    out = Simulator(ship, compiled=False).run(batch.targets[0].numpy(), batch.controls.numpy(), 1.0)[:, :6]
    return float(((out - batch.targets.numpy())[:, 5] ** 2).mean())


def test_by_default_a_missing_force_is_learned_under_a_small_weight() -> None:
    by_path, heavy = trained(None), trained(0.3)
    assert TrainSettings().penalty is None and by_path.decision and by_path.decision.kept
    chosen = [row["penalty"] for row in by_path.per_seed]
    assert max(chosen) < 0.3, chosen
    assert by_path.hybrid is not None and heavy.hybrid is not None
    truth = error_on_fresh_runs(hybrids.lacking())
    left = [error_on_fresh_runs(ship) - truth for ship in (by_path.hybrid, heavy.hybrid, hybrids.ship())]
    assert left[0] < 0.5 * left[1] < 0.5 * left[2], left


def test_by_default_noise_alone_is_declined() -> None:
    quiet = train(hybrids.ship(), hybrids.trials(hybrids.ship()), settings=replace(DEFAULT, epochs=6))
    assert quiet.decision and not quiet.decision.kept
    assert quiet.ship.network is None


def test_a_penalty_that_is_given_is_the_only_one() -> None:
    rows = trained(0.3).per_seed
    assert {row["penalty"] for row in rows} == {0.3}
    lengths = [[step["rollout_s"] for step in row["history"]] for row in rows]
    assert lengths == [[0.0, *[10.0] * round(0.3 * DEFAULT.epochs), *[30.0] * round(0.7 * DEFAULT.epochs)]] * 2


def test_windows_as_long_as_those_of_a_calibration_are_trained_on_and_at_most_four_times_as_many_epochs() -> None:
    for row, once in zip(trained(None).per_seed, trained(0.3).per_seed, strict=True):
        lengths = [step["rollout_s"] for step in row["history"]]
        assert {10.0, 30.0, 100.0} <= set(lengths)
        assert len(lengths) <= 4 * len(once["history"])


class HeldBallast(Ballast):
    """A drift in x whose size is penalised."""

    def penalty(self) -> torch.Tensor:
        return 1e3 * (self.w**2).sum()


def held(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    return HeldBallast()


class Fragile(HeldBallast):
    """The same, of which a drift that is no longer small ends in NaN."""

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return super().rates(z, controls) + torch.where(self.w.abs() > 0.2, float("nan"), 0.0)


def fragile(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    return Fragile()


def drift_task(build: object, speeds: list[float]) -> Task:
    """A training on runs that drift at these speeds, of which the first judges."""
    ship, trials = hybrids.ship(), drifting(5, speeds)
    given = pieces_of(trials, 1.0, ship.inputs)
    training = TrainSettings(seeds=1, step=1.0, epochs=30, rate=2e-2, curriculum=((10.0, 1.0),))
    scales = hybrid_scales(ship, given, trials, 1.0)
    return training_tasks(build, ship, scales, training, given)[0]  # type: ignore[arg-type]


@pytest.mark.parametrize("judged", [-0.3, 0.3])
def test_what_judges_does_not_choose_the_weight(judged: float) -> None:
    """Four runs drift forward; whether the judging one drifts with them or against them, the choice is the same, and
    the decision tells which."""
    found = train_one(drift_task(held, [judged, 0.3, 0.3, 0.3, 0.3]))
    assert [weight for weight, _ in found.path] == list(PATH)
    least = [error for _, error in found.path]
    assert least == sorted(least, reverse=True) and found.penalty == PATH[-1]
    assert found.state["w"][0] == pytest.approx(0.3, abs=0.06)
    assert (found.after[0] < found.before[0]) is (judged > 0)
    assert decide([found, found]).kept is False or judged > 0


def test_a_small_weight_under_which_it_diverges_leaves_what_was_best() -> None:
    found = train_one(drift_task(fragile, [0.3] * 5))
    assert (found.status, found.restarts) == ("finished", 0)
    assert 0 < found.state["w"][0] <= 0.2 and len(found.path) < len(PATH) and found.penalty in PATH
    assert found.after[0] < found.before[0]


def test_an_untrained_system_that_stays_the_best_has_no_weight() -> None:
    history = ((0, 0.0, np.nan, 1.0), (1, 10.0, 1.0, 1.2))
    found = Outcome(0, "finished", (1.0, 1.0), (1.0, 1.0), history, {}, 1e-3, 0, 1.0, 1, 1, path=((0.3, 1.2),))
    assert found.penalty is None


def test_a_seed_that_was_kept_knows_its_path(tmp_path: Path) -> None:
    trials = hybrids.trials(hybrids.lacking(), 3, 200)
    settings = replace(DEFAULT, seeds=1, epochs=1, width=4)
    found = train_one(tasks_of(HYBRID_KIND, hybrids.ship(), trials, settings)[0])
    store = training_store(tmp_path / "run", hybrids.ship(), trials, (), settings)
    store.open()
    save_outcome(store, found)
    again = load_outcome(store, 0)
    assert again is not None and again.path == found.path and again.penalty == found.penalty


def losses(net: torch.nn.Module, x: torch.Tensor, skipped: bool) -> torch.Tensor:
    """A loss of which the last bias has no gradient where it is ``skipped``."""
    first, last = net[0], net[2]  # type: ignore[index]
    out = torch.nn.functional.linear(torch.tanh(first(x)), last.weight, None if skipped else last.bias)
    return (out - x.sum(dim=1, keepdim=True).sin()).square().mean()


def test_steps_are_those_of_torch_bit_for_bit() -> None:
    for dtype in (torch.float32, torch.float64):
        torch.set_default_dtype(dtype)
        try:
            nets = []
            for _ in range(2):
                torch.manual_seed(3)
                nets.append(torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1)))
            ours, theirs = Adam(nets[0].parameters()), torch.optim.Adam(nets[1].parameters(), lr=1e-2)
            for step in range(25):
                x = torch.randn(16, 4)
                theirs.param_groups[0]["lr"] = 1e-2 / (1 + step)
                for net in nets:
                    net.zero_grad()
                    losses(net, x, skipped=step % 3 == 0).backward()
                ours.step(1e-2 / (1 + step))
                theirs.step()
            assert all(torch.equal(a, b) for a, b in zip(nets[0].parameters(), nets[1].parameters(), strict=True))
        finally:
            torch.set_default_dtype(torch.float32)


def test_training_does_not_import_the_compiler() -> None:
    words = (
        "import sys, torch; from residual.train import Adam; p = torch.nn.Parameter(torch.ones(2)); "
        "o = Adam([p]); p.sum().backward(); o.step(0.1); print(p.tolist()[0] < 1.0, 'torch._dynamo' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "True False"


MODULES = ("residual.settings", "residual.result", "residual.report", "fitting.calibrate")


def test_reading_and_calibrating_need_no_torch() -> None:
    lines = [f"import {module}; assert 'torch' not in sys.modules, '{module}'" for module in MODULES]
    done = subprocess.run([sys.executable, "-c", "\n".join(["import sys", *lines])], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
