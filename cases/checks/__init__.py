"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.
"""

from __future__ import annotations

from collections.abc import Sequence

from cases.checks.duplicates import duplicates
from cases.checks.excitation import GROUPS, excitation, inputs_are_constant, pooled
from cases.checks.kinematics import kinematics
from cases.checks.report import CONTRADICTORY, INFO, CheckFinding, CheckReport, Found
from cases.checks.rudder import rudder_sign
from cases.checks.sampling import sampling
from cases.checks.wind import wind
from cases.io.unit_sanity import implausible
from cases.trial import Trial
from mmg.messages import message_rows

__all__ = ["GROUPS", "CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled"]


def check(trials: Sequence[Trial]) -> list[CheckReport]:
    """One report for each of ``trials``, in their order; duplicates are looked for among all of them."""
    twins = duplicates(trials)
    return [_check_one(trial, *twins[i]) for i, trial in enumerate(trials)]


def _check_one(trial: Trial, copies: list[dict], shared: list[Found]) -> CheckReport:
    """All checks of one trial; notices of the reading come first."""
    findings = [
        CheckFinding("reading", INFO, row["code"], row["text"][0].upper() + row["text"][1:] + ".")
        for row in message_rows(trial.notices)
    ]
    sentence = implausible(trial.columns)
    if sentence:
        findings.append(CheckFinding("units", CONTRADICTORY, "unit", sentence[0].upper() + sentence[1:] + "."))
    numbers: dict = {"duplicates": copies}
    findings += [CheckFinding("duplicates", *found) for found in shared]
    for topic, look in (
        ("sampling", sampling),
        ("kinematics", kinematics),
        ("rudder", rudder_sign),
        ("wind", wind),
        ("excitation", excitation),
    ):
        values, sentences = look(trial)
        numbers[topic] = values
        findings += [CheckFinding(topic, *found) for found in sentences]
    return CheckReport(trial.name, str(trial.path or ""), tuple(findings), numbers)
