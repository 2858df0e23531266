"""Black boxes of the papers as one kind of thing: built from settings, trained as a hybrid is, predicting as a ship.

``forecast`` is what ``fitting.prediction.predict`` asks of a model that is no ship.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from cases.inputs import step_means
from cases.shipfiles.network_file import ship_hash
from cases.trial import Trial
from fitting.prediction.stretches import Stretch
from mmg.errors import UserError
from mmg.ship import AIR, Ship
from residual.networks.features import features
from residual.networks.feedforward import Feedforward
from residual.networks.initial_state import InitialState
from residual.networks.recurrent import Standard, Windowed
from residual.rollout import RolloutBatch, rollout
from residual.settings import BlackBoxSettings, TrainSettings
from residual.system import Past, TrainableSystem
from residual.training.pieces import Piece
from residual.training.scales import Scales, training_scales
from residual.training.tasks import ModelKind
from residual.training.trainer import Outcome, Task, restored

REACH = 0.2
"""How far an estimated initial velocity may be from the measured one, over the deviation of that velocity."""


def build_box(ship: Ship | None, scales: Scales, settings: TrainSettings, seed: int) -> TrainableSystem:
    """An untrained black box of these ``scales``, ``settings`` and ``seed``; nothing of the ``ship`` is used."""
    assert isinstance(settings, BlackBoxSettings)
    t, system = settings, TrainableSystem()
    if t.kind == "fnn":
        accelerations = scales.acceleration_mean, scales.acceleration
        system = Feedforward(scales.mean, scales.std, *accelerations, t.width, t.layers, t.zero, seed)
    else:
        recurrent = Standard if t.kind == "rnn" else Windowed
        system = recurrent(scales.feature, scales.output, t.width, t.memory, seed)
    if not t.initial:
        return system
    reach = REACH * scales.std[:3]
    return InitialState(system, t.initial, scales.mean, scales.std, reach, t.width, seed)


def box_scales(ship: Ship, pieces: Sequence[Piece], trials: Sequence[Trial], h: float) -> Scales:
    """Scales from the training rows ``pieces`` of ``trials`` of a ``ship`` on a grid of ``h`` [s].

    Raises UserError where there are no rows, or nothing moves in them.
    """
    return training_scales(ship, pieces, trials, h, features)


BOX_KIND = ModelKind(build_box, box_scales, lambda ship: (*ship.actuators, *AIR), lambda ship: features)
"""A network without physics; of a ship only actuators and length are used."""


@dataclass(frozen=True)
class BlackBox:
    """Trained black boxes of one kind from several seeds; it predicts the mean of their trajectories.

    ship: name of the ship it was trained for, ship_hash: of ``cases.shipfiles.network_file``; h: step of its grid [s];
    scales: with which its systems were built, needed to write it.
    """

    settings: BlackBoxSettings
    actuators: tuple[str, ...]
    h: float
    systems: tuple[TrainableSystem, ...]
    ship: str = ""
    ship_hash: str = ""
    scales: Scales | None = None

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of its inputs, as of ``Ship.inputs``."""
        return (*self.actuators, *AIR)

    @torch.no_grad()
    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        """Logged columns (N + 1, 6, M) at the samples of stretches, each from its measured first row.

        It steps along its own grid and is interpolated. Of what was before a stretch it reads the rows that its memory
        takes; where there are fewer, the oldest one stands for those before.
        """
        torch.set_num_threads(1)
        past = max(system.past for system in self.systems)
        batch = gridded(stretches, self.h, past)
        known = [replace(batch, past=batch.past and batch.past.latest(s.past)) for s in self.systems]
        paths = [rollout(s, b, self.settings.method).numpy() for s, b in zip(self.systems, known, strict=True)]
        path = np.mean(paths, axis=0)
        rows = max(s.last - s.first for s in stretches) + 1
        out = np.full((rows, 6, len(stretches)), np.nan)
        grid = self.h * np.arange(len(path))
        for i, s in enumerate(stretches):
            t = s.record.t[s.first : s.last + 1] - s.record.t[s.first]
            out[: len(t), :, i] = np.column_stack([np.interp(t, grid, path[:, j, i]) for j in range(6)])
            out[0, :, i] = s.record.states[s.first]
        return out


def gridded(stretches: Sequence[Stretch], h: float, past: int) -> RolloutBatch:
    """``stretches`` on a grid of ``h`` [s] from their first rows, inputs held beyond their ends; targets only there.

    past: rows before each start that are given along.
    """
    steps = [max(1, int(np.ceil((s.record.t[s.last] - s.record.t[s.first]) / h - 1e-9))) for s in stretches]
    N, C, M = max(steps), stretches[0].record.controls.shape[1], len(stretches)
    controls, start = np.zeros((N, C, M)), np.zeros((1, 6, M))
    logged, held = np.zeros((past, 6, M)), np.zeros((past, C, M))
    for i, s in enumerate(stretches):
        rows = slice(s.first, s.last + 1)
        t = s.record.t[rows]
        means = step_means(t, s.record.controls[rows], t[0] + h * np.arange(steps[i] + 1))
        controls[: steps[i], :, i], controls[steps[i] :, :, i] = means, means[-1]
        start[0, :, i] = s.record.states[s.first]
        if past:
            logged[:, :, i], held[:, :, i] = _before(s, h, past)
    tensors = [torch.from_numpy(a) for a in (controls, start, logged, held)]
    return RolloutBatch(h, tensors[0], tensors[1], torch.ones_like(tensors[1]), Past(*tensors[2:]) if past else None)


def _before(s: Stretch, h: float, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Logged rows (P, 6) h [s] apart before a stretch and inputs (P, C) over the steps after them."""
    record, first = s.record, s.first
    longest = 2.5 * float(np.median(np.diff(record.t)))
    k = first
    while k > 0 and record.good[k - 1] and record.t[k] - record.t[k - 1] <= max(longest, 2 * h):
        k -= 1
        if record.t[first] - record.t[k] >= rows * h:
            break
    t = record.t[k : first + 1]
    known = min(rows, int((t[-1] - t[0]) / h + 1e-6))
    edges = t[-1] - h * np.arange(known, -1, -1)
    if not known:
        return record.states[[first] * rows], record.controls[[first] * rows]
    states = np.column_stack([np.interp(edges[:-1], t, record.states[k : first + 1, j]) for j in range(6)])
    inputs = step_means(t, record.controls[k : first + 1], edges)
    missing = [0] * (rows - known) + list(range(known))
    return states[missing], inputs[missing]


def box_of(task: Task, outcomes: Sequence[Outcome]) -> BlackBox:
    """The black boxes that trainings like ``task`` ended with, by the ``outcomes`` of the seeds.

    Raises UserError where every training diverged.
    """
    systems, ship, settings = restored(task, outcomes), task.ship, task.settings
    assert isinstance(settings, BlackBoxSettings)
    if not systems:
        raise UserError("every training of the network diverged, also at lower rates; give a lower --rate or more data")
    return BlackBox(settings, ship.actuators, task.h, tuple(systems), ship.name, ship_hash(ship), task.scales)
