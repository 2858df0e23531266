"""Scores of the same trials before and after a model was changed: what became worse, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitting.prediction.score import MOST_NAMED, NO_SCORE, WINDOW, Score
from fitting.prediction.score_words import in_words, is_worse
from mmg.messages import Message
from mmg.states import STATES

UNDESCRIBED = 0.5
"""A mean squared error of 30 s windows, summed over six states in units of their variance, above which a
calibrated ship does not follow the trials; real ships of good trials have 0.1."""


@dataclass(frozen=True)
class ScorePair:
    """Scores of the same trials, predicted by a model before and after it was changed."""

    before: Score
    after: Score

    def worse(self, name: str) -> list[Message]:
        """Messages on metrics that became worse; name: of the set of trials, such as "validation"."""
        windows = ("30 s windows", self.before.window, self.after.window)
        restarts = ("100 s restarts", self.before.paper, self.after.paper)
        return [
            Message(f"{label} of the {name} trials became worse: {before:.4f} -> {in_words(after)}", "worse_after")
            for label, before, after in (windows, restarts)
            if is_worse(before, after)
        ]

    @property
    def worse_runs(self) -> tuple[str, ...]:
        """Runs that became worse, with their errors in units before and after, in words.

        Judged by 30 s windows, and by the share of change where the windows that suit the ship are longer.
        """
        units, found = (self.before.units, self.after.units), []
        for k, (before, after) in enumerate(zip(self.before.trials, self.after.trials, strict=True)):
            numbers, words = (before.window, after.window), f"{in_words(before.window)} -> {in_words(after.window)}"
            if units[0] and units[1]:
                b, a = units[0].runs[k], units[1].runs[k]
                numbers = (b.share, a.share) if units[1].window > WINDOW else numbers
                words = f"position {b.errors['position']:.3g} -> {a.errors['position']:.3g} m, "
                words += f"heading {b.errors['heading']:.3g} -> {a.errors['heading']:.3g} deg"
            if is_worse(*numbers):
                found.append(f"{after.name} ({words})")
        return tuple(found)

    def worse_by_run(self, name: str) -> list[Message]:
        """A message that lists the runs that became worse; name: of the set of trials, such as "validation"."""
        runs = self.worse_runs
        if not runs:
            return []
        words = f"worse than before on {len(runs)} of {len(self.after.trials)} {name} runs: {'; '.join(runs)}"
        return [Message(words, "worse_runs")]

    def failed(self, name: str) -> list[Message]:
        """A message where the model after the change has no score; name: of the set of trials, such as "validation"."""
        names = self.after.diverged
        if not names:
            return []
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        where = ", ".join(names[:MOST_NAMED]) + more
        return [Message(f"no score of the {name} trials: the prediction diverges on {where}", NO_SCORE)]

    def undescribed(self) -> list[Message]:
        """A message where the ship does not follow the trials that she was calibrated on."""
        if not self.after.window > UNDESCRIBED:
            return []
        share = (self.after.window / len(STATES)) ** 0.5
        words = (
            f"30 s predictions of the trials err by {share:.0%} of what the states vary by (rms): this ship does not "
            "follow them; see that they are hers and in her size, and what mmg check says of them"
        )
        return [Message(words, "not_described")]


NO_SCORES: Mapping[str, ScorePair] = {}
"""Scores of no set of trials."""


def score_pairs(before: Mapping[str, Score], after: Mapping[str, Score]) -> dict[str, ScorePair]:
    """Scores ``before`` and ``after`` a change of the model, as of ``scores_by_set``, by set of trials."""
    return {name: ScorePair(before[name], found) for name, found in after.items() if name in before}
