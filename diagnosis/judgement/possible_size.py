"""Whether an effect was found with a size that it can have in nature."""

from __future__ import annotations

from diagnosis.estimation.candidates import Candidate, FullModel, parameters
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.summary import parameters_of


def impossible_size(full: FullModel, fit: Estimate, candidate: Candidate) -> str:
    """Which parameter of a ``candidate`` in a ``fit`` of the ``full`` model is surely less or more than it can be in
    nature, in words, or nothing."""
    sizes = parameters_of(full, fit, candidate)
    calibrated = any(c.prior_std is not None for c in full.ship.coefficients.values())
    for p in parameters(full.ship, candidate.effect):
        if (found := sizes.get(p.symbol)) is None:
            continue
        least, error = p.least - (p.lost if calibrated else 0.0), 2 * found.std
        limits = [f"less than {least:.3g}"] * (found.value + error < least)
        limits += [f"more than {p.most:.3g}"] * (found.value - error > p.most)
        if limits:
            size = f"{p.symbol} = {found.value:.3g} ± {found.std:.2g} {found.unit}".rstrip()
            return f"{candidate.effect} ({size}), which cannot be {limits[0]} {found.unit}".rstrip()
    return ""
