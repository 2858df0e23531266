"""Whether an effect was found with a size that it can have in nature."""

from __future__ import annotations

import math

from diagnosis.estimation.candidates import Candidate, FullModel, parameters
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.summary import parameters_of


def impossible_size(full: FullModel, fit: Estimate, candidate: Candidate) -> str:
    """Which parameter of a ``candidate`` in a ``fit`` of the ``full`` model is surely less or more than it can be in
    nature, in words, or nothing."""
    limited = [p for p in parameters(full.ship, candidate.effect) if math.isfinite(p.least) or math.isfinite(p.most)]
    sizes = parameters_of(full, fit, candidate) if limited else {}
    calibrated = any(c.prior_std is not None for c in full.ship.coefficients.values())
    for p in (p for p in limited if p.symbol in sizes):
        found, least = sizes[p.symbol], p.least - (p.lost if calibrated else 0.0)
        limit = f"less than {least:.3g}" if found.value + 2 * found.std < least else ""
        limit = f"more than {p.most:.3g}" if found.value - 2 * found.std > p.most else limit
        if limit:
            size = f"{p.symbol} = {found.value:.3g} ± {found.std:.2g} {found.unit}".rstrip()
            return f"{candidate.effect} ({size}), which cannot be {limit} {found.unit}".rstrip()
    return ""
