"""The diagnosis in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

from diagnosis.findings import HeldOut, NamedEffect
from diagnosis.hypotheses.forward_selection import Selection


def amount(effect: NamedEffect) -> str:
    """The parameters of an ``effect`` in words."""
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
    found: Selection,
) -> str:
    """The diagnosis in one sentence, for the top of the report.

    verdict: "none", "named" or "unknown"; effects: those named; same: effects that the data cannot tell from the first;
    remainder: whether something is left unexplained; held: the check on test trials; found: the selection.
    """
    if verdict == "none":
        return "No effect beyond the ship's model is needed to explain these trials: what remains looks like chance."
    if verdict == "unknown":
        nearest = next((r.candidate.effect for s in found.searches[:1] for r in s.refitted), "")
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
    return words + (". A part of the gap remains unexplained." if remainder else ".")
