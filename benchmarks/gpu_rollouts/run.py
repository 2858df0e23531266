"""The same rollouts on a GPU, checked against the processor's results: see the package. Needs no casadi."""

from __future__ import annotations

import ctypes
import importlib
import json
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.gpu_rollouts.problem import BATCH, NAMES, STEPS, WIDTH, H, drawn

POINTERS = ("start", "controls", "weights", "seeds", "out", "Z", "X", "T1", "T2", "G1", "G2", "GA", "first")
"""As in ``benchmarks.gpu_rollouts.cuda_source``, which needs casadi."""
S, F, THREADS, REPEATS = 6, 7, 32, 20
LARGER = 16384


class _Run(ctypes.Structure):
    """The struct Run of the kernels."""

    _fields_ = [("points", ctypes.c_longlong), ("steps", ctypes.c_longlong), ("h", ctypes.c_double)] + [
        (name, ctypes.c_void_p) for name in POINTERS
    ]


def filled(points: int, arrays: dict[str, Tensor]) -> _Run:
    """The struct for M ``points`` and arrays by name."""
    return _Run(points, STEPS, H, *[arrays[name].data_ptr() if name in arrays else None for name in POINTERS])


def room(points: int, device: str) -> dict[str, Tensor]:
    """Arrays for what the kernels leave, NaN so that what was not written shows."""
    rows = {"Z": S, "X": F, "T1": WIDTH, "T2": WIDTH, "G1": WIDTH, "G2": WIDTH, "GA": 3}
    shapes = {**{name: (4 * STEPS, n) for name, n in rows.items()}, "out": (STEPS + 1, S), "first": (S,)}
    return {
        name: torch.full((*shape, points), float("nan"), dtype=torch.float64, device=device)
        for name, shape in shapes.items()
    }


class Kernels:
    """``forward`` and ``backward`` on the GPU."""

    def __init__(self, source: Path) -> None:
        cubin = source.with_suffix(".cubin")
        subprocess.run(
            ["nvcc", "-cubin", "-O3", "-std=c++17", "-arch=native", "-diag-suppress", "177", "-o", cubin, source],
            check=True,
        )
        self.module = importlib.import_module("cupy").RawModule(path=str(cubin))

    def __call__(self, which: str, points: int, arrays: dict[str, Tensor]) -> None:
        """Call one on arrays by name; those that are not given are null."""
        run = np.frombuffer(bytes(filled(points, arrays)), dtype=np.dtype((np.void, ctypes.sizeof(_Run))))
        self.module.get_function(which)((-(-points // THREADS),), (THREADS,), (run[0],))


def weights(layers: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Of ``forward`` and of ``backward``."""
    matrices, biases = ([layers[name] for name in NAMES if name[0] == kind] for kind in "Wb")
    before = [part.flatten() for W, b in zip(matrices, biases, strict=True) for part in (W.T.contiguous(), b)]
    return torch.cat(before), torch.cat([a.flatten() for a in (*matrices, *biases)])


def gradient(kernels: Kernels, layers: dict[str, Tensor], data: list[Tensor], kept: dict[str, Tensor]) -> list[Tensor]:
    """Gradients of the mean square of errors by the start and by the layers; ``kept`` is overwritten."""
    (start, controls, target), (forward, backward) = data, weights(layers)
    M = start.shape[1]
    kernels("forward", M, {"start": start, "controls": controls, "weights": forward, **kept})
    seeds = torch.zeros_like(kept["out"])
    seeds[1:] = 2 * (kept["out"][1:] - target) / target.numel()
    kernels("backward", M, {"controls": controls, "weights": backward, "seeds": seeds, **kept})
    found = [kept["first"]]
    for at, given in (("G1", "X"), ("G2", "T1"), ("GA", "T2")):
        found += [torch.bmm(kept[at], kept[given].transpose(1, 2)).sum(0), kept[at].sum((0, 2))]
    return found


def timed(step: Callable[[], Any]) -> float:
    """Median milliseconds by the GPU's own events."""
    seconds = []
    for _ in range(REPEATS + 3):
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        begin.record()
        step()
        end.record()
        torch.cuda.synchronize()
        seconds.append(begin.elapsed_time(end))
    return statistics.median(seconds[3:])


def measured(kernels: Kernels, layers: dict[str, Tensor], points: int, wanted: Any) -> dict[str, float]:
    """Milliseconds of a forward pass and of a whole gradient for M ``points``; relative errors against ``wanted``:
    states at the end, gradients by the start and by W2."""
    data = [torch.as_tensor(a).cuda() for a in drawn(points)]
    kept = room(points, "cuda")
    plain = {"start": data[0], "controls": data[1], "weights": weights(layers)[0], "out": kept["out"]}
    figures = {"points": float(points), "forward": timed(lambda: kernels("forward", points, plain))}
    figures["gradient"] = timed(lambda: gradient(kernels, layers, data, kept))
    if wanted is not None:
        first, _, _, by_W2, by_b2, *_ = gradient(kernels, layers, data, kept)
        found = {"last": kept["out"][-1], "first": first, "W2": by_W2 - torch.outer(by_b2, torch.tanh(layers["b1"]))}
        for name, a in found.items():
            b = torch.as_tensor(wanted[f"wanted_{name}"]).cuda()
            figures[f"error of {name}"] = float((a - b).norm() / b.norm())
    return figures


def main(folder: Path) -> None:
    wanted = dict(np.load(folder / "problem.npz"))
    kernels = Kernels(folder / "kernels.cu")
    layers = {name: torch.as_tensor(wanted[name]).cuda() for name in NAMES}
    figures = [measured(kernels, layers, BATCH, wanted), measured(kernels, layers, LARGER, None)]
    print(json.dumps({"device": torch.cuda.get_device_name(), "figures": figures}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
