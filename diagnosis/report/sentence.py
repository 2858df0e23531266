"""The diagnosis in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.findings import HeldOut, NamedEffect
from diagnosis.hypotheses.forward_selection import Found


def amount(effect: NamedEffect) -> str:
    """The parameters of an effect as words."""
    parts = []
    for symbol, p in effect.parameters.items():
        parts.append(f"{symbol} = {p.value:.3g} ± {p.std:.2g} {p.unit}".rstrip())
    return ", ".join(parts) + (" in the mean, different in each run" if effect.by_run else "")


def sentence_of(
    verdict: str,
    effects: Sequence[NamedEffect],
    same: Sequence[str],
    remainder: bool,
    held: HeldOut | None,
    found: Found,
) -> str:
    """One sentence for the top of the report."""
    if verdict == "none":
        return "No effect beyond the ship's model is needed to explain these trials: what remains looks like chance."
    if verdict == "unknown":
        nearest = found.searches[0].tried[0].candidate.effect if found.searches and found.searches[0].tried else ""
        hint = f" The nearest known effect, {nearest}, does not account for it." if nearest else ""
        return f"Something is missing in the model, but none of the known effects explains it.{hint}"
    named = "; ".join(f"{e.name} ({amount(e)})" for e in effects)
    words = f"The trials point to {named}"
    if same:
        words += f", which these trials cannot tell from {' or '.join(same)}"
    if held is not None:
        words += (
            f"; with it the error of 30 s predictions of the test trials changes by {-held.reduction:+.0%} "
            f"(90 % interval {-held.interval_90[1]:+.0%} to {-held.interval_90[0]:+.0%})"
        )
    return words + (". A part of the gap remains without a name." if remainder else ".")
