"""Regions of state, input, wind and place in which the latent force differs from that elsewhere.

A region is compared with all samples outside of it: z is the log ratio of the mean squares in and out by its standard
error, mean_z the difference of the means by its own. Standard errors are of the
jackknife over runs, and not below those of as many independent samples as the region lasts correlation times tau.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis.location.situations import Variable

CHANNELS, UNITS = ("surge", "sway", "yaw"), ("N", "N", "N m")
MOST, EACH = 30, 3
"""Most regions listed: of all, and of one variable and channel."""
ENOUGH = 5.0
"""Correlation times tau of the latent force that a region must last to be listed."""
GRID = 3
"""Cells of the place along north and along east."""
SMALL = 0.25
"""Ratio of the rms at which a region with little force still counts in the order."""


@dataclass(frozen=True)
class Samples:
    """M samples of the latent force [N, N, N m]: force (M, 3), after (M, 3) with the named effects, or None; run: (M,)
    trial of each; h: step [s]; tau: correlation time [s]."""

    force: np.ndarray
    after: np.ndarray | None
    run: np.ndarray
    h: float
    tau: float

    def rms(self, member: np.ndarray) -> np.ndarray:
        """Root mean squares (bins, 3) of the samples of each bin; member: (bins, M)."""
        return np.sqrt(means(self.force**2, member))

    def summary(self, member: np.ndarray, channel: int) -> dict[str, float]:
        """Rms and mean of the force of one channel (0 to 2) over the samples ``member`` (M,), later force included."""
        row: dict[str, float] = {}
        for end, force in (("", self.force), ("_after", self.after)):
            if force is not None:
                part = force[member, channel]
                row[f"force_rms{end}"] = float(np.sqrt((part**2).mean())) if len(part) else 0.0
                row[f"mean{end}"] = float(part.mean()) if len(part) else 0.0
        return row


def means(force: np.ndarray, member: np.ndarray) -> np.ndarray:
    """Means (bins, 3) of ``force`` (M, 3) over the samples of each bin; member: (bins, M)."""
    return member.astype(float) @ force / np.maximum(member.sum(axis=1), 1)[:, None]


Bin = tuple[str, Any, Any, str]
"""Variable, low, high, unit; low and high of a place are pairs (north, east)."""


def all_bins(variables: Sequence[Variable], z: np.ndarray, inside: np.ndarray) -> tuple[list[Bin], np.ndarray]:
    """(the bins, their samples (bins, M)): bins of the ``variables``, halves by sign of signed ones, cells of the
    place.

    z: (K + 1, R, S) states; inside: (K, R) steps that exist, M of them.
    """
    bins: list[Bin] = []
    members = []
    for one in variables:
        ends = one.values.min(), one.values.max()
        pairs = list(itertools.pairwise(one.edges))
        if one.signed and ends[0] < 0 < ends[1]:
            pairs += [(ends[0], 0.0), (0.0, ends[1] * (1 + 1e-9))]
        bins += [(one.name, float(low), float(high), one.unit) for low, high in pairs]
        members += [(one.values >= low) & (one.values < high) for low, high in pairs]
    x, y = (0.5 * (z[:-1, :, i] + z[1:, :, i])[inside] for i in (0, 1))
    cells = [
        np.linspace(float(p.min()), float(p.max()) + 1e-9 * max(1.0, abs(float(p.max()))), GRID + 1) for p in (x, y)
    ]
    for (a, b), (c, d) in itertools.product(*(itertools.pairwise(edges) for edges in cells)):
        bins.append(("place", [float(a), float(c)], [float(b), float(d)], "m"))
        members.append((x >= a) & (x < b) & (y >= c) & (y < d))
    return bins, np.array(members)


def regions(bins: list[Bin], member: np.ndarray, s: Samples) -> list[dict[str, Any]]:
    """Rows of the bins whose force differs most clearly from that outside of them, at most MOST.

    bins; member: (bins, M) their samples; s: the samples.
    """
    z, mean_z, ratio = _contrast(member, s)
    count = member.sum(axis=1)
    effective = count * s.h / s.tau
    outside = (member.shape[1] - count) * s.h / s.tau
    sure = np.maximum(np.abs(z), np.abs(mean_z)) * np.maximum(ratio, SMALL)
    telling = np.where((np.minimum(effective, outside) >= ENOUGH)[:, None], sure, 0.0)
    listed: dict[tuple[str, int], list[float]] = {}
    rows: list[dict[str, Any]] = []
    for flat in np.argsort(-telling, axis=None, kind="stable"):
        i, c = divmod(int(flat), 3)
        if len(rows) >= MOST or telling[i, c] <= 1.0:
            break
        name, low, high, unit = bins[i]
        gaps = listed.setdefault((name, c), [])
        if len(gaps) >= EACH or any(math.isclose(abs(mean_z[i, c]), g, rel_tol=1e-9) for g in gaps):
            continue  # the complement of a listed region says the same
        gaps.append(abs(float(mean_z[i, c])))
        row = {"variable": name, "low": low, "high": high, "unit": unit, "channel": CHANNELS[c], "force_unit": UNITS[c]}
        row |= {"ratio": float(ratio[i, c]), "count": int(count[i]), "effective": float(effective[i])}
        row |= {"z": float(z[i, c]), "mean_z": float(mean_z[i, c])}
        rows.append(row | s.summary(member[i], c))
    return rows


def _contrast(member: np.ndarray, s: Samples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z of the mean squares and of the means, inside against outside, and the rms by that of all, each (bins, 3)."""
    runs = np.unique(s.run)
    moments = np.concatenate([np.ones((len(s.force), 1)), s.force, s.force**2], axis=1)  # (M, 7)
    own = [s.run == run for run in runs]
    whole = np.array([moments[m].sum(axis=0) for m in own])  # (runs, 7)
    by_run = np.array([member[:, m].astype(float) @ moments[m] for m in own])  # (runs, bins, 7)
    total, inner = whole.sum(axis=0), by_run.sum(axis=0)
    log_ratio, gap = _differences(inner, total[None] - inner)
    count_in, count_out = inner[:, 0] * s.h / s.tau, (total[0] - inner[:, 0]) * s.h / s.tau
    share = 1 / np.maximum(count_in, 0.5) + 1 / np.maximum(count_out, 0.5)
    floor_ratio = 2 * share[:, None]
    floor_gap = 2 * share[:, None] * (total[4:] / total[0])  # of means: a sample lasts two correlation times
    n = len(runs)
    if n >= 3:
        left = _differences(inner[None] - by_run, (total - whole)[:, None] - (inner[None] - by_run))
        spread = [(n - 1) / n * ((d - d.mean(axis=0)) ** 2).sum(axis=0) for d in left]
        floor_ratio, floor_gap = np.maximum(floor_ratio, spread[0]), np.maximum(floor_gap, spread[1])
    overall = np.sqrt(total[4:] / total[0])
    rms = np.sqrt(inner[:, 4:] / np.maximum(inner[:, :1], 1))
    ratio = np.divide(rms, overall, out=np.ones_like(rms), where=np.broadcast_to(overall > 0, rms.shape))
    safe = np.maximum(floor_gap, 1e-300)
    return log_ratio / np.sqrt(floor_ratio), gap / np.sqrt(safe), ratio


def _differences(inner: np.ndarray, outer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log ratio of the mean squares and difference of the means from sums (..., 7): count, 3 sums, 3 squares."""
    n_in, n_out = np.maximum(inner[..., :1], 1.0), np.maximum(outer[..., :1], 1.0)
    a, b = np.maximum(inner[..., 4:] / n_in, 0.0), np.maximum(outer[..., 4:] / n_out, 0.0)
    tiny = 1e-12 * (a + b) + 1e-300
    return np.log((a + tiny) / (b + tiny)), inner[..., 1:4] / n_in - outer[..., 1:4] / n_out


def by_variable(variables: Sequence[Variable], s: Samples) -> list[dict[str, Any]]:
    """Rows by variable and channel: the force averaged in bins (for the figure), the best explained first.

    variables; s: samples. "explained": share of the mean square of the force due to its mean by bin, less the share
    expected by chance.
    """
    rows: list[dict[str, Any]] = []
    square = (s.force**2).mean(axis=0)
    for one in variables:
        member = (one.values >= one.edges[:-1, None]) & (one.values < one.edges[1:, None])
        count = member.sum(axis=1)
        used = count * s.h / s.tau >= 1.0
        if used.sum() < 2:
            continue
        member, count = member[used], count[used]
        at = member.astype(float) @ one.values / count
        mean, rms = means(s.force, member), s.rms(member)
        later = means(s.after, member) if s.after is not None else None
        spread = np.sqrt(np.maximum(rms**2 - mean**2, 0.0) / np.maximum(count * s.h / (2 * s.tau), 1.0)[:, None])
        chance = 2 * s.tau * len(count) / (len(s.force) * s.h)
        for c, channel in enumerate(CHANNELS):
            share = float((count * mean[:, c] ** 2).sum() / len(s.force) / square[c]) if square[c] > 0 else 0.0
            row: dict[str, Any] = {"variable": one.name, "unit": one.unit, "channel": channel, "force_unit": UNITS[c]}
            row |= {"explained": share - chance, "at": at.tolist(), "mean": mean[:, c].tolist()}
            row |= {"std": spread[:, c].tolist(), "rms": rms[:, c].tolist()}
            if later is not None:
                row["mean_after"] = later[:, c].tolist()
            rows.append(row)
    return sorted(rows, key=lambda row: -row["explained"])
