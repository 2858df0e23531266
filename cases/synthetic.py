"""Synthetic trials: a ship in a manoeuvre or under recorded inputs, sensor noise, trial files."""

from __future__ import annotations

import contextlib
import math
import os
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np

from cases.gusts import Wind
from cases.maneuvers import MODEL_LENGTH, Maneuver
from cases.trial import STATES, UNITS, Trial
from cases.units import house_unit
from mmg.errors import UserError
from mmg.frames import wind_vector
from mmg.model import assemble
from mmg.ship import Ship
from mmg.smooth import GRAVITY

LONGEST_STEP = 0.5
"""Largest Runge-Kutta step [s] for a 3 m model; longer samples are divided. Scales with sqrt(L)."""

MOST_STEPS = 5_000_000


def step_function(ship: Ship) -> ca.Function:
    """One step of the classical Runge-Kutta method: (state (6,), controls (4,), h [s]) -> state (6,), SI."""
    rates = assemble(ship, symbols=()).rates
    z, c, h = ca.SX.sym("z", 6), ca.SX.sym("c", 4), ca.SX.sym("h")
    k1 = rates(z, c, [])
    k2 = rates(z + 0.5 * h * k1, c, [])
    k3 = rates(z + 0.5 * h * k2, c, [])
    k4 = rates(z + h * k3, c, [])
    return ca.Function("step", [z, c, h], [z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)], {"cse": True})


def simulate(
    ship: Ship,
    maneuver: Maneuver,
    dt: float = 0.1,
    wind: Wind | None = None,
    seed: int = 0,
    start: np.ndarray | None = None,
) -> Trial:
    """A manoeuvre in closed loop: the controller sees the true state at each sample; inputs are held between.

    dt: sampling and integration step [s] (divided where it is longer than 0.5 s of a 3 m model); seed: of the
    gusts; start: state (6,) instead of the manoeuvre's own. Columns t, x, y, psi (wrapped), u, v, r, n,
    delta, and the true wind when there is one. Raises UserError for a step that makes no sense and for a
    motion that diverges.
    """
    if not (math.isfinite(dt) and dt > 0):
        raise UserError(f"dt = {dt:g} s must be positive")
    if not 1 <= maneuver.duration / dt <= MOST_STEPS:
        raise UserError(f"{maneuver.duration:g} s in steps of {dt:g} s: give 1 to {MOST_STEPS} steps")
    count = math.floor(maneuver.duration / dt + 1e-9)
    t = np.round(dt * np.arange(count + 1), 9)
    air = (wind or Wind(0.0)).series(t, seed)
    north, east = wind_vector(air[:, 0], air[:, 1])
    step, parts = step_function(ship), _parts(ship, dt)
    controller = maneuver.controller()
    state = np.array(maneuver.start if start is None else start, dtype=float)
    states, inputs = np.empty((count + 1, 6)), np.empty((count + 1, 2))
    for k in range(count + 1):
        states[k], inputs[k] = state, controller.commands(t[k], state)
        if controller.over or k == count:
            break
        held = np.array([*inputs[k], north[k], east[k]])
        for _ in range(parts):
            state = np.array(step(state, held, dt / parts)).ravel()
    rows = slice(0, k + 1)
    columns = _columns(t[rows], states[rows], inputs[rows], None if wind is None else air[rows])
    notices = _notices(ship, wind is not None)
    meta = {"ship": ship.name, "maneuver": maneuver.name, "seed": str(seed)}
    return Trial(_stem(maneuver.name), _checked(columns, ship), notices=notices, kind=maneuver.kind, meta=meta)


def simulate_controls(ship: Ship, controls: Trial, wind: Wind | None = None, seed: int = 0) -> Trial:
    """Open loop under the recorded n, delta and wind of a trial, from its first state (origin if unknown).

    Inputs are held from each sample to the next, at the samples' own times, all in one call. ``wind``
    replaces the trial's. Raises UserError when an input is missing somewhere, or the motion diverges.
    """
    t, inputs = controls.t, np.column_stack([controls["n"], controls["delta"]])
    air = wind.series(t, seed) if wind else None
    if air is None and controls.has_wind:
        air = np.column_stack([controls["wind_speed"], controls["wind_direction"]])
    flow = np.zeros((len(t), 2)) if air is None else np.column_stack(wind_vector(air[:, 0], air[:, 1]))
    start = controls.states[0]
    start[:2] = np.where(np.isfinite(start[:2]), start[:2], 0.0)
    held = np.column_stack([inputs, flow])
    for name, values in (("first state", start), ("n, delta or wind", held)):
        if not np.isfinite(values).all():
            raise UserError(f"{controls.name}: missing values in {name}; the inputs must be complete")
    gaps = np.diff(t)
    parts = np.ceil(gaps / _longest(ship) - 1e-9).astype(int)
    if parts.sum() > MOST_STEPS:
        raise UserError(f"{controls.name}: {t[-1] - t[0]:g} s are too long for {ship.name}; at most {MOST_STEPS} steps")
    h, rows = np.repeat(gaps / parts, parts), np.repeat(np.arange(len(gaps)), parts)
    run = step_function(ship).mapaccum("run", len(h))
    path = np.vstack([start, np.array(run(start, held[rows].T, h)).T])
    states = path[np.concatenate([[0], np.cumsum(parts)])]
    notices = _notices(ship, air is not None)
    meta = {"ship": ship.name, "controls": controls.name, "seed": str(seed)}
    columns = _checked(_columns(t, states, inputs, air), ship)
    return Trial(controls.name, columns, notices=notices, kind=controls.kind, meta=meta)


def _longest(ship: Ship) -> float:
    return LONGEST_STEP * math.sqrt(ship.particulars["L"] / MODEL_LENGTH)


def _parts(ship: Ship, dt: float) -> int:
    """Into how many integration steps a sample is divided."""
    return max(1, math.ceil(dt / _longest(ship) - 1e-9))


def _stem(name: str) -> str:
    """A manoeuvre's name as a file stem: zigzag:-10/10 -> zigzag_-10_10."""
    return name.replace(":", "_").replace("/", "_")


def _columns(t: np.ndarray, states: np.ndarray, inputs: np.ndarray, air: np.ndarray | None) -> dict[str, np.ndarray]:
    columns = {"t": t, **dict(zip(STATES, states.T, strict=True)), "n": inputs[:, 0], "delta": inputs[:, 1]}
    if air is not None:
        columns |= {"wind_speed": air[:, 0], "wind_direction": air[:, 1]}
    return {name: np.array(wrap(a) if name == "psi" else a, dtype=float) for name, a in columns.items()}


def _checked(columns: dict[str, np.ndarray], ship: Ship) -> dict[str, np.ndarray]:
    """The columns, if the motion is one of a ship. Raises UserError with the first time at which it is not.

    That is: not finite, faster than Froude number 3 or spinning by more than 10 sqrt(g / L).
    """
    L = ship.particulars["L"]
    speed, spin = np.hypot(columns["u"], columns["v"]), np.abs(columns["r"])
    good = np.isfinite(np.column_stack([columns[name] for name in STATES])).all(axis=1)
    good &= (speed < 3 * math.sqrt(GRAVITY * L)) & (spin < 10 * math.sqrt(GRAVITY / L))
    if not good.all():
        when = columns["t"][int(np.argmin(good))]
        raise UserError(f"the motion of {ship.name} diverges at t = {when:g} s; check its coefficients and the inputs")
    return columns


def _notices(ship: Ship, windy: bool) -> tuple[str, ...]:
    if windy and "wind" not in ship.components:
        return (f"{ship.name} has no wind model: the wind is recorded but exerts no force",)
    return ()


def wrap(psi: np.ndarray) -> np.ndarray:
    """Angles [rad] in (-pi, pi]; those already there are left to the last digit."""
    inside = (psi > -math.pi) & (psi <= math.pi)
    return np.where(inside, psi, math.pi - np.mod(math.pi - psi, 2 * math.pi))


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise: m, rad, m/s, rad/s; the defaults are those of a 3 m model."""

    x: float = 0.01
    y: float = 0.01
    psi: float = 0.0015
    u: float = 0.004
    v: float = 0.004
    r: float = 0.0006

    @classmethod
    def for_length(cls, length: float) -> SensorNoise:
        """Noise for a length [m]: positions scale with L, velocities with sqrt(L), rates with 1 / sqrt(L)."""
        n, scale = cls(), length / MODEL_LENGTH
        root = math.sqrt(scale)
        return cls(n.x * scale, n.y * scale, n.psi, n.u * root, n.v * root, n.r / root)


def add_noise(trial: Trial, noise: SensorNoise, seed: int = 0) -> Trial:
    """A copy with white noise on the states it has, by ``seed``. Inputs and wind stay as they are."""
    draws = np.random.default_rng([2, seed]).standard_normal((len(STATES), len(trial)))
    noisy = {
        name: trial[name] + sd * draw
        for name, sd, draw in zip(STATES, astuple(noise), draws, strict=True)
        if name in trial
    }
    noisy["psi"] = wrap(noisy["psi"])
    return replace(trial, columns={**trial.columns, **noisy})


def write_trial(trial: Trial, path: str | Path) -> None:
    """The trial as a CSV file (Parquet for .parquet) with the contract's headers, SI, shortest exact digits.

    The file appears complete or not at all; one that exists is replaced. Raises UserError when it cannot be
    written or the suffix is neither.
    """
    import pandas as pd

    path = Path(path)
    if path.suffix.lower() not in (".csv", ".parquet"):
        raise UserError(f"{path}: trial files end in .csv or .parquet")
    order = {name: i for i, name in enumerate(UNITS)}
    names = sorted(trial.columns, key=lambda name: order.get(name, len(order)))
    frame = pd.DataFrame({f"{name} [{house_unit(name)}]": trial[name] for name in names})
    scratch = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        if path.suffix.lower() == ".parquet":
            frame.to_parquet(scratch, index=False)
        else:
            frame.to_csv(scratch, index=False, lineterminator="\n")
        scratch.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror or error}); check the folder") from None
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink(missing_ok=True)
