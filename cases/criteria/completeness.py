"""Did a simulated manoeuvre reach the event it is made for? One sentence with the offending value if it did not."""

from __future__ import annotations

import math

import numpy as np

from cases.criteria.figures import Since, since
from cases.maneuvers.definitions import STEADY_CHANGE, Maneuver
from cases.trial import Trial
from mmg.errors import TooFewData
from mmg.messages import Message


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
