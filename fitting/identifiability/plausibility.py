"""Ranges outside which a coefficient is no longer physical: it stands in for something that the model lacks.

Engineering judgement for merchant ships; public fits of the ESSO OSAKA records leave most of them.
"""

from __future__ import annotations

import math

from fitting.nlp.problem import Prior
from mmg.messages import Message

PHYSICAL: dict[str, tuple[float, float]] = {
    "t_P": (0.0, 0.4),
    "w_P0": (0.0, 0.8),
    "x_P": (-0.7, -0.3),
    "t_R": (0.0, 0.6),
    "a_H": (0.0, 1.0),
    "x_H": (-0.6, -0.3),
    "epsilon": (0.7, 1.6),
    "ell_R": (-1.2, -0.5),
    "gamma_P": (0.2, 0.8),
    "gamma_N": (0.2, 0.8),
    "gamma_R_plus": (0.2, 0.8),
    "gamma_R_minus": (0.2, 0.8),
    "X_0F": (-math.inf, 0.0),
    "X_0A": (-math.inf, 0.0),
    "R_0": (0.0, math.inf),
    "Y_v": (-math.inf, 0.0),
    "N_v": (-math.inf, 0.0),
    "N_r": (-math.inf, 0.0),
    "C_D": (0.0, math.inf),
    "k_0": (0.0, math.inf),
}
ADDED_MASSES = ("m_x", "m_y", "I_J_z")
WITHIN_PRIOR = 2.0
"""Prior standard deviations within which the estimate of an added mass must lie."""


def implausible(prior: Prior, values: dict[str, float]) -> list[Message]:
    """Warnings on ``values`` (symbol -> estimate) outside their physical range; on added masses far from ``prior``."""
    found = []
    for symbol, value in values.items():
        low, high = PHYSICAL.get(symbol, (-math.inf, math.inf))
        if low <= value <= high:
            continue
        limits = f"{low:g} to {high:g}" if math.isfinite(low) and math.isfinite(high) else (
            f"at most {high:g}" if math.isfinite(high) else f"at least {low:g}"
        )  # fmt: skip
        words = (
            f"{symbol} = {value:.3g} is outside its physical range ({limits}): it stands in for something else; fix "
            "it, narrow its prior, or free what is missing"
        )
        found.append(Message(words, "implausible"))
    for i, symbol in enumerate(prior.symbols):
        shift = (values.get(symbol, prior.mean[i]) - prior.mean[i]) / prior.std[i]
        if symbol in ADDED_MASSES and abs(shift) > WITHIN_PRIOR:
            words = (
                f"{symbol} = {values[symbol]:.3g} lies {abs(shift):.1f} prior standard deviations from its prior; "
                "trials hardly determine added masses, so it makes up for something else: narrow its prior or fix it"
            )
            found.append(Message(words, "added_mass_far_from_prior"))
    return found
