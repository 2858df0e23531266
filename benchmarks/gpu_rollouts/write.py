"""Code, data and the processor's figures: see the package. One thread, float64."""

from __future__ import annotations

import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import torch

from benchmarks.gpu_rollouts.cuda_source import cuda_source
from benchmarks.gpu_rollouts.problem import BATCH, NAMES, SCALES, WIDTH, H, drawn
from benchmarks.record import machine
from cases.shipfiles.ship_file import load_ship
from residual.bounded_network import Residual
from residual.physics.fused_rollout import FusedRollout
from residual.physics.operator import Physics

REPEATS = 7


def network() -> Residual:
    """A network whose output counts: W3 is drawn, not zero as where training starts."""
    made = Residual(*SCALES, width=WIDTH)
    draw = torch.Generator().manual_seed(1)
    with torch.no_grad():
        made.W3.copy_(torch.randn(made.W3.shape, generator=draw, dtype=torch.float64))
    return made


def folded(residual: Residual) -> dict[str, torch.Tensor]:
    """Its plain layers by name."""
    return dict(zip(NAMES, (a.detach() for a in residual.plain()), strict=True))


def main(folder: Path) -> None:
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    fused, residual = FusedRollout(Physics(load_ship("esso_osaka_3m")), WIDTH), network()
    (folder / "kernels.cu").write_text(cuda_source(fused), encoding="utf-8")
    start, controls, target = (torch.as_tensor(a) for a in drawn(BATCH))
    seconds: dict[str, list[float]] = {"forward": [], "gradient": []}
    for _ in range(REPEATS + 1):
        start.requires_grad_(False)
        began = time.perf_counter()
        with torch.no_grad():
            fused(start, controls, H, residual)
        seconds["forward"].append(time.perf_counter() - began)
        start = start.detach().requires_grad_()
        residual.zero_grad(set_to_none=True)
        began = time.perf_counter()
        states = fused(start, controls, H, residual)
        loss = ((states[1:] - target) ** 2).mean()
        loss.backward()  # type: ignore[no-untyped-call]
        seconds["gradient"].append(time.perf_counter() - began)
    assert start.grad is not None and residual.W2.grad is not None
    np.savez(
        folder / "problem.npz",
        wanted_last=states[-1].detach().numpy(),
        wanted_first=start.grad.numpy(),
        wanted_W2=residual.W2.grad.numpy(),
        **{name: a.numpy() for name, a in folded(residual).items()},
    )
    figures = {name: 1e3 * statistics.median(s[1:]) for name, s in seconds.items()}
    (folder / "processor.json").write_text(json.dumps({"machine": machine(), **figures}), encoding="utf-8")
    print(figures)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
