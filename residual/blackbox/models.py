"""Black boxes of the papers as one kind of thing: built from settings, trained as a hybrid is, predicting as a ship.

``forecast`` is what ``fitting.prediction.predict`` asks of a model that is no ship.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from cases.inputs import step_means
from cases.shipfiles.network_file import ship_hash
from cases.trial import Trial
from fitting.nlp.grid import default_step
from fitting.prediction.stretches import Stretch
from mmg.errors import UserError
from mmg.progress import OnProgress
from mmg.ship import AIR, Ship
from residual.networks.features import features
from residual.networks.feedforward import Feedforward
from residual.networks.initial_state import InitialState
from residual.networks.recurrent import Standard, Windowed
from residual.rollout import RolloutBatch, rollout
from residual.settings import BlackBoxSettings, TrainSettings
from residual.system import Past, TrainableSystem
from residual.training.checkpoint import Store
from residual.training.scales import LEAST_SCALE, Scales, measured_scales
from residual.training.seeds import train_seeds
from residual.training.tasks import training_tasks
from residual.training.trainer import Outcome, restored
from residual.training.windows import Piece, pieces_of

REACH = 0.2
"""How far an estimated initial velocity may be from the measured one, over the deviation of that velocity."""


@dataclass(frozen=True)
class BoxScales(Scales):
    """Beside ``Scales``: mean and deviation of the features (F,) and mean of the measured accelerations (3,)."""

    mean: np.ndarray
    std: np.ndarray
    acceleration_mean: np.ndarray


def inputs_of(actuators: Sequence[str]) -> tuple[str, ...]:
    """Names of the inputs of a black box of a ship with these ``actuators``."""
    return (*actuators, *AIR)


def build_box(ship: Ship | None, scales: Scales, settings: TrainSettings, seed: int) -> TrainableSystem:
    """An untrained black box of these ``scales``, ``settings`` and ``seed``; nothing of the ``ship`` is used."""
    assert isinstance(scales, BoxScales) and isinstance(settings, BlackBoxSettings)
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


def box_scales(pieces: Sequence[Piece], trials: Sequence[Trial], h: float, length: float) -> BoxScales:
    """Scales from the training rows, those of the measured accelerations included (Wakita et al. 2025, Eq. 14).

    pieces: of ``trials`` on a grid of ``h`` [s]; length: of the ship [m]. Raises UserError where there are no rows, or
    nothing moves in them.
    """
    m = measured_scales(pieces, trials, h, length)
    values = features(m.rows.targets[0], m.rows.controls[0]).numpy()
    rms, std = np.sqrt((values**2).mean(axis=1)), values.std(axis=1)
    return BoxScales(
        feature=np.where(rms > LEAST_SCALE, rms, 1.0),
        output=m.std,
        sigma=m.sigma,
        score=m.score,
        acceleration=m.std,
        noise=m.noise,
        features=values,
        mean=values.mean(axis=1),
        std=np.where(std > LEAST_SCALE, std, 1.0),
        acceleration_mean=m.mean,
    )


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
    scales: BoxScales | None = None

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of its inputs, as of ``Ship.inputs``."""
        return inputs_of(self.actuators)

    @torch.no_grad()
    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        """Logged columns (N + 1, 6, M) at the samples of stretches, each from its measured first row.

        It steps along its own grid and is interpolated. Of what was before a stretch it reads the rows that its memory
        takes; where there are fewer, the oldest one stands for those before.
        """
        torch.set_num_threads(1)
        past = max(system.past for system in self.systems)
        batch = gridded(stretches, self.h, past)
        paths = [rollout(s, _with_past(batch, s.past), self.settings.method).numpy() for s in self.systems]
        path = np.mean(paths, axis=0)
        rows = max(s.last - s.first for s in stretches) + 1
        out = np.full((rows, 6, len(stretches)), np.nan)
        grid = self.h * np.arange(len(path))
        for i, s in enumerate(stretches):
            t = s.record.t[s.first : s.last + 1] - s.record.t[s.first]
            out[: len(t), :, i] = np.column_stack([np.interp(t, grid, path[:, j, i]) for j in range(6)])
            out[0, :, i] = s.record.states[s.first]
        return out


def _with_past(batch: RolloutBatch, rows: int) -> RolloutBatch:
    """The batch with only the last rows of its past."""
    past = Past(batch.past.logged[-rows:], batch.past.controls[-rows:]) if batch.past and rows else None
    return replace(batch, past=past)


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


@dataclass(frozen=True)
class TrainedBox:
    """What training a black box made: outcomes of the seeds, and the box of those that did not diverge.

    settings: with the step filled in; scales: of the training data; seconds: it took; interrupted: by Ctrl-C.
    """

    box: BlackBox
    outcomes: tuple[Outcome, ...]
    settings: BlackBoxSettings
    scales: BoxScales
    seconds: float
    interrupted: bool = False


def train_box(
    ship: Ship,
    trials: Sequence[Trial],
    settings: BlackBoxSettings,
    validation: Sequence[Trial] = (),
    progress: OnProgress | None = None,
    store: Store | None = None,
) -> TrainedBox:
    """Train a black box for a ship from several seeds; of the ship only actuators and length are used.

    Each seed stops by another part of the ``trials`` (``residual.training.folds``), or by ``validation``. Nothing has
    to be decided, so nothing is kept back to judge: the held-out errors are those of the windows to stop by. settings:
    how to train; progress: called after each epoch or seed; store: finished seeds, which are not trained again.
    Returns what was trained. Raises UserError where there is too little, or every training diverged,
    KeyboardInterrupt after Ctrl-C before any training began.
    """
    began = time.perf_counter()
    inputs = inputs_of(ship.actuators)
    h = settings.step or default_step(trials, ship.particulars["L"])
    settings = replace(settings, step=h)
    pieces = pieces_of(trials, h, inputs)
    held = pieces_of(validation, h, inputs) if validation else []
    scales = box_scales(pieces, trials, h, ship.particulars["L"])
    tasks = training_tasks(build_box, ship, scales, settings, pieces, held, judged_apart=False)
    outcomes, interrupted = train_seeds(tasks, settings, progress, store)
    systems = restored(tasks[0], outcomes)
    if not systems:
        raise UserError("every training of the network diverged, also at lower rates; give a lower --rate or more data")
    box = BlackBox(settings, ship.actuators, h, tuple(systems), ship.name, ship_hash(ship), scales)
    return TrainedBox(box, tuple(outcomes), settings, scales, time.perf_counter() - began, interrupted)
