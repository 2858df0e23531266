"""The CUDA source of whole rollouts, compiled for the processor: the same results as the processor's own code."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.gpu_rollouts import run
from benchmarks.gpu_rollouts.cuda_source import ARRAYS, cuda_source
from benchmarks.gpu_rollouts.problem import STEPS, WIDTH, H, drawn
from benchmarks.gpu_rollouts.write import folded, network
from cases.shipfiles.ship_file import load_ship
from residual.physics.fused_rollout import FusedRollout
from residual.physics.operator import Physics

POINTS = 3
SURROUNDINGS = """
#include <cmath>
#include <cstring>
static long long thread;
#define DEVICE static inline
#define KERNEL extern "C"
#define SHARED(w, n) static double w[n];
#define LOAD(w, from, n) for (int i = 0; i < (n); i++) w[i] = (from)[i];
#define THREAD thread
"""
ALL = """
extern "C" void all(Run r, int way) {
  for (thread = 0; thread <= r.points; thread++) way ? backward(r) : forward(r);
}
"""


class OnProcessor(run.Kernels):
    """The kernels thread after thread; one thread more than there are points, as the last block has."""

    def __init__(self, folder: Path, source: str) -> None:
        (folder / "kernels.cpp").write_text(source + ALL, encoding="utf-8")
        library = folder / "kernels.so"
        compiler = shutil.which("g++")
        subprocess.run([compiler, "-O1", "-w", "-shared", "-fPIC", "-o", library, folder / "kernels.cpp"], check=True)
        self.library = ctypes.CDLL(str(library))

    def __call__(self, which: str, points: int, arrays: dict[str, torch.Tensor]) -> None:
        self.library.all(run.filled(points, arrays), which == "backward")


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_threads_of_the_gpu_do_what_the_processor_does(tmp_path: Path) -> None:
    assert ARRAYS == run.POINTERS
    fused, residual = FusedRollout(Physics(load_ship("esso_osaka_3m")), WIDTH), network()
    kernels = OnProcessor(tmp_path, cuda_source(fused, SURROUNDINGS))
    data = [torch.as_tensor(a) for a in drawn(POINTS)]
    layers, kept = folded(residual), run.room(POINTS, "cpu")
    by_start, by_W1, _, _, by_b2, by_W3, by_b3 = run.gradient(kernels, layers, data, kept)
    start = data[0].clone().requires_grad_()
    states = fused(start, data[1], H, residual)
    ((states[1:] - data[2]) ** 2).mean().backward()  # type: ignore[no-untyped-call]
    assert len(states) == STEPS + 1
    assert start.grad is not None and residual.b2.grad is not None
    np.testing.assert_allclose(kept["out"], states.detach(), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(by_start, start.grad, rtol=1e-7, atol=1e-10 * float(start.grad.abs().max()))
    expected = residual.b2.grad + (1 - torch.tanh(residual.b2.detach()) ** 2) * (
        residual.W3.detach().T @ (residual.scale * by_b3)
    )
    np.testing.assert_allclose(by_b2, expected, rtol=1e-7, atol=1e-10 * float(by_b2.abs().max()))
    assert by_W1.abs().max() > 0 and by_W3.abs().max() > 0
