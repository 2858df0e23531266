"""Measured manoeuvres corrected to still water and calm air, as MSC/Circ.1053 (2002) 3.4.2 asks where the conditions of
the criteria were not met.

Current, 3.4.2.5: in a turning circle the positions a whole turn apart, from a change of heading of 180 deg on, drift
with the water. The mean of their velocities is the current; the track less its way is that in still water. ITTC
7.5-04-02-01 (2017) asks for the circle for the same purpose. Wind: the model of the ship runs the manoeuvre in the mean
wind and in calm air, and the difference of a figure is added to the measured one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.criteria.measured_maneuvers import Execute
from cases.criteria.standard_runs import STEP, Run, figures_of, measured_figures
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.effects import calm_and_deep
from cases.simulation.gusts import Wind
from cases.simulation.simulate import simulate
from mmg.errors import Missing, UserError
from mmg.messages import Message
from mmg.motion.froude import time_scale
from mmg.ship import Ship

FIRST, WHOLE = math.pi, 2 * math.pi
"""Change of heading from which positions count, and that between two of a pair [rad] (3.4.2.5)."""

PAIRS_EVERY = math.radians(10.0)
"""Between the pairs of positions [rad]."""

MOST_SCATTER = 0.5
"""Standard deviation of the velocities of a circle's pairs, as a share of their mean, above which they are no steady
current; one that is less than LEAST_SCATTER of the ship's speed is never too much."""

LEAST_SCATTER = 0.03


@dataclass(frozen=True)
class WaterVelocity:
    """Velocity of the water over ground.

    north, east [m/s]; std: standard deviation of the velocities behind it [m/s]; origin: where it is from, in words.
    """

    north: float
    east: float
    std: float
    origin: str

    @property
    def words(self) -> str:
        """Speed and the direction that it goes to, in words."""
        speed = math.hypot(self.north, self.east)
        towards = math.degrees(math.atan2(self.east, self.north)) % 360
        return f"current {speed:.3g} m/s towards {towards:.0f} deg ({self.origin})"


def current_of(run: Run) -> WaterVelocity | None:
    """The current in which a measured turning circle drifted; None for another run, one that turns less than 540 deg,
    one without positions, and one whose pairs disagree.
    """
    trial = run.trial
    if run.kind != "turning" or not trial.has_position:
        return None
    t = trial.t - trial.t[0]
    psi, x, y = trial.psi_unwrapped, trial["x"], trial["y"]
    rows = np.isfinite(psi) & np.isfinite(x) & np.isfinite(y) & (t >= run.order_time) & (t <= run.end + 1e-9)
    if rows.sum() < 10:
        return None
    t, x, y = t[rows], x[rows], y[rows]
    change = np.maximum.accumulate(math.copysign(1.0, run.rudder) * (psi[rows] - psi[rows][0]))
    starts = np.arange(FIRST, float(change[-1]) - WHOLE, PAIRS_EVERY)
    if len(starts) == 0:
        return None
    rising = np.concatenate([[True], np.diff(change) > 0])
    t, x, y, change = t[rising], x[rising], y[rising], change[rising]

    def at(values: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return np.interp(angles, change, values)

    seconds = at(t, starts + WHOLE) - at(t, starts)
    velocity = np.array([at(p, starts + WHOLE) - at(p, starts) for p in (x, y)]) / seconds
    mean, scatter = velocity.mean(axis=1), float(np.hypot(*velocity.std(axis=1)))
    if scatter > max(MOST_SCATTER * float(np.hypot(*mean)), LEAST_SCATTER * run.speed):
        return None
    return WaterVelocity(float(mean[0]), float(mean[1]), scatter, f"{len(starts)} pairs of positions of {run.name}")


def mean_current(currents: Sequence[WaterVelocity]) -> WaterVelocity | None:
    """The mean of ``currents`` of several circles, None of none."""
    if not currents:
        return None
    parts = np.array([(c.north, c.east) for c in currents])
    std = float(np.hypot(*parts.std(axis=0))) if len(currents) > 1 else currents[0].std
    origin = f"mean of {len(currents)} circles, which differ by {std:.2g} m/s"
    if len(currents) == 1:
        origin = currents[0].origin
    north, east = (float(x) for x in parts.mean(axis=0))
    return WaterVelocity(north, east, std, origin)


def in_still_water(run: Run, current: WaterVelocity) -> Run:
    """Returns ``run`` as seen from water that moves with the ``current``: track, velocities, test speed, figures."""
    trial = run.trial
    psi, t = trial.psi_unwrapped, trial.t - trial.t[0] - run.order_time
    c, s = np.cos(psi), np.sin(psi)
    columns = {
        "u": trial["u"] - (c * current.north + s * current.east),
        "v": trial["v"] - (-s * current.north + c * current.east),
    }
    if trial.has_position:
        columns |= {"x": trial["x"] - current.north * t, "y": trial["y"] - current.east * t}
    moved = trial.with_columns(**columns)
    before = (t <= 1e-9) & np.isfinite(psi)
    at = np.flatnonzero(before)[-1] if before.any() else np.flatnonzero(np.isfinite(psi))[0]
    ahead = float(c[at] * current.north + s[at] * current.east)
    corrected = replace(run, trial=moved, speed=run.speed - ahead)
    return replace(corrected, figures=measured_figures(moved, corrected))


@dataclass(frozen=True)
class _Model:
    """What a ship's model makes of a measured run: figures in calm air and in its wind, and how the wind alone moves a
    circle over ground, north and east [m/s]."""

    calm: dict[str, float]
    windy: dict[str, float]
    drift: tuple[float, float]


def _modelled(run: Run, ship: Ship) -> _Model:
    """Raises UserError where the run has no wind, or the model does not reach what was measured."""
    trial = run.trial
    t = trial.t - trial.t[0]
    rows = (t >= run.order_time) & (t <= run.end + 1e-9) & np.isfinite(trial.wind_vector).all(axis=1)
    if not trial.has_wind or not rows.any():
        raise Missing("no wind is recorded")
    north, east = -trial.wind_vector[rows].mean(axis=0)
    good = np.isfinite(trial["psi"])
    heading = float(np.interp(run.order_time, t[good], trial.psi_unwrapped[good]))
    wind = Wind(math.hypot(north, east), math.atan2(east, north) - heading)
    calm, _ = calm_and_deep(ship)
    degrees = math.degrees(run.rudder)
    own = {"turning": f":{degrees:g}", "zigzag": f":{degrees:g}/{math.degrees(run.heading):g}"}
    text, dt = run.kind + own.get(run.kind, ""), STEP * time_scale(ship.particulars["L"])
    plan = parse_maneuver(text, calm, speed=run.speed)
    longer = replace(plan, duration=1.5 * plan.duration) if run.kind == "turning" else plan
    still, windy = simulate(calm, plan, dt), simulate(calm, longer, dt, wind)
    whole = Execute(plan.kind, plan.parameters["order_time"], run.rudder, (), windy.duration, 0.0, run.speed, ())
    moved = current_of(Run(**vars(whole), name="model", trial=windy, length=run.length, figures={}))
    ahead, aside = (moved.north, moved.east) if moved else (0.0, 0.0)
    c, s = math.cos(heading), math.sin(heading)
    drift = (c * ahead - s * aside, s * ahead + c * aside)
    return _Model(figures_of(still, plan), figures_of(windy, plan), drift)


def corrected_runs(
    runs: Sequence[Run], ship: Ship | None, current: WaterVelocity | None = None
) -> tuple[list[Run], list[Message]]:
    """Measured ``runs`` in still water and calm air, and what was done, as messages.

    current: as known; None takes for a circle its own, less what the model drifts in the wind alone, for the others the
    mean of all circles among the runs. ship: whose wind model corrects for the wind of the runs; None or without one:
    none is corrected for.
    """
    notices, models = [], {}
    if ship is not None and ship.feels_wind:
        for run in runs:
            try:
                models[run.name] = _modelled(run, ship)
            except UserError as error:
                notices.append(Message(f"{run.name}: not corrected for wind: {error}", "not_corrected"))
    else:
        words = "wind is not corrected for: there is no ship with a wind model"
        notices.append(Message(words, "no_wind_model"))
    own = {}
    for run in runs:
        found = None if current else current_of(run)
        if found is not None:
            north, east = models[run.name].drift if run.name in models else (0.0, 0.0)
            own[run.name] = replace(found, north=found.north - north, east=found.east - east)
    shared, result = current or mean_current(list(own.values())), []
    for run in runs:
        water = own.get(run.name, shared)
        if water is not None:
            run = in_still_water(run, water)
            notices.append(Message(f"{run.name}: corrected for {water.words}", "current_corrected"))
        model = models.get(run.name)
        if model is not None:
            shift = {k: model.calm[k] - model.windy[k] for k in model.calm if k in model.windy}
            run = replace(run, figures={k: v + shift.get(k, 0.0) for k, v in run.figures.items()})
            words = f"{run.name}: corrected for wind by what it changes of the figures of {ship.name if ship else ''}"
            notices.append(Message(words, "wind_corrected"))
        result.append(run)
    if shared is None:
        words = "no current is known: give one, or a turning circle of 540 deg and more among the trials"
        notices.append(Message(words, "no_current"))
    return result, notices
