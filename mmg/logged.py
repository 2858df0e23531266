"""Between the state of a model and what a trial logs of it: settled memory, logged columns, and back."""

from __future__ import annotations

import numpy as np

from mmg.model import Model

INVERSIONS = 30
"""Most fixed-point steps from logged columns to the state behind them."""


def settled(model: Model, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """States (S, M) from x, y, psi, u, v, r (6, M), with what is remembered settled under inputs (C, M)."""
    if len(model.states) == 6:
        return np.array(six, dtype=float)
    return np.array(model.initial(six, controls, theta))


def columns(model: Model, states: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """The six columns as they are logged, (..., 6, M), of states (..., S, M)."""
    if not model.measured:
        return states[..., :6, :]
    flat = states.reshape(-1, *states.shape[-2:])
    logged = np.array([np.array(model.columns(z, theta)) for z in flat])
    return logged.reshape(*states.shape[:-2], 6, states.shape[-1])


def states_behind(model: Model, logged: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """States (S, M) that are logged as (6, M) under inputs (C, M), their memory settled; NaN stays NaN."""
    six = np.array(logged, dtype=float)
    states = settled(model, six, controls, theta)
    if not model.measured:
        return states
    for _ in range(INVERSIONS):
        error = columns(model, states, theta) - logged
        six -= error
        states = settled(model, six, controls, theta)
        if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
            break
    return states
