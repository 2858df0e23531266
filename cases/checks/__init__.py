"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cases.checks.copies import duplicates
from cases.checks.excitation import excitation, inputs_are_constant, pooled
from cases.checks.folders import decided
from cases.checks.report import DOUBTFUL, INFO, CheckFinding, CheckReport, Found
from cases.checks.single import rudder_sign, sampling, wind
from cases.checks.stretches import stretch_findings
from cases.io.sentinels import CODE, without_sentinels
from cases.trial import Trial
from mmg.messages import Message, message_rows

__all__ = ["CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled"]


LOOKS = {
    "sampling": sampling,
    "stretches": stretch_findings,
    "rudder": rudder_sign,
    "wind": wind,
    "excitation": excitation,
}
"""Topic -> what looks at one trial: its numbers, and level, code and sentence of each finding."""


def check(trials: Sequence[Trial]) -> list[CheckReport]:
    """One report for each of ``trials``, in their order; duplicates are looked for among all of them.

    Notices of the reading come first.
    """
    reports = []
    trials = [_known(trial) for trial in trials]
    for trial, (copies, shared) in zip(trials, duplicates(trials), strict=True):
        look = {topic: look(trial) for topic, look in LOOKS.items()}
        numbers: dict[str, Any] = {"duplicates": copies, **{topic: row[0] for topic, row in look.items()}}
        found: dict[str, list[Found]] = {
            "reading": [
                (DOUBTFUL if row["code"] == CODE else INFO, row["code"], _sentence(row["text"]))
                for row in message_rows(trial.notices)
            ],
            "duplicates": shared,
            **{topic: row[1] for topic, row in look.items()},
        }
        findings = tuple(CheckFinding(topic, *each) for topic, some in found.items() for each in some)
        reports.append(CheckReport(trial.name, str(trial.path or ""), findings, numbers))
    return decided(trials, reports)


def _known(trial: Trial) -> Trial:
    """``trial`` without numbers that stand for no value, where it was not read from a file."""
    if trial.path is not None:
        return trial
    notices: list[Message] = []
    columns = without_sentinels(trial.columns, {name: (0, 1.0) for name in trial.columns}, (), notices)
    return replace(trial, columns=columns, notices=(*trial.notices, *notices)) if notices else trial


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:] + "."
