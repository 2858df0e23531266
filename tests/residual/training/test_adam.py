"""Steps are those of torch's class, which is not imported."""

from __future__ import annotations

import subprocess
import sys

import torch

from residual.training.adam import Adam


def losses(net: torch.nn.Module, x: torch.Tensor, skipped: bool) -> torch.Tensor:
    """A loss of which the last bias has no gradient where it is ``skipped``."""
    first, last = net[0], net[2]  # type: ignore[index]
    out = torch.nn.functional.linear(torch.tanh(first(x)), last.weight, None if skipped else last.bias)
    return (out - x.sum(dim=1, keepdim=True).sin()).square().mean()


def test_steps_are_those_of_torch_bit_for_bit() -> None:
    for dtype in (torch.float32, torch.float64):
        torch.set_default_dtype(dtype)
        try:
            nets = []
            for _ in range(2):
                torch.manual_seed(3)
                nets.append(torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1)))
            ours, theirs = Adam(nets[0].parameters(), 1e-2), torch.optim.Adam(nets[1].parameters(), lr=1e-2)
            for step in range(25):
                x = torch.randn(16, 4)
                ours.rate = theirs.param_groups[0]["lr"] = 1e-2 / (1 + step)
                for net, optimizer in zip(nets, (ours, theirs), strict=True):
                    optimizer.zero_grad()
                    losses(net, x, skipped=step % 3 == 0).backward()
                    optimizer.step()
            assert all(torch.equal(a, b) for a, b in zip(nets[0].parameters(), nets[1].parameters(), strict=True))
        finally:
            torch.set_default_dtype(torch.float32)


def test_training_does_not_import_the_compiler() -> None:
    words = (
        "import sys, torch; from residual.training.adam import Adam; p = torch.nn.Parameter(torch.ones(2)); "
        "o = Adam([p], 0.1); p.sum().backward(); o.step(); print(p.tolist()[0] < 1.0, 'torch._dynamo' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "True False"
