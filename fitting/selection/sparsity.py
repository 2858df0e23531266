"""Which terms of a fitted polynomial the data do not ask for: backward elimination by evidence.

The posterior about the estimate is taken as Gaussian, the prior of a term is N(0, 1) in its own size. Then the evidence
of the model without a term, by that of the model with it, is the posterior density at zero by the prior density there
(Savage-Dickey): ln B = -1/2 (ln C + p^2 / C) for estimate p and variance C. The term with the largest ln B goes first,
estimate and covariance of the others are conditioned on it, and so on until no ln B is positive.
"""

from __future__ import annotations

import numpy as np

from fitting.calibration import Calibration


def weak_terms(found: Calibration) -> tuple[str, ...]:
    """Generated terms of the calibration ``found`` that its evidence speaks against, the weakest first."""
    symbols = found.prior.symbols
    own = found.problem.ship.monomials
    droppable = np.array([symbol in own and found.prior.mean[i] == 0.0 for i, symbol in enumerate(symbols)], dtype=bool)
    order = eliminate(found.p, found.covariance_model, droppable)
    return tuple(symbols[i] for i in order)


def eliminate(p: np.ndarray, covariance: np.ndarray, droppable: np.ndarray) -> list[int]:
    """Positions of the terms to leave out, in the order in which they go.

    p: estimates (P,) in prior standard deviations; covariance: theirs (P, P); droppable: which of them may go (P,).
    """
    p, C, may = p.copy(), covariance.copy(), droppable.copy()
    gone: list[int] = []
    while may.any():
        variance = np.clip(np.diag(C), 1e-300, None)
        gain = np.where(may, -0.5 * (np.log(variance) + p**2 / variance), -np.inf)
        i = int(np.argmax(gain))
        if not gain[i] > 0:
            break
        p = p - C[:, i] * (p[i] / variance[i])
        C = C - np.outer(C[:, i], C[i]) / variance[i]
        may[i] = False
        gone.append(i)
    return gone
