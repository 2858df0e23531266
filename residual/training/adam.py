"""Adam (Kingma & Ba 2015) by the function of ``torch.optim``, whose class imports torch's compiler: most of a second in
each process that trains."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch.optim.adam import adam


class Adam:
    """Steps of ``parameters`` as ``torch.optim.Adam`` takes them, bit for bit; rate: of learning."""

    def __init__(self, parameters: Iterable[torch.nn.Parameter], rate: float) -> None:
        self.parameters, self.rate = [p for p in parameters if p.requires_grad], rate
        self.means, self.squares = ([torch.zeros_like(p) for p in self.parameters] for _ in range(2))
        self.steps = [torch.zeros((), dtype=torch.get_default_dtype()) for _ in self.parameters]

    def zero_grad(self) -> None:
        """Forget all gradients."""
        for p in self.parameters:
            p.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """One step of the parameters that have a gradient."""
        moved = [(i, p, p.grad) for i, p in enumerate(self.parameters) if p.grad is not None]
        adam(
            [p for _, p, _ in moved],
            [gradient for _, _, gradient in moved],
            [self.means[i] for i, _, _ in moved],
            [self.squares[i] for i, _, _ in moved],
            [],
            [self.steps[i] for i, _, _ in moved],
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=self.rate,
            weight_decay=0.0,
            eps=1e-8,
            maximize=False,
        )
