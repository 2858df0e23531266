"""Black boxes of the papers as one kind of thing: built from settings, trained as a hybrid is, predicting as a ship.

``forecast`` is what ``fitting.prediction.predict`` asks of a model that is no ship. Files are safetensors with the
weights of all seeds, settings in the metadata; no pickles.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError

from cases.inputs import step_means
from cases.io.files import parse_json
from cases.shipfiles.network_file import BLACK_BOX, NETWORK, members_in, read_tensors, save_tensors, ship_hash
from cases.trial import Trial
from fitting.prediction.stretches import Stretch
from mmg.errors import BadValue, Conflict, NoSolution, NotWritable
from mmg.motion.flow import INPUTS
from mmg.network import LARGEST, OTHER
from mmg.ship import AIR, Ship
from residual.papers.networks import Feedforward, InitialState, Standard, Windowed, features
from residual.settings import KINDS, BlackBoxSettings, TrainSettings, settings_from
from residual.splits import Piece
from residual.system import Past, RolloutBatch, TrainableSystem, rollout
from residual.train import ModelKind, Outcome, Task, restored
from residual.windows import Scales, training_scales

REACH = 0.2
"""How far an estimated initial velocity may be from the measured one, over its deviation. Set by hand."""


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
        raise NoSolution(
            "every training of the network diverged, also at lower rates; give a lower --rate or more data"
        )
    return BlackBox(settings, ship.actuators, task.h, tuple(systems), ship.name, ship_hash(ship), task.scales)


_SCALES = ("feature", "output", "acceleration", "mean", "std", "acceleration_mean")
"""Names of ``Scales`` with which a box is built; the rest belongs to its training."""


def save_box(path: Path, box: BlackBox) -> None:
    """Write the black ``box`` with its scales to ``path``.

    Raises UserError where a weight is not finite or the file cannot be written.
    """
    arrays = {f"scales.{name}": torch.as_tensor(np.array(getattr(box.scales, name))) for name in _SCALES}
    for k, system in enumerate(box.systems):
        arrays |= {f"{k}.{name}": value.detach().contiguous() for name, value in system.state_dict().items()}
    bad = [name for name, value in arrays.items() if not torch.isfinite(value).all()]
    if bad:
        raise NoSolution(f"{path}: {bad[0]} of the network is not finite, so it is not written; train it again")
    about = {
        "format": BLACK_BOX, "ship": box.ship, "ship_hash": box.ship_hash, "h": repr(box.h),
        "actuators": json.dumps(box.actuators), "members": str(len(box.systems)),
        "training": json.dumps({k: v for k, v in asdict(box.settings).items() if k != "workers"}),
    }  # fmt: skip
    try:
        save_tensors(path, {name: value.numpy() for name, value in arrays.items()}, about)
    except (OSError, SafetensorError) as error:
        raise NotWritable(f"{path}: cannot be written ({error})") from None


def load_box(where: str | Path, ship: Ship | None = None) -> BlackBox:
    """The black box in the file or run folder ``where``. ship: one that it must have been trained for.

    Raises UserError when it cannot be read, is incomplete, or belongs to another ship or other inputs.
    """
    path = Path(where) / NETWORK if Path(where).is_dir() else Path(where)
    about, numbers = read_tensors(path, BLACK_BOX, "black box")
    arrays = {name: torch.from_numpy(a) for name, a in numbers.items()}
    try:
        settings = _settings(about, arrays)
        actuators = tuple(map(str, parse_json(about["actuators"])))
        scales = _scales(arrays)
        systems = tuple(build_box(None, scales, settings, 0) for _ in range(members_in(about, arrays)))
        for k, system in enumerate(systems):
            own = {name: a for name, a in arrays.items() if name.startswith(f"{k}.")}
            system.load_state_dict({name.partition(".")[2]: a for name, a in own.items()})
        box = BlackBox(settings, actuators, float(about["h"]), systems, about["ship"], about["ship_hash"], scales)
        fault = _fault(box)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, RuntimeError) as error:
        raise BadValue(f"{path}: is incomplete ({str(error).splitlines()[0]}); train it again") from None
    if fault:
        raise BadValue(f"{path}: {fault}; train it again")
    if ship and (actuators != ship.actuators or box.ship_hash != ship_hash(ship)):
        raise Conflict(
            f"{path}: {OTHER}: it was trained for {box.ship} with {', '.join(actuators)}; "
            f"{ship.name} has {', '.join(ship.actuators)}"
        )
    return box


def _settings(about: Mapping[str, str], arrays: Mapping[str, torch.Tensor]) -> BlackBoxSettings:
    """The settings of a file, whose layers are no larger than its arrays. Raises ValueError for others."""
    settings = settings_from(parse_json(about["training"]))
    if not isinstance(settings, BlackBoxSettings):
        raise ValueError("no kind of network")
    if settings.width < 1 or settings.layers < 1:
        raise ValueError("it has no layer")
    square = settings.kind != "fnn" or settings.layers > 1
    if settings.layers > len(arrays) or settings.width ** (1 + square) > sum(a.numel() for a in arrays.values()):
        raise ValueError("its layers are larger than its arrays")
    return settings


def _scales(arrays: dict[str, torch.Tensor]) -> Scales:
    scales = {name: arrays[f"scales.{name}"].double().numpy() for name in _SCALES}
    if {len(scales[name]) for name in ("feature", "mean", "std")} != {len(scales["mean"])}:
        raise ValueError("scales of different lengths")
    return Scales(**scales, **{name: np.empty(0) for name in ("sigma", "score", "noise", "features")})


def _fault(box: BlackBox) -> str:
    """What is wrong with it, in words; "" if nothing."""
    if box.settings.kind not in KINDS or not box.systems or not box.h > 0:
        return "it names no kind of network, or has no member, or no step"
    if any(name not in INPUTS for name in box.actuators):
        return f"{OTHER}: it takes {', '.join(box.actuators)}"
    if not all(torch.isfinite(a).all() for system in box.systems for a in system.state_dict().values()):
        return "some of its numbers are not finite"
    if not all((abs(a) <= LARGEST).all() for system in box.systems for a in system.parameters()):
        return f"some of its weights are larger than {LARGEST:g}"
    return ""
