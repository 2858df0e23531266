"""What may be fitted and scored: trials without their broken stretches, each once, by their roles in the sidecar.

Files contain each other whatever their clocks say: one hash per row, one join over all files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cases.checks.report import DOUBTFUL, Found
from cases.checks.stretches import BrokenStretch, broken_stretches
from cases.io.campaigns import campaign_labels
from cases.io.leave_out import CODE, left_out, looked_at
from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.errors import Missing
from mmg.messages import Message

COLUMNS = ("psi", "u", "v", "r")
"""Required of every trial and noisy, so that rows of different runs never agree in all of them."""

GRIDS = (1e-7, 1e-3)
"""Values are compared on these grids (rad, m/s, rad/s); the coarse one finds copies with fewer digits."""

MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
"""One large odd multiplier per column, to mix its bits."""

VERBS = {"copy": "Is a copy of", "inside": "Is contained in", "contains": "Contains", "overlaps": "Overlaps"}

SHARE = 0.05
"""Overlaps below this share of the shorter file are not reported."""


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


DOUBT = "doubtful"
"""Code of the notice on what mmg check doubts of a trial."""


def without_broken(trials: Sequence[Trial], known: Sequence[Sequence[BrokenStretch]] | None = None) -> list[Trial]:
    """``trials`` without their broken stretches, each with a notice on what was left out and why.

    known: the broken stretches of each, where they are. A trial whose sidecar says what to exclude, or that was looked
    at before, stays as it is.
    """
    rows: Sequence[Sequence[BrokenStretch] | None] = [None] * len(trials) if known is None else known
    return [trial if looked_at(trial) else _without(trial, row) for trial, row in zip(trials, rows, strict=True)]


def as_they_are(trials: Sequence[Trial]) -> list[Trial]:
    """``trials`` marked as looked at, so that nothing of them is left out later."""
    return [trial if looked_at(trial) else left_out(trial, [], "") for trial in trials]


def with_doubt(trial: Trial, text: str) -> Trial:
    """``trial`` with a notice on a doubt about it: its name and the sentence ``text``."""
    return replace(trial, notices=(*trial.notices, Message(f"{trial.name}: doubtful: {text}", DOUBT)))


def remarks(trials: Sequence[Trial]) -> list[Message]:
    """Messages on what was left out of ``trials`` and what is doubtful about them."""
    found = [note for trial in trials for note in trial.notices if getattr(note, "code", "") in (CODE, DOUBT)]
    return list(dict.fromkeys(note for note in found if isinstance(note, Message)))


def _without(trial: Trial, known: Sequence[BrokenStretch] | None) -> Trial:
    found = broken_stretches(trial) if known is None else known
    spans = [(s.begin_s, s.end_s) for s in found]
    why = "; ".join(dict.fromkeys(part for s in found for part in s.what.split("; ")))
    words = f"{why}; to keep all, add to {line_for(trial.path, trial.name, 'exclude = []')}"
    return left_out(trial, spans, words, [span for span, s in zip(spans, found, strict=True) if s.moved])


MOST_LISTED = 5
"""Of names and pairs in one message."""


def training_trials(trials: Sequence[Trial], judges: Sequence[Trial] = ()) -> tuple[list[Trial], list[Message]]:
    """The ``trials`` to train on, and messages on those that trials.toml keeps out by their role test or validate, on
    copies, which would count as if the run had been made again, and on what was left out of trials and ``judges``.

    Raises UserError when none is left.
    """
    kept, out = by_role(trials)
    names = ", ".join(t.name for t in out)
    if out and not kept:
        line = line_for(out[0].path, out[0].name, 'role = "train"')
        words = (
            "trials.toml gives them the role test or validate; none is left to train on: write for those to train on"
        )
        raise Missing(f"{names}: {words}, {line}")
    messages = [Message(f"not trained on, by their role in trials.toml: {names}", "role_held_out")] if out else []
    once, copies = without_copies(kept)
    return once, [*remarks([*once, *judges]), *messages, *copies]


def by_role(trials: Sequence[Trial]) -> tuple[list[Trial], list[Trial]]:
    """Those of the ``trials`` that may train, and those that trials.toml keeps out by their role test or validate."""
    out = [t for t in trials if t.role in ("test", "validate")]
    return [t for t in trials if t.role not in ("test", "validate")], out


def without_copies(trials: Sequence[Trial]) -> tuple[list[Trial], list[Message]]:
    """The ``trials`` of which each is there once, and messages on copies, which would count as if the run had been made
    again."""
    messages: list[Message] = []
    once: dict[bytes, int] = {}
    copies: dict[int, list[int]] = {}
    for i, trial in enumerate(trials):
        first = once.setdefault(_content(trial), i)
        if first != i:
            copies.setdefault(first, []).append(i)
    campaign = campaign_labels(trials) if copies else []
    for first, others in copies.items():
        name = trials[first].name
        words = f"{_listed([trials[i].name for i in others])}: copies of {name}, which say nothing more; left out, so "
        words += "that no run counts twice"
        messages.append(Message(words, "copies_left_out"))
        for i in others:
            if campaign[i] != campaign[first]:
                words = f"{name} of campaign {campaign[first]} and {trials[i].name} of campaign {campaign[i]} are the "
                words += f"same file; it counts for {campaign[first]}: remove the one that is wrong"
                messages.append(Message(words, "same_file_in_two_campaigns"))
    return [trials[i] for i in once.values()], messages


def _content(trial: Trial) -> bytes:
    """What is the same for two trials of the same numbers; a clock may begin anywhere."""
    found = hashlib.sha256()
    for name, column in sorted(trial.columns.items()):
        values = column - column[0] if name == "t" else column
        found.update(name.encode())
        found.update(np.ascontiguousarray(np.round(values, 9) + 0.0, dtype=float).tobytes())
    return found.digest()


def _listed(names: Sequence[str]) -> str:
    """The ``names``, of more than MOST_LISTED only the first and how many there are."""
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more


def shared_rows(train: Sequence[Trial], held_out: Sequence[Trial]) -> list[Message]:
    """Messages on rows that two trials of ``train`` share, or one of them and one of ``held_out``."""
    trials = [*train, *held_out]
    messages = []
    for i, (copies, _) in enumerate(duplicates(trials)):
        names, first = {copy["other"] for copy in copies}, trials[i].name
        for other in [j for j in range(i + 1, len(trials)) if trials[j].name in names]:
            second = trials[other].name
            if i < len(train) <= other:
                words = f"{second} shares rows with {first}: its score is not held out"
                messages.append(Message(words, "not_held_out"))
            elif other < len(train):
                words = f"{first} and {second} share rows, which count twice in the fit: leave one of them out"
                messages.append(Message(words, "shared_rows"))
    found = list(dict.fromkeys(messages))
    for code in ("not_held_out", "shared_rows"):
        same = [m for m in found if m.code == code]
        if len(same) > MOST_LISTED:
            found = [m for m in found if m.code != code] + same[:MOST_LISTED]
            found.append(
                Message(f"{len(same) - MOST_LISTED} more pairs of trials share rows (mmg check lists them)", code)
            )
    return found
