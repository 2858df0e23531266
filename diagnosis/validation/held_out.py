"""How far the gap closes: trials that took no part, predicted before and after an effect is added."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from diagnosis.estimation.candidates import Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import smoothed
from diagnosis.estimation.linearisation import Trajectory, initial_trajectory, linearise_and_filter
from diagnosis.estimation.map_estimate import Estimate, estimate, initial_point
from diagnosis.estimation.parameters import Priors, active_states, mean_over_windows
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import HeldOut
from mmg.effects import EFFECTS
from mmg.model import Model, columns
from mmg.motion.froude import state_scale, time_scale
from mmg.ship import Ship

WINDOW, STRIDE = 30.0, 15.0
"""Seconds of a window and between their starts."""
DRAWS = 2000


class Stepper(Protocol):
    """What predicts step by step: ``TransitionModel`` of a ship, or a ship with a learned residual."""

    ship: Ship
    model: Model

    def settled(self, six: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) that are logged as (6, M) under inputs (C, M)."""

    def advance(self, z: np.ndarray, controls: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """States (S, M) a step later."""


def scales(length: float) -> np.ndarray:
    """What an error of each state is measured by (6,): .3 m, .3 m, 5 deg, .05 m/s, .05 m/s, .01 rad/s at 3 m length."""
    return np.array([0.3, 0.3, np.radians(5.0), 0.05, 0.05, 0.01]) * state_scale(length)


def errors(
    steps: Stepper,
    data: GriddedTrials,
    theta: np.ndarray,
    length: float,
    later: bool = False,
    begin: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean squared scaled errors of open-loop windows of ``length`` seconds (0: whole runs), by window, and their run.

    Each begins at its logged row, with what actuators and forces remember of the run before it (``begun``); of two
    windows one begins STRIDE seconds after the other. A channel that was not measured does not count. theta: (all,), or
    (all, R) by window of the data; later: in the second half of each run; begin: ``begun`` if it is known already.
    """
    half = halves(data) if later else data.t[0]
    starts: list[tuple[int, int]] = []
    rows = round(length / data.h)
    for r, total in enumerate(data.steps.astype(int)):
        start = min(int(np.searchsorted(data.t[: total + 1, r], half[r])), total)
        span = rows or max(total - start, 1)
        first = range(start, total - span + 1, max(1, round(STRIDE / data.h)) if rows else span)
        starts += [(k, r) for k in first if data.measured[k, r, 2:].all()]
    if not starts:
        return np.zeros(0), np.zeros(0, dtype=int)
    k0, r0 = np.array(starts).T
    count = np.full(len(k0), rows) if rows else data.steps[r0] - k0
    z = (begun(steps, data, theta) if begin is None else begin)[k0, r0].T
    theta = theta[:, r0] if theta.ndim > 1 else theta
    sigma = scales(float(steps.ship.particulars["L"]))
    total, seen = np.zeros(len(k0)), np.zeros(len(k0))
    for k in range(int(count.max())):
        at = np.minimum(k0 + k, len(data.inputs) - 1)
        z = steps.advance(z, data.inputs[at, r0].T, theta)
        row = np.minimum(k0 + k + 1, len(data.y) - 1)
        error = (columns(steps.model, z, theta).T - data.y[row, r0]) / sigma
        good = data.measured[row, r0] & (k < count)[:, None]
        square = np.where(good, np.minimum(np.nan_to_num(error**2, nan=1e6), 1e6), 0.0)
        total += square.sum(axis=1)
        seen += good.sum(axis=1)
    return total / np.maximum(seen, 1), data.run[r0]


def begun(steps: Stepper, data: GriddedTrials, theta: np.ndarray) -> np.ndarray:
    """States (K + 1, R, S) at the logged rows, from which a prediction may begin.

    What actuators and forces remember follows from the inputs and the logged motion before; what a sensor remembers is
    settled, since the motion behind its log is not known.
    """
    names = steps.model.states
    carried = np.array([i for i, s in enumerate(names) if "." in s and not _of_sensor(s)], dtype=int)
    K, R = data.inputs.shape[:2]
    inputs = np.concatenate([data.inputs, data.inputs[-1:]])
    every = np.tile(theta, (1, K + 1)) if theta.ndim > 1 else theta
    z = steps.settled(data.y.reshape(-1, 6).T, inputs.reshape((K + 1) * R, -1).T, every).T.reshape(K + 1, R, -1)
    if not len(carried):
        return z
    logged = np.asarray(data.measured[..., 2:].all(axis=2))
    for k in range(K):
        end = steps.advance(z[k].T, inputs[k].T, theta).T
        z[k + 1][:, carried] = end[:, carried]
        z[k + 1] = np.where(logged[k + 1, :, None], z[k + 1], end)
    return z


def _of_sensor(state: str) -> bool:
    """Whether a state is the memory of an effect of the measurement."""
    name = state.split(".")[0]
    return name in EFFECTS and EFFECTS[name].measures


def halves(data: GriddedTrials) -> np.ndarray:
    """Time at which the second half of the run of each window begins, (R,) [s]."""
    ends = np.array([data.t[n, r] for r, n in enumerate(data.steps)])
    return np.array([0.5 * (data.t[0, data.run == r].min() + ends[data.run == r].max()) for r in data.run])


def in_their_runs(steps: TransitionModel, data: GriddedTrials, found: Estimate) -> Estimate:
    """A fit with parameters by run, on other trials: theirs follow from the first half of each run.

    What is known of them before is their mean and scatter over the runs of the fit; all else stays as it is.
    """
    own_columns = [c for c in found.free.columns if c.run is not None]
    symbols = dict.fromkeys(c.symbol for c in own_columns)
    values = [np.array([found.value(*c) for c in own_columns if c.symbol == s]) for s in symbols]
    runs = np.unique(data.run)
    columns_of = tuple(Column(s, r) for r in runs for s in symbols)
    mean, std = (np.tile([f(v) for v in values], len(runs)) for f in (np.mean, lambda v: np.std(v) + 1e-9))
    unbounded = np.full(len(columns_of), np.inf)
    theta = mean_over_windows(found.theta)
    first = replace(data, good=data.good & (data.t < halves(data))[..., None])
    own = Priors(columns_of, mean, std, -unbounded, unbounded)
    start = initial_point(steps, first, theta, own, found.noise)
    return replace(found, theta=estimate(steps, first, start, iterations=6, fixed_noise=True).theta)


def window_length(ship: Ship) -> float:
    """Seconds of a window: WINDOW of a 3 m model."""
    return WINDOW * time_scale(ship.particulars["L"])


FEW, TOGETHER = 3, 4
"""With fewer runs than this, so many neighbouring windows are drawn together instead of runs."""


def interval_of(a: np.ndarray, b: np.ndarray, run: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """90 % interval of 1 - sum(b) / sum(a), errors by window before and after, by drawing the runs again.

    Of FEW runs, neighbouring windows are drawn together instead.
    """
    if len(np.unique(run)) < FEW:
        run = np.arange(len(a)) // TOGETHER + 1000 * run
    runs = np.unique(run)
    sums = np.array([[x[run == r].sum() for r in runs] for x in (a, b)])
    draws = rng.choice(len(runs), (DRAWS, len(runs)))
    lost = 1 - sums[1][draws].sum(axis=1) / np.maximum(sums[0][draws].sum(axis=1), 1e-300)
    low, high = np.quantile(lost, [0.05, 0.95])
    return float(low), float(high)


@dataclass(frozen=True)
class _Measured:
    """What a fit predicts: errors of windows and their run, of whole runs and of one step, log likelihood by window."""

    windows: np.ndarray
    run: np.ndarray
    whole: float
    step: float
    nll: np.ndarray


def _measured(steps: TransitionModel, data: GriddedTrials, found: Estimate, later: bool) -> _Measured | None:
    """None without a whole window."""
    begin = begun(steps, data, found.theta)
    lengths = (window_length(steps.ship), 0.0, data.h)
    (windows, run), (whole, _), (step, _) = (errors(steps, data, found.theta, x, later, begin) for x in lengths)
    if not len(windows):
        return None
    if later:
        data = replace(data, good=data.good & (data.t >= halves(data))[..., None])
    return _Measured(windows, run, float(whole.mean()), float(step.mean()), one_step_likelihood(steps, data, found))


def compare(
    steps: TransitionModel, data: GriddedTrials, before: Estimate, after: Estimate, seed: int = 0
) -> HeldOut | None:
    """Windows by two fits, with an interval of the reduction by drawing runs again; None without a whole window."""
    later = after.free.by_run
    a = _measured(steps, data, before, later)
    b = a if after is before else _measured(steps, data, in_their_runs(steps, data, after) if later else after, later)
    if a is None or b is None:
        return None
    rng = np.random.default_rng(seed)
    interval = interval_of(a.windows, b.windows, a.run, rng)
    gain = a.nll - b.nll
    gains = np.array([gain[data.run == r].sum() for r in np.unique(data.run)])
    drawn = gains[rng.choice(len(gains), (DRAWS, len(gains)))].sum(axis=1)
    low, high = (float(x) for x in np.quantile(drawn, [0.05, 0.95]))
    mean = float(a.windows.mean()), float(b.windows.mean())
    each = {data.trials[r]: (a.windows[a.run == r], b.windows[a.run == r]) for r in np.unique(a.run)}
    return HeldOut(
        mse_before=mean[0],
        mse_after=mean[1],
        reduction=1 - mean[1] / max(mean[0], 1e-300),
        interval_90=interval,
        windows=len(a.windows),
        by_run={name: (float(x.mean()), float(y.mean())) for name, (x, y) in each.items()},
        likelihood_gain=float(gains.sum()),
        likelihood_interval_90=(low, high) if len(gains) >= FEW else None,
        horizons={"1 step": (a.step, b.step), "30 s": mean, "whole run": (a.whole, b.whole)},
    )


@np.errstate(all="ignore")
def one_step_likelihood(
    steps: TransitionModel, data: GriddedTrials, found: Estimate, iterations: int = 4
) -> np.ndarray:
    """Negative log likelihood of each window (R,) of other trials at the coefficients and noise of a fit."""
    active = active_states(steps, found.free.symbols, found.theta)
    path = initial_trajectory(steps, data, found.theta)
    for k in range(iterations):
        linearised = linearise_and_filter(steps, data, replace(found.fixed(), path=path), active)
        if k == iterations - 1:
            break
        mean, _, _ = smoothed(
            linearised.system, linearised.filter, linearised.white[..., -1], linearised.states[..., -1]
        )
        z = path.z.copy()
        z[..., active] += mean[..., : len(active)]
        path = Trajectory(z, path.force + mean[..., len(active) : len(active) + 3])
    return 0.5 * (linearised.filter.log_det + (linearised.white[..., -1] ** 2).sum(axis=(0, 2)))
