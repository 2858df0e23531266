"""Executed manoeuvres: a ship and orders, or recorded inputs, to a trial; a standard manoeuvre, simulated or measured,
with its figures: what criteria and plots take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.criteria import figures as read
from cases.criteria.measured_maneuvers import Execute, find_maneuvers, without_broken_parts
from cases.io.campaigns import ship_in
from cases.io.read import read_controls
from cases.maneuvers.definitions import STEADY_CHANGE, STOPS, Maneuver, parse_maneuver
from cases.maneuvers.self_propulsion import TEST_FROUDE, known_speed
from cases.simulation.simulate import SensorNoise, Wind, add_noise, parse_wind, simulate, simulate_controls
from cases.trial import Trial
from mmg.errors import Conflict, OutOfRange, TooFewData, UserError
from mmg.messages import Message
from mmg.motion.froude import time_scale
from mmg.ship import Ship

if TYPE_CHECKING:
    from cases.simulation.simulate_batch import SimulatedRuns

STEP = 0.05  # Sampling and integration step [s] for a 3 m model; Froude scaled. Set by hand.
ZIGZAGS = ("zigzag:10/10", "zigzag:-10/10", "zigzag:20/20", "zigzag:-20/20")
STANDARD = ("turning:35", "turning:-35", *ZIGZAGS, "crash-stop")  # What the criteria of MSC.137(76) need


@dataclass(frozen=True, kw_only=True)
class Run(Execute):
    """A standard manoeuvre and its figures. name: as ordered ("zigzag:20/20") or the trial's; trial: the motion; length
    L [m]; figures: SI and rad, by the names of cases/criteria/figures.py; measured: from a file."""

    name: str
    trial: Trial
    length: float
    figures: Mapping[str, float]
    measured: bool = False


def approach_speed(ship: Ship, speed: float | None = None) -> tuple[float, str]:
    """Test speed of a ``ship`` [m/s] and where it is from: given, else as of ``known_speed`` with Froude number 0.142.
    Raises UserError for a speed that is not positive."""
    if speed is not None:
        if not (math.isfinite(speed) and speed > 0):
            raise OutOfRange(f"test speed {speed:g} m/s must be positive")
        return speed, "as given"
    return known_speed(ship, TEST_FROUDE)


def simulated_run(ship: Ship, text: str, speed: float, rudder_rate: float | None = None) -> Run:
    """A standard manoeuvre of a ship in calm air and deep water, one that has an order.

    text: as for ``parse_maneuver``; speed [m/s] of the approach, at its self-propulsion; rudder_rate [rad/s]. Raises
    UserError when the manoeuvre does not reach its event.
    """
    return planned_run(ship, parse_maneuver(text, ship, speed=speed, rudder_rate=rudder_rate))


def planned(
    ship: Ship, text: str, seed: int, dt: float | None = None, duration: float | None = None, **orders: Any
) -> tuple[Maneuver | None, Trial | None]:
    """The manoeuvre of a ``ship`` that a ``text`` names; of "harbour:SEED" inputs instead, to be followed as a trial's.

    seed, dt: as of ``simulated_trial``; duration, orders: as of ``parse_maneuver``. Raises UserError as that does.
    """
    from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed  # late: a fit has no use for it

    if (own_seed := harbour_seed(text, seed)) is None:
        return parse_maneuver(text, ship, seed=seed, duration=duration, **orders), None
    for name in (name for name, value in orders.items() if value):
        raise Conflict(f"--{name}: is not for {text}, which starts at rest with actuators at their own rates")
    return None, harbour_inputs(ship, duration, own_seed, dt)


def simulated_trial(
    ship: Ship,
    maneuver: str | Maneuver | None = None,
    controls: str | Path | Trial | None = None,
    wind: str | Wind | None = None,
    noise: bool = False,
    seed: int = 0,
    dt: float | None = None,
) -> Trial:
    """The motion of a ship in a manoeuvre or under recorded inputs, as a trial.

    maneuver: text as for ``parse_maneuver``, or a ``Maneuver``, for another speed, duration or rudder rate; controls: a
    trial or its file, whose inputs and wind are followed from its first state; give one of the two. wind:
    "speed:direction[:gusty]" in m/s and degrees it comes from, default calm air, or the wind of the controls; noise:
    white sensor noise on the states; seed: of gusts, noise and random manoeuvres; dt: sampling interval [s] of a
    manoeuvre, default 0.1. Raises UserError for what cannot be read or simulated, and when a manoeuvre misses its first
    event.
    """
    if (maneuver is None) == (controls is None):
        raise Conflict("give either a manoeuvre or controls, one of them")
    air = wind if wind is None or isinstance(wind, Wind) else parse_wind(wind)
    plan, controls = planned(ship, maneuver, seed, dt) if isinstance(maneuver, str) else (maneuver, controls)
    if plan is not None:
        trial = simulate(ship, plan, 0.1 if dt is None else dt, air, seed)
        trial = replace(trial, notices=trial.notices + check_completeness(trial, plan))
    else:
        source = controls if isinstance(controls, Trial) else read_controls(Path(str(controls)), ship.actuators)
        trial = simulate_controls(ship_in(ship, [source])[0], source, air, seed)
        replaced = air is not None and source.has_wind
        more = (Message("the wind of the file is replaced by --wind", "wind_replaced"),) if replaced else ()
        trial = replace(trial, notices=(*source.notices, *more, *trial.notices))
    return add_noise(trial, SensorNoise.for_length(ship.particulars["L"]), seed) if noise else trial


def planned_run(ship: Ship, plan: Maneuver) -> Run:
    """The manoeuvre ``plan`` of a ``ship``, one that has an order. Raises UserError as ``simulated_run``."""
    trial = simulate(ship, plan, STEP * time_scale(ship.particulars["L"]))
    notes, p = check_completeness(trial, plan), plan.parameters
    rudder, heading = p.get("rudder", 0.0), p.get("heading", 0.0)
    execute = Execute(plan.kind, p["order_time"], rudder, (), trial.duration, heading, plan.speed, notes)
    return Run(
        **vars(execute), name=plan.name, trial=trial, length=ship.particulars["L"], figures=figures_of(trial, plan)
    )


# Kind -> figure that a run must reach -> the event at which it is read; without the first of them it tells nothing.
EVENTS = {
    "turning": {"advance": "a change of heading of 90 deg", "tactical_diameter": "a change of heading of 180 deg"},
    "zigzag": {"overshoot_1": "the first overshoot", "overshoot_2": "the second overshoot"},
    **{kind: {"track_reach": "the end of the headway"} for kind in STOPS},
}


def check_completeness(trial: Trial, maneuver: Maneuver) -> tuple[Message, ...]:
    """A notice about the events that a run ended before; empty for one that is complete.

    Raises UserError when the manoeuvre's first event was missed although no duration was asked for: the figures
    would silently be absent. A run of given duration may end early; then the same sentence is a notice.
    trial: the run; maneuver: what was ordered.
    """
    p, name = maneuver.parameters, maneuver.name
    if "order_time" not in p:
        return ()
    run, fatal, words = read.since(trial, p["order_time"]), True, ""  # fatal: nothing can be read of the run
    steady = run.r[run.t >= run.t[-1] - p.get("window", 0.0)]
    if trial.duration <= p["order_time"]:
        words = f"{name}: the run ends after {trial.duration:g} s, before the order at {p['order_time']:g} s"
    elif maneuver.kind in EVENTS:
        events, figures = EVENTS[maneuver.kind], _figures(run, maneuver, steady=False)
        missed = [figure for figure in events if figure not in figures]
        fatal = missed == list(events)
        side = math.copysign(1.0, p.get("rudder", 1.0))
        turned = f"the heading changed by up to {math.degrees((side * run.change).max()):.3g} deg"
        makes = f"the ship makes {run.u[-1]:.3g} m/s of {run.u[0]:.3g} m/s"
        if missed:
            words = f"{name}: the run ends before {events[missed[0]]}, {run.t[-1]:.4g} s after the order: "
            words += f"{makes if maneuver.kind in STOPS else turned}; give --duration, or other orders"
    elif (
        "window" in p
        and trial.duration >= maneuver.duration * (1 - 1e-6) - p["window"]
        and not (np.ptp(steady) <= p["tolerance"] * 1.001 and run.t[-1] >= p["window"])
    ):
        words = (
            f"{name}: at rudder {math.degrees(run.delta[-1]):.3g} deg the turn rate is not yet steady, "
            f"{run.t[-1]:.4g} s after the order (r L/U changes by more than {STEADY_CHANGE:g}); give --duration"
        )
    if words and fatal and not maneuver.partial:
        raise TooFewData(words)
    return (Message(words, "event_not_reached"),) if words else ()


def figures_of(trial: Trial, plan: Maneuver) -> dict[str, float]:
    """All figures of a simulated ``trial`` of the manoeuvre ``plan``, SI and rad; empty for one that has none."""
    p = plan.parameters
    return _figures(read.since(trial, p["order_time"]), plan, steady=True) if "order_time" in p else {}


def figures_of_each(runs: SimulatedRuns, plan: Maneuver) -> list[dict[str, float]]:
    """Those of ``figures_of`` but for the means of a steady turn, of each of the ``runs`` of the manoeuvre ``plan``;
    empty where one diverged."""
    each = since_each(runs, plan.parameters["order_time"])
    return [_figures(run, plan, steady=False) if run is not None else {} for run in each]


def since_each(runs: SimulatedRuns, order_time: float) -> list[read.Since | None]:
    """Each of the ``runs`` from the order at ``order_time`` [s] on to its end; None where it diverged."""
    trials = [runs.trial(m) for m in range(len(runs.last))]
    return [read.since(trial, order_time) if np.isfinite(trial.states).all() else None for trial in trials]


def _figures(run: read.Since, plan: Maneuver, steady: bool) -> dict[str, float]:
    """Figures of a ``run`` of the manoeuvre ``plan`` from its order on. steady: with the means of a steady turn."""
    p = plan.parameters
    if plan.kind == "zigzag":
        ten = math.isclose(abs(p["rudder"]), math.radians(10), rel_tol=1e-6)  # of the initial turning ability
        figures = read.zigzag_figures(run, p["rudder"], p["heading"])
        return figures | (read.initial_turning_figures(run, p["rudder"]) if ten else {})
    if plan.kind == "heading":
        return read.heading_figures(run, p["heading"])
    return _one_order(run, plan.kind, p.get("rudder", 0.0), p.get("least", 0.0), steady)


def _one_order(run: read.Since, kind: str, rudder: float, least: float = 0.0, steady: bool = True) -> dict[str, float]:
    """Figures of a manoeuvre whose orders do not wait for the heading."""
    if kind == "turning":
        return read.turning_figures(run, rudder) | (read.steady_turn_figures(run, rudder) if steady else {})
    if kind in STOPS:
        return read.stopping_figures(run, least)
    return {"spiral": read.spiral_figures, "pull-out": read.pull_out_figures}[kind](run)


def measured_runs(trial: Trial, length: float) -> list[Run]:
    """The standard manoeuvres found in a measured run of a ship of this length [m], in the order of time.

    The approach is cut off (cases/criteria/measured_maneuvers.py). Several in one record are named by its name, their
    number and what they are. Raises UserError when there is none in it, and where a broken stretch decides in all of
    them. trial: the run; what was left out of it is bridged, or ends it.
    """
    executes = find_maneuvers(trial, length)
    runs, refused = [], []
    for number, execute in enumerate(executes, 1):
        name = f"{trial.name} {number} ({execute.title})" if len(executes) > 1 else trial.name
        try:
            runs.append(_measured(trial, length, execute, name))
        except UserError as error:
            refused.append(error)
    if not runs:
        raise refused[0]
    return runs


def _measured(trial: Trial, length: float, execute: Execute, name: str) -> Run:
    trial, execute = without_broken_parts(trial, execute)
    figures = measured_figures(trial, execute)
    return Run(**vars(execute), name=name, trial=trial, length=length, figures=figures, measured=True)


def measured_figures(trial: Trial, execute: Execute) -> dict[str, float]:
    """All figures, SI and rad, of the manoeuvre ``execute`` in the measured run ``trial``."""
    rows = trial.t - trial.t[0] <= execute.end + 1e-9  # what comes after is another manoeuvre
    used = trial.with_columns(**{name: np.asarray(values)[rows] for name, values in trial.columns.items()})
    run = read.since(used, execute.order_time)
    if execute.kind == "zigzag":
        figures = read.overshoot_figures(used, execute.rudder, execute.reversals, execute.end)
        return figures | read.initial_turning_figures(run, execute.rudder)
    return _one_order(run, execute.kind, execute.rudder)
