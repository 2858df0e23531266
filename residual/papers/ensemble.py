"""Ensembles of systems: particles that follow their members, and how well their spread tells the error.

Wakita et al. (2025), sections 4 and 5.3: systems trained from different seeds stand for what the data leave open.
Particles start from one measured state; under TS-infinity each keeps its member, under TS1 it draws one at every step
(Chua et al. 2018). Eq. 30 is their mean and covariance, Eq. 31 the distances of the truth from them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from cases.io.campaigns import campaign_among, ship_of_campaign
from cases.trial import Trial
from fitting.nlp.windows import default_step
from fitting.prediction.predict import Window, planned_windows
from mmg.errors import UnknownName
from mmg.messages import Message
from mmg.ship import Ship
from residual.hybrid import Hybrid, Residual
from residual.papers.black_box import BlackBox, at_samples, gridded
from residual.physics import Physics
from residual.system import RolloutBatch, TrainableSystem, rollout

SAMPLINGS = ("ts-infinity", "ts1")
SINGULAR = 1e-13  # Smallest eigenvalue of a correlation matrix to invert. Set by hand: some hundred roundings.
PARTICLES = 100  # Particles of each window under TS1; under TS-infinity more than the members add nothing. Set by hand.


def members_of(model: Ship | BlackBox) -> list[TrainableSystem]:
    """The members of a ``model``: of a hybrid ship's network, each on the same physics, or of a black box.

    Raises UserError for a ship without a network.
    """
    if isinstance(model, BlackBox):
        return list(model.systems)
    # one physics for all, compiled once; no training rows, which only a penalty needs
    physics, nothing = Physics(model.without_network()), np.zeros((len(model.features), 1))
    return [Hybrid(physics, Residual.of_network(m.network), nothing) for m in model.members if m.network]


def predict_members(
    model: Ship | BlackBox,
    trial: Trial,
    length: float,
    stride: float,
    short_last: bool,
    sampling: str = "ts-infinity",
    seed: int = 0,
) -> tuple[list[Window], list[Message]]:
    """Windows of a ``trial`` with mean and standard deviation (Eq. 30) of particles that follow the members of
    ``model``, and notes: windows that were left out, and how far the measured u, v, r are from the particles (Eq. 31).

    length, stride [s], short_last: as of ``fitting.prediction.predict.window_rows``; sampling, seed: as of
    ``particles``. Raises UserError for an unknown sampling and for a ship without a network.
    """
    if sampling not in SAMPLINGS:
        raise UnknownName(f"--members {sampling}: unknown; choose one of {', '.join(SAMPLINGS)}")
    if isinstance(model, Ship):  # its instruments as in the campaign of the trial, as a prediction by the mean has them
        model = ship_of_campaign(model, campaign_among(trial, model.campaigns))
    members, method = members_of(model), model.settings.method if isinstance(model, BlackBox) else "rk4"
    stretches, notes = planned_windows(trial, model.inputs, length, stride, short_last)
    if not stretches:
        return [], notes
    h = model.h if isinstance(model, BlackBox) else default_step([trial], model.particulars["L"])
    batch = gridded(list(stretches.values()), h, members[0].past)
    paths = particles(members, batch, len(members) if sampling != "ts1" else PARTICLES, sampling, method, seed)
    windows, distances = [], []
    for i, (number, s) in enumerate(stretches.items()):
        cloud = at_samples(paths[:, :, :, i], h, s)  # (N + 1, 6, P)
        # divided by their number: particles that follow the same member add nothing
        windows.append(Window(number, s.first, s.last, cloud.mean(axis=2), cloud.std(axis=2)))
        distances.append(mahalanobis(cloud, trial.states[s.first : s.last + 1]))
    words = f"{trial.name}: std is the spread of {len(members)} members, not the error of a prediction"
    if np.isfinite(distances).all():
        # 3: the mean squared distance of three components that are as far away as they scatter
        words += f"; u, v, r are {np.sqrt(np.mean(distances) / 3):.1f} times as far from their mean (rms)"
    return windows, [*notes, Message(words, "spread_of_members")]


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
    if sampling == "ts-infinity":
        paths = torch.stack([rollout(member, batch, method) for member in members[:count]], dim=2)
        return paths[:, :, torch.arange(count) % len(members)].numpy()
    draw, M = torch.Generator().manual_seed(seed), len(batch)
    which = torch.randint(len(members), (count * M,), generator=draw)  # particle p of window m is column p M + m
    starts = torch.stack([member.start(batch.targets[0], batch.controls[0], batch.past) for member in members])
    z = starts[which, :, torch.arange(count * M) % M].T.contiguous()  # (Z, P M)
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


def mahalanobis(paths: np.ndarray, truth: np.ndarray) -> float:
    """Eq. 31b: mean over the rows after the start of the squared distance of u, v, r of ``truth`` (N + 1, 6) from the
    mean of particles ``paths`` (N + 1, 6, P), by their inverse covariance.

    Rows with NaN in the truth count nothing. NaN where a covariance is singular: of fewer than four members, or of
    members that agree.
    """
    cloud = paths[1:, 3:6]
    mean = cloud.mean(axis=2)
    off, error = cloud - mean[:, :, None], truth[1:, 3:6] - mean
    C = np.einsum("nip,njp->nij", off, off) / cloud.shape[2]
    # by the correlation matrix: u, v and r have unlike units, which alone would make C look singular
    scale = np.sqrt(np.maximum(np.diagonal(C, axis1=1, axis2=2), 1e-300))  # 1e-300: no division by 0
    correlation = C / (scale[:, :, None] * scale[:, None, :])
    if np.linalg.eigvalsh(correlation).min() < SINGULAR:
        return float("nan")
    scaled = error / scale
    return float(np.nanmean((scaled * np.linalg.solve(correlation, scaled[..., None])[..., 0]).sum(axis=-1)))
