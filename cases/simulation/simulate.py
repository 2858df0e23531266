"""Synthetic trials: a ship in a manoeuvre or under recorded inputs, steady and gusty wind, sensor noise, trial files.

Gusts are one-dimensional Ornstein-Uhlenbeck filters for speed and direction of the true wind,
dU = -alpha_u (U - U_mean) dt + sigma_u dW, dgamma = -alpha_g sin(gamma - gamma_mean) dt + sigma_g dW; the
filter of the speed matches Hino's spectrum at f = 0 and 0.5 Hz, that of the direction a spread of 32 U^(-3/4)
degrees (Maki et al. 2022). The time scale is that of real wind, for models too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from cases.inputs import actuator_columns, step_means
from cases.io.files import replaced
from cases.maneuvers.definitions import Maneuver, stopping_notices
from cases.maneuvers.self_propulsion import actuator_positions
from cases.quantities import UNITS, as_number
from cases.trial import Trial
from mmg.components.catalogue import module
from mmg.effects import effect
from mmg.errors import BadValue, Missing, NoSolution, NotWritable, OutOfRange
from mmg.messages import Message
from mmg.model import Model, assemble
from mmg.motion.flow import STATES, Flow
from mmg.motion.frames import earth_to_body, wind_vector
from mmg.motion.froude import GRAVITY, reference_speed, state_scale, time_scale
from mmg.runge_kutta import rk4_step
from mmg.ship import Ship

REFERENCE_FREQUENCY = 0.5  # Hz at which filter and spectrum agree, besides zero (Maki et al. 2022)
HEIGHT = 15.0  # m above the sea, for which Hino's spectrum is taken: that of the published check values
STRONGEST = 115.0  # m/s; the strongest gust ever measured has 113 (Barrow Island, 1996)


@dataclass(frozen=True)
class GustFilter:
    """Rates alpha [1/s] and intensities sigma [m/s / sqrt(s), rad / sqrt(s)] of the two filters."""

    alpha_u: float
    sigma_u: float
    alpha_direction: float
    sigma_direction: float


def hino_spectrum(f: float, mean: float) -> float:
    """Two-sided spectrum of the wind speed [m^2/s] at f [Hz] for a mean speed [m/s] > 0 at HEIGHT."""
    drag, exponent = 0.001, 1.0 / 8.0  # of the sea surface, and of the power law of the speed by height [-]
    variance = 6 * drag * mean**2
    beta = 1.169e-3 * mean * exponent / math.sqrt(drag) * (HEIGHT / 10) ** (4 * exponent - 1)
    return 0.2382 * variance / beta * (1 + (f / beta) ** 2) ** (-5 / 6)


def gust_filter(mean: float) -> GustFilter:
    """The filters for a mean wind speed [m/s] > 0."""
    at_zero, at_reference = hino_spectrum(0.0, mean), hino_spectrum(REFERENCE_FREQUENCY, mean)
    alpha = 2 * math.pi * REFERENCE_FREQUENCY * math.sqrt(at_reference / (at_zero - at_reference))
    # stationary spread sigma / sqrt(2 alpha) of the direction: 32 U^(-3/4) deg; its intensity [deg / sqrt(s)] is fixed
    spread = 2.3
    return GustFilter(
        alpha_u=alpha,
        sigma_u=math.sqrt(at_zero) * alpha,  # S(f) = sigma^2 / (alpha^2 + (2 pi f)^2)
        alpha_direction=spread**2 * mean**1.5 / (2 * 32.0**2),
        sigma_direction=math.radians(spread),
    )


@dataclass(frozen=True)
class Wind:
    """True wind over ground: mean speed [m/s], mean direction it comes from [rad], gusty or steady."""

    speed: float
    direction: float = 0.0
    gusty: bool = False

    def series(self, t: np.ndarray, seed: int = 0) -> np.ndarray:
        """Speed [m/s], never negative, and direction [rad in 0..2 pi], (N, 2), at rising times t (N,) [s].

        Gusts start from the mean and are reproducible by ``seed``. The update of the speed is exact for any step, that
        of the direction is exact for small deviations (its rate is frozen at alpha sin(e) / e over a step).
        """
        mean = np.full(len(t), self.speed)
        direction = np.full(len(t), self.direction)
        if self.gusty and self.speed > 0:
            filters = gust_filter(self.speed)
            draws = np.random.default_rng([1, seed]).standard_normal((len(t), 2))
            deviation, turn = 0.0, 0.0
            for k, dt in enumerate(np.diff(t), start=1):
                deviation = _ornstein_uhlenbeck_step(deviation, filters.alpha_u, filters.sigma_u, dt, draws[k, 0])
                turn = math.remainder(turn, 2 * math.pi)  # the pull goes with its sine: the same after a whole turn
                rate = filters.alpha_direction * (math.sin(turn) / turn if abs(turn) > 1e-9 else 1.0)
                turn = _ornstein_uhlenbeck_step(turn, max(rate, 0.0), filters.sigma_direction, dt, draws[k, 1])
                mean[k] += deviation
                direction[k] += turn
        return np.column_stack([np.maximum(mean, 0.0), np.mod(direction, 2 * math.pi)])


def _ornstein_uhlenbeck_step(value: float, alpha: float, sigma: float, dt: float, draw: float) -> float:
    """Exact step of an Ornstein-Uhlenbeck process about zero; a random walk where alpha is zero."""
    growth = -math.expm1(-2 * alpha * dt) / (2 * alpha) if alpha * dt > 1e-12 else dt
    return value * math.exp(-alpha * dt) + sigma * math.sqrt(growth) * draw


def parse_wind(text: str) -> Wind:
    """A wind from "speed:direction" or "speed:direction:gusty", m/s and degrees it comes from. Raises UserError when
    the text is anything else."""
    if not isinstance(text, str):
        words = 'give "speed:direction" [m/s, deg it comes from]; one that changes is given to simulate at times, as'
        raise BadValue(f"wind: {type(text).__name__} is no text; {words} wind_speed [m/s] and wind_direction [rad]")
    parts = [part.strip() for part in text.split(":")]
    speed, direction = (as_number(part) for part in (*parts, "", "")[:2])
    fits = len(parts) == 2 or (len(parts) == 3 and parts[2] == "gusty")
    if not (fits and math.isfinite(direction) and 0 <= speed < math.inf):
        raise BadValue(
            f"wind '{text}': write speed:direction or speed:direction:gusty in m/s and degrees it "
            "comes from, such as 1.5:60:gusty"
        )
    if speed > STRONGEST:
        raise OutOfRange(f"wind '{text}': {speed:g} m/s is more than any wind; at most {STRONGEST:g} m/s")
    return Wind(speed, math.radians(direction) % (2 * math.pi), len(parts) == 3)


def logged(ship: Ship, t: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Columns x, y, psi, u, v, r (N, 6) as the ship's measurement effects make them of the true ones (N, 6) at t.

    Delays and lags are exact here, on the samples, where the model of a fit approximates them.
    states (N, 6), t (N,) [s].
    """
    columns = list(np.asarray(states, dtype=float).T)
    flow = Flow(u=columns[3], v=columns[4], r=columns[5], psi=columns[2])
    for name in ship.effects:
        e = effect(name)
        if e.measures:
            columns = e.samples(t, columns, flow, ship.parameters_of(name), ship.namespace)
    return np.column_stack(columns)


def wrap(psi: np.ndarray) -> np.ndarray:
    """Angles [rad] in (-pi, pi]; those already there are left to the last digit. psi (N,) [rad]."""
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
        return cls(*(np.array(astuple(cls())) * state_scale(length)).tolist())


def add_noise(trial: Trial, noise: SensorNoise, seed: int = 0) -> Trial:
    """A copy of ``trial`` with white noise on the states it has, by ``seed``. Inputs and wind stay as they are."""
    draws = np.random.default_rng([2, seed]).standard_normal((len(STATES), len(trial)))
    noisy = {
        name: trial[name] + sd * draw
        for name, sd, draw in zip(STATES, astuple(noise), draws, strict=True)
        if name in trial
    }
    noisy["psi"] = wrap(noisy["psi"])
    return replace(trial, columns={**trial.columns, **noisy})


# Largest Runge-Kutta step [s] for a 3 m model; longer samples are divided. Scales with sqrt(L). Set by hand.
LONGEST_STEP = 0.5
MOST_STEPS = 5_000_000  # Most Runge-Kutta steps of a run. Set by hand: it bounds time, to some minutes, and memory.


def _plant(ship: Ship) -> tuple[ca.Function, Model, float]:
    """A ship that is driven by logged inputs: one classical Runge-Kutta step (state (S,), inputs (C,), h [s]) -> state
    (S,), its model without what the generator does exactly, and the delay of rudder and revolutions [s]."""
    delay = 0.0  # what shifts inputs in time is done on the samples, what instruments do after the run (``logged``)
    for name in ship.effects:
        held_back = effect(name).input_delay(ship.parameters_of(name))
        delay += held_back or 0.0
        if held_back is not None or effect(name).measures:
            ship = ship.without_effect(name)
    model = assemble(ship, symbols=())
    z, c, h = ca.SX.sym("z", len(model.states)), ca.SX.sym("c", len(model.controls)), ca.SX.sym("h")
    step = ca.Function("step", [z, c, h], [rk4_step(lambda s, _: model.rates(s, c, []), z, h)], {"cse": True})
    return step, model, float(delay)


def _buffered(step: ca.Function) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """``step`` of ``_plant`` with arrays of its own for what goes in and out: the same values in half the time."""
    state, inputs, h = (np.zeros(step.numel_in(i)) for i in range(3))
    end = np.zeros(step.numel_out(0))
    kept: Any = step.buffer()  # the buffer too, which evaluating does not keep
    for i, values in enumerate((state, inputs, h)):
        kept[0].set_arg(i, values.data)
    kept[0].set_res(0, end.data)

    def advanced(z: np.ndarray, c: np.ndarray, seconds: float) -> np.ndarray:
        state[:], inputs[:], h[0] = z, c, seconds
        kept[1]()
        return end.copy()

    return advanced


def _vector(inputs: Sequence[str], positions: Mapping[str, float], air: np.ndarray, t: float) -> np.ndarray:
    """Values of ``inputs`` by name; actuators that are not moved are at rest."""
    values = {**positions, "wind_north": air[0], "wind_east": air[1], "time": t}
    return np.array([values.get(name, 0.0) for name in inputs])


def _begin(ship: Ship, maneuver: Maneuver) -> np.ndarray:
    """State (6,) of the approach: the manoeuvre's speed is through the water, the state's over ground."""
    six = np.array(maneuver.start, dtype=float)
    if "current" in ship.effects:
        current = ship.parameters_of("current")
        six[3:5] += earth_to_body(current.x, current.y, six[2])
    return six


def simulate(
    ship: Ship,
    maneuver: Maneuver,
    dt: float = 0.1,
    wind: Wind | None = None,
    seed: int = 0,
    start: np.ndarray | None = None,
) -> Trial:
    """A manoeuvre in closed loop: the controller sees the true state at each sample; inputs are held between.

    dt: sampling and integration step [s] (divided where it is longer than 0.5 s of a 3 m model); seed: of the gusts;
    start: state (6,) instead of the manoeuvre's own. Columns t, x, y, psi (wrapped), u, v, r as the ship's measurement
    effects log them, its actuators, and the true wind when there is one. Inputs are means over the step that follows.
    Raises UserError for a step that makes no sense and for a motion that diverges. maneuver: what is ordered.
    """
    if not (math.isfinite(dt) and dt > 0):
        raise OutOfRange(f"dt = {dt:g} s must be positive")
    if not 1 <= maneuver.duration / dt <= MOST_STEPS:
        raise OutOfRange(f"{maneuver.duration:g} s in steps of {dt:g} s: give 1 to {MOST_STEPS} steps")
    ship, count = maneuver.ship_of(ship), math.floor(maneuver.duration / dt + 1e-9)
    t = np.round(dt * np.arange(count + 1), 9)  # 0.3 and not 0.30000000000000004, as trial files have it
    air = (wind or Wind(0.0)).series(t, seed)
    flow = np.column_stack(wind_vector(air[:, 0], air[:, 1]))
    (step, model, delay), parts, controller = _plant(ship), integration_steps(ship, dt), maneuver.controller()
    once, (samples, part) = _buffered(step), divmod(delay / dt, 1.0)  # of the delay: whole samples and the rest
    six = _begin(ship, maneuver) if start is None else np.array(start, dtype=float)
    first = _vector(model.controls, actuator_positions(ship, controller.n, controller.delta), flow[0], 0.0)
    state = np.array(model.initial(six, first, [])).ravel()
    states, inputs = np.empty((count + 1, len(state))), np.empty((count + 1, 2))

    def advanced(k: int, state: np.ndarray, order: tuple[float, float]) -> np.ndarray:
        inputs[k] = order  # a delay lets the means of earlier steps act
        late, later = (inputs[max(k - int(samples) - back, 0)] for back in (0, 1))
        acting = (1 - part) * late + part * later
        controls = _vector(model.controls, actuator_positions(ship, *acting), flow[k], t[k])
        for _ in range(parts):
            state = once(state, controls, dt / parts)
        return state

    for k in range(count + 1):
        states[k] = state
        inputs[k] = controller.held(t[k], dt, state, partial(advanced, k, state))
        if controller.over or k == count:
            break
        state = advanced(k, state, (inputs[k, 0], inputs[k, 1]))
    rows = slice(0, k + 1)
    positions = actuator_positions(ship, *inputs[rows].T)
    columns = _columns(ship, model.states, t[rows], states[rows], positions, None if wind is None else air[rows])
    meta = {"ship": ship.name, "maneuver": maneuver.name, "seed": str(seed)}
    stem = maneuver.name.replace(":", "_").replace("/", "_")
    notices = (*_notices(ship, wind is not None, states[rows]), *stopping_notices(maneuver))
    return Trial(stem, columns, notices=notices, kind=maneuver.kind, meta=meta)


def simulate_controls(ship: Ship, controls: Trial, wind: Wind | None = None, seed: int = 0) -> Trial:
    """Open loop under the recorded inputs and wind of a trial, from its first state (origin if unknown).

    Inputs are held from each sample to the next, at the samples' own times, all in one call. ``wind``
    replaces the trial's. Raises UserError when an input is missing somewhere, or the motion diverges.
    ship: that moves; controls: the trial followed; seed: of gusts. Returns the motion as a trial.
    """
    t = controls.t
    actuators, assumed = actuator_columns(controls, ship.actuators)
    air = wind.series(t, seed) if wind else None
    if air is None and controls.has_wind:
        air = np.column_stack([controls["wind_speed"], controls["wind_direction"]])
    flow = np.zeros((len(t), 2)) if air is None else np.column_stack(wind_vector(air[:, 0], air[:, 1]))
    start = controls.states[0]
    start[:2] = np.where(np.isfinite(start[:2]), start[:2], 0.0)
    step, model, delay = _plant(ship)
    for name, values in (("first state", start), ("an input or the wind", np.column_stack([actuators, flow]))):
        if not np.isfinite(values).all():
            raise Missing(f"{controls.name}: missing values in {name}; the inputs must be complete")
    # of the last row no step follows
    acting = np.vstack([step_means(t, actuators, t - delay), actuators[-1:]]) if delay else actuators
    named = dict(zip(ship.actuators, acting.T, strict=True))
    named |= {"wind_north": flow[:, 0], "wind_east": flow[:, 1], "time": t - t[0]}
    inputs = np.column_stack([named.get(name, np.zeros(len(t))) for name in model.controls])
    gaps = np.diff(t)
    parts = np.ceil(gaps / longest_step(ship) - 1e-9).astype(int)  # steps in each sample, equal within it
    if parts.sum() > MOST_STEPS:
        raise OutOfRange(
            f"{controls.name}: {t[-1] - t[0]:g} s are too long for {ship.name}; at most {MOST_STEPS} steps"
        )
    h, rows = np.repeat(gaps / parts, parts), np.repeat(np.arange(len(gaps)), parts)
    run = step.mapaccum("run", len(h))
    begin = np.array(model.initial(start, inputs[0], [])).ravel()
    path = np.vstack([begin, np.array(run(begin, inputs[rows].T, h)).T])
    states = path[np.concatenate([[0], np.cumsum(parts)])]  # (N, S): those at the samples
    columns = _columns(ship, model.states, t, states, dict(zip(ship.actuators, actuators.T, strict=True)), air)
    notices = (*_notices(ship, air is not None, states), *assumed)
    meta = {"ship": ship.name, "controls": controls.name, "seed": str(seed)}
    return Trial(controls.name, columns, notices=notices, kind=controls.kind, meta=meta)


def longest_step(ship: Ship) -> float:
    """The longest Runge-Kutta step [s] that is accurate for ``ship``: 0.5 s of a 3 m model."""
    return LONGEST_STEP * time_scale(ship.particulars["L"])


def integration_steps(ship: Ship, dt: float) -> int:
    """Number of equal integration steps of ``ship`` in a sample of ``dt`` [s]."""
    return max(1, math.ceil(dt / longest_step(ship) - 1e-9))


def _columns(
    ship: Ship,
    names: Sequence[str],
    t: np.ndarray,
    states: np.ndarray,
    actuators: Mapping[str, np.ndarray],
    air: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Columns of a run with states (N, S) of these names, those of the motion as the ship's instruments log them.

    A trial always has revolutions and a rudder angle: zero where the ship has none. Raises UserError with the first
    time at which the motion is not that of a ship: not finite, faster than Froude number 3 or spinning by more than
    10 sqrt(g / L).
    """
    six, L = states[:, :6], ship.particulars["L"]
    speed, spin = np.hypot(six[:, 3], six[:, 4]), np.abs(six[:, 5])
    good = np.isfinite(six).all(axis=1) & (speed < 3 * reference_speed(L)) & (spin < 10 * math.sqrt(GRAVITY / L))
    if not good.all():
        when = t[int(np.argmin(good))]
        raise NoSolution(f"the motion of {ship.name} diverges at t = {when:g} s; check its coefficients and the inputs")
    if any(effect(name).measures for name in ship.effects):
        six = logged(ship, t, six)
    columns: dict[str, Any] = {"t": t, **dict(zip(STATES, six.T, strict=True)), **actuators}
    columns |= {} if "n" in columns else {"n": 0.0}
    columns |= {} if {"delta", "delta_port"} & set(columns) else {"delta": 0.0}
    columns |= {} if air is None else {"wind_speed": air[:, 0], "wind_direction": air[:, 1]}
    columns |= {name: states[:, names.index(name)] for name in ("phi", "p") if name in names}
    columns |= {name: wrap(columns[name]) for name in columns if name == "psi" or name.startswith("azimuth")}
    return {name: np.array(np.broadcast_to(values, len(t)), dtype=float) for name, values in columns.items()}


def _notices(ship: Ship, windy: bool, states: np.ndarray) -> tuple[Message, ...]:
    """What a user must know of a run of true states (N, 6)."""
    notices = []
    if windy and not ship.feels_wind:
        words = f"{ship.name} has no wind model: the wind is recorded but exerts no force"
        notices.append(Message(words, "no_wind_model"))
    hull = ship.components.get("hull")
    limit = getattr(module("hull", hull), "LARGEST_DRIFT", None) if hull else None
    speed = np.hypot(states[:, 3], states[:, 4])
    drift = np.abs(np.arctan2(states[:, 4], states[:, 3]))[speed > 0.1 * speed.max()]  # slower it is noise
    if limit is not None and len(drift) and drift.max() > limit:
        words = (
            f"the drift angle reaches {math.degrees(drift.max()):.0f} deg, where the {hull} hull "
            f"(up to about {math.degrees(limit):.0f} deg) only extrapolates"
        )
        notices.append(Message(words, "hull_extrapolates"))
    return tuple(notices)


def write_trial(trial: Trial, path: str | Path) -> None:
    """The trial as a CSV file (Parquet for .parquet) with canonical headers, SI, shortest exact digits.

    The file appears complete or not at all; one that exists is replaced. Raises UserError when it cannot be
    written or the suffix is neither. path: of the file.
    """
    path = Path(path)
    if path.suffix.lower() not in (".csv", ".parquet"):
        raise BadValue(f"{path}: trial files end in .csv or .parquet")
    order = [*UNITS, *(name for name in trial.columns if name not in UNITS)]
    frame = replace(trial, columns={name: trial[name] for name in order if name in trial}).to_pandas()
    try:
        with replaced(path) as scratch:
            if path.suffix.lower() == ".parquet":
                frame.to_parquet(scratch, index=False, engine="pyarrow", write_page_checksum=True)
            else:
                frame.to_csv(scratch, index=False, lineterminator="\n")
    except OSError as error:
        raise NotWritable(f"{path}: cannot be written ({error.strerror or error}); check the folder") from None
