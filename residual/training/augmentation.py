"""Slicing and jittering with the named sets of Wakita et al. (2024, Table 4).

A set cuts runs into windows of I rows that begin every I / slices rows (Eq. 15 to 19), and replaces each by ``copies``
of it with independent normal noise on u, v and r (Eq. 20 to 23; Table 5: no noise on position and heading).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from residual.rollout import RolloutBatch
from residual.system import Past
from residual.training.pieces import Piece
from residual.training.windows import jittered, windows


@dataclass(frozen=True)
class Augmentation:
    """slices: windows begin every I / slices rows; copies: noisy copies of each window, 0: the window as it is."""

    slices: int = 1
    copies: int = 0

    @property
    def factor(self) -> int:
        """How many times as many windows it gives as ref, about."""
        return self.slices * max(1, self.copies)


SETS = {
    "ref": Augmentation(),
    "sli2": Augmentation(2),
    "sli10": Augmentation(10),
    "jit2": Augmentation(1, 2),
    "jit10": Augmentation(1, 10),
    "sli2+jit2": Augmentation(2, 2),
    "sli10+jit10": Augmentation(10, 10),
    "d-ref": Augmentation(),
}
"""The sets by name. d-ref is ref on twice the data: whoever compares gives it all trials and the others half."""


def augmented(
    pieces: Sequence[Piece], h: float, rows: int, how: Augmentation, noise: torch.Tensor, seed: int, past: int = 0
) -> RolloutBatch | None:
    """Windows of I = ``rows`` rows of ``pieces`` on a grid of ``h`` [s], as the set ``how`` says; None where none fits.

    noise: of the instruments (6,), drawn by ``seed``; past: rows before each start that are given along.
    """
    batch = windows(pieces, h, rows - 1, max(1, rows // how.slices), past)
    if batch is None or not how.copies:
        return batch
    draw = torch.Generator().manual_seed(seed)
    only = torch.cat([torch.zeros(3, dtype=torch.float64), noise[3:]])
    return joined([jittered(batch, only, draw) for _ in range(how.copies)])


def joined(batches: Sequence[RolloutBatch]) -> RolloutBatch:
    """``batches`` of windows of the same length as one."""
    first = batches[0]
    parts = {n: torch.cat([getattr(b, n) for b in batches], dim=2) for n in ("controls", "targets", "mask")}
    pasts = [b.past for b in batches if b.past]
    past = Past(*(torch.cat(both, dim=2) for both in zip(*pasts, strict=True))) if pasts else None
    return RolloutBatch(first.h, **parts, past=past)
