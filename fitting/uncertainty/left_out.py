"""What stretches that were left out of the trials were worth: scores with and without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cases.io.leave_out import inside, spans_left_out
from cases.trial import Trial
from fitting.prediction.score import ScorePair, in_words, score
from mmg.messages import Message
from mmg.rollout import Simulator

SETS = {"validation": "held-out trials", "training": "training trials"}


def worth_of_left_out(
    after: Simulator, sets: Mapping[str, Sequence[Trial]], scores: Mapping[str, ScorePair]
) -> dict[str, Any] | None:
    """Content of "left_out" in result.json; None where nothing was left out.

    after: the calibrated ship; sets: trials by name, "training" and "validation"; scores: of them, without what was
    left out. Returns seconds and trials that are concerned, and both metrics with and without.
    """
    concerned = {t.name: _row(t) for some in sets.values() for t in some if t.whole is not None}
    if not concerned:
        return None
    errors = {}
    for name, pair in scores.items():
        if any(t.whole is not None for t in sets[name]):
            kept = score(after, [t.whole or t for t in sets[name] if t.has_position], pair.after.sigma)
            errors[name] = {
                metric: {"without": getattr(pair.after, metric), "with": getattr(kept, metric)}
                for metric in ("window", "paper")
            }
    return {"seconds": sum(row["seconds"] for row in concerned.values()), "trials": concerned, "scores": errors}


def worth_message(found: Mapping[str, Any] | None) -> list[Message]:
    """A message on ``found``, what ``worth_of_left_out`` gave."""
    if not found:
        return []
    count = len(found["trials"])
    parts = [f"{found['seconds']:.1f} s of {count} trial{'s' * (count > 1)} were left out"]
    for name, row in found["scores"].items():
        words = [
            f"{label} {in_words(row[key]['with'])} instead of {in_words(row[key]['without'])}"
            for key, label in (("window", "30 s windows"), ("paper", "100 s restarts"))
        ]
        parts.append(f"with them the {SETS.get(name, name)} have {', '.join(words)}")
    return [Message("; ".join(parts), "left_out_worth")]


def _row(trial: Trial) -> dict[str, Any]:
    spans = spans_left_out(trial)
    why = [str(note) for note in trial.notices if getattr(note, "code", "") == "left_out"]
    seconds = float(inside(trial, spans).sum()) * trial.dt
    return {"seconds": seconds, "spans": [list(span) for span in spans], "why": "; ".join(why)}
