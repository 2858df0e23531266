"""Sparse robust regression: the few faults that explain the rows of several runs.

Forward selection: the fault that explains most is added while it is significant by jackknife standard errors, over
blocks of a run or, where there are many runs, over runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cases.evidence.tails import normal_tail, student_quantile

SIGMAS = 3.0
"""Standard errors that a found value must exceed; more (by Student's t) with few blocks."""
RUNS = 10
"""From so many runs on, standard errors are those between runs."""
CLIP = 1.5
"""Standard deviations from which an error counts by its size, not by its square (Huber 1964: between 1 and 2)."""
ITERATIONS, MOST = 8, 5
"""Of a fit, and faults at most."""
CLOSE, SHARE = 6.0, 0.8
"""A rival is named if it explains less by at most CLOSE in chi-squared, or SHARE of it; of two such faults the one that
an effect of the library repeats comes first."""

Rows = Callable[[float], tuple[np.ndarray, np.ndarray]]
"""lag [s] -> (A (M, P), y (M,)), linear about it."""


@dataclass(frozen=True)
class Fit:
    """Few faults that explain the rows, and what each other one would be in addition.

    active: the faults; values, std, sharp: (P,), sharp where the data tell more than the prior; crit: Student's SIGMAS;
    rivals: fault -> [(other, its value)] that would explain the rows nearly as well in its place; cost: negative
    logarithm of the likelihood of what is left, with Huber's tails.
    """

    active: tuple[int, ...]
    values: np.ndarray
    std: np.ndarray
    sharp: np.ndarray
    crit: float
    rivals: dict[int, list[tuple[int, float]]]
    cost: float


@dataclass(frozen=True)
class Normal:
    """Normal equations by group, N (G, P, P) and h (G, P), of parameters with a prior (P,).

    cost: as of ``Fit`` at the present values; squares: weighted squares of the rows, ``rows`` in number.
    """

    N: np.ndarray
    h: np.ndarray
    prior: np.ndarray
    cost: float
    squares: float
    rows: float

    def solve(self, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """(values, std, std without regard to groups, drop of the weighted squares) with only these, the others 0."""
        c = np.array(chosen, dtype=int)
        N, h, wish = self.N[:, c[:, None], c], self.h[:, c], np.diag(self.prior[c] ** -2.0)
        b, G = np.linalg.solve(N.sum(axis=0) + wish, h.sum(axis=0)), len(N)
        drop = float(b @ h.sum(axis=0))
        sharper = max(self.rows / max(self.squares - drop, 1e-12 * self.squares), 1.0)
        plain = np.sqrt(np.diag(np.linalg.inv(sharper * N.sum(axis=0) + wish)))
        without = np.linalg.solve(N.sum(axis=0) - N + wish, (h.sum(axis=0) - h)[..., None])[..., 0]
        return b, np.maximum(plain, np.sqrt((G - 1) * without.var(axis=0))), plain, drop


def _normal(rows: Sequence[Rows], blocks: Sequence[np.ndarray], b: np.ndarray, prior: np.ndarray, few: float) -> Normal:
    """Huber-weighted normal equations about b (P,), one group per run, or per block where there are few runs."""
    groups, cost, squares, count = [], 0.0, 0.0, 0.0
    for row, block in zip(rows, blocks, strict=True):
        A, y = row(b[0])
        good = np.isfinite(A).all(axis=1) & np.isfinite(y)
        A, y, group = A[good], y[good], block[good] if len(rows) < RUNS else np.zeros(good.sum())
        error = np.abs(y - A @ b)
        spread = float(np.median(error)) / (1.18 if np.iscomplexobj(A) else 0.67) + 1e-6 * prior[0]
        scaled = error / spread
        weight = few / np.maximum(scaled / CLIP, 1.0) / spread**2
        tails = np.where(scaled < CLIP, 0.5 * scaled**2, CLIP * (scaled - 0.5 * CLIP))
        cost += few * float(len(y) * (1 + np.iscomplexobj(A)) * math.log(spread) + tails.sum())
        squares, count = squares + float(weight @ np.abs(y) ** 2), count + few * len(y) * (1 + np.iscomplexobj(A))
        AW = (A.conj() * weight[:, None]).T
        for g in np.unique(group):
            at = group == g
            groups.append(((AW[:, at] @ A[at]).real, (AW[:, at] @ y[at]).real))
    N, h = (np.stack(parts) for parts in zip(*groups, strict=True))
    return Normal(N, h, prior, cost, squares, count)


def fit(
    rows: Sequence[Rows],
    blocks: Sequence[np.ndarray],
    prior: np.ndarray,
    least: np.ndarray,
    preferred: np.ndarray,
    few: float,
    start: Sequence[int] = (),
) -> Fit:
    """The few faults among P that explain the ``rows`` of the runs; blocks: (M,) block of each row, by run.

    prior, least: (P,) prior standard deviation, and least size that matters; preferred: (P,) bool, first of two that
    explain alike; few: share of a row that is independent, as windows overlap; start: faults present in any case.
    """
    P = len(prior)
    active = list(start)
    b, std, sharp = np.zeros(P), np.zeros(P), np.zeros(P, dtype=bool)
    while True:
        for _ in range(ITERATIONS if active else 3):
            system = _normal(rows, blocks, b, prior, few)
            if active:
                b[active] += np.clip(system.solve(active)[0] - b[active], -prior[active], prior[active])
        crit = -student_quantile(normal_tail(SIGMAS), len(system.N) - 1) if len(system.N) > 1 else math.inf
        values, drops = b.copy(), np.full(P, -math.inf)
        for j in range(P):
            chosen = [i for i in active if i != j] + [j]
            value, error, plain, drop = system.solve(chosen)
            values[j], std[j], sharp[j] = value[-1], error[-1], plain[-1] < 0.5 * prior[j]
            if j not in active and abs(values[j]) > max(crit * std[j], least[j]):
                drops[j] = drop
        if not np.isfinite(drops).any() or len(active) >= MOST:
            return Fit(tuple(active), values, std, sharp, crit, _rivals(system, active), system.cost)
        base = system.solve(active)[3] if active else 0.0
        alike = drops - base >= SHARE * (drops.max() - base)
        active.append(
            int(np.argmax(np.where(alike & (preferred if (alike & preferred).any() else True), drops, -np.inf)))
        )


def _rivals(system: Normal, active: Sequence[int]) -> dict[int, list[tuple[int, float]]]:
    """Per fault the others that would do nearly as well in its place, and how large they would be."""
    out: dict[int, list[tuple[int, float]]] = {}
    for j in active:
        rest = [i for i in active if i != j]
        value, std, _, drop = system.solve([*rest, j])
        own = drop - (system.solve(rest)[3] if rest else 0.0)
        for k in set(range(len(system.prior))) - set(active):
            other = system.solve([*rest, k])
            lost = (drop - other[3]) / own
            if lost < max(1 - SHARE, CLOSE * float(std[-1] / value[-1]) ** 2):
                out.setdefault(j, []).append((k, float(other[0][-1])))
    return out
