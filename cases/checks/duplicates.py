"""Files that contain each other, whatever their clocks say: one hash per row, one sort over all files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, Found
from cases.trial import Trial

COLUMNS = ("psi", "u", "v", "r")
"""Required of every trial and noisy, so that rows of different runs never agree in all of them."""

GRIDS = (1e-7, 1e-3)
"""Values are compared on these grids (rad, m/s, rad/s); the coarse one finds copies with fewer digits."""

MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
"""One large odd multiplier per column, to mix its bits."""

VERBS = {"copy": "Is a copy of", "inside": "Is contained in", "contains": "Contains", "overlaps": "Overlaps"}

SHARE = 0.05
"""Overlaps below this share of the shorter file are not reported."""


def duplicates(trials: Sequence[Trial]) -> list[tuple[list[dict[str, Any]], list[Found]]]:
    """For each of ``trials``: the others it overlaps with (numbers), and findings about them.

    Rows that occur twice within one file (a ship at rest) do not count, nor do matches out of step with
    the others. Cost: one sort over all rows.
    """
    if len(trials) < 2:
        return [([], []) for _ in trials]
    out: list[tuple[list[dict[str, Any]], list[Found]]] = [([], []) for _ in trials]
    reported: set[tuple[int, int]] = set()
    for grid in GRIDS:
        for (a, b), (rows_a, rows_b) in _matches(trials, grid).items():
            if (a, b) not in reported and _report_overlap(trials, a, b, rows_a, rows_b, out):
                reported.add((a, b))
    return out


def _matches(trials: Sequence[Trial], grid: float) -> dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]:
    """Pair of trials -> row indices of equal rows in the first and in the second."""
    hashes, owner, row = _rows(trials, grid)
    order = np.argsort(hashes, kind="stable")
    hashes, owner, row = hashes[order], owner[order], row[order]
    pairs: dict[tuple[int, int], list[tuple[np.ndarray, np.ndarray]]] = {}
    for apart in range(1, len(trials)):
        same = np.flatnonzero(hashes[apart:] == hashes[:-apart])
        if not len(same):
            break
        first, second = owner[same], owner[same + apart]
        for a, b in set(zip(first.tolist(), second.tolist(), strict=True)):
            hit = same[(first == a) & (second == b)]
            pairs.setdefault((a, b), []).append((row[hit], row[hit + apart]))
    return {
        pair: (np.concatenate([h[0] for h in hits]), np.concatenate([h[1] for h in hits]))
        for pair, hits in pairs.items()
    }


def _rows(trials: Sequence[Trial], grid: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hash, trial index and row index of every complete row that is unique within its trial."""
    keys = np.array(MULTIPLIERS, np.uint64)
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for i, trial in enumerate(trials):
        values = np.column_stack([trial[c] for c in COLUMNS])
        whole = np.flatnonzero(np.isfinite(values).all(axis=1))
        whole_values = np.rint(values[whole] / grid).astype(np.int64).view(np.uint64)
        mixed = (whole_values * keys) ^ ((whole_values * keys) >> np.uint64(29))
        hashed = (mixed * keys[::-1]).sum(axis=1, dtype=np.uint64)
        unique, first, count = np.unique(hashed, return_index=True, return_counts=True)
        once = count == 1
        parts.append((unique[once], np.full(int(once.sum()), i), whole[first[once]]))
    hashes, owner, row = (np.concatenate(column) for column in zip(*parts, strict=True))
    return hashes, owner, row


def _report_overlap(
    trials: Sequence[Trial],
    a: int,
    b: int,
    rows_a: np.ndarray,
    rows_b: np.ndarray,
    out: list[tuple[list[dict[str, Any]], list[Found]]],
) -> bool:
    """Adds the overlap of trials a and b to both reports when it is a run of rows in step; True if so."""
    offsets, count = np.unique(rows_b - rows_a, return_counts=True)
    in_step = rows_b - rows_a == offsets[np.argmax(count)]
    rows_a, rows_b = rows_a[in_step], rows_b[in_step]
    for me, other, mine, theirs in ((a, b, rows_a, rows_b), (b, a, rows_b, rows_a)):
        n_me, n_other = len(trials[me]), len(trials[other])
        span_me, span_other = int(mine.max() - mine.min() + 1), int(theirs.max() - theirs.min() + 1)
        if len(mine) < 10 or len(mine) < SHARE * min(n_me, n_other):
            return False
        inside, holds = span_me >= 0.99 * n_me, span_other >= 0.99 * n_other
        relation = "copy" if inside and holds else "inside" if inside else "contains" if holds else "overlaps"
        identical = bool(trials[me].sha256) and trials[me].sha256 == trials[other].sha256
        out[me][0].append({
            "other": trials[other].name, "relation": relation, "identical_bytes": identical,
            "rows": [int(mine.min()), int(mine.max())], "other_rows": [int(theirs.min()), int(theirs.max())],
            "share": span_me / n_me,
        })  # fmt: skip
        text = (
            f"{VERBS[relation]} {trials[other].name}: rows {mine.min()}-{mine.max()} are its rows "
            f"{theirs.min()}-{theirs.max()}; keep both on the same side of a train/test split."
        )
        out[me][1].append((DOUBTFUL, "duplicate", text))
    return True
