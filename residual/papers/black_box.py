"""Black boxes of the papers as one kind of thing: built from settings, trained as a hybrid is, predicting as a ship.

``forecast`` is what ``fitting.prediction.predict`` asks of a model that is no ship. Files are safetensors with the
weights of all seeds, settings in the metadata; no pickles.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from torch import nn

from cases.inputs import step_means
from cases.io.files import parse_json
from cases.shipfiles.network_file import BLACK_BOX, NETWORK, members_in, read_tensors, save_tensors, ship_hash
from fitting.nlp.windows import Stretch
from mmg.errors import BadValue, Conflict, NoSolution, NotWritable
from mmg.motion.flow import INPUTS
from mmg.network import LARGEST, OTHER
from mmg.ship import AIR, Ship
from residual.hybrid import hidden, normal, uniform
from residual.settings import KINDS, BlackBoxSettings, TrainSettings, settings_from
from residual.system import Past, RolloutBatch, TrainableSystem, rollout
from residual.train import ModelKind, Outcome, Task, restored
from residual.windows import Scales, training_scales


def features(logged: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
    """u, v, r, actuators, a_x, a_y, (F, M), from columns ``logged`` (6, M) and ``controls`` (F - 3, M), the air last.

    a_x, a_y [m/s]: velocity of the air relative to the hull in body axes, minus w' of Wakita et al. (2022), Eq. 6.
    """
    _, _, psi, u, v, _ = logged
    c, s = torch.cos(psi), torch.sin(psi)
    north, east = controls[-2], controls[-1]  # of the air over ground, going to
    air = torch.stack([c * north + s * east - u, c * east - s * north - v])
    return torch.cat([logged[3:6], controls[:-2], air])


def kinematics(logged: torch.Tensor) -> torch.Tensor:
    """Rates of x, y, psi (3, M) at columns ``logged`` (6, M): Wakita et al. (2022), Eq. 5."""
    _, _, psi, u, v, r = logged
    c, s = torch.cos(psi), torch.sin(psi)
    return torch.stack([u * c - v * s, u * s + v * c, r])


def advance_columns(logged: torch.Tensor, accelerations: torch.Tensor, h: float, method: str) -> torch.Tensor:
    """Columns ``logged`` (6, M) a step of ``h`` [s] later under ``accelerations`` (3, M) that are held over it.

    method: "euler": Wakita et al. (2022), Eq. 20 to 22; "rk4": kinematics by the midpoint rule, with an error of third
    order.
    """
    velocities = logged[3:6] + h * accelerations  # exact for accelerations that are held
    if method == "euler":
        return torch.cat([logged[:3] + h * kinematics(logged), velocities])
    # half a step on, psi = psi_0 + (h / 2) r_0 + (h / 2)^2 r' / 2, and u, v, r in the middle
    turned = logged[2] + 0.5 * h * (logged[5] + 0.25 * h * accelerations[2])
    middle = torch.cat([logged[:2], turned[None], logged[3:6] + 0.5 * h * accelerations])
    return torch.cat([logged[:3] + h * kinematics(middle), velocities])


def _keep(system: nn.Module, **values: np.ndarray) -> None:
    """Keep ``values`` (N,) as buffers (N, 1) of ``system`` by name: in its file, and not trained."""
    for name, value in values.items():
        system.register_buffer(name, torch.as_tensor(np.array(value, dtype=float))[:, None])


SAMPLES = 10_000  # Standard normal inputs at which the output of the untrained network is standardised (2025, Eq. 13).


def layered(sizes: tuple[int, ...], seed: int) -> nn.Sequential:
    """Linear layers of these ``sizes`` with tanh between, initialised by ``seed`` as PyTorch does (2025, 3.3)."""
    with torch.random.fork_rng(devices=[]):  # PyTorch's layers draw from the global generator, which stays as it is
        torch.manual_seed(seed)
        linear = [nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes)]
    parts: list[nn.Module] = []
    for layer in linear:
        parts += [layer, nn.Tanh()]
    return nn.Sequential(*parts[:-1])  # no tanh after the last layer


class Feedforward(TrainableSystem):
    """Accelerations from standardised features by a network whose output is standardised as well.

    s = (features - mean) / std; y = net(s), standardised by the mean and deviation of the untrained net at standard
    normal inputs; acceleration = mean + std * y of the measured accelerations. Where settings.zero, what it gives at
    the origin of the features is subtracted: a ship at rest in calm air stays there (2022, section 2.1).
    """

    mean: torch.Tensor
    std: torch.Tensor
    a_mean: torch.Tensor
    a_std: torch.Tensor
    y_mean: torch.Tensor
    y_std: torch.Tensor

    def __init__(self, scales: Scales, settings: BlackBoxSettings, seed: int) -> None:
        super().__init__()
        F, self.zero = len(scales.mean), settings.zero
        self.net = layered((F, *(settings.width,) * settings.layers, 3), seed)
        _keep(self, mean=scales.mean, std=scales.std, a_mean=scales.acceleration_mean, a_std=scales.acceleration)
        with torch.no_grad():
            y = self.net(torch.randn(SAMPLES, F, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))
        self.register_buffer("y_mean", y.mean(dim=0)[:, None])
        self.register_buffer("y_std", y.std(dim=0)[:, None])

    def output(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M), before anything is subtracted."""
        y = self.net(((values - self.mean) / self.std).T).T  # PyTorch's layers take points as rows
        return self.a_mean + self.a_std * (y - self.y_mean) / self.y_std

    def acceleration(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        if not self.zero:
            return self.output(values)
        both = self.output(torch.cat([values, torch.zeros_like(values[:, :1])], dim=1))  # the origin as last point
        return both[:, :-1] - both[:, -1:]

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return torch.cat([kinematics(z), self.acceleration(features(z, controls))])


class Standard(TrainableSystem):
    """Eq. 7: all that was before is remembered in z1, which is zero ``past`` rows before the start.

    With memory = 1 it is zero at the start, as in the paper's training; with more it runs along the measured rows
    before, as in the paper's predictions (section 4). Its state is the six columns and z1.
    """

    feature_scale: torch.Tensor
    scale: torch.Tensor

    def __init__(self, scales: Scales, settings: BlackBoxSettings, seed: int) -> None:
        super().__init__()
        self.width, self.past = settings.width, settings.memory - 1  # m rows are the present one and m - 1 before it
        draw, F, width = torch.Generator().manual_seed(seed), len(scales.feature), self.width
        # the order of the draws is part of a seed: another order is another training
        self.W0, self.Wr = uniform(draw, width, F), nn.Parameter(0.5 * uniform(draw, width, width).detach())
        self.W1, self.W2 = uniform(draw, width, width), uniform(draw, width, width)
        self.W3 = nn.Parameter(torch.zeros(3, width, dtype=torch.float64))  # untrained, it adds no acceleration
        self.b0, self.b1, self.b2 = (normal(draw, width) for _ in range(3))
        # (F,) and (3,), as files have them
        self.register_buffer("feature_scale", torch.as_tensor(np.array(scales.feature, dtype=float)))
        self.register_buffer("scale", torch.as_tensor(np.array(scales.output, dtype=float)))

    def _fed(self, values: torch.Tensor) -> torch.Tensor:
        """What features (F, M) feed into the hidden layer, bias included (width, M)."""
        return torch.addmm(self.b0[:, None], self.W0, values / self.feature_scale[:, None])

    def _last(self, z1: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) of a hidden layer (width, M)."""
        return self.scale[:, None] * (self.W3 @ hidden(hidden(z1, self.W1, self.b1), self.W2, self.b2))

    def _fresh(self, M: int) -> torch.Tensor:
        """Memory of nothing, (rows, M)."""
        return torch.zeros(self.width, M, dtype=torch.float64)

    def _remember(self, memory: torch.Tensor, fed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """z1 of the present row (width, M) and the memory for the next one."""
        # zero at the origin, as ``hidden`` is: the bias is in ``fed``
        z1 = torch.tanh(torch.addmm(fed, self.Wr, memory)) - torch.tanh(self.b0)[:, None]
        return z1, z1

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        memory = self._fresh(logged.shape[1])
        if past is not None:
            for row, inputs in zip(past.logged, past.controls, strict=True):
                memory = self._remember(memory, self._fed(features(row, inputs)))[1]
        return torch.cat([logged, memory])

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        """Eq. 20 to 22 (method "euler"); otherwise the kinematics by the midpoint rule."""
        z1, memory = self._remember(z[6:], self._fed(features(z[:6], controls)))
        return torch.cat([advance_columns(z[:6], self._last(z1), h, method), memory])

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        """Eq. 13 and 15: the network runs along the measured rows."""
        memory, result = self.start(logged[0], controls[0], past)[6:], []
        for row, inputs in zip(logged, controls, strict=True):
            z1, memory = self._remember(memory, self._fed(features(row, inputs)))
            result.append(self._last(z1))
        return torch.stack(result)


class Windowed(Standard):
    """Eq. 9: the hidden layer runs anew along the last m rows; what was before is forgotten.

    Of the windows that end in the next m - 1 rows it remembers how far each has come: every row takes all of them one
    further, by one product. Rows before the first one leave z1 at zero, as the origin does.
    """

    def _fresh(self, M: int) -> torch.Tensor:
        return torch.zeros(self.past * self.width, M, dtype=torch.float64)

    def _remember(self, memory: torch.Tensor, fed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        # (m, width, M): windows begun m - 1 rows ago, ..., one row ago, and the one that begins now
        begun = torch.cat([self.Wr @ memory.reshape(self.past, *fed.shape), torch.zeros_like(fed)[None]])
        every = torch.tanh(fed + begun) - torch.tanh(self.b0)[:, None]
        return every[0], every[1:].reshape(memory.shape)  # the oldest is complete and answers; the others go on


REACH = 0.2  # How far an estimated initial velocity may be from the measured one, over its deviation. Set by hand.


class InitialState(TrainableSystem):
    """A black box, started from estimated u, v, r instead of the measured ones.

    The estimate is the measured velocity plus reach * tanh(net(standardised features of the start and of ``rows`` rows
    before it)): never further than reach (3,) from the measurement, and equal to it before training. The paper reads
    the first rows of the window itself; a prediction may not, so here the rows before it are read.
    """

    mean: torch.Tensor
    std: torch.Tensor
    reach: torch.Tensor

    def __init__(self, inner: TrainableSystem, scales: Scales, settings: BlackBoxSettings, seed: int) -> None:
        super().__init__()
        self.inner, self.rows = inner, settings.initial
        self.past = max(self.rows, inner.past)
        self.net = layered((len(scales.mean) * (self.rows + 1), settings.width, 3), seed)
        last = self.net[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)  # zero output: before training the estimate is the measurement
        nn.init.zeros_(last.bias)
        _keep(self, mean=scales.mean, std=scales.std, reach=REACH * scales.std[:3])

    def shift(self, logged: torch.Tensor, controls: torch.Tensor, past: Past) -> torch.Tensor:
        """Estimated less measured u, v, r (3, M)."""
        before = zip(past.logged[-self.rows :], past.controls[-self.rows :], strict=True)
        values = torch.cat([(features(*row) - self.mean) / self.std for row in (*before, (logged, controls))])
        return self.reach * torch.tanh(self.net(values.T).T)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        assert past is not None
        z = self.inner.start(logged, controls, past.latest(self.inner.past))
        return torch.cat([z[:3], z[3:6] + self.shift(logged, controls, past), z[6:]])

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return self.inner.step(z, controls, h, method)

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        return self.inner.accelerations(logged, controls, past and past.latest(self.inner.past))

    def penalty(self) -> torch.Tensor:
        return self.inner.penalty()


def build_box(ship: Ship | None, scales: Scales, settings: TrainSettings, seed: int) -> TrainableSystem:
    """An untrained black box of these ``scales``, ``settings`` and ``seed``; nothing of the ``ship`` is used."""
    assert isinstance(settings, BlackBoxSettings)
    kind = {"fnn": Feedforward, "rnn": Standard}.get(settings.kind, Windowed)
    system = kind(scales, settings, seed)
    return InitialState(system, scales, settings, seed) if settings.initial else system


# A network without physics; of a ship only actuators and length are used.
BOX_KIND = ModelKind(
    build_box,
    partial(training_scales, features_at=features),
    lambda ship: (*ship.actuators, *AIR),
    lambda ship: features,
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
        torch.set_num_threads(1)  # as in a training: other processes may run beside this one
        past = max(system.past for system in self.systems)
        batch = gridded(stretches, self.h, past)
        batches = [replace(batch, past=batch.past and batch.past.latest(s.past)) for s in self.systems]
        paths = [rollout(s, b, self.settings.method).numpy() for s, b in zip(self.systems, batches, strict=True)]
        path = np.mean(paths, axis=0)
        out = np.full((max(s.steps for s in stretches) + 1, 6, len(stretches)), np.nan)
        for i, s in enumerate(stretches):
            out[: s.steps + 1, :, i] = at_samples(path[:, :, i], self.h, s)
            out[0, :, i] = s.logged[0]  # as measured, also where the start was estimated
        return out


def at_samples(path: np.ndarray, h: float, stretch: Stretch) -> np.ndarray:
    """A ``path`` (N + 1, ...) on a grid of ``h`` [s] from the first row of a ``stretch``, interpolated to its rows."""
    place = np.minimum((stretch.t - stretch.t[0]) / h, len(path) - 1)
    below = np.minimum(place.astype(int), len(path) - 2)  # the last row is the end of the last step
    share = (place - below).reshape(-1, *(1,) * (path.ndim - 1))
    return (1 - share) * path[below] + share * path[below + 1]


def gridded(stretches: Sequence[Stretch], h: float, past: int) -> RolloutBatch:
    """``stretches`` on a grid of ``h`` [s] from their first rows, inputs held beyond their ends; targets only there.

    past: rows before each start that are given along.
    """
    # the slack is for spans of whole steps, which rounding makes a little longer
    steps = [max(1, int(np.ceil((s.t[-1] - s.t[0]) / h - 1e-9))) for s in stretches]
    N, C, M = max(steps), stretches[0].record.controls.shape[1], len(stretches)
    controls, start = np.zeros((N, C, M)), np.zeros((1, 6, M))
    logged, inputs = np.zeros((past, 6, M)), np.zeros((past, C, M))
    for i, s in enumerate(stretches):
        inside = s.record.controls[s.first : s.last + 1]
        means = step_means(s.t, inside, s.t[0] + h * np.arange(steps[i] + 1))
        controls[: steps[i], :, i], controls[steps[i] :, :, i] = means, means[-1]
        start[0, :, i] = s.logged[0]
        if past:
            logged[:, :, i], inputs[:, :, i] = _before(s, h, past)
    tensors = [torch.from_numpy(a) for a in (controls, start, logged, inputs)]
    return RolloutBatch(h, tensors[0], tensors[1], torch.ones_like(tensors[1]), Past(*tensors[2:]) if past else None)


def _before(s: Stretch, h: float, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Logged rows (P, 6) h [s] apart before a stretch and inputs (P, C) over the steps after them."""
    record, first = s.record, s.first
    # a longer pause is a gap, as of ``fitting.nlp.windows.pieces_of``
    longest = max(2.5 * float(np.median(np.diff(record.t))), 2 * h)
    broken = ~record.good[:first] | (np.diff(record.t[: first + 1]) > longest)
    # no further back than is read: what was long before must not move a digit
    read = int(np.searchsorted(record.t, record.t[first] - rows * h, "right")) - 1
    k = max(int(np.flatnonzero(broken).max(initial=-1)) + 1, read)
    t = record.t[k : first + 1]
    logged_rows = min(rows, int((t[-1] - t[0]) / h + 1e-6))
    edges = t[-1] - h * np.arange(logged_rows, -1, -1)
    if not logged_rows:
        return record.states[[first] * rows], record.controls[[first] * rows]
    states = np.column_stack([np.interp(edges[:-1], t, record.states[k : first + 1, j]) for j in range(6)])
    inputs = step_means(t, record.controls[k : first + 1], edges)
    chosen = [0] * (rows - logged_rows) + list(range(logged_rows))  # the oldest stands for those before it
    return states[chosen], inputs[chosen]


def box_of(task: Task, outcomes: Sequence[Outcome]) -> BlackBox:
    """The black boxes that trainings like ``task`` ended with, by the ``outcomes`` of the seeds.

    Raises UserError where every training diverged.
    """
    systems, ship, settings = restored(task, outcomes), task.ship, task.settings
    assert isinstance(settings, BlackBoxSettings)
    if not systems:
        raise NoSolution("every training diverged, also at lower rates; give a lower --rate or more data")
    return BlackBox(settings, ship.actuators, task.h, tuple(systems), ship.name, ship_hash(ship), task.scales)


# Names of ``Scales`` with which a box is built; the rest belongs to its training.
_SCALES = ("feature", "output", "acceleration", "mean", "std", "acceleration_mean")


def save_box(path: Path, box: BlackBox) -> None:
    """Write the black ``box`` with its scales to ``path``.

    Raises UserError where a weight is not finite or the file cannot be written.
    """
    arrays = {f"scales.{name}": np.array(getattr(box.scales, name)) for name in _SCALES}
    for k, system in enumerate(box.systems):
        arrays |= {f"{k}.{name}": value.detach().contiguous().numpy() for name, value in system.state_dict().items()}
    bad = [name for name, value in arrays.items() if not np.isfinite(value).all()]
    if bad:
        raise NoSolution(f"{path}: {bad[0]} of the network is not finite, so it is not written; train it again")
    about = {
        "format": BLACK_BOX, "ship": box.ship, "ship_hash": box.ship_hash, "h": repr(box.h),
        "actuators": json.dumps(box.actuators), "members": str(len(box.systems)),
        "training": json.dumps({k: v for k, v in asdict(box.settings).items() if k != "workers"}),
    }  # fmt: skip
    try:
        save_tensors(path, arrays, about)
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
            prefix = f"{k}."
            system.load_state_dict({n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)})
        box = BlackBox(settings, actuators, float(about["h"]), systems, about["ship"], about["ship_hash"], scales)
        _check(box)
    # a file may be anybody's: whatever its content makes of the code above is a refusal in one line
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, RuntimeError) as error:
        raise BadValue(f"{path}: cannot be used ({str(error).splitlines()[0]}); train it again") from None
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
    # before anything is built: a file that lies must not make arrays of gigabytes
    square = settings.kind != "fnn" or settings.layers > 1  # whether it has weights of width by width
    if settings.layers > len(arrays) or settings.width ** (1 + square) > sum(a.numel() for a in arrays.values()):
        raise ValueError("its layers are larger than its arrays")
    return settings


def _scales(arrays: dict[str, torch.Tensor]) -> Scales:
    scales = {name: arrays[f"scales.{name}"].double().numpy() for name in _SCALES}
    if {len(scales[name]) for name in ("feature", "mean", "std")} != {len(scales["mean"])}:
        raise ValueError("scales of different lengths")
    # what only a training needs is not in the file
    return Scales(**scales, **{name: np.empty(0) for name in ("sigma", "score", "noise", "features")})


def _check(box: BlackBox) -> None:
    """Raises ValueError where something is wrong with it."""
    if box.settings.kind not in KINDS or not box.systems or not box.h > 0:
        raise ValueError("it names no kind of network, or has no member, or no step")
    if any(name not in INPUTS for name in box.actuators):
        raise ValueError(f"{OTHER}: it takes {', '.join(box.actuators)}")
    # NaN is not smaller either
    if not all((abs(a) <= LARGEST).all() for system in box.systems for a in system.state_dict().values()):
        raise ValueError(f"some of its numbers are not finite, or larger than {LARGEST:g}")
