"""What a model must beat to be worth its trouble: velocities that are kept, and a plain grey box of 18 coefficients.

Both forecast windows from their measured first row as any model does, so that they are scored by the same code. The
grey box is a ship of 3 degrees of freedom in a uniform current, whose accelerations are sums of 16 terms of relative
velocities and actuators (after Norrbin 1971, without added mass, wind or lateral thrusters). Linear regression of the
velocity steps gives its start, least squares of the errors over windows its coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.predict import change_over, planned_windows
from fitting.prediction.stretches import WindowBatch, measured_columns, wrapped_error
from mmg.errors import TooFewData
from mmg.motion.flow import INPUTS, PROPELLERS, RUDDERS
from mmg.motion.frames import body_to_earth, earth_to_body
from mmg.runge_kutta import rk4_step

# The coefficients of the accelerations in surge, sway and yaw, and the current north and east [m/s].
SURGE, SWAY, YAW, CURRENT = slice(0, 5), slice(5, 10), slice(10, 16), slice(16, 18)
# Steps of a window for which the grey box is fitted: 1 s of a 3 m model, an eighth of a ship length of sailing.
STEPS = 30  # set by hand
# Most windows to which it is fitted, evenly drawn from longer logs: those of 8 hours at 30 s, in 20 s.
WINDOWS = 2000  # set by hand: it bounds time
# Most evaluations of a fit; those of R/V Gunnerus and of 8 and 35 runs of the ESSO OSAKA take 5 to 7. So it was
# measured; the limit was set by hand.
EVALUATIONS = 60
# Relative change of the cost at which a fit ends; at 1e-8 the errors of R/V Gunnerus differ by less than 0.1 %. So it
# was measured.
TOLERANCE = 1e-4
# Step of the differences, of coefficients scaled so that 1 causes all the change there is. Set by hand.
DIFFERENCE = 1e-4
# Smallest singular value, of the largest, of the columns of a regression that is used: its fit is a start alone.
COLLINEAR = 1e-2  # set by hand
BEYOND = 3.0  # Times the largest measured velocity to which those of the grey box are bounded, so that no fit overflows


@dataclass(frozen=True)
class Persistence:
    """Keeps surge, sway and turn rate of the first row of a window. inputs: those of the model that it is compared
    with, so that the windows are the same; it reads none."""

    inputs: tuple[str, ...]

    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        """Logged columns (N + 1, 6, M) at the samples of ``stretches``: arcs of circles."""
        batch = WindowBatch.of(stretches)
        t = batch.times
        x, y, psi, u, v, r = (np.broadcast_to(row, t.shape) for row in batch.logged)
        turned = r * t
        # chord of an arc: t sin(r t / 2) / (r t / 2), along the heading half way; np.sinc(x) is sin(pi x) / (pi x)
        chord, course = t * np.sinc(turned / (2 * np.pi)), psi + 0.5 * turned
        north, east = body_to_earth(u, v, course)
        return np.stack([x + chord * north, y + chord * east, psi + turned, u, v, r], axis=1)


@dataclass(frozen=True)
class GreyBox:
    """A grey box with its coefficients (18,).

    inputs: as of ``Ship.inputs``; places: of propellers or pods by name of their revolutions, forward and to starboard
    of midship in half ship lengths; bounds: of the relative velocities (3,) [m/s, m/s, rad/s].
    """

    inputs: tuple[str, ...]
    places: Mapping[str, tuple[float, float]]
    coefficients: np.ndarray
    bounds: np.ndarray

    def forecast(self, stretches: Sequence[Stretch]) -> np.ndarray:
        """Logged columns (N + 1, 6, M) at the samples of ``stretches``."""
        batch = WindowBatch.of(stretches)
        actuation = _actuation(self, batch.inputs)
        return _rollout(batch, actuation, self.coefficients[:, None], self.bounds)[:, :, 0]


def fit_grey_box(
    trials: Sequence[Trial], inputs: Sequence[str], particulars: Mapping[str, float], window: float
) -> GreyBox:
    """The grey box of a ship, fitted to windows of ``window`` [s], every half window, of ``trials``.

    inputs: as of ``Ship.inputs``; particulars: of the ship, for the places of pods, {} puts them at the stern. Errors
    are divided by what the states change by over a window, and large ones count less (soft L1). Raises UserError where
    no window is whole.
    """
    from scipy.optimize import least_squares  # late: slow to import, and a diagnosis needs none of it

    planned = [planned_windows(trial, inputs, window, 0.5 * window, False)[0] for trial in trials]
    stretches = [stretch for kept in planned for stretch in kept.values()]
    if not stretches:
        raise TooFewData(f"no whole window of {window:g} s in the trials that the baseline is to be fitted to")
    stretches = stretches[:: math.ceil(len(stretches) / WINDOWS)]
    samples = WindowBatch.of(stretches)
    # integrated from node to node with mean inputs: STEPS a window, whatever the sampling
    nodes = np.unique(np.linspace(0, len(samples.steps), STEPS + 1).round().astype(int))
    batch, measured = samples.between(nodes), measured_columns(stretches)[nodes]
    speed, turn = np.nanmax(np.hypot(measured[:, 3], measured[:, 4])), np.nanmax(np.abs(measured[:, 5]))
    half = 0.5 * particulars.get("L", 1.0)
    y = particulars.get("y_P", 0.0) / half
    places = {"n": (-1.0, y), "n_2": (-1.0, -y)}  # and pods, where the particulars say
    for name in INPUTS:
        ending = name.removeprefix("n_azimuth")
        if ending != name and f"x_az{ending}" in particulars:
            places[name] = (particulars[f"x_az{ending}"] / half, particulars[f"y_az{ending}"] / half)
    box = GreyBox(tuple(inputs), places, np.zeros(18), BEYOND * np.array([speed, speed, turn]))
    actuation = _actuation(box, batch.inputs)
    change = change_over(trials, window, 0.5 * window)
    start, size = _regressed(batch, measured, actuation, np.where(change < np.inf, change, 0.0)[3:] / window)

    def errors(scaled: np.ndarray) -> np.ndarray:
        """Errors (rows, K) by K sets of ``scaled`` coefficients (18, K), divided by the change over a window."""
        states = _rollout(batch, actuation, scaled * size[:, None], box.bounds)
        error = wrapped_error(states, measured[:, :, None])[1:] / change[:, None, None]
        return np.nan_to_num(np.moveaxis(error, 2, -1)).reshape(-1, scaled.shape[1])

    def sensitivities(scaled: np.ndarray) -> np.ndarray:
        """Derivatives of the errors (rows, 18) by differences, all coefficients side by side."""
        perturbed = errors(np.column_stack([scaled, scaled[:, None] + DIFFERENCE * np.eye(18)]))
        return (perturbed[:, 1:] - perturbed[:, :1]) / DIFFERENCE

    solution = least_squares(
        lambda scaled: errors(scaled[:, None])[:, 0],  # type: ignore[misc]
        start / size,
        sensitivities,
        loss="soft_l1",
        ftol=TOLERANCE,
        max_nfev=EVALUATIONS,
    )
    return replace(box, coefficients=solution.x * size)


def _actuation(box: GreyBox, inputs: np.ndarray) -> np.ndarray:
    """What the actuators do (6, N, M) under the ``inputs`` (N, C, M) of the ``box``, as means over her propellers.

    Thrust n |n| forward, to starboard and turning about midship [1/s^2, lever in half ship lengths], revolutions [1/s],
    and sin(a) cos(a) of the direction a of the jet, which is that of a lift in the flow: to starboard, and turning.
    A rudder at the stern turns the jet of her propeller: to starboard it pushes the stern to port.
    """
    column = dict(zip(box.inputs, np.moveaxis(inputs, 1, 0), strict=False))
    rudders = [column[name] for name in RUDDERS if name in column]
    rudder = -np.mean(rudders, axis=0) if rudders else np.zeros_like(inputs[:, 0])
    driving = [name for name in column if name in PROPELLERS or name.startswith("n_azimuth")]
    rows = []
    for name in driving or [""]:  # a polynomial of the hull with her propeller has no revolutions
        revolutions = column.get(name, np.ones_like(rudder))
        angle = column[name.removeprefix("n_")] if name.startswith("n_azimuth") else rudder
        x, y = box.places.get(name, (-1.0, 0.0))
        thrust, lift = revolutions * np.abs(revolutions), 0.5 * np.sin(2 * angle)  # sin(a) cos(a)
        forward, side = thrust * np.cos(angle), thrust * np.sin(angle)
        rows.append([forward, side, x * side - y * forward, np.abs(revolutions), lift, x * lift])
    return np.mean(rows, axis=0)


def _terms(relative: np.ndarray, actuation: np.ndarray) -> np.ndarray:
    """What the coefficients of SURGE, SWAY and YAW multiply (16, ...), at velocities ``relative`` to the water (3, ...)
    under an ``actuation`` (6, ...)."""
    u, v, r = relative
    forward, side, turning, revolutions, lift, lift_turning = actuation
    still = np.zeros_like(u)
    surge = (forward + still, revolutions * u, u * np.abs(u), v * r, r * r)
    sway = (np.abs(u) * v, u * r, v * np.abs(v), side + still, u * u * lift)
    yaw = (u * v, np.abs(u) * r, r * np.abs(r), r, turning + still, u * u * lift_turning)
    return np.stack([*surge, *sway, *yaw])


def _regressed(
    batch: WindowBatch, measured: np.ndarray, actuation: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (18,) by linear regression of the steps of ``measured`` velocities, in still water, and sizes (18,)
    by which they are scaled: each alone causes the ``rates`` (3,), a tenth of the speed is the current."""
    velocities = measured[:, 3:]
    terms = _terms(np.moveaxis(0.5 * (velocities[1:] + velocities[:-1]), 1, 0), actuation)
    steps = np.where(batch.steps > 0, batch.steps, np.nan)
    # the current starts at 0, its size is a tenth of the rms speed ahead
    start, size = np.zeros(18), np.full(18, 0.1 * np.sqrt(np.nanmean(velocities[:, 0] ** 2)))
    for part, state in ((SURGE, 0), (SWAY, 1), (YAW, 2)):
        matrix = terms[part].reshape(part.stop - part.start, -1).T
        rate = (np.diff(velocities[:, state], axis=0) / steps).ravel()
        finite = np.isfinite(matrix).all(axis=1) & np.isfinite(rate)
        rms = np.sqrt((matrix[finite] ** 2).mean(axis=0))
        rms = np.where(rms > 0, rms, np.inf)  # a term that is always 0 has the coefficient 0
        size[part] = rates[state] / rms
        start[part] = np.linalg.lstsq(matrix[finite] / rms, rate[finite], rcond=COLLINEAR)[0] / rms
    return start, np.where(size > 0, size, 1.0)


def _rollout(batch: WindowBatch, actuation: np.ndarray, coefficients: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """States (N + 1, 6, K, M) of ``batch`` under an ``actuation`` (6, N, M) by K sets of ``coefficients`` (18, K). In
    the frame of the water, whose way is added to the positions. Velocities stay within their ``bounds`` (3,)."""
    factors, (north, east) = coefficients[:16, :, None], coefficients[CURRENT, :, None]
    logged, limit = batch.logged[:, None], bounds[:, None, None]
    sets = (6, coefficients.shape[1], logged.shape[-1])
    ahead, abeam = earth_to_body(north, east, logged[2])
    water = np.stack([ahead, abeam, np.zeros_like(ahead)])
    states = np.empty((len(batch.steps) + 1, *sets))
    states[0] = logged
    states[0, 3:] -= water
    for k, h in enumerate(batch.steps):

        def rates(z: np.ndarray, _: float, acting: np.ndarray = actuation[:, k, None]) -> np.ndarray:
            forces = factors * _terms(z[3:], acting)
            return np.stack(
                [*body_to_earth(z[3], z[4], z[2]), z[5], *(forces[part].sum(axis=0) for part in (SURGE, SWAY, YAW))]
            )

        states[k + 1] = rk4_step(rates, states[k], h)
        states[k + 1, 3:] = np.clip(states[k + 1, 3:], -limit, limit)
    states[:, 0] += north * batch.times[:, None]
    states[:, 1] += east * batch.times[:, None]
    ahead, abeam = earth_to_body(north, east, states[:, 2])
    states[:, 3] += ahead
    states[:, 4] += abeam
    return states
