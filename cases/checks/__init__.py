"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.
"""

from __future__ import annotations

from collections.abc import Sequence

from cases.checks.duplicates import duplicates
from cases.checks.excitation import GROUPS, excitation, inputs_are_constant, pooled
from cases.checks.kinematics import kinematics
from cases.checks.report import CheckReport, Finding, info, unusable
from cases.checks.rudder import rudder_sign
from cases.checks.sampling import sampling
from cases.checks.wind import wind
from cases.io.unit_sanity import implausible
from cases.trial import Trial

__all__ = ["GROUPS", "CheckReport", "Finding", "check", "inputs_are_constant", "pooled"]


def check(trials: Sequence[Trial]) -> list[CheckReport]:
    """One report per trial, in the order given; duplicates are looked for among all of them."""
    twins = duplicates(trials)
    return [_check_one(trial, *twins[i]) for i, trial in enumerate(trials)]


def _check_one(trial: Trial, copies: list[dict], said: list[Finding]) -> CheckReport:
    """All checks of one trial; what was said while reading comes first."""
    findings = [info("reading", notice[0].upper() + notice[1:] + ".") for notice in trial.notices]
    sentence = implausible(trial.columns)
    if sentence:
        findings.append(unusable("units", sentence[0].upper() + sentence[1:] + "."))
    numbers: dict = {"duplicates": copies}
    findings += said
    for topic, look in (
        ("sampling", sampling),
        ("kinematics", kinematics),
        ("rudder", rudder_sign),
        ("wind", wind),
        ("excitation", excitation),
    ):
        values, sentences = look(trial)
        numbers[topic] = values
        findings += sentences
    return CheckReport(trial.name, str(trial.path or ""), tuple(findings), numbers)
