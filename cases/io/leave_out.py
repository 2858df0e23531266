"""Stretches of a trial that are left out: their states become gaps, their inputs stay."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cases.trial import Trial
from mmg.messages import Message
from mmg.states import STATES

CODE = "left_out"
"""Code of the notice on what was left out."""

Span = tuple[float, float]
"""Begin and end [s] on the clock of the file."""


def inside(trial: Trial, spans: Sequence[Span]) -> np.ndarray:
    """Rows of ``trial`` in the ``spans``, ends included, (N,) of bool."""
    rows = np.zeros(len(trial), bool)
    for begin, end in spans:
        rows |= (trial.t >= begin - 1e-6) & (trial.t <= end + 1e-6)
    return rows


def left_out(trial: Trial, spans: Sequence[Span], why: str, moved: Sequence[Span] = ()) -> Trial:
    """``trial`` without the states of its rows in ``spans``, with a notice; with none it is marked as looked at.

    why: in words, where the spans are from; moved: those of the spans in which something else moved the ship, over
    which no prediction may run.
    """
    rows = inside(trial, spans)
    measured = inside(trial, [span for span in spans if span not in moved])
    columns = {name: np.where(rows, np.nan, trial[name]) for name in STATES if name in trial}
    meta = {**trial.meta, "left_out": json.dumps([list(span) for span in spans]), "looked_at": "yes"}
    meta["bridged"] = "".join("1" if row else "0" for row in measured & rows) if rows.any() else ""
    notices = tuple(trial.notices)
    if rows.any():
        words = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in spans)
        seconds = float(rows.sum()) * trial.dt
        text = f"{trial.name}: {seconds:.1f} of {trial.duration:.0f} s left out ({words}): {why}"
        notices = (*notices, Message(text, CODE))
    if not rows.any():
        return replace(trial, meta=meta)
    columns = {**trial.columns, **columns}
    return replace(trial, columns=columns, meta=meta, notices=notices, whole=trial.whole or trial)


def bridged(trial: Trial) -> np.ndarray:
    """Rows of ``trial`` without states over which a prediction may run all the same, (N,) of bool: the instruments
    broke there, the ship and her inputs did not."""
    marks = trial.meta.get("bridged", "")
    return np.array([mark == "1" for mark in marks]) if len(marks) == len(trial) else np.zeros(len(trial), bool)


def spans_left_out(trial: Trial) -> list[Span]:
    """Begin and end [s] of each stretch that was left out of ``trial``."""
    return [(float(begin), float(end)) for begin, end in json.loads(trial.meta.get("left_out", "") or "[]")]


def looked_at(trial: Trial) -> bool:
    """Whether it was decided what of ``trial`` is left out, by its sidecar or by the checks."""
    return trial.meta.get("looked_at") == "yes"
