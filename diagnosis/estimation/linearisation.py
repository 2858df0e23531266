"""The model linearised about a path and whitened by a Kalman filter, as a Gauss-Newton step needs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from diagnosis.estimation.acting_inputs import acting, linearised, logdet_gradient
from diagnosis.estimation.filtering import fastest
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import (
    Adjoint,
    DrivenColumns,
    Filtered,
    LinearSystem,
    NoiseModel,
    ProductColumns,
    linear_system,
)
from diagnosis.estimation.parameters import NO_PRIORS, Priors, active_in_window, active_states, set_values
from diagnosis.estimation.transition_model import LinearModel, TransitionModel, spread
from mmg.model import settled
from mmg.motion.flow import INPUTS
from mmg.motion.froude import state_scale
from mmg.ship import Ship


@dataclass(frozen=True)
class Trajectory:
    """States z (K + 1, R, S), latent force (K + 1, R, 3) [N, N, N m]; gust: (K + 1, R, 2) of gusts along and across the
    wind [share of its speed], None: none; gusts: what these push by, as of ``GriddedTrials``."""

    z: np.ndarray
    force: np.ndarray
    gust: np.ndarray | None = None
    gusts: np.ndarray | None = None

    @property
    def push(self) -> np.ndarray:
        """Latent force and that of gusts together, (K + 1, R, 3) [N, N, N m]."""
        if self.gust is None or self.gusts is None:
            return self.force
        push = self.force.copy()
        # a gust [share] times what one of the wind's speed pushes by
        push[:-1] += (self.gusts @ self.gust[:-1, ..., None])[..., 0]
        return push

    def moved(self, z: np.ndarray, mean: np.ndarray, gusts: np.ndarray | None) -> Trajectory:
        """Other states, and the forces and gusts changed.

        z: (K + 1, R, S); mean: (K + 1, R, 3 or more) by which latent force and gusts change, in the order of the
        filter's states; gusts: as of the trials.
        """
        force = self.force + mean[..., :3]
        if gusts is None:
            return Trajectory(z, force)
        gust = mean[..., 3:5] if self.gust is None else self.gust + mean[..., 3:5]
        return Trajectory(z, force, gust, gusts)


@dataclass(frozen=True)
class Point:
    """Where a model is linearised.

    theta: (all,) coefficients of the full model, or (all, R) by window; free: priors of the free parameters; p: (P,)
    their values in theta, less the prior mean, in prior std; path; noise.
    """

    theta: np.ndarray
    free: Priors
    p: np.ndarray
    path: Trajectory
    noise: NoiseModel

    def with_values(self, ship: Ship, data: GriddedTrials, p: np.ndarray) -> Point:
        """The same with other ``p`` (P,), cut to the bounds; ship, data: as of ``set_values``."""
        p = np.clip(p, *self.free.scaled_bounds)
        theta = set_values(ship, data, self.theta, self.free.columns, self.free.mean + self.free.std * p)
        return Point(theta, self.free, p, self.path, self.noise)

    def fixed(self) -> Point:
        """The same with nothing free."""
        return Point(self.theta, NO_PRIORS, np.zeros(0), self.path, self.noise)


# More columns of a linearisation, in parts, side by side.
ExtraColumns = Callable[[LinearModel], Sequence[DrivenColumns | ProductColumns]]


@dataclass(frozen=True)
class Linearisation:
    """Model and filter about a point; P free parameters and extra columns, n states of the filter.

    steps, data, at, active: model, trials, point and active states that it was made of; parts: the columns, those of
    the free parameters first; left: (K + 1, R, 6) whitened responses of the negative residual; states: (K + 1, R, n)
    its predicted states; residual: it as a column; size: (R, P) prior std of the free parameters, 0 in windows where
    they do not act; nll: as of an ``Estimate``; rows: grid times of ``white``, None: all. What follows is made when it
    is first asked for.
    """

    steps: TransitionModel
    data: GriddedTrials
    at: Point
    active: np.ndarray
    linear: LinearModel
    system: LinearSystem
    filter: Filtered
    parts: tuple[DrivenColumns | ProductColumns, ...]
    left: np.ndarray
    states: np.ndarray
    residual: DrivenColumns
    size: np.ndarray
    nll: float
    rows: np.ndarray | None = None

    @cached_property
    def white(self) -> np.ndarray:
        """Whitened responses (K + 1, R, 6, P + 1) of the columns per prior std, and last those of the negative
        residual, or of these the ``rows`` alone."""
        last = self.left if self.rows is None else self.left[self.rows]
        white, end = np.empty((*last.shape, sum(part.width for part in self.parts) + 1)), 0
        for block in (block for part in self.parts for block in part.blocks()):
            begin, end = end, end + block.width
            fastest().whitened(self.system, self.filter, block, white[..., begin:end], rows=self.rows)
        white[..., -1] = last  # the residual stands last, so that products with it are the last row
        return white

    @cached_property
    def adjoint(self) -> Adjoint:
        """Derivatives of 1/2 log det."""
        return fastest().adjoint(self.system, self.filter)

    @cached_property
    def by_rates(self) -> np.ndarray:
        """Derivative (K, R, A, A + 3) of 1/2 log det by the Jacobian of the rates by states and latent force in the
        middle of each step [1/s]."""
        return fastest().by_rates(self.system, self.adjoint.by_T, self.data.h, self.data.gusts)

    @cached_property
    def logdet_gradient(self) -> np.ndarray:
        """Derivative (R, P) of 1/2 log det by the columns, by window; 0 for extra columns."""
        free, path, A = self.at.free, self.at.path, len(self.active)
        push = path.push[:-1]
        given = (path.z, self.data.inputs, self.at.theta, push, self.by_rates, self.adjoint.by_Z[..., :A])
        positions = column_positions(self.steps, free)
        own = self.steps.logdet_gradient(*given, positions, self.active) * self.size
        gradient = np.zeros((len(self.data.run), self.white.shape[3] - 1))
        at, late = logdet_gradient(
            self.steps, self.data, self.at.theta, path.z, push, self.by_rates, positions, self.active
        )
        own[:, at] = late * self.size[:, at]
        gradient[:, : own.shape[1]] = own
        return gradient

    def smoothed(self, dp: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Smoothed states (K + 1, R, n), and the smoother's r (K, R, n) and u (K + 1, R, 6), when the free parameters
        have moved by dp (P,) [prior std] (default: not at all)."""
        white, states = self.left, self.states
        if dp is not None and len(dp):
            move = self.size * dp  # (R, P) in units of the parameters
            pushed, seen = self.residual.forcing.copy(), self.residual.observed.copy()
            pushed[:, :, : self.linear.G.shape[2], 0] += (self.linear.G @ move[:, :, None])[..., 0]
            seen[..., 0] += np.einsum("krld,rd->krl", self.linear.observed, move[:, self.linear.observing])
            column = DrivenColumns.dense(pushed, seen, self.residual.start)  # the residual at the moved parameters
            white, states = (x[..., 0] for x in fastest().whitened(self.system, self.filter, column, with_states=True))
        return fastest().smoothed(self.system, self.filter, white, states)


def initial_trajectory(steps: TransitionModel, data: GriddedTrials, theta: np.ndarray) -> Trajectory:
    """The measured states of ``data`` without latent force; missing ones are interpolated in time, or zero.

    steps: model, whose memory states are settled; theta: coefficients (all,) or by window (all, R).
    """
    data = acting(steps, data, theta)
    y, measured = data.y.copy(), data.measured
    rows = np.arange(len(y))
    for r in range(y.shape[1]):
        for j in range(6):
            if not measured[:, r, j].all():
                known = measured[:, r, j]
                y[:, r, j] = np.interp(rows, rows[known], y[known, r, j]) if known.any() else 0.0
    K1, R = y.shape[:2]
    controls = np.concatenate([data.inputs, data.inputs[-1:]]).reshape(K1 * R, -1).T
    every = spread(theta, K1 * R) if theta.ndim > 1 else theta
    z = steps.settled(y.reshape(K1 * R, 6).T, controls, every)
    return Trajectory(z.T.reshape(K1, R, -1), np.zeros((K1, R, 3)))


# Standard deviations of x, y, psi, u, v, r [m, m, rad, m/s, m/s, rad/s] of a 3 m model that are as good as unknown, by
# ``state_scale``. Set by hand.
FIRST = np.array([3.0, 3.0, 0.3, 0.3, 0.3, 0.1])
# Standard deviation of a memory state about its settled value at the start of a window, in typical sizes.
SETTLED = 0.03  # set by hand


def initial_covariance(
    steps: TransitionModel, data: GriddedTrials, z: np.ndarray, theta: np.ndarray, active: np.ndarray
) -> np.ndarray:
    """Covariance (R, A, A) of the active states where windows of ``data`` begin: motion unknown, memory settled.

    steps: model; z: (R, S) first states; theta: coefficients (all,) or (all, R); active: (A,) positions of states.
    """
    R = len(z)
    six = FIRST * state_scale(steps.ship.particulars["L"])
    slope = np.zeros((R, steps.S, 6))
    slope[:, np.arange(6), np.arange(6)] = six
    if len(active) > 6:
        start = np.repeat(z[:, :6].T, 7, axis=1).reshape(6, R, 7)
        for j in range(6):
            # forward differences: a standard deviation needs no more digits
            start[j, :, j + 1] += 1e-4 * six[j]
        controls = np.repeat(data.inputs[0].T, 7, axis=1)
        every = np.repeat(theta, 7, axis=1) if theta.ndim > 1 else theta
        tried = settled(steps.model, start.reshape(6, -1), controls, every).reshape(steps.S, R, 7)
        slope[:, 6:] = np.moveaxis((tried[6:, :, 1:] - tried[6:, :, :1]) / 1e-4, 0, 1)
    P = slope @ slope.swapaxes(1, 2)  # (R, S, S): six independent errors of the motion
    at = np.arange(6, steps.S)
    P[:, at, at] += (SETTLED * steps.model.sizes) ** 2  # else the covariance has no inverse
    return P[:, active[:, None], active[None]]


def linearise_and_filter(
    steps: TransitionModel,
    data: GriddedTrials,
    at: Point,
    active: np.ndarray | None = None,
    extra: ExtraColumns | None = None,
    is_brief: bool = False,
    linear: LinearModel | None = None,
) -> Linearisation:
    """Linearise the model ``steps`` about the point ``at`` and whiten its columns and its residual from ``data``.

    active: (A,) positions of the states that take part (default: ``active_states``); extra: further columns, whose
    gradient of log det is taken as zero; is_brief: of ``white``, which is zero where nothing is compared, only grid
    times at which something is in any window are kept; linear: of the same point with other noise, default: made here.
    """
    free, path, noise, theta = at.free, at.path, at.noise, at.theta
    if active is None:
        active = active_states(steps, free.symbols, theta)
    data = acting(steps, data, theta)
    if linear is None:
        linear = linearised(steps, data, theta, path.z, path.push[:-1], column_positions(steps, free), active)
    start = initial_covariance(steps, data, path.z[0], theta, active)
    system = linear_system(linear, noise, start, data.good, data.inside, data.h, data.gusts)
    filter_run = fastest().filtered(system)
    size = free.std * active_in_window(free.columns, data)  # (R, P)
    parts: list[DrivenColumns | ProductColumns] = [DrivenColumns(linear.G, linear.observed, linear.observing, size)]
    parts += extra(linear) if extra is not None else []
    residual = _residual(steps, data, at, linear, active)
    left, states = (x[..., 0] for x in fastest().whitened(system, filter_run, residual, with_states=True))
    rows = np.flatnonzero(data.good.any(axis=(1, 2))) if is_brief else None
    # prediction error decomposition, and the priors
    nll = 0.5 * float(filter_run.log_det.sum() + (left**2).sum() + at.p @ at.p)
    return Linearisation(
        steps, data, at, active, linear, system, filter_run, tuple(parts), left, states, residual, size, nll, rows
    )


def path_of_all_states(steps: TransitionModel, data: GriddedTrials, point: Point) -> Trajectory:
    """The path of a ``point`` of ``steps`` in trials ``data``; states on which nothing depends there are simulated."""
    passive = np.setdiff1d(np.arange(steps.S), active_states(steps, point.free.symbols, point.theta))
    if not len(passive):
        return point.path
    controls, path = acting(steps, data, point.theta).controls, point.path
    return replace(path, z=steps.with_passive_states(path.z, controls, point.theta, path.push, passive))


def column_positions(steps: TransitionModel, free: Priors) -> np.ndarray:
    """Positions (P,) of the ``free`` parameters among the symbols of ``steps``."""
    return np.array([steps.symbols.index(s) for s in free.symbols], dtype=int)


def linearised_if_finite(
    steps: TransitionModel, data: GriddedTrials, at: Point, active: np.ndarray | None = None
) -> Linearisation | None:
    """``linearise_and_filter`` of these arguments, brief, or None where the ship explodes or a column has no noise.

    steps: the model; data: the trials; at: the point; active: (A,) positions of the states that take part.
    """
    try:
        here = linearise_and_filter(steps, data, at, active, is_brief=True)
    except np.linalg.LinAlgError:
        return None
    return here if np.isfinite(here.nll) else None


def _residual(
    steps: TransitionModel, data: GriddedTrials, at: Point, linear: LinearModel, active: np.ndarray
) -> DrivenColumns:
    """The negative residual as a column, with the latent force among the states."""
    K, R, A = linear.F.shape[:3]
    z, force, gust = at.path.z, at.path.force, at.path.gust
    own = A + 3 + (0 if data.gusts is None else 2)
    pushed = np.zeros((K, R, own, 1))
    pushed[:, :, :A, 0] = (linear.end - z[1:])[..., active]
    # what the path's force adds to its decay
    pushed[:, :, A : A + 3, 0] = np.exp(-data.h / at.noise.tau) * force[:-1] - force[1:]
    start = np.zeros((R, own, 1))
    start[:, A : A + 3, 0] = -force[0]  # the column is where the model should be less where it is
    if data.gusts is not None and gust is not None:
        pushed[:, :, A + 3 :, 0] = np.exp(-data.h / at.noise.gust_tau) * gust[:-1] - gust[1:]
        start[:, A + 3 :, 0] = -gust[0]
    if A > 6:
        # memory states begin where they would come to rest
        calm = settled(steps.model, z[0, :, :6].T, data.inputs[0].T, at.theta).T
        start[:, 6:A, 0] = (calm - z[0])[:, active[6:]]
    return DrivenColumns.dense(pushed, (linear.logged - data.y)[..., None], start)


# Standard deviation of the time of an input, in intervals of its samples: no two clocks are the same. Set by hand.
TIMING = 0.1
DIFFERENCE = {"rad": 1e-3, "rps": 1e-2}  # Change of an input of each unit by which its action is differentiated


def timing_columns(steps: TransitionModel, data: GriddedTrials, at: Point, active: np.ndarray) -> np.ndarray:
    """What each actuator adds over a step to the ``active`` states (A,) if it acts TIMING of a sample late.

    steps: the transition model; data: the trials, with the changes of the inputs and their sampling time; at: the
    point. Returns (K, R, A, c) for c actuators.
    """
    data = acting(steps, data, at.theta)
    K, R = data.inputs.shape[:2]
    names = [name for name in steps.model.controls if name in INPUTS]
    begin = at.path.z[:-1].reshape(K * R, -1).T
    held = data.inputs.reshape(K * R, -1).T
    theta = steps.coefficients(at.theta, at.path.push[:-1].reshape(-1, 3).T)
    columns = []
    for name in names:
        i, small = steps.model.controls.index(name), DIFFERENCE[INPUTS[name][1]]
        ends = []
        for sign in (1, -1):
            moved = held.copy()
            moved[i] += sign * small
            ends.append(steps.advance(begin, moved, theta))
        action = ((ends[0] - ends[1]) / (2 * small))[active].T.reshape(K, R, -1)
        columns.append(action * (data.changes[..., i] * (-TIMING * data.sample / data.h))[..., None])
    return np.stack(columns, axis=-1)
