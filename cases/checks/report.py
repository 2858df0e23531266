"""What a check says about a file: findings in sentences, numbers, and a verdict."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

OK, CONSISTENT, INFO, DOUBTFUL, CONTRADICTORY = "ok", "consistent", "info", "doubtful", "contradictory"
Found = tuple[str, str, str]  # Level, code and sentence of a finding whose topic is known.


class CheckFinding(NamedTuple):
    """One sentence about a file.

    topic: sampling, duplicates, kinematics, rudder, propeller, wind, excitation, units or reading; level: "info"
    (worth knowing), "doubtful" (look at it before a calibration) or "contradictory" (the data refute what the file
    says of them); code: what was found, in a word that does not change with the sentence, such as rudder_sign,
    velocity_frame or unit.
    """

    topic: str
    level: str
    code: str
    text: str


# Findings that the text of a report shows, and the length of a line. Set by hand: display.
MOST_SHOWN, WIDTH = 10, 118


@dataclass(frozen=True, repr=False)
class CheckReport:
    """The checks of one trial. numbers: topic -> the measured values (SI; keys end in their unit where they have one),
    None where the data do not tell."""

    name: str
    path: str
    findings: tuple[CheckFinding, ...]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """ "ok", "consistent", "doubtful" or "contradictory": the worst level among the findings; consistent is what is
        so as far as it can be checked, as some of its columns were derived from those they would be compared with."""
        levels = {finding.level for finding in self.findings}
        unchecked = any(finding.code == "not_checked" for finding in self.findings)
        return next((level for level in (CONTRADICTORY, DOUBTFUL) if level in levels), CONSISTENT if unchecked else OK)

    def __repr__(self) -> str:
        lines = [f"<CheckReport {self.name}: {self.verdict}, {len(self.findings)} findings"]
        lines += [f"  {f.level}, {f.topic} ({f.code}): {f.text}" for f in self.findings[:MOST_SHOWN]]
        if len(self.findings) > MOST_SHOWN:
            lines.append(f"  and {len(self.findings) - MOST_SHOWN} more: report.findings")
        return "\n".join(line if len(line) <= WIDTH else f"{line[: WIDTH - 3]}..." for line in lines) + ">"

    def as_dict(self) -> dict[str, Any]:
        """Plain types for JSON, keys stable: name, path, verdict, findings, numbers; None for what is not finite."""
        numbers = json.loads(json.dumps(self.numbers, default=float), parse_constant=lambda _: None)
        findings = [finding._asdict() for finding in self.findings]
        head = {"name": self.name, "path": self.path, "verdict": self.verdict}
        return {**head, "findings": findings, "numbers": numbers}
