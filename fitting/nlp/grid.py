"""Trials on a uniform grid of time: pieces without gaps, interpolated states, mean inputs over each step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cases.inputs import STANDARD, model_inputs, step_means
from cases.trial import Trial
from mmg.motion.froude import reference_speed


@dataclass(frozen=True)
class Grid:
    """One piece of a trial on a uniform grid of step h.

    t: (N+1,) grid times [s]; states: (N+1, 6), NaN where not measured; controls: (N, C), the mean over each step of
    the inputs of the model.
    """

    t: np.ndarray
    states: np.ndarray
    controls: np.ndarray


def grids(
    trial: Trial, h: float, inputs: Sequence[str] = STANDARD, means: Callable[..., np.ndarray] = step_means
) -> list[Grid]:
    """The gap-free pieces of a ``trial`` on grids of step h [s], for a model with these ``inputs``.

    means: how samples of the inputs (N, C) become means over steps (``step_means``: each is held until the next).
    """
    result = []
    states, controls = trial.states, model_inputs(trial, inputs).array
    good = np.flatnonzero(np.isfinite(np.column_stack([states[:, 2:], controls])).all(axis=1))
    gaps = np.flatnonzero(np.diff(trial.t[good]) > max(2.5 * trial.dt, 2.0 * h)) + 1
    for rows in np.split(good, gaps) if len(good) else []:
        t = trial.t[rows]
        count = int(np.floor((t[-1] - t[0]) / h + 1e-9))
        if count < 1:
            continue
        edges = t[0] + h * np.arange(count + 1)
        on_grid = np.column_stack([_interpolate(edges, t, states[rows, j]) for j in range(6)])
        result.append(Grid(edges, on_grid, means(t, controls[rows], edges)))
    return result


def _interpolate(at: np.ndarray, t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear interpolation; NaN where a neighbouring sample is missing."""
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(at), np.nan)
    out = np.interp(at, t[good], values[good])
    if not good.all():
        position = np.clip(np.searchsorted(t, at - 1e-9), 0, len(t) - 1)
        out[~(good[position] & good[np.maximum(position - 1, 0)])] = np.nan
    return out


def default_step(trials: Sequence[Trial], length: float) -> float:
    """Integration step [s] for ``trials`` of a ship of this ``length`` [m].

    A twentieth of the time to travel a ship length at rms speed, at least the sampling time, rounded to 1, 2 or 5 times
    a power of ten, and then to whole samples: states are compared where they were measured, not interpolated.
    """
    u2 = np.concatenate([t["u"] ** 2 + t["v"] ** 2 for t in trials])
    speed = max(float(np.sqrt(np.nanmean(u2))), 0.02 * reference_speed(length))
    dt = max(t.dt for t in trials)
    wanted = max(0.05 * length / speed, dt)
    decade = 10 ** np.floor(np.log10(wanted))
    step = float(min((c * decade for c in (1, 2, 5, 10)), key=lambda s: abs(np.log(s / wanted))))
    samples = max(1, int(np.floor(step / dt + 0.5 - 1e-6)))
    return step if abs(step / dt - samples) < 1e-3 else samples * dt
