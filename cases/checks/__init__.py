"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cases.checks.duplicates import duplicates
from cases.checks.excitation import excitation, inputs_are_constant, pooled
from cases.checks.kinematics import kinematics
from cases.checks.report import CONTRADICTORY, INFO, CheckFinding, CheckReport, Found
from cases.checks.rudder import rudder_sign
from cases.checks.sampling import sampling
from cases.checks.wind import wind
from cases.io.unit_sanity import implausible
from cases.trial import Trial
from mmg.errors import UserError
from mmg.messages import message_rows

__all__ = ["CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled", "refuse_contradictory"]


LOOKS = {"sampling": sampling, "kinematics": kinematics, "rudder": rudder_sign, "wind": wind, "excitation": excitation}
"""Topic -> what looks at one trial: its numbers, and level, code and sentence of each finding."""


def check(trials: Sequence[Trial]) -> list[CheckReport]:
    """One report for each of ``trials``, in their order; duplicates are looked for among all of them.

    Notices of the reading come first.
    """
    reports = []
    for trial, (copies, shared) in zip(trials, duplicates(trials), strict=True):
        wrong = implausible(trial.columns)
        numbers: dict[str, Any] = {"duplicates": copies}
        found: dict[str, list[Found]] = {
            "reading": [(INFO, row["code"], _sentence(row["text"])) for row in message_rows(trial.notices)],
            "units": [(CONTRADICTORY, "unit", _sentence(wrong))] if wrong else [],
            "duplicates": shared,
        }
        for topic, look in LOOKS.items():
            numbers[topic], found[topic] = look(trial)
        findings = tuple(CheckFinding(topic, *each) for topic, some in found.items() for each in some)
        reports.append(CheckReport(trial.name, str(trial.path or ""), findings, numbers))
    return reports


def refuse_contradictory(trials: Sequence[Trial], anyway: str) -> None:
    """Raises UserError where the data of one of ``trials`` refute what its file says of them.

    anyway: how to go on all the same, in words.
    """
    wrong = [report for report in check(trials) if report.verdict == CONTRADICTORY]
    if wrong:
        text = next(f.text for f in wrong[0].findings if f.level == CONTRADICTORY).rstrip(".")
        names = ", ".join(report.path or report.name for report in wrong)
        raise UserError(f"{names}: contradictory, as mmg check says ({text}); correct it in trials.toml, or {anyway}")


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:] + "."
