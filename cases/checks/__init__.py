"""Import checks: is this trial what its header says, and what can be learned from it?

``check(trials)`` gives one ``CheckReport`` per trial; ``pooled(reports)`` says what they excite together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

from cases.checks.excitation import excitation, inputs_are_constant, pooled
from cases.checks.folders import decided
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, CheckFinding, CheckReport, Found
from cases.checks.single import rudder_sign, sampling, wind
from cases.checks.stretches import BrokenStretch, stretch_findings
from cases.checks.trusted import as_they_are, duplicates, with_doubt, without_broken
from cases.io.sentinels import CODE, without_sentinels
from cases.trial import Trial
from mmg.errors import Conflict
from mmg.messages import Message, message_rows

__all__ = ["CheckFinding", "CheckReport", "check", "inputs_are_constant", "pooled", "ready"]


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


def ready(*sets: Sequence[Trial], unchecked: bool = False) -> tuple[list[Trial], ...]:
    """The ``sets`` of trials as they may be fitted and judged: without broken stretches, doubts among their notices.

    unchecked: leave them as they are. Raises UserError where the data of one
    of them refute what its file says.
    """
    sets = tuple([_known(trial) for trial in some] for some in sets)
    if unchecked:
        return tuple(as_they_are(some) for some in sets)
    found = check([trial for some in sets for trial in some])
    wrong = [report for report in found if report.verdict == CONTRADICTORY]
    if wrong:
        text = next(f.text for f in wrong[0].findings if f.level == CONTRADICTORY).rstrip(".")
        names = ", ".join(report.path or report.name for report in wrong)
        advice = "correct it in trials.toml, or add --unchecked"
        raise Conflict(f"{names}: contradictory, as mmg check says ({text}); {advice}")
    all_reports = iter(found)
    out = []
    for some in sets:
        reports = list(islice(all_reports, len(some)))
        kept = without_broken(
            some, [[BrokenStretch(**s) for s in report.numbers["stretches"]["broken"]] for report in reports]
        )
        for i, report in enumerate(reports):
            for finding in report.findings:
                if finding.level == DOUBTFUL and finding.topic not in ("stretches", "duplicates"):
                    kept[i] = with_doubt(kept[i], finding.text)
        out.append(kept)
    return tuple(out)


def _known(trial: Trial) -> Trial:
    """``trial`` without numbers that stand for no value, where it was not read from a file."""
    if trial.path is not None:
        return trial
    notices: list[Message] = []
    columns = without_sentinels(trial.columns, {name: (0, 1.0) for name in trial.columns}, (), notices)
    return replace(trial, columns=columns, notices=(*trial.notices, *notices)) if notices else trial


def _sentence(words: str) -> str:
    return words[0].upper() + words[1:] + "."
