"""Trials on one time grid: windows side by side, with masks of missing values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.inputs import is_sampled, step_means, straight_means
from cases.trial import Trial
from fitting.nlp.windows import default_step, pieces_of
from mmg.errors import TooFewData
from mmg.motion.froude import time_scale
from mmg.ship import Ship

LONGEST = 600  # Steps of a window; a longer piece is divided evenly: the filter is fast at windows side by side
SHORTEST = 20  # Steps of a window; a shorter piece is left out. Set by hand.
# Sampling time [s of a 3 m model] beyond which half a sample of the actuators is as long as a delay. Set by hand.
COARSE = 0.2
PARTS = 8  # Parts of a step whose means give the change of an input over it. Set by hand.
EVEN = 0.02  # Share of the sampling time by which a sample may be off a grid that parts of it make. Set by hand.
# Seconds [of a 3 m model] at the start of a window that are simulated but not compared: delays have no past there.
RUN_IN = 3.0  # set by hand
# Seconds [of a 3 m model] before a window of which the inputs are kept: twice the longest delay or lag.
BEFORE = 20.0  # set by hand


@dataclass(frozen=True)
class GriddedTrials:
    """Windows of trials on a grid of step h [s]; R windows of at most K steps, padded at their ends.

    Attributes
    ----------
    h: step [s]; t: (K + 1, R) time since the start of the run [s].
    y: (K + 1, R, 6) logged x, y, psi, u, v, r [m, m, rad, m/s, m/s, rad/s]; measured: (K + 1, R, 6) whether each was
    measured; good: (K + 1, R, 6) whether it is compared (measured, and not in the first RUN_IN seconds of a window).
    inputs: (K, R, C) of the model, means over each step; steps: (R,) steps of each window.
    run: (R,) number of the trial of each window; trials: their names; dropped: sentences on what was left out.
    changes: (K, R, C) by which inputs rise from the start to the end of each step (of the line with the same mean and
    first moment); sample: longest sampling time of the trials [s]; is_even: all have a sample that often; straight:
    inputs were joined by lines between samples, not held.
    record: (N, R, C) of the inputs, means over PARTS of each step, with what was before the first one;
    acting_at: values of what makes ``inputs`` and ``changes`` late of it, by window where they differ, (): nothing.
    gusts: (K, R, 3, 2) force X, Y, N [N, N, N m] over each step by a gust of the wind's own speed, along it and across;
    None: none are thought of (``with_gusts``).
    """

    h: float
    t: np.ndarray
    y: np.ndarray
    good: np.ndarray
    measured: np.ndarray
    inputs: np.ndarray
    steps: np.ndarray
    run: np.ndarray
    trials: tuple[str, ...]
    changes: np.ndarray
    record: np.ndarray
    sample: float
    dropped: tuple[str, ...] = ()
    is_even: bool = True
    straight: bool = False
    acting_at: tuple[tuple[float, ...], ...] = ()
    gusts: np.ndarray | None = None

    @property
    def inside(self) -> np.ndarray:
        """Which steps exist, (K, R)."""
        return np.arange(len(self.inputs))[:, None] < self.steps[None]

    @property
    def controls(self) -> np.ndarray:
        """Inputs and their changes over each step, (K, R, 2 C), as ``TransitionModel`` takes them."""
        return np.concatenate([self.inputs, self.changes], axis=2)

    @property
    def samples(self) -> int:
        """Number of grid times with anything measured, over all windows."""
        return int(self.good.any(axis=2).sum())

    @property
    def steps_of_sample(self) -> int:
        """Steps from one sample to the next, 1 where a step holds one or more."""
        return max(1, round(self.sample / self.h))  # never 0, where a step holds several samples

    def windows(self, chosen: np.ndarray) -> GriddedTrials:
        """Those of the R windows that are ``chosen`` (R,), of trials whose inputs are as they were logged."""
        at = np.flatnonzero(chosen)
        by_window = ("t", "y", "measured", "good", "inputs", "changes", "record", "gusts")
        own = {name: getattr(self, name)[:, at] for name in by_window if getattr(self, name) is not None}
        return replace(self, **own, steps=self.steps[at], run=self.run[at])

    def thinned(self, every: int) -> GriddedTrials:
        """The same with one in ``every`` samples on the grid compared."""
        sample = np.arange(len(self.good)) // self.steps_of_sample
        return replace(self, good=self.good & (sample % every == every - 1)[:, None, None])


def grid_trials(
    trials: Sequence[Trial], ship: Ship, step: float | None = None, straight: bool = False
) -> GriddedTrials:
    """The ``trials`` of a ``ship`` on a grid.

    step: of the grid [s] (default: that of the calibration); straight: the inputs are interpolated linearly instead of
    held between samples. Raises UserError when no piece without a gap is long enough.
    """
    inputs, length = ship.inputs, float(ship.particulars["L"])
    h = step or default_step(trials, length)
    before = math.ceil(BEFORE * time_scale(length) / h)
    means, C = with_changes(straight_means if straight else step_means), len(inputs)  # columns: means, changes, parts
    long = [piece for piece in pieces_of(trials, h, inputs, means) if piece.steps >= SHORTEST]
    # -(-a // b): rounded up
    pieces = [part for piece in long for part in piece.evenly(max(1, -(-piece.steps // LONGEST)))]
    dropped = []
    for number, trial in enumerate(trials):
        lost = trial.t[-1] - trial.t[0] - h * sum(piece.steps for piece in long if piece.run == number)  # [s]
        if lost > SHORTEST * h:
            dropped.append(f"{trial.name}: {lost:.0f} s lie in gaps or in pieces too short between them")
    if not pieces:
        names = ", ".join(t.name for t in trials)
        raise TooFewData(f"{names}: nothing to diagnose, no piece is longer than {SHORTEST * h:g} s without a gap")
    K, R = max(p.steps for p in pieces), len(pieces)
    t, y = np.zeros((K + 1, R)), np.full((K + 1, R, 6), np.nan)
    held = np.zeros((K, R, 2 * C))
    record = np.zeros((PARTS * (before + K), R, C))
    for i, p in enumerate(pieces):
        n, end = p.steps, PARTS * (before + p.steps)
        known = p.record.controls[max(0, p.first - before) : p.last, 2 * C :].reshape(-1, C)
        record[: end - len(known), i], record[end - len(known) : end, i], record[end:, i] = known[0], known, known[-1]
        t[: n + 1, i], t[n + 1 :, i] = p.t, p.t[-1]
        held[:n, i], held[n:, i] = p.controls[:, : 2 * C], p.controls[-1, : 2 * C]
        y[: n + 1, i] = _at_samples(p.t, p.logged, trials[p.run], h)
    measured = np.isfinite(y)
    good = measured.copy()
    good[: round(RUN_IN * time_scale(length) / h)] = False  # delays have no past there
    return GriddedTrials(
        h=h,
        t=t,
        y=np.nan_to_num(y),
        good=good,
        measured=measured,
        inputs=held[..., :C],
        changes=held[..., C:],
        sample=max(t.dt for t in trials),
        is_even=can_divide(trials, max(t.dt for t in trials)),
        steps=np.array([p.steps for p in pieces]),
        run=np.array([p.run for p in pieces]),
        trials=tuple(trial.name for trial in trials),
        dropped=tuple(dropped),
        straight=straight,
        record=record,
    )


def grids_as_read(
    trials: Sequence[Trial], ship: Ship, step: float | None = None, straight: bool | None = None
) -> list[GriddedTrials]:
    """The ``trials`` as of ``grid_trials`` in each way that their actuators may be read: held, and joined by lines.

    ship, step, and errors: as there; straight: how they are read, where it is known.
    """
    readings = possible_readings(trials) if straight is None else (straight,)
    return [grid_trials(trials, ship, step, reading) for reading in readings]


def can_divide(trials: Sequence[Trial], sample: float) -> bool:
    """Whether all ``trials`` have a sample every ``sample`` [s]: states are compared where they were measured."""
    gaps = np.concatenate([np.diff(t.t) for t in trials])
    return bool(np.all(np.abs(gaps / sample - np.maximum(1, np.round(gaps / sample))) < EVEN))


def _at_samples(times: np.ndarray, states: np.ndarray, trial: Trial, h: float) -> np.ndarray:
    """The ``states`` (N + 1, 6) on the grid ``times`` [s] of step h [s], NaN between samples of the ``trial``."""
    if h > 0.9 * trial.dt:
        return states
    at = np.clip(np.searchsorted(trial.t, times), 1, len(trial.t) - 1)  # the sample behind; that before is at - 1
    away = np.minimum(np.abs(trial.t[at] - times), np.abs(times - trial.t[at - 1]))
    return np.where((away < EVEN * trial.dt)[:, None], states, np.nan)


def with_changes(means: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """``means`` over steps with, behind them, changes over each step and means over its parts.

    They are an array (K, M), M = (2 + PARTS) C.
    """

    def both(t: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
        at = np.interp(np.arange((len(edges) - 1) * PARTS + 1) / PARTS, np.arange(len(edges)), edges)
        parts = means(t, values, at)
        return np.hstack([*means_and_changes(parts), parts.reshape(len(edges) - 1, -1)])

    return both


def means_and_changes(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over steps and changes over each (K, ...): of the line with the same mean and first moment.

    parts: (K PARTS, ...) means over PARTS of each step.
    """
    parts = parts.reshape(-1, PARTS, *parts.shape[1:])
    place = (np.arange(PARTS) + 0.5) / PARTS - 0.5
    return parts.mean(axis=1), np.einsum("kp...,p->k...", parts, place) / (place @ place)


def possible_readings(trials: Sequence[Trial]) -> tuple[bool, ...]:
    """Whether the actuators of ``trials`` may be joined by straight lines between samples: (False,) where a sidecar
    says what they are (``cases.inputs`` has joined those that are sampled), and of an order, which moves in single
    steps; (False, True) of angles that move over several samples."""
    if all(is_sampled(trial) is not None for trial in trials) or any(is_sampled(trial) for trial in trials):
        return (False,)
    alone, whole = 0.0, 0.0
    for trial in trials:
        for name in ("delta", "delta_port"):
            if name not in trial:
                continue
            d = np.abs(np.diff(np.nan_to_num(trial[name])))
            moves = np.concatenate([[False], d > 1e-6, [False]])
            single = moves[1:-1] & ~moves[:-2] & ~moves[2:]
            alone, whole = alone + float(d[single].sum()), whole + float(d.sum())
    return (False,) if alone > 0.5 * whole else (False, True)  # an order jumps, an angle moves over several samples
