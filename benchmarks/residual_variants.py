"""What settings of the residual bring: gain of the mean of five seeds on 21 records that took no part, three times.

``python -m benchmarks.residual_variants RUN [VARIANT ...]``: RUN is a calibration on Train-TZRB (Wakita et al. 2022).
Trained on the same eight records; scored on the others of Train-TZRB+ but the five development hold-outs. Each
variant takes some minutes on one core.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from benchmarks.ensembles.fixed_ship import FixedShip
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.grid import default_step
from fitting.prediction.score import pooled_sigma
from mmg.ship import Ship
from residual.bounded_network import Residual
from residual.physics.operator import Physics
from residual.rollout import rollout, squares
from residual.settings import TrainSettings
from residual.system import Hybrid, Past, TrainableSystem
from residual.training.acceptance import decide
from residual.training.folds import WINDOW
from residual.training.hybrid import build_hybrid, hybrid_scales
from residual.training.pieces import pieces_of
from residual.training.scales import Scales
from residual.training.tasks import training_tasks
from residual.training.trainer import BuildSystem, restored, train_one
from residual.training.window_errors import RESTART, STRIDE, window_errors
from residual.training.windows import windows

LAG = 10.0
"""Time constant of the memory [s]; it is settled along twice as many rows of 1 s before a start."""


class Remembering(Hybrid):
    """A hybrid whose residual also sees its features behind a first-order lag."""

    past = 20

    def __init__(self, physics: Physics, residual: Residual, seen: np.ndarray) -> None:
        super().__init__(physics, residual, np.vstack([seen, seen]))
        self.S = len(physics.model.states)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        assert past is not None
        z = self.physics.start(logged, controls)
        seen = [self.physics.features(self.physics.start(a, c), c) for a, c in zip(*past, strict=True)]
        memory = seen[0]
        for features in seen[1:]:
            memory = memory + (features - memory) * (1 - math.exp(-1 / LAG))
        return torch.cat([z, memory])

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        ship, memory = z[: self.S].contiguous(), z[self.S :]
        rates, features = self.physics.rates_and_features(ship, controls)
        added = self.residual(torch.cat([features, memory]))
        return torch.cat([rates[:3], rates[3:6] + added, rates[6:], (features - memory) / LAG])

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        return self.physics.columns(z[: self.S].contiguous())

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return TrainableSystem.simulate(self, z, controls, h, method)


def build_remembering(ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    """An untrained one."""
    residual = Residual(np.tile(scales.feature, 2), scales.output, training.width, seed)
    return Remembering(Physics(ship), residual, scales.features)


def only_sway_and_yaw(scales: Scales) -> Scales:
    return replace(scales, output=scales.output * np.array([1e-9, 1.0, 1.0]))


def same(scales: Scales) -> Scales:
    return scales


LONG = ((10.0, 0.3), (30.0, 0.4), (100.0, 0.3))
VARIANTS: dict[str, tuple[dict, BuildSystem, Callable[[Scales], Scales]]] = {
    "plain": ({"symmetric": False}, build_hybrid, same),
    "plain-penalty-1": ({"symmetric": False, "penalty": 1.0}, build_hybrid, same),
    "plain-100-s": ({"symmetric": False, "curriculum": LONG}, build_hybrid, same),
    "plain-sway-yaw": ({"symmetric": False}, build_hybrid, only_sway_and_yaw),
    "symmetric": ({}, build_hybrid, same),
    "symmetric-penalty-0.1": ({"penalty": 0.1}, build_hybrid, same),
    "symmetric-100-s": ({"curriculum": LONG}, build_hybrid, same),
    "memory": ({"symmetric": False, "epochs": 20}, build_remembering, same),
}


def main(run: str, names: list[str]) -> None:
    """Print a row per variant."""
    torch.set_num_threads(1)
    out = {*splits.TRAIN_TZRB, *splits.DEVELOPMENT_HOLDOUT, "turn_14-Sep-2020_15_58_08"}
    train = read_trials(splits.find(splits.TRAIN_TZRB))
    others = read_trials(splits.find([name for name in splits.TRAIN_TZRB_PLUS if name not in out]))
    ship = load_ship(run).without_network()
    h = default_step(train, ship.particulars["L"])
    pieces, held = (pieces_of(trials, h, ship.inputs) for trials in (train, others))
    sigma = torch.as_tensor(pooled_sigma(others))
    print("| variant | 30 s windows | 100 s restarts | its own judged 30 s windows |\n|---|---|---|---|")
    for name in names or VARIANTS:
        settings, build, changed = VARIANTS[name]
        scales, rows = changed(hybrid_scales(ship, pieces, train, h)), []
        for seed in (0, 100, 200):
            training = TrainSettings(seed=seed, step=h, **{"penalty": 0.3, **settings})
            tasks = training_tasks(build, ship, scales, training, pieces)
            outcomes = [train_one(task) for task in tasks]
            systems, row = restored(tasks[0], outcomes), []
            for length, stride in ((WINDOW, STRIDE), (RESTART, RESTART)):
                batch = windows(held, h, round(length / h), round(stride / h), systems[0].past)
                assert batch is not None
                with torch.no_grad():
                    mean = torch.stack([rollout(system, batch) for system in systems]).mean(0)
                before = window_errors(FixedShip(ship), batch, sigma, training.method).mean()
                row.append(1 - float(squares(mean, batch, sigma).mean()) / before)
            rows.append([*row, decide(outcomes).improvement])
        figures = [f"{100 * mean:+.2f} ± {100 * std:.2f} %" for mean, std in zip(*moments(rows), strict=True)]
        print(f"| {name} | {' | '.join(figures)} |", flush=True)


def moments(rows: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of each column."""
    return np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
