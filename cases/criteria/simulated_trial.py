"""From a ship and a manoeuvre, or recorded inputs, to a trial: wind, noise, and whether it reached its event."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.criteria.figures import Since, since
from cases.io.campaigns import ship_in
from cases.io.read import read_controls
from cases.maneuvers.definitions import STEADY_CHANGE, Maneuver, parse_maneuver
from cases.simulation.gusts import Wind, parse_wind
from cases.simulation.harbour_inputs import harbour_inputs, harbour_seed
from cases.simulation.sensors import SensorNoise, add_noise
from cases.simulation.simulate import simulate, simulate_controls
from cases.trial import Trial
from mmg.errors import Conflict, TooFewData
from mmg.messages import Message
from mmg.ship import Ship


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

    maneuver: text as for ``parse_maneuver``, "harbour:SEED" for random use of all actuators from rest, or a
    ``Maneuver``, for another speed, duration or rudder rate; controls: a trial or its file, whose inputs and wind are
    followed from its first state; give one of the two. wind:
    "speed:direction[:gusty]" in m/s and degrees it comes from, default calm air, or the wind of the controls; noise:
    white sensor noise on the states; seed: of gusts, noise and random manoeuvres; dt: sampling interval [s] of a
    manoeuvre, default 0.1. Raises UserError for what cannot be read or simulated, and when a manoeuvre misses its first
    event.
    """
    if (maneuver is None) == (controls is None):
        raise Conflict("give either a manoeuvre or controls, one of them")
    air = parse_wind(wind) if isinstance(wind, str) else wind
    if isinstance(maneuver, str) and (own := harbour_seed(maneuver, seed)) is not None:
        maneuver, controls = None, harbour_inputs(ship, None, own, dt)
    if maneuver is not None:
        plan = parse_maneuver(maneuver, ship, seed=seed) if isinstance(maneuver, str) else maneuver
        trial = simulate(ship, plan, 0.1 if dt is None else dt, air, seed)
        trial = replace(trial, notices=trial.notices + check_completeness(trial, plan))
    else:
        source = controls if isinstance(controls, Trial) else read_controls(Path(str(controls)), ship.actuators)
        trial = simulate_controls(ship_in(ship, [source])[0], source, air, seed)
        replaced = air is not None and source.has_wind
        more = (Message("the wind of the file is replaced by --wind", "wind_replaced"),) if replaced else ()
        trial = replace(trial, notices=(*source.notices, *more, *trial.notices))
    return add_noise(trial, SensorNoise.for_length(ship.particulars["L"]), seed) if noise else trial


def check_completeness(trial: Trial, maneuver: Maneuver) -> tuple[Message, ...]:
    """Notices about events that a run ended before; empty for one that is complete.

    Raises UserError when the manoeuvre's first event was missed although no duration was asked for: the figures
    would silently be absent. A run of given duration may end early; then the same sentence is a notice.
    trial: the run; maneuver: what was ordered.
    """
    judge = {
        "turning": _turning,
        "zigzag": _zigzag,
        "crash-stop": _crash_stop,
        "coasting": _crash_stop,
        "spiral": _steps,
        "pull-out": _steps,
    }
    if maneuver.kind not in judge:
        return ()
    order_time = maneuver.parameters["order_time"]
    if trial.duration <= order_time:
        words = f"{maneuver.name}: the run ends after {trial.duration:g} s, before the order at {order_time:g} s"
        fatal = True
    else:
        fatal, words = judge[maneuver.kind](since(trial, order_time), maneuver)
    if fatal and not maneuver.partial:
        raise TooFewData(words)
    return (Message(words, "event_not_reached"),) if words else ()


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.3g} deg"


def _turning(run: Since, m: Maneuver) -> tuple[bool, str]:
    """Whether nothing can be read from the run, and the sentence on what is missing, "" for nothing; as the others."""
    reached = float((math.copysign(1.0, m.parameters["rudder"]) * run.change).max())
    for needed, what in ((math.pi / 2, "the advance needs"), (math.pi, "the tactical diameter needs")):
        if reached < needed:
            words = (
                f"{m.name}: the heading changed by {_deg(reached)} of the {_deg(needed)} that {what} "
                f"within {run.t[-1]:.4g} s after the order; give more rudder, n or --duration"
            )
            return needed < 2, words
    return False, ""


def _zigzag(run: Since, m: Maneuver) -> tuple[bool, str]:
    side, heading, row = math.copysign(1.0, m.parameters["rudder"]), m.parameters["heading"], 0
    for execute in range(1, 4):
        beyond = np.flatnonzero(side * run.change[row:] >= heading * (1 - 1e-9))
        if len(beyond) == 0:
            reached = float((side * run.change[row:]).max())
            words = (
                f"{m.name}: the heading changed by {_deg(reached)} of the {_deg(heading)} at which the rudder is "
                f"reversed, to the side of execute {execute}, within {run.t[-1]:.4g} s after the order; "
                "give more rudder, n or --duration, or a smaller switch heading"
            )
            return execute <= 2, words
        row, side = row + int(beyond[0]), -side
    return False, ""


def _crash_stop(run: Since, m: Maneuver) -> tuple[bool, str]:
    if run.u[0] <= 0:
        return True, f"{m.name}: the ship has no headway at the order (u = {run.u[0]:.3g} m/s); give --speed or --n"
    if run.u.min() <= m.parameters.get("least", 0.0) * run.u[0] * (1 + 1e-9):
        return False, ""
    why = ", or check the thrust astern" if m.kind == "crash-stop" else ""
    words = (
        f"{m.name}: the ship still makes {run.u[-1]:.3g} m/s of {run.u[0]:.3g} m/s {run.t[-1]:.4g} s after the order; "
        f"give --duration{why}"
    )
    return True, words


def _steps(run: Since, m: Maneuver) -> tuple[bool, str]:
    p = m.parameters
    if run.t[-1] + p["order_time"] < m.duration * (1 - 1e-6) - p["window"]:
        return False, ""
    rows = run.t >= run.t[-1] - p["window"]
    spread = float(np.ptp(run.r[rows]))
    if spread <= p["tolerance"] * 1.001 and run.t[-1] >= p["window"]:
        return False, ""
    words = (
        f"{m.name}: at rudder {_deg(float(run.delta[-1]))} the turn rate still changes by {_deg(spread)}/s "
        f"in {p['window']:.4g} s, {_deg(p['tolerance'])}/s would be steady (r L/U {STEADY_CHANGE:g}), "
        f"at the end {run.t[-1]:.4g} s after the order; give --duration"
    )
    return True, words
