"""The recurrent networks of Wakita et al. (2022): standard (Eq. 7) and with a memory of m rows (Eq. 9).

Both vanish at the origin. Features are divided by their rms and outputs multiplied by the deviation of the measured
accelerations, which the paper leaves to the weights. A step of the network is a row of the grid.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from residual.bounded_network import hidden, normal, uniform
from residual.networks.features import advance_columns, features
from residual.networks.feedforward import squared_weights
from residual.system import Past, TrainableSystem


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
