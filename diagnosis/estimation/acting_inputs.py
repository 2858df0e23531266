"""Inputs as they act: records of rudder and revolutions, late by the delay and the lag of a ship's effects.

Both are operators on the record alone, so that they are applied to it exactly, in eighths of a step: the model needs
neither states for them nor an approximation (a fit and a prediction have both, see ``Effect.actuators``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.estimation.gridded_trials import PARTS, GriddedTrials, means_and_changes
from diagnosis.estimation.transition_model import LinearModel, TransitionModel
from mmg.effects import EFFECTS

# Steps of h by which an input is moved for its derivative: one part, over which the record is straight.
APART = 1.0 / PARTS


def acting(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> GriddedTrials:
    """``data`` with the inputs as they act on a ship of coefficients ``theta`` (all,) or (all, R) by window.

    steps: the transition model. The record of ``data`` stays, so that other coefficients may follow. Whatever follows
    the inputs (backlash, the hull, the propeller) follows those that act.
    """
    values = _values(steps, theta)
    if values == data.acting_at:
        return data
    record = _acted(steps, data, values) if values else data.record
    # without what was before the window
    inputs, changes = means_and_changes(record[len(record) - PARTS * len(data.inputs) :])
    return replace(data, inputs=inputs, changes=changes, acting_at=values)


def linearised(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    z: np.ndarray,
    force: np.ndarray,
    columns: Sequence[int] | np.ndarray,
    active: np.ndarray,
) -> LinearModel:
    """``TransitionModel.linearise`` with the inputs as they act, and with the responses to what makes them late.

    steps: the model; data: the trials; theta: coefficients (all,) or (all, R); z: (K + 1, R, S) path; force: (K, R, 3)
    latent; columns: (P,) positions in ``steps.symbols``; active: (A,) positions of states. Returns the model.
    """
    at = np.asarray(columns, dtype=int)
    linear = steps.linearise(z, acting(steps, data, theta).controls, theta, force, at, active, data.steps)
    late = _late(steps, at)
    if not late:
        return linear
    K, R = data.inputs.shape[:2]
    begin = z[:-1].reshape(K * R, -1).T
    every = steps.coefficients(theta, force.reshape(-1, 3).T)
    for i, symbol in late:
        sides, apart = _both_sides(steps, data, theta, symbol)
        ends = [steps.advance(begin, side.controls.reshape(K * R, -1).T, every) for side in sides]
        # by difference: the record is no expression of the model
        linear.G[..., i] = (ends[1] - ends[0])[active].T.reshape(K, R, -1) / apart[..., None]
    return linear


def logdet_gradient(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    z: np.ndarray,
    force: np.ndarray,
    by_rates: np.ndarray,
    columns: Sequence[int] | np.ndarray,
    active: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of 1/2 log det by those of the ``columns`` that make inputs late.

    by_rates: (K, R, A, A + 3) derivative by the Jacobian of the rates; steps, data, theta, z, force, columns, active:
    as of ``linearised``. Returns their places (q,) among the columns, and values by window (R, q).
    """
    late = _late(steps, np.asarray(columns, dtype=int))
    places, values = np.array([i for i, _ in late], dtype=int), np.zeros((data.inputs.shape[1], len(late)))
    for j, (_, symbol) in enumerate(late):
        sides, apart = _both_sides(steps, data, theta, symbol)
        less, more = (steps.weighted_rates(z, side.inputs, theta, force, by_rates, active) for side in sides)
        values[:, j] = (more - less) / apart
    return places, values


def _late(steps: TransitionModel, columns: np.ndarray) -> list[tuple[int, str]]:
    """Places and symbols of those ``columns`` that make inputs late."""
    named = [(i, steps.symbols[c]) for i, c in enumerate(columns)]
    return [(i, s) for i, s in named if s in steps.late]


def _values(steps: TransitionModel, theta: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """Values of what makes inputs late, of ``theta`` (all,) or (all, R): by window where they differ, () for none."""
    each = [np.atleast_1d(theta[steps.ship.symbols.index(s)]) for s in steps.late]
    if not any(x.any() for x in each):
        return ()
    return tuple(tuple((x[:1] if (x == x[0]).all() else x).tolist()) for x in each)


def _both_sides(
    steps: TransitionModel, data: GriddedTrials, theta: np.ndarray, symbol: str
) -> tuple[tuple[GriddedTrials, GriddedTrials], np.ndarray]:
    """``data`` with a little less and a little more of what makes inputs late (of a lag: none less than none), and how
    much lies between, () or (R,)."""
    place, lower = steps.ship.symbols.index(symbol), -np.inf
    if not EFFECTS[symbol.partition(".")[0]].acts_before:
        lower = 0.0
    less, more = theta.copy(), theta.copy()
    less[place] = np.maximum(less[place] - APART * data.h, lower)
    more[place] = more[place] + APART * data.h
    return (acting(steps, data, less), acting(steps, data, more)), np.asarray(more[place] - less[place])


def _acted(steps: TransitionModel, data: GriddedTrials, values: Sequence[Sequence[float]]) -> np.ndarray:
    """The record (N, R, C) of ``data`` in parts of steps, as it acts."""
    names, record = list(steps.model.controls), data.record.copy()
    for symbol, by_window in zip(steps.late, values, strict=True):
        effect = EFFECTS[symbol.partition(".")[0]]
        moved = np.array([names.index(n) for n in effect.moves if n in names], dtype=int)
        for value in dict.fromkeys(by_window):
            own = np.flatnonzero(np.broadcast_to(by_window, record.shape[1]) == value)
            if value != 0.0 and len(moved):
                at = (slice(None), own[:, None], moved)
                record[at] = effect.acted(record[at], data.h / PARTS, value)
    return record
