"""What a check says about a file: findings in sentences, numbers, and a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

OK, WARNINGS, UNUSABLE = "ok", "warnings", "unusable"


@dataclass(frozen=True)
class Finding:
    """One sentence. topic: sampling, duplicates, kinematics, rudder, wind, excitation, units or reading;
    level: "info" (worth knowing), "warning" (look at it before fitting) or "unusable"."""

    topic: str
    level: str
    text: str


@dataclass(frozen=True)
class CheckReport:
    """The checks of one trial.

    verdict: "ok", "warnings" or "unusable", the worst level among the findings. numbers: topic -> the
    measured values (SI; keys end in their unit where they have one), None where the data do not tell.
    """

    name: str
    path: str
    findings: tuple[Finding, ...]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        levels = {finding.level for finding in self.findings}
        return UNUSABLE if "unusable" in levels else WARNINGS if "warning" in levels else OK

    @property
    def sentences(self) -> tuple[str, ...]:
        return tuple(finding.text for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """Plain types for JSON, keys stable: name, path, verdict, findings, numbers."""
        return {
            "name": self.name,
            "path": self.path,
            "verdict": self.verdict,
            "findings": [{"topic": f.topic, "level": f.level, "text": f.text} for f in self.findings],
            "numbers": _plain(self.numbers),
        }


def _plain(value: Any) -> Any:
    """Mappings and sequences as dict and list, numbers as Python's own, None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (bool, int, str)) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def info(topic: str, text: str) -> Finding:
    return Finding(topic, "info", text)


def warning(topic: str, text: str) -> Finding:
    return Finding(topic, "warning", text)


def unusable(topic: str, text: str) -> Finding:
    return Finding(topic, "unusable", text)
