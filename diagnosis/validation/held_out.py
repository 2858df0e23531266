"""How far the gap closes: the error of predictions of test trials before and after an effect is added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.estimation.acting_inputs import acting
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Linearisation, initial_trajectory, linearised_if_finite
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.noise_sizes import initial_noise, updated_noise
from diagnosis.estimation.parameters import active_states
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from fitting.prediction.score import STRIDE, WINDOW
from mmg.effects import EFFECTS
from mmg.motion.froude import state_scale, time_scale
from mmg.ship import Ship

# Draws of runs or blocks, for intervals. Set by hand: the ends of a 90 % interval are known to 0.05 standard errors.
DRAWS = 2000
MOST = 1e6  # Largest scaled squared error [-], also of a prediction that diverges. Set by hand: it bounds a mean.


def scales(length: float) -> np.ndarray:
    """Scale of an error of each state for a ship of a ``length`` [m].

    Returns (6,), at 3 m .3 m, .3 m, 5 deg, .05 m/s, .05 m/s, .01 rad/s.
    """
    return np.array([0.3, 0.3, np.radians(5.0), 0.05, 0.05, 0.01]) * state_scale(length)


@dataclass(frozen=True)
class WindowErrors:
    """Errors of W open-loop windows: their mean squared scaled errors, mean (W,); squared errors at their ends of the
    position [m^2] and of the heading [rad^2], end (W, 2), 0 where it was not measured; run: (W,) their runs."""

    mean: np.ndarray
    end: np.ndarray
    run: np.ndarray

    @staticmethod
    def joined(parts: Sequence[WindowErrors]) -> WindowErrors:
        """The windows of all ``parts``."""
        return WindowErrors(*(np.concatenate([getattr(p, f) for p in parts]) for f in ("mean", "end", "run")))


def errors(
    steps: TransitionModel,
    data: GriddedTrials,
    theta: np.ndarray,
    length: float,
    begin: np.ndarray | None = None,
    force: np.ndarray | None = None,
) -> WindowErrors:
    """Errors of open-loop windows of ``length`` seconds (0: whole runs).

    steps: the transition model; data: R windows of the test trials; theta: (all,) coefficients; begin: (K + 1, R, S)
    from ``start_states`` if known; force: (K, R, 3) that pushes the ship as well [N, N, N m]. Each window begins at its
    logged row, STRIDE seconds after the one before. A channel that was not measured does not count.
    """
    data = acting(steps, data, theta)
    starts: list[tuple[int, int]] = []
    rows, n = round(length / data.h), data.steps_of_sample
    for r, total in enumerate(data.steps.astype(int)):
        span = rows or max(total, 1)
        first = range(0, total - span + 1, n * max(1, round(STRIDE / (n * data.h))) if rows else span)
        starts += [(k, r) for k in first if data.measured[k, r, 2:].all()]
    if not starts:
        return WindowErrors(np.zeros(0), np.zeros((0, 2)), np.zeros(0, dtype=int))
    k0, r0 = np.array(starts).T
    count = np.full(len(k0), rows) if rows else data.steps[r0] - k0
    z = (start_states(steps, data, theta) if begin is None else begin)[k0, r0]
    sigma = scales(float(steps.ship.particulars["L"]))
    along = np.arange(int(count.max()))[:, None]
    at, row = (np.minimum(k0 + along + i, len(x) - 1) for i, x in enumerate((data.inputs, data.y)))
    pushed = None if force is None else force[at, r0]
    path = steps.follow(np.repeat(z[None], len(along) + 1, axis=0), data.controls[at, r0], theta, force=pushed)
    error = (steps.logged(path[1:], theta) - data.y[row, r0]) / sigma
    good = data.measured[row, r0] & (along < count)[..., None]
    square = np.where(good, np.minimum(np.nan_to_num(error**2, nan=MOST), MOST), 0.0)
    last = square[count - 1, np.arange(len(k0)), :3] * sigma[:3] ** 2  # [m2, m2, rad2]
    end = np.stack([last[:, 0] + last[:, 1], last[:, 2]], axis=1)
    return WindowErrors(square.sum(axis=(0, 2)) / np.maximum(good.sum(axis=(0, 2)), 1), end, data.run[r0])


def start_states(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> np.ndarray:
    """States (K + 1, R, S) at the logged rows, from which a prediction may begin.

    steps: the transition model; data: the trials; theta: (all,) coefficients. Lagged states of actuators and forces
    follow from the inputs and the logged motion before; those of sensors are at their steady values.
    """
    data = acting(steps, data, theta)
    names = steps.model.states
    sensors = {name for name, effect in EFFECTS.items() if effect.measures}
    carried = np.array([i for i, s in enumerate(names) if "." in s and s.split(".")[0] not in sensors], dtype=int)
    K, R = data.inputs.shape[:2]
    inputs = np.concatenate([data.inputs, data.inputs[-1:]])
    z = steps.settled(data.y.reshape(-1, 6).T, inputs.reshape((K + 1) * R, -1).T, theta).T.reshape(K + 1, R, -1)
    if not len(carried):
        return z
    logged = np.asarray(data.measured[..., 2:].all(axis=2))
    return steps.follow(z, data.controls, theta, carried, whole=~logged[1:])


def window_length(ship: Ship) -> float:
    """Seconds of a window for the length of ``ship``: WINDOW of a 3 m model."""
    return WINDOW * time_scale(ship.particulars["L"])


def window_words(ship: Ship) -> str:
    """``window_length`` of ``ship`` as pages and files say it: "30 s" of a 3 m model."""
    return f"{window_length(ship):.0f} s"


FEW = 3  # Runs below which blocks of neighbouring windows are drawn instead of runs. Set by hand.
TOGETHER = 4  # Windows of such a block. Set by hand.


def redrawn_means(columns: Sequence[np.ndarray], run: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Means (DRAWS, k) of k ``columns`` (W,) of windows whose runs ``run`` (W,) are drawn again (block bootstrap), or
    blocks of TOGETHER neighbouring windows where runs are few; rng: random numbers."""
    if len(np.unique(run)) < FEW:
        run = np.arange(len(run)) // TOGETHER + 1000 * run  # no block holds windows of two runs
    runs = np.unique(run)
    sums = np.array([[x[run == r].sum() for r in runs] for x in columns])
    counts = np.array([(run == r).sum() for r in runs])
    at = rng.choice(len(runs), (DRAWS, len(runs)))
    return np.asarray((sums[:, at].sum(axis=2) / counts[at].sum(axis=1)).T)


def interval_of(a: np.ndarray, b: np.ndarray, run: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """90 % interval of the reduction 1 - sum(b) / sum(a), by drawing runs again.

    a, b: (W,) errors of the windows before and after; run: (W,) their runs; rng: random numbers.
    """
    before, after = redrawn_means((a, b), run, rng).T
    low, high = np.quantile(1 - after / np.maximum(before, 1e-300), [0.05, 0.95])
    return float(low), float(high)


# A model with the test trials that it is to predict, and a fit of it
Predicted = tuple[TransitionModel, GriddedTrials, Estimate]


def compare(before: Predicted, after: Predicted, seed: int = 0) -> HeldOut | None:
    """Errors of the same test trials by two fits, ``before`` and ``after``, with intervals by drawing runs again; None
    where the windows differ, or without a whole one. seed: of the draws."""
    metric, horizons, windows = window_words(before[0].ship), dict[str, tuple[float, float]](), list[WindowErrors]()
    acted = [acting(steps, data, fit.theta) for steps, data, fit in (before, after)]  # once, for the lengths
    sides = [(steps, a, fit.theta) for (steps, _, fit), a in zip((before, after), acted, strict=True)]
    begins = [start_states(*side) for side in sides]
    data = before[1]
    for name, length in (("1 step", data.h), (metric, window_length(before[0].ship)), ("whole run", 0.0)):
        found = [errors(*side, length, begin) for side, begin in zip(sides, begins, strict=True)]
        if not len(found[0].run):
            return None
        horizons[name] = float(found[0].mean.mean()), float(found[1].mean.mean())
        windows = found if name == metric else windows
    a, b, run = windows[0].mean, windows[1].mean, windows[0].run
    if len(a) != len(b):
        return None
    mean = horizons[metric]
    return HeldOut(
        mse_before=mean[0],
        mse_after=mean[1],
        reduction=1 - mean[1] / max(mean[0], 1e-300),
        interval_90=interval_of(a, b, run, np.random.default_rng(seed)),
        windows=len(a),
        by_run={data.trials[r]: (float(a[run == r].mean()), float(b[run == r].mean())) for r in np.unique(run)},
        metric=metric,
        horizons=horizons,
    )


SETTLED = 0.1  # Change of log likelihood from which a filter along other trials has settled. Set by hand.
FITS = 20  # Linearisations of it at most: where hardly any random force acts, its size falls step by step. Set by hand.


def likelihood_of(here: Linearisation) -> np.ndarray:
    """Negative log likelihood of one-step predictions of each window (R,) of the trials that were followed ``here``."""
    return np.asarray(0.5 * (here.filter.log_det + (here.left**2).sum(axis=(0, 2))))


@np.errstate(all="ignore")
def filtered_along(
    steps: TransitionModel, data: GriddedTrials, fit: Estimate, near: Linearisation | None = None
) -> Linearisation | None:
    """The filter along other trials, its path and latent force those that are most likely; None where they explode.

    steps: the transition model; data: the trials; fit: the fit; near: of another fit along them, from which it begins.
    The sizes of the noise, which say nothing of the ship, are those that
    make the other trials most likely: in its own trials an effect that explains a little of all leaves too little.
    """
    active = active_states(steps, fit.free.symbols, fit.theta)
    path = initial_trajectory(steps, data, fit.theta) if near is None else near.at.path
    noise = fit.noise if near is None else near.at.noise.with_(tau=fit.noise.tau)
    best, share, typical = None, 1.0, initial_noise(steps.ship)
    for _ in range(FITS):
        here = linearised_if_finite(steps, data, replace(fit.fixed(), path=path, noise=noise), active)
        if best is None and here is None:
            return None if near is None else filtered_along(steps, data, fit)
        if best is not None and (here is None or here.nll > best.nll + SETTLED):
            share *= 0.3  # the step was too far
        elif here is not None:
            is_settled = best is not None and best.nll - here.nll < SETTLED
            best, share, start = here, 1.0, path
            if is_settled:
                break
            mean, r, u = here.smoothed()
            following = updated_noise(here, r, u, typical)
        assert best is not None
        noise = best.at.noise.towards(following, share)
        z = start.z.copy()
        z[..., active] += share * mean[..., : len(active)]
        path = start.moved(z, share * mean[..., len(active) : len(active) + 5], data.gusts)
    return best
