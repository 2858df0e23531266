"""Trials that contain each other, whatever their clocks say: one hash per row, one join over all files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, Found
from cases.trial import Trial

COLUMNS = ("psi", "u", "v", "r")
"""Required of every trial and noisy, so that rows of different runs never agree in all of them."""

GRIDS = (1e-7, 1e-3)
"""Values are compared on these grids (rad, m/s, rad/s); the coarse one finds copies with fewer digits."""

MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
"""One large odd multiplier per column, to mix its bits; a join of pandas would take a third of a second to import."""

VERBS = {"copy": "Is a copy of", "inside": "Is contained in", "contains": "Contains", "overlaps": "Overlaps"}

SHARE = 0.05
"""Overlaps below this share of the shorter file are not reported: a matter of display."""

Pair = tuple[int, int]


def duplicates(trials: Sequence[Trial]) -> list[tuple[list[dict[str, Any]], list[Found]]]:
    """For each of ``trials``: the others it overlaps with (numbers), and findings about them.

    Rows that occur twice within one file (a ship at rest) do not count, nor do matches out of step with
    the others. Cost: one join over all rows.
    """
    out: list[tuple[list[dict[str, Any]], list[Found]]] = [([], []) for _ in trials]
    reported: set[Pair] = set()
    for grid in GRIDS if len(trials) > 1 else ():
        for pair, rows in _matches(trials, grid).items():
            for me, copy, finding in _overlap(trials, pair, rows) if pair not in reported else ():
                out[me][0].append(copy)
                out[me][1].append(finding)
                reported.add(pair)
    return out


def _matches(trials: Sequence[Trial], grid: float) -> dict[Pair, tuple[np.ndarray, np.ndarray]]:
    """Pair of trials -> row indices of equal rows in the first and in the second: complete rows, each of them
    unique within its trial. Pairs in the order of their trials."""
    keys, parts = np.array(MULTIPLIERS, np.uint64), []
    for i, trial in enumerate(trials):
        values = np.column_stack([trial[c] for c in COLUMNS])
        whole = np.flatnonzero(np.isfinite(values).all(axis=1))
        whole_values = np.rint(values[whole] / grid).astype(np.int64).view(np.uint64)
        mixed = (whole_values * keys) ^ ((whole_values * keys) >> np.uint64(29))
        hashed = (mixed * keys[::-1]).sum(axis=1, dtype=np.uint64)
        once, first, count = np.unique(hashed, return_index=True, return_counts=True)
        once, first = once[count == 1], first[count == 1]
        parts.append((once, np.full(len(once), i), whole[first]))
    hashes, number, row = (np.concatenate(some) for some in zip(*parts, strict=True))
    order = np.argsort(hashes, kind="stable")  # equal ones side by side, by trial
    hashes, number, row = hashes[order], number[order], row[order]
    found: dict[Pair, list[tuple[np.ndarray, np.ndarray]]] = {}
    for apart in range(1, len(trials)):
        at = np.flatnonzero(hashes[apart:] == hashes[:-apart])
        if not len(at):
            break
        both = number[at] * len(trials) + number[at + apart]
        for code in np.unique(both):
            one, pair = at[both == code], divmod(int(code), len(trials))
            found.setdefault(pair, []).append((row[one], row[one + apart]))
    return {pair: _joined(found[pair]) for pair in sorted(found)}


def _joined(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    first, second = (np.concatenate(some) for some in zip(*parts, strict=True))
    return first, second


def _overlap(
    trials: Sequence[Trial], pair: Pair, rows: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[int, dict[str, Any], Found]]:
    """For both trials of a ``pair``, its index and what its report says of their overlap, if that is a run of
    ``rows`` in step."""
    offsets, count = np.unique(rows[1] - rows[0], return_counts=True)
    in_step = rows[1] - rows[0] == offsets[np.argmax(count)]
    if in_step.sum() < max(10, SHARE * min(len(trials[i]) for i in pair)):
        return
    ends = [(int(some[in_step].min()), int(some[in_step].max())) for some in rows]
    identical = bool(trials[pair[0]].sha256) and trials[pair[0]].sha256 == trials[pair[1]].sha256
    shares = [(last - first + 1) / len(trials[i]) for i, (first, last) in zip(pair, ends, strict=True)]
    for me, other in ((0, 1), (1, 0)):
        inside, holds, name = shares[me] >= 0.99, shares[other] >= 0.99, trials[pair[other]].name
        relation = "copy" if inside and holds else "inside" if inside else "contains" if holds else "overlaps"
        copy = {
            "other": name, "relation": relation, "identical_bytes": identical,
            "rows": list(ends[me]), "other_rows": list(ends[other]), "share": shares[me],
        }  # fmt: skip
        text = (
            f"{VERBS[relation]} {name}: rows {ends[me][0]}-{ends[me][1]} are its rows "
            f"{ends[other][0]}-{ends[other][1]}; keep both on the same side of a train/test split."
        )
        yield pair[me], copy, (DOUBTFUL, "duplicate", text)
