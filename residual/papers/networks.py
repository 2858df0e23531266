"""The networks of Wakita et al. as dynamic models: feedforward, recurrent, of the initial state, and what they see."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from torch import nn

from residual.hybrid import hidden, normal, uniform
from residual.system import Past, TrainableSystem


def features(logged: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
    """u, v, r, actuators, a_x, a_y, (F, M), from columns ``logged`` (6, M) and ``controls`` (F - 3, M), the air last.

    a_x, a_y [m/s]: velocity of the air relative to the hull in body axes, minus w' of Wakita et al. (2022), Eq. 6.
    """
    _, _, psi, u, v, _ = logged
    c, s = torch.cos(psi), torch.sin(psi)
    north, east = controls[-2], controls[-1]
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
    velocities = logged[3:6] + h * accelerations
    if method == "euler":
        return torch.cat([logged[:3] + h * kinematics(logged), velocities])
    turned = logged[2] + 0.5 * h * (logged[5] + 0.25 * h * accelerations[2])
    middle = torch.cat([logged[:2], turned[None], logged[3:6] + 0.5 * h * accelerations])
    return torch.cat([logged[:3] + h * kinematics(middle), velocities])


SAMPLES = 10_000
"""Standard normal inputs at which the output of the untrained network is standardised (2025, Eq. 13)."""


def layered(sizes: tuple[int, ...], seed: int) -> nn.Sequential:
    """Linear layers of these ``sizes`` with tanh between, initialised by ``seed`` as PyTorch does (2025, 3.3)."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        linear = [nn.Linear(a, b, dtype=torch.float64) for a, b in pairwise(sizes)]
    parts: list[nn.Module] = []
    for layer in linear:
        parts += [layer, nn.Tanh()]
    return nn.Sequential(*parts[:-1])


class Feedforward(TrainableSystem):
    """Accelerations from standardised features by a network whose output is standardised as well.

    s = (features - mean) / std; y = net(s), standardised by the mean and deviation of the untrained net at standard
    normal inputs; acceleration = mean + std * y of the measured accelerations. zero: what it gives at the origin of
    the features is subtracted, so that a ship at rest in calm air stays there (2022, section 2.1).

    mean, std: of the features (F,); acceleration_mean, acceleration_std: of the measured accelerations (3,).
    """

    mean: torch.Tensor
    std: torch.Tensor
    a_mean: torch.Tensor
    a_std: torch.Tensor
    y_mean: torch.Tensor
    y_std: torch.Tensor

    def __init__(
        self,
        mean: np.ndarray,
        std: np.ndarray,
        acceleration_mean: np.ndarray,
        acceleration_std: np.ndarray,
        width: int = 32,
        layers: int = 2,
        zero: bool = True,
        seed: int = 0,
    ) -> None:
        super().__init__()
        F, self.zero = len(mean), zero
        self.net = layered((F, *(width,) * layers, 3), seed)
        for name, value in (("mean", mean), ("std", std), ("a_mean", acceleration_mean), ("a_std", acceleration_std)):
            self.register_buffer(name, torch.as_tensor(np.array(value, dtype=float))[:, None])
        with torch.no_grad():
            y = self.net(torch.randn(SAMPLES, F, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))
        self.register_buffer("y_mean", y.mean(dim=0)[:, None])
        self.register_buffer("y_std", y.std(dim=0)[:, None])

    def output(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M), before anything is subtracted."""
        y = self.net(((values - self.mean) / self.std).T).T
        return self.a_mean + self.a_std * (y - self.y_mean) / self.y_std

    def acceleration(self, values: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) at features (F, M)."""
        if not self.zero:
            return self.output(values)
        both = self.output(torch.cat([values, torch.zeros_like(values[:, :1])], dim=1))
        return both[:, :-1] - both[:, -1:]

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return torch.cat([kinematics(z), self.acceleration(features(z, controls))])

    def penalty(self) -> torch.Tensor:
        """Sum of squared weights (2024, Eq. 11)."""
        return squared_weights(self)


def squared_weights(system: nn.Module) -> torch.Tensor:
    """Sum of squares of the weight matrices (out, in) of ``system``, a scalar."""
    return torch.stack([(p**2).sum() for p in system.parameters() if p.ndim == 2]).sum()


class Standard(TrainableSystem):
    """Eq. 7: all that was before is remembered in z1, which is zero ``past`` rows before the start.

    With memory = 1 it is zero at the start, as in the paper's training; with more it runs along the measured rows
    before, as in the paper's predictions (section 4). Its state is the six columns and z1.
    """

    feature_scale: torch.Tensor
    scale: torch.Tensor

    def __init__(
        self, feature_scale: np.ndarray, scale: np.ndarray, width: int = 32, memory: int = 4, seed: int = 0
    ) -> None:
        """feature_scale (F,), scale (3,); memory: rows that it remembers besides the present one, plus one (m)."""
        super().__init__()
        self.width, self.past = width, memory - 1
        draw, F = torch.Generator().manual_seed(seed), len(feature_scale)
        self.W0, self.Wr = uniform(draw, width, F), nn.Parameter(0.5 * uniform(draw, width, width).detach())
        self.W1, self.W2 = uniform(draw, width, width), uniform(draw, width, width)
        self.W3 = nn.Parameter(torch.zeros(3, width, dtype=torch.float64))
        self.b0, self.b1, self.b2 = (normal(draw, width) for _ in range(3))
        self.register_buffer("feature_scale", torch.as_tensor(np.array(feature_scale, dtype=float)))
        self.register_buffer("scale", torch.as_tensor(np.array(scale, dtype=float)))

    def _fed(self, values: torch.Tensor) -> torch.Tensor:
        """What features (F, M) feed into the hidden layer, bias included (width, M)."""
        return torch.addmm(self.b0[:, None], self.W0, values / self.feature_scale[:, None])

    def _row(self, fed: torch.Tensor, z1: torch.Tensor | None) -> torch.Tensor:
        """z1 (width, M) from what is fed and the one before; None: nothing is remembered."""
        inside = fed if z1 is None else torch.addmm(fed, self.Wr, z1)
        return torch.tanh(inside) - torch.tanh(self.b0)[:, None]

    def _last(self, z1: torch.Tensor) -> torch.Tensor:
        """Accelerations (3, M) of a hidden layer (width, M)."""
        return self.scale[:, None] * (self.W3 @ hidden(hidden(z1, self.W1, self.b1), self.W2, self.b2))

    def _fresh(self, M: int) -> torch.Tensor:
        """Memory of nothing, (rows, M)."""
        return torch.zeros(self.width, M, dtype=torch.float64)

    def _remember(self, memory: torch.Tensor, fed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """z1 of the present row (width, M) and the memory for the next one."""
        z1 = self._row(fed, memory)
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

    def penalty(self) -> torch.Tensor:
        """Sum of squared weights."""
        return squared_weights(self)


class Windowed(Standard):
    """Eq. 9: the hidden layer runs anew along the last m rows; what was before is forgotten.

    What each row feeds is remembered beside the six columns, so that only the recurrence is repeated. Rows before the
    first one feed b_0, as the origin does: it leaves z1 at zero.
    """

    def _fresh(self, M: int) -> torch.Tensor:
        return self.b0.repeat(self.past)[:, None].expand(-1, M)

    def _remember(self, memory: torch.Tensor, fed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        every = torch.cat([memory, fed])
        z1 = None
        for row in every.split(self.width):
            z1 = self._row(row, z1)
        assert z1 is not None
        return z1, every[self.width :]


class InitialState(TrainableSystem):
    """Any system, started from estimated u, v, r instead of the measured ones.

    The estimate is the measured velocity plus reach * tanh(net(standardised features of the start and of ``rows`` rows
    before it)): never further than reach (3,) from the measurement, and equal to it before training. The paper reads
    the first rows of the window itself; a prediction may not, so here the rows before it are read.
    """

    mean: torch.Tensor
    std: torch.Tensor
    reach: torch.Tensor

    def __init__(
        self,
        inner: TrainableSystem,
        rows: int,
        mean: np.ndarray,
        std: np.ndarray,
        reach: np.ndarray,
        width: int = 32,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.inner, self.rows = inner, rows
        self.past = max(rows, inner.past)
        self.net = layered((len(mean) * (rows + 1), width, 3), seed)
        last = self.net[-1]
        assert isinstance(last, nn.Linear)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        for name, value in (("mean", mean), ("std", std), ("reach", reach)):
            self.register_buffer(name, torch.as_tensor(np.array(value, dtype=float))[:, None])

    def shift(self, logged: torch.Tensor, controls: torch.Tensor, past: Past) -> torch.Tensor:
        """Estimated less measured u, v, r (3, M)."""
        before = zip(past.logged[-self.rows :], past.controls[-self.rows :], strict=True)
        values = torch.cat([(features(*row) - self.mean) / self.std for row in (*before, (logged, controls))])
        return self.reach * torch.tanh(self.net(values.T).T)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        if past is None:
            raise ValueError("the estimate of the initial state needs the rows before the start")
        z = self.inner.start(logged, controls, past.latest(self.inner.past))
        return torch.cat([z[:3], z[3:6] + self.shift(logged, controls, past), z[6:]])

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return self.inner.rates(z, controls)

    def step(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return self.inner.step(z, controls, h, method)

    def columns(self, z: torch.Tensor) -> torch.Tensor:
        return self.inner.columns(z)

    def accelerations(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        return self.inner.accelerations(logged, controls, past and past.latest(self.inner.past))

    def penalty(self) -> torch.Tensor:
        return self.inner.penalty()
