"""Which trial would help which coefficient, in words, and the analysis of identifiability as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np

from fitting.design.next_trial import NextTrial
from fitting.identifiability.analysis import DETERMINED, CoefficientFinding, Identifiability
from fitting.identifiability.verdicts import cause, verdict


def advice(i: int, finding: CoefficientFinding, trial: NextTrial | None) -> str:
    """Which ``trial`` would help coefficient ``i``; "" when its ``finding`` needs none, or none was scored."""
    if trial is None or finding.kind in ("determined", "unknown") or not trial.options:
        return ""
    best = trial.best(i)
    if best:
        option, left = best
        after = trial.before[i] * left
        outcome = f"would bring its standard error down by {1 - np.sqrt(left):.0%}"
        if after < DETERMINED:
            outcome = f"would determine it (share {after:.0%})"
        return f"best next trial: {option.name}, {trial.duration:.0f} s of it {outcome}"
    many = trial.best(i, many=True)
    if many:
        option, left = many
        return (
            f"{trial.duration:.0f} s of no trial of the library would help by much; {trial.many} times that of "
            f"{option.name} would bring its standard error down by {1 - np.sqrt(left):.0%}"
        )
    return "none of the library would help: take it from captive tests, computation or regression"


def identifiability_dict(found: Identifiability, trial: NextTrial | None = None) -> dict[str, Any]:
    """Plain values for result.json: what was ``found``, a sentence each, and the trials scored (``trial``), if any."""
    content = found.to_dict()
    for i, finding in enumerate(found.findings):
        missing, help_ = trial.missing[i] if trial else "", advice(i, finding, trial)
        words = verdict(finding, missing)
        content["coefficients"][finding.symbol] |= {
            "sentence": f"{words}; {help_}" if help_ else words,
            "cause": cause(finding, missing),
            "advice": help_,
        }
    if trial:
        content["next_trial"] = trial.to_dict([f.symbol for f in found.findings])
        for cluster, best in zip(content["clusters"], trial.clusters(found), strict=True):
            cluster["best_trial"] = {"name": best[0].name, "variance_left": best[1]} if best else None
    return content
