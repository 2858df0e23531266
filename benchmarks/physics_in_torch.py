"""Time of a gradient step with the ship's equations in the loop, as a ratio to the same network alone.

Forward rollout, gradient and Adam update; one thread, float64 in both, repeats alternate, medians of processor time.
The network alone integrates its accelerations of (u, v, r, inputs) with no rotation between frames: the least that any
model must do.
Run from the repository root: python -m benchmarks.physics_in_torch
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from benchmarks.record import record, table
from cases.shipfiles.ship_file import load_ship
from residual.bounded_network import Residual
from residual.physics.fused_rollout import FusedRollout
from residual.physics.operator import Physics

ALONE = "network alone"
BATCH, STEPS, H, REPEATS = 512, 100, 0.2, 15
SCALES = np.array([0.5, 0.2, 0.1, 10.0, 0.5, 1.0, 1.0]), np.array([0.01, 0.01, 0.01])
"""Of the features and of the accelerations of ESSO OSAKA."""

Model = Callable[[Tensor, Tensor, Residual], Tensor]
"""(start (6, M), inputs (N, C, M), network) -> states (N + 1, 6, M)."""


def alone(z: Tensor, controls: Tensor, network: Residual) -> Tensor:
    """An Euler step of the network alone."""
    motion = z[3:6]
    return z + H * torch.cat([motion, network(torch.cat([motion, controls]))])


def stepwise(step: Callable[[Tensor, Tensor, Residual], Tensor]) -> Model:
    """The rollout of single steps."""

    def states(start: Tensor, controls: Tensor, network: Residual) -> Tensor:
        every = [start]
        for inputs in controls:
            every.append(step(every[-1], inputs, network))
        return torch.stack(every)

    return states


class Stepped(Physics):
    """Single steps of a ship with a network: one node in torch's graph besides the network in each stage."""

    def step(self, z: Tensor, controls: Tensor, network: Residual, method: str = "rk4") -> Tensor:
        """State (S, M) a step later, inputs (C, M) held, by "rk4" or "euler"."""
        y1 = self.stage(z, z, controls, network, H if method == "euler" else H / 2)
        if method == "euler":
            return y1
        y2 = self.stage(z, y1, controls, network, H / 2)
        y3 = self.stage(z, y2, controls, network, H)
        return self.stage((y1 + 2 * y2 + y3 - z) / 3, y3, controls, network, H / 6)

    def stage(self, base: Tensor, z: Tensor, controls: Tensor, network: Residual, h: float) -> Tensor:
        """base + h (rates at z)."""
        length = torch.full((1, 1), h, dtype=torch.float64)
        return self.call("advance", base, z, network(self.features(z, controls)), controls, length)[0]


def gradient_step(
    model: Model,
    network: Residual,
    optimiser: torch.optim.Optimizer,
    data: tuple[Tensor, Tensor, Tensor],
) -> float:
    """Processor seconds of one gradient step."""
    start, controls, target = data
    began = time.process_time()
    optimiser.zero_grad(set_to_none=True)
    ((model(start, controls, network)[1:] - target) ** 2).mean().backward()  # type: ignore[no-untyped-call]
    optimiser.step()
    return time.process_time() - began


def main() -> None:
    torch.set_num_threads(1)
    ship = load_ship("esso_osaka_3m")
    physics, interpreted = Stepped(ship), Stepped(ship, compiled=False)
    fused = {width: FusedRollout(physics, width) for width in (64, 32)}
    ways: dict[str, Model] = {
        ALONE: stepwise(alone),
        "physics + network": stepwise(lambda z, c, net: physics.step(z, c, net, "euler")),
        "fused rollout": lambda start, c, net: fused[len(net.b1)](start, c, H, net, "euler"),
        "physics + network, Runge-Kutta 4": stepwise(lambda z, c, net: physics.step(z, c, net, "rk4")),
        "fused rollout, Runge-Kutta 4": lambda start, c, net: fused[len(net.b1)](start, c, H, net, "rk4"),
        "physics interpreted + network": stepwise(lambda z, c, net: interpreted.step(z, c, net, "euler")),
    }
    rng = np.random.default_rng(0)
    start = torch.as_tensor(rng.normal(size=(6, BATCH)) * [[0], [0], [1], [0.1], [0.05], [0.02]])
    start[3] += 0.4
    controls = torch.as_tensor(rng.normal(size=(STEPS, 4, BATCH)) * [[1], [0.3], [1], [1]])
    controls[:, 0] += 10.0
    target = torch.as_tensor(0.1 * rng.normal(size=(STEPS, 6, BATCH)))
    rows = []
    for width in fused:
        made = {}
        for name, model in ways.items():
            network = Residual(*SCALES, width=width)
            made[name] = (model, network, torch.optim.Adam(network.parameters(), 1e-4), (start, controls, target))
            gradient_step(*made[name])
        times: dict[str, list[float]] = {name: [] for name in ways}
        for repeat in range(REPEATS):
            for name, given in made.items():
                if "interpreted" not in name or repeat < 3:
                    times[name].append(gradient_step(*given))
        median = {name: float(np.median(t)) for name, t in times.items()}
        for name, seconds in median.items():
            ratio = seconds / median[ALONE]
            rows.append([f"2x{width}", name, f"{1e3 * seconds:.0f}", f"{ratio:.2f}"])
    lines = table(["network", "model", "ms per gradient step", "x network alone"], rows)
    lines += [
        "",
        f"{BATCH} trajectories, {STEPS} steps, one thread, float64. Targets with Euler: 1.3, fused 0.5.",
    ]
    record("Physics inside torch", "python -m benchmarks.physics_in_torch", lines)


if __name__ == "__main__":
    main()
