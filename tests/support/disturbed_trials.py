"""Synthetic trials as bad as real ones: forces that no model explains, late and biased sensors, coloured noise.

The truth behind each is known: coefficients drawn from the prior of a ship, Ornstein-Uhlenbeck forces X, Y, N with a
memory of seconds, and the defects that were measured on real records (velocities late, turn rate too small, an antenna
off midship). Meant for claims on intervals: they must hold the truth although the residuals are autocorrelated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace

import casadi as ca
import numpy as np
from scipy.signal import lfilter

from cases.inputs import model_inputs
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import with_effects
from cases.simulation.simulate import SensorNoise, Wind, logged, simulate, wrap
from cases.trial import Trial
from mmg.errors import UserError
from mmg.model import assemble
from mmg.motion.flow import STATES
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship

DEFECTS = ("velocity_filter:tau=0.7", "gyro:share=-0.013", "antenna_offset:x=0.1")
"""Measurement effects of the real records of the 3 m model."""


@dataclass(frozen=True)
class Disturbed:
    """How bad: sizes of the forces X, Y [N] and N [N m] of a 3 m model, their correlation time [s], that of the
    coloured part of the sensor noise [s], sensor noise and defects."""

    X: float = 0.3
    Y: float = 0.4
    N: float = 0.3
    tau: float = 8.0
    noise_tau: float = 2.0
    noise: SensorNoise = field(default_factory=SensorNoise)
    defects: tuple[str, ...] = DEFECTS


def drawn_ship(ship: Ship, seed: int) -> Ship:
    """The ship with its free coefficients drawn from its prior, within its bounds."""
    rng, values = np.random.default_rng([7, seed]), {}
    for symbol in ship.free:
        c = ship.coefficients[symbol]
        value = rng.normal(c.value, c.std)
        while not c.lower < value < c.upper:
            value = rng.normal(c.value, c.std)
        values[symbol] = value
    return replace(ship.with_values(values), name="drawn")


def process(count: int, dt: float, tau: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary Ornstein-Uhlenbeck process of unit variance at ``count`` samples ``dt`` [s] apart."""
    left, draws = np.exp(-dt / tau), rng.standard_normal(count)
    draws[1:] *= np.sqrt(1 - left**2)
    return np.asarray(lfilter([1.0], [1.0, -left], draws))


def disturbed_trial(ship: Ship, trial: Trial, how: Disturbed, seed: int) -> Trial:
    """The run again under its recorded inputs, pushed by random forces, and as bad sensors log it.

    Raises UserError when the motion diverges.
    """
    rng = np.random.default_rng([8, seed])
    model = assemble(ship.with_effect("tow", {}), symbols=("tow.X", "tow.Y", "tow.N"))
    t = trial.t
    dt = float(np.median(np.diff(t)))
    forces = np.column_stack([size * process(len(t), dt, how.tau, rng) for size in (how.X, how.Y, how.N)])
    inputs = model_inputs(trial, model.controls).array
    z, c, d = ca.SX.sym("z", len(model.states)), ca.SX.sym("c", inputs.shape[1]), ca.SX.sym("d", 3)
    step = ca.Function("step", [z, c, d], [rk4_step(lambda s, _: model.rates(s, c, d), z, dt)], {"cse": True})
    begin = np.array(model.initial(trial.states[0], inputs[0], forces[0])).ravel()
    path = np.array(step.mapaccum("run", len(t) - 1)(begin, inputs[:-1].T, forces[:-1].T)).T
    states = np.vstack([begin, path])[:, :6]
    if not np.isfinite(states).all() or np.abs(states[:, 3:5]).max() > 10 * np.abs(trial.states[:, 3:5]).max() + 1:
        raise UserError(f"{trial.name}: the motion diverges under the random forces; make them smaller")
    seen = logged(with_effects(ship, how.defects), t, states)
    for j, sd in enumerate(astuple(how.noise)):
        coloured = process(len(t), dt, how.noise_tau, rng)
        seen[:, j] += sd * (0.5 * rng.standard_normal(len(t)) + coloured)
    seen[:, 2] = wrap(seen[:, 2])
    return replace(trial, columns={**trial.columns, **dict(zip(STATES, seen.T, strict=True))})


def disturbed_trials(
    ship: Ship, runs: Sequence[tuple[str, float]], seed: int, how: Disturbed | None = None, dt: float = 0.1
) -> list[Trial]:
    """Runs (manoeuvre, duration [s]) of a ship in gusty wind, each pushed and logged as ``how`` says."""
    trials = []
    for number, (text, duration) in enumerate(runs):
        rng = np.random.default_rng([9, seed, number])
        wind = Wind(rng.uniform(0.5, 2.0), rng.uniform(0, 2 * np.pi), gusty=True)
        maneuver = parse_maneuver(text, ship, n=10.0, duration=duration)
        start = maneuver.start
        start[2] = rng.uniform(-np.pi, np.pi)
        gusts, own = (int(value) for value in rng.integers(0, 2**31, 2))
        clean = simulate(ship, maneuver, dt, wind, gusts, start)
        trial = disturbed_trial(ship, clean, how or Disturbed(), own)
        trials.append(replace(trial, name=f"{number}_{trial.name}"))
    return trials
