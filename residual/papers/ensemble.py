"""Ensembles of systems: particles that follow their members, and how well their spread tells the error.

Wakita et al. (2025), sections 4 and 5.3: systems trained from different seeds stand for what the data leave open.
Particles start from one measured state; under TS-infinity each keeps its member, under TS1 it draws one at every step
(Chua et al. 2018). Eq. 30 is their mean and covariance, Eq. 31 the distances of the truth from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

from mmg.errors import Missing
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual
from residual.physics import Physics
from residual.splits import blocks
from residual.system import RolloutBatch, TrainableSystem, rollout
from residual.train import Task

VELOCITIES = slice(3, 6)
"""Rows u, v, r of the logged columns, on which Eq. 30 and 31 are taken."""


def members_of_ship(ship: Ship) -> list[TrainableSystem]:
    """The members of a hybrid ship's network, each on the same physics. UserError for a ship without a network."""
    if ship.network is None:
        raise Missing(f"{ship.name} has no network, so there is no ensemble: train one with mmg train --seeds 5")
    physics = Physics(ship.without_network())
    nothing = np.zeros((len(ship.features), 1))
    count = range(len(ship.network.members))
    return [Hybrid(physics, Residual.of_network(ship.network, i), nothing) for i in count]


def bootstrapped(task: Task) -> Task:
    """The ``task`` on blocks of its training pieces, as many as they hold, drawn with replacement by its seed."""
    cut = blocks(task.split.train, task.settings.block, task.h)
    draws = np.random.default_rng([11, task.seed]).integers(0, len(cut), len(cut))
    return replace(task, split=task.split._replace(train=[cut[i] for i in draws]))


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
    the latter member i is followed by the particles i, i + E, i + 2E, ... Raises ValueError for another sampling.
    """
    if sampling == "ts-infinity":
        paths = torch.stack([rollout(member, batch, method) for member in members[:count]], dim=2)
        return paths[:, :, torch.arange(count) % len(members)].numpy()
    if sampling != "ts1":
        raise ValueError(f"sampling {sampling!r} is neither ts1 nor ts-infinity")
    draw, M = torch.Generator().manual_seed(seed), len(batch)
    which = torch.randint(len(members), (count * M,), generator=draw)
    starts = torch.stack([member.start(batch.targets[0], batch.controls[0], batch.past) for member in members])
    z = starts[which, :, torch.arange(count * M) % M].T.contiguous()
    states = [members[0].columns(z)]
    for controls in batch.controls:
        which = torch.randint(len(members), (count * M,), generator=draw)
        before, inputs, z = z, controls.repeat(1, count), torch.empty_like(z)
        for i, member in enumerate(members):  # what a member remembers is handed on to the next one (2025, Eq. 28)
            at = (which == i).nonzero()[:, 0]
            if len(at):
                z[:, at] = member.step(before[:, at], inputs[:, at], batch.h, method)
        states.append(members[0].columns(z))
    return torch.stack(states).reshape(len(states), 6, count, M).numpy()


def moments(paths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eq. 30: mean (N + 1, 6, M) and covariance (N + 1, 6, 6, M) of the particles ``paths`` (N + 1, 6, P, M).

    Divided by P: particles that follow the same member add nothing.
    """
    mean = paths.mean(axis=2)
    off = paths - mean[:, :, None]
    return mean, np.einsum("nipm,njpm->nijm", off, off) / paths.shape[2]


class Distances(NamedTuple):
    """Of the truth from the particles, per window (M,), in u, v, r; Eq. 31 and what belongs to it.

    euclidean: mean over the rows of |truth - mean|^2; mahalanobis: the same weighted by the inverse covariance;
    variance: mean trace of the covariance. The roots of the first two hardly correlate where the spread grows with the
    bias (Fig. 6).
    """

    euclidean: np.ndarray
    mahalanobis: np.ndarray
    variance: np.ndarray


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
        raise ValueError("the covariance of u, v, r is singular: 4 different members are needed")
    error = np.moveaxis((truth[1:] - mean)[:, VELOCITIES], 1, -1)
    counted = mask[1:, VELOCITIES].all(axis=1)
    rows = np.maximum(counted.sum(axis=0), 1)

    def averaged(values: np.ndarray) -> np.ndarray:
        return np.where(counted, values, 0.0).sum(axis=0) / rows

    scaled = error / scale
    weighted = (scaled * np.linalg.solve(alike, scaled[..., None])[..., 0]).sum(axis=-1)
    variance = np.trace(C, axis1=2, axis2=3)
    return Distances(averaged((error**2).sum(axis=-1)), averaged(weighted), averaged(variance))
