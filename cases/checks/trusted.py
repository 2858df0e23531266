"""What may be fitted and scored: trials that the data do not refute, without their broken stretches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cases.checks.stretches import BrokenStretch, broken_stretches
from cases.io.leave_out import CODE, left_out, looked_at
from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.messages import Message

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


def keeping_line(trial: Trial) -> str:
    """What to add to trials.toml so that nothing of ``trial`` is left out, in words."""
    return f"add to {line_for(trial.path, trial.name, 'exclude = []')}"


def _without(trial: Trial, known: Sequence[BrokenStretch] | None) -> Trial:
    found = broken_stretches(trial) if known is None else known
    spans = [(s.begin_s, s.end_s) for s in found]
    why = "; ".join(dict.fromkeys(part for s in found for part in s.what.split("; ")))
    words = f"{why}; to keep all, {keeping_line(trial)}"
    return left_out(trial, spans, words, [span for span, s in zip(spans, found, strict=True) if s.moved])
