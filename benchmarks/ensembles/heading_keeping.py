"""How well PD gains keep a heading in wind, by an ensemble and by the true ship: Wakita et al. (2025), section 5.4.

delta = -(K_p (psi - psi_0) + K_d r) within the limits of the rudder (Eq. 32; all rudders alike), from each particle's
own psi and r. The cost of a particle is the rms heading error [rad] over the run. Formulas and numbers of the paper's
section 5.4 were not legible in the text at hand: sign, cost and settings are those of this module.
The cost of an ensemble is that of its worst particle: gains that any plausible ship would handle badly are not trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cases.simulation.gusts import Wind
from mmg.motion.frames import wind_vector
from residual.ensemble import drawn, step
from residual.system import TrainableSystem

LOST = math.pi
"""Cost [rad] beyond which a run counts as lost, and what one that is not finite costs."""


@dataclass(frozen=True)
class HeadingKeeping:
    """The task. Times [s], angles [rad].

    speed [m/s], n [1/s]: approach; heading: to be kept; error: of the heading at the start; winds: mean true winds, one
    run each; limit, rate: of the rudder; seconds, h: length of a run and of its steps, at which the rudder is ordered;
    seed: of the gusts.
    """

    speed: float
    n: float
    winds: tuple[Wind, ...]
    heading: float = 0.0
    error: float = math.radians(10.0)
    limit: float = math.radians(35.0)
    rate: float = math.radians(20.0)
    seconds: float = 150.0
    h: float = 1.0
    seed: int = 0

    @property
    def steps(self) -> int:
        return round(self.seconds / self.h)

    def air(self) -> np.ndarray:
        """Velocity of the air over ground (N, 2, W) [m/s], held over each step."""
        t = self.h * np.arange(self.steps)
        series = [wind.series(t, self.seed + i) for i, wind in enumerate(self.winds)]
        return np.stack([np.column_stack(wind_vector(a[:, 0], a[:, 1])) for a in series], axis=-1)


def random_winds(count: int, speed: tuple[float, float], seed: int) -> tuple[Wind, ...]:
    """Gusty winds of uniform mean speed [m/s] in a range, from any direction."""
    draw = np.random.default_rng([12, seed])
    return tuple(Wind(draw.uniform(*speed), draw.uniform(0, 2 * math.pi), gusty=True) for _ in range(count))


def grid(kp: np.ndarray, kd: np.ndarray) -> np.ndarray:
    """All combinations of gains, (G, 2); K_d [s] runs fastest."""
    return np.array([(a, b) for a in kp for b in kd])


@torch.no_grad()
def headings(
    members: Sequence[TrainableSystem],
    inputs: Sequence[str],
    gains: np.ndarray,
    task: HeadingKeeping,
    count: int | None = None,
    sampling: str = "ts-infinity",
    seed: int = 0,
) -> np.ndarray:
    """Heading error [rad] (N + 1, P, G, W) of P particles under gains (G, 2) in W winds, psi from each particle.

    inputs: names of the ship's inputs; rudders are all moved alike, "n" is held, other actuators are at rest.
    count: particles, by default one for each member.
    """
    P, G, W = count or len(members), len(gains), len(task.winds)
    M, draw, air = P * G * W, torch.Generator().manual_seed(seed), torch.as_tensor(task.air())
    rudders = [i for i, name in enumerate(inputs) if name.startswith("delta")]
    kp, kd = (torch.as_tensor(np.ascontiguousarray(k)).repeat_interleave(W).repeat(P) for k in gains.T)
    held = torch.zeros(len(inputs), M, dtype=torch.float64)
    held[inputs.index("n")] = task.n
    logged = torch.zeros(6, M, dtype=torch.float64)
    logged[2], logged[3] = task.heading + task.error, task.speed

    def members_now() -> torch.Tensor:
        if sampling == "ts1":
            return drawn(M, len(members), sampling, draw)
        return drawn(P, len(members), sampling, draw).repeat_interleave(G * W)

    held[-2:] = air[0].repeat(1, P * G)
    z, delta = members[0].start(logged, held), torch.zeros(M, dtype=torch.float64)
    errors = [logged[2] - task.heading]
    for k in range(task.steps):
        six = members[0].columns(z)
        order = (-kp * (six[2] - task.heading) - kd * six[5]).nan_to_num().clamp(-task.limit, task.limit)
        delta = delta + (order - delta).clamp(-task.rate * task.h, task.rate * task.h)
        held[rudders], held[-2:] = delta, air[k].repeat(1, P * G)
        z = step(members, members_now(), z, held, task.h, "rk4")
        errors.append(members[0].columns(z)[2] - task.heading)
    return torch.stack(errors).reshape(-1, P, G, W).numpy()


def costs(errors: np.ndarray) -> np.ndarray:
    """Cost (P, G): rms over time and winds of heading errors (N + 1, P, G, W); LOST where a run is not finite."""
    mean = np.sqrt((np.clip(np.nan_to_num(errors, nan=LOST), -LOST, LOST)[1:] ** 2).mean(axis=(0, 3)))
    return np.where(np.isfinite(errors).all(axis=(0, 3)), mean, LOST)


@dataclass(frozen=True)
class Judgement:
    """Gains (G, 2) judged: cost by each particle (P, G) and by the true ship (G,), rms heading errors [rad]."""

    gains: np.ndarray
    particles: np.ndarray
    true: np.ndarray

    @property
    def worst(self) -> np.ndarray:
        """Cost (G,) of the worst particle."""
        return self.particles.max(axis=0)

    def overestimated(self, cost: np.ndarray, margin: float = 0.05) -> float:
        """Share of gains whose performance a cost (G,) overestimates by more than ``margin`` of the true cost."""
        return float(np.mean(cost < (1 - margin) * self.true))

    def regret(self, cost: np.ndarray) -> float:
        """True cost of the gains that a cost (G,) would choose, over that of the truly best ones."""
        return float(self.true[np.argmin(cost)] / self.true.min())


def judge(
    members: Sequence[TrainableSystem],
    true: TrainableSystem,
    inputs: Sequence[str],
    gains: np.ndarray,
    task: HeadingKeeping,
    count: int | None = None,
    sampling: str = "ts-infinity",
) -> Judgement:
    """The same gains in the same winds by an ensemble and by the true ship."""
    return Judgement(
        gains,
        costs(headings(members, inputs, gains, task, count, sampling)),
        costs(headings([true], inputs, gains, task))[0],
    )
