"""Ensembles of systems: particles that follow their members, and how well their spread tells the error.

Wakita et al. (2025), sections 4 and 5.3: systems trained from different seeds stand for what the data leave open.
Particles start from one measured state; under TS-infinity each keeps its member, under TS1 it draws one at every step
(Chua et al. 2018). Eq. 30 is their mean and covariance, Eq. 31 the distances of the truth from them.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from fitting.parallel import run_all
from mmg.errors import UserError
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual
from residual.physics import Physics
from residual.settings import TrainSettings
from residual.splits import Piece, blocks
from residual.system import RolloutBatch, TrainableSystem, rollout
from residual.train import BuildSystem, Outcome, restored, train_one, training_tasks
from residual.windows import Scales

SAMPLINGS = ("ts1", "ts-infinity")
VELOCITIES = slice(3, 6)
"""Rows u, v, r of the logged columns, on which Eq. 30 and 31 are taken."""
LEAST_MEMBERS = 4
"""Fewer distinct particles leave the covariance of u, v, r singular."""


def members_of_ship(ship: Ship) -> list[TrainableSystem]:
    """The members of a hybrid ship's network, each on the same physics. UserError for a ship without a network."""
    if ship.network is None:
        raise UserError(f"{ship.name} has no network, so there is no ensemble: train one with mmg train --seeds 5")
    physics = Physics(ship.without_network())
    nothing = np.zeros((len(ship.features), 1))
    count = range(len(ship.network.members))
    return [Hybrid(physics, Residual.of_network(ship.network, i), nothing) for i in count]


def bootstrapped(pieces: Sequence[Piece], seconds: float, h: float, seed: int) -> list[Piece]:
    """Blocks of about ``seconds`` of ``pieces`` on a grid of ``h`` [s], as many as they hold, drawn by ``seed``."""
    cut = blocks(pieces, seconds, h)
    draws = np.random.default_rng([11, seed]).integers(0, len(cut), len(cut))
    return [cut[i] for i in draws]


def train_members(
    build: BuildSystem,
    ship: Ship,
    scales: Scales,
    settings: TrainSettings,
    pieces: Sequence[Piece],
    held_out: Sequence[Piece],
    bootstrap: bool = False,
) -> tuple[list[TrainableSystem], list[Outcome]]:
    """Train the members of an ensemble from the seeds of ``settings``, on the same pieces or on resampled blocks.

    build, ship, scales: make each system; pieces: to train on, drawn anew in blocks for each with ``bootstrap``;
    held_out: pieces that choose the weights of all; the training pieces themselves: nothing is held out (Wakita et al.
    2025); none: each member holds out other runs. Returns members and outcomes. Raises UserError when every training
    diverged.
    """
    tasks = training_tasks(build, ship, scales, settings, pieces, held_out, judged_apart=not held_out)
    if bootstrap:
        own = [bootstrapped(task.split.train, settings.block, task.h, task.seed) for task in tasks]
        tasks = [replace(t, split=t.split._replace(train=blocks)) for t, blocks in zip(tasks, own, strict=True)]
    outcomes = run_all(train_one, tasks, settings.workers, name="members")
    members = restored(tasks[0], outcomes)
    if not members:
        raise UserError("every member of the ensemble diverged in training; give a lower --rate or more data")
    return members, outcomes


def step(
    members: Sequence[TrainableSystem],
    which: torch.Tensor,
    z: torch.Tensor,
    controls: torch.Tensor,
    h: float,
    method: str,
) -> torch.Tensor:
    """States (Z, M) a step of ``h`` [s] later, each column by the one of ``members`` that it follows (2025, Eq. 28).

    which: (M,) numbers of the members; z: states (Z, M); controls: inputs (C, M); method: "rk4" or "euler". What a
    member remembers is handed on to the next one.
    """
    out = torch.empty_like(z)
    for i, member in enumerate(members):
        at = (which == i).nonzero()[:, 0]
        if len(at):
            out[:, at] = member.step(z[:, at], controls[:, at], h, method)
    return out


def drawn(count: int, members: int, sampling: str, draw: torch.Generator) -> torch.Tensor:
    """Numbers of members (count,) for a step of TS1, or once for all of TS-infinity: there each is taken equally often.

    count: particles; members: how many there are; sampling: one of SAMPLINGS; draw: random numbers. Raises ValueError
    for another sampling.
    """
    if sampling not in SAMPLINGS:
        raise ValueError(f"sampling {sampling!r} is none of {SAMPLINGS}")
    return torch.randint(members, (count,), generator=draw) if sampling == "ts1" else torch.arange(count) % members


@torch.no_grad()
def particles(
    members: Sequence[TrainableSystem],
    batch: RolloutBatch,
    count: int,
    sampling: str = "ts-infinity",
    method: str = "rk4",
    seed: int = 0,
) -> np.ndarray:
    """Logged columns (N + 1, 6, P, M) of P = ``count`` particles per window of ``batch``, from its measured start.

    members: systems that they follow; method: "rk4" or "euler"; seed: of TS1; sampling: "ts1" or "ts-infinity". Under
    the latter member i is followed by the particles i, i + E, i + 2E, ...
    """
    draw, M = torch.Generator().manual_seed(seed), len(batch)
    if sampling == "ts-infinity":
        paths = torch.stack([rollout(member, batch, method) for member in members[:count]], dim=2)
        return paths[:, :, drawn(count, len(members), sampling, draw)].numpy()
    which = drawn(count * M, len(members), sampling, draw)
    starts = torch.stack([member.start(batch.targets[0], batch.controls[0], batch.past) for member in members])
    z = starts[which, :, torch.arange(count * M) % M].T.contiguous()
    states = [members[0].columns(z)]
    for controls in batch.controls:
        which = drawn(count * M, len(members), sampling, draw)
        z = step(members, which, z, controls.repeat(1, count), batch.h, method)
        states.append(members[0].columns(z))
    return torch.stack(states).reshape(len(states), 6, count, M).numpy()


def moments(paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 30: mean (N + 1, 6, M) and covariance (N + 1, 6, 6, M) of the particles ``paths`` (N + 1, 6, P, M).

    Divided by P: particles that follow the same member add nothing.
    """
    mean = paths.mean(axis=2)
    off = paths - mean[:, :, None]
    return mean, np.einsum("nipm,njpm->nijm", off, off) / paths.shape[2]


@dataclass(frozen=True)
class Distances:
    """Of the truth from the particles, per window (M,), in u, v, r; Eq. 31 and what belongs to it.

    euclidean: mean over the rows of |truth - mean|^2; mahalanobis: the same weighted by the inverse covariance;
    variance: mean trace of the covariance.
    """

    euclidean: np.ndarray
    mahalanobis: np.ndarray
    variance: np.ndarray

    def correlation(self) -> float:
        """Of bias and Mahalanobis distance, both as roots (Fig. 6): low where the spread grows with the bias."""
        return float(np.corrcoef(np.sqrt(self.euclidean), np.sqrt(self.mahalanobis))[0, 1])

    def spread_correlation(self) -> float:
        """Of bias and spread, both as roots: high where the spread tells the bias."""
        return float(np.corrcoef(np.sqrt(self.euclidean), np.sqrt(self.variance))[0, 1])


def distances(paths: np.ndarray, truth: np.ndarray, mask: np.ndarray, noise: np.ndarray | None = None) -> Distances:
    """Distances of ``truth`` (N + 1, 6, M) from particles over the rows after the start.

    paths: (N + 1, 6, P, M); mask: (N + 1, 6, M), 1 where measured: a row counts where u, v, r were; noise: (6,)
    standard deviations of the measurement, added to the covariance of the particles (not in Eq. 31, where the truth is
    known). Raises ValueError when a covariance is singular: fewer than four members, or members that agree.
    """
    mean, covariance = moments(paths[1:])
    C = np.moveaxis(covariance[:, VELOCITIES, VELOCITIES], -1, 1).copy()
    if noise is not None:
        C += np.diag(noise[VELOCITIES] ** 2)
    scale = np.sqrt(np.maximum(np.diagonal(C, axis1=2, axis2=3), 1e-300))
    alike = C / (scale[..., :, None] * scale[..., None, :])
    if np.linalg.eigvalsh(alike)[..., 0].min() < 1e-13:
        raise ValueError(f"the covariance of u, v, r is singular: {LEAST_MEMBERS} different members are needed")
    error = np.moveaxis((truth[1:] - mean)[:, VELOCITIES], 1, -1)
    counted = mask[1:, VELOCITIES].all(axis=1)
    rows = np.maximum(counted.sum(axis=0), 1)

    def averaged(values: np.ndarray) -> np.ndarray:
        return np.where(counted, values, 0.0).sum(axis=0) / rows

    scaled = error / scale
    weighted = (scaled * np.linalg.solve(alike, scaled[..., None])[..., 0]).sum(axis=-1)
    variance = np.trace(C, axis1=2, axis2=3)
    return Distances(averaged((error**2).sum(axis=-1)), averaged(weighted), averaged(variance))
