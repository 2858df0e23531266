"""Which trials may train and which judge: roles of the sidecar, and rows that both would hold."""

from __future__ import annotations

from collections.abc import Sequence

from cases.checks.duplicates import duplicates
from cases.trial import Trial
from mmg.errors import UserError
from mmg.messages import Message


def training_trials(trials: Sequence[Trial]) -> tuple[list[Trial], list[Message]]:
    """The ``trials`` to train on, and a message on those that trials.toml keeps out by their role test or validate.

    Raises UserError when none is left.
    """
    kept = [t for t in trials if t.role not in ("test", "validate")]
    out = ", ".join(t.name for t in trials if t.role in ("test", "validate"))
    if out and not kept:
        raise UserError(f"{out}: trials.toml gives them the role test or validate; none is left to train on")
    return kept, [Message(f"not trained on, by their role in trials.toml: {out}", "role_held_out")] if out else []


def shared_rows(train: Sequence[Trial], held_out: Sequence[Trial]) -> list[Message]:
    """Messages on rows that two trials of ``train`` share, or one of them and one of ``held_out``."""
    trials = [*train, *held_out]
    messages = []
    for i, (copies, _) in enumerate(duplicates(trials)):
        names, first = {copy["other"] for copy in copies}, trials[i].name
        for other in [j for j in range(i + 1, len(trials)) if trials[j].name in names]:
            second = trials[other].name
            if i < len(train) <= other:
                words = f"{second} shares rows with {first}: its score is not held out"
                messages.append(Message(words, "not_held_out"))
            elif other < len(train):
                words = f"{first} and {second} share rows, which count twice in the fit: leave one of them out"
                messages.append(Message(words, "shared_rows"))
    return list(dict.fromkeys(messages))
