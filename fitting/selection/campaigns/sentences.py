"""What differs between campaigns, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cases.io.campaigns import Campaigns, campaigns_of
from cases.trial import Trial
from fitting.nlp.run_constants import RunConstants
from mmg.messages import Message

NAMES = {
    "gyro.T": "the lag of the turn rate",
    "gyro.share": "the scale error of the turn rate",
    "log_scale.share": "the scale error of the log",
}
"""Constants in words."""
UNTOLD = 0.9
"""Share of the width from which a standard error says that the runs of a campaign tell nothing of a constant."""


def why_not(campaigns: Campaigns, wanted: bool) -> Message | None:
    """Why these ``campaigns`` cannot be compared, None if they can; said of a single one only if ``wanted``."""
    if len(campaigns.comparable) >= 2:
        return None
    if len(campaigns.names) < 2:
        words = "all trials are of one campaign, so instruments have one value"
        return Message(words, "one_campaign") if wanted else None
    few = ", ".join(name for name in campaigns.names if name not in campaigns.comparable)
    words = (
        f"instruments keep one value for all campaigns: {few} with one run each, of which none could be left out and "
        "still be told by the others; two campaigns with two runs each are needed"
    )
    return Message(words, "one_run_a_campaign")


def not_asked(trials: Sequence[Trial], wanted: Sequence[str]) -> tuple[Message, ...]:
    """What to say of campaigns of ``trials`` where each run has constants of its own; nothing for a single campaign, or
    where "none" is ``wanted``. Raises UserError for campaigns that contradict each other."""
    if tuple(wanted) == ("none",) or len(campaigns_of(trials).comparable) < 2:
        return ()
    words = (
        "trials of several campaigns, but instruments keep one value for all of them: with --per-run nothing else is "
        "asked"
    )
    return (Message(words, "campaigns_not_asked"),)


def differences(constants: RunConstants, campaigns: Campaigns, left: np.ndarray) -> list[Message]:
    """A sentence on each of the ``constants``, which differ, and on ``campaigns`` that do not tell it.

    left: (campaigns, Q) share of the width that the trials of each leave, as standard errors of the model.
    """
    found = []
    for k, symbol in enumerate(constants.symbols):
        value, std = constants.value[:, k], constants.std[:, k]
        unit = f" {constants.units[k]}" if constants.units[k] else ""
        low, high = int(np.argmin(value)), int(np.argmax(value))
        each = ", ".join(
            f"{name} {_short(v, s)} +- {s:.1g}" for name, v, s in zip(constants.runs, value, std, strict=True)
        )
        least, most = _short(value[low], std[low]), _short(value[high], std[high])
        mean, width = _short(constants.prior_value[k], constants.prior_std[k]), constants.prior_std[k]
        words = (
            f"{NAMES.get(symbol, symbol)} ({symbol}) differs between campaigns, from {least}{unit} "
            f"({constants.runs[low]}) to {most}{unit} ({constants.runs[high]}), "
            f"mean {mean} +- {width:.1g}{unit}: {each}"
        )
        found.append(Message(words, "campaigns_differ"))
        vague = [n for n, share in zip(constants.runs, left[:, k], strict=True) if share > UNTOLD]
        if vague:
            words = (
                f"{', '.join(vague)}: {'its' if len(vague) == 1 else 'their'} runs tell nothing of {symbol} (too "
                "little excitation, or too few runs); the value is the mean of all campaigns"
            )
            found.append(Message(words, "campaign_tells_nothing"))
    alone = [name for name in constants.runs if campaigns.runs(name) == 1]
    if alone:
        words = (
            f"{', '.join(alone)}: one run each; what is said of {'it' if len(alone) == 1 else 'them'} no other confirms"
        )
        found.append(Message(words, "one_run_a_campaign"))
    return found


def _short(value: float, std: float) -> str:
    """A value to the first digit of its standard error."""
    if not 0 < std < 10:
        return f"{value:.3g}"
    digits = max(0, -math.floor(math.log10(std)))
    return f"{round(value, digits) + 0.0:.{digits}f}"
