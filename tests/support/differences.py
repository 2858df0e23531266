"""Gradients of torch against finite differences."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest
import torch

STEP = 1e-6


def check_gradients(loss: Callable[[], torch.Tensor], parameters: Iterable[torch.Tensor]) -> None:
    """Fails unless the gradient of ``loss`` by the middle entry of each of ``parameters`` is that by central
    differences."""
    chosen = list(parameters)
    assert chosen
    loss().backward()
    for parameter in chosen:
        at = tuple(s // 2 for s in parameter.shape)
        assert parameter.grad is not None
        gradient = parameter.grad[at].item()
        with torch.no_grad():
            parameter[at] += STEP
            up = loss().item()
            parameter[at] -= 2 * STEP
            down = loss().item()
            parameter[at] += STEP
        assert gradient == pytest.approx((up - down) / (2 * STEP), rel=1e-4, abs=1e-7)
