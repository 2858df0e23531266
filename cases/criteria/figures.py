"""Figures of the standard manoeuvres from a trial: turning circle, zigzag, stopping, spiral, pull-out.

Definitions of IMO MSC.137(76) and its explanatory notes: origin and axes are midship and heading when the order is
given; samples are interpolated linearly, the moment of the order too. The path length is the integral of the speed,
so that noise of the positions does not lengthen it; without positions the track is integrated from u, v and psi.
Lengths in metres, angles in radians, times in seconds; what was not reached is absent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cases.criteria.measured_maneuvers import held_stretches
from cases.inputs import integral
from cases.trial import Trial

_UNITS = {"time": "s", "overshoot": "rad", "width": "rad", "drift": "rad", "rate": "rad/s", "height": "rad/s",
          "heading": "rad", "rudder": "rad"}  # fmt: skip


def figure_unit(name: str) -> str:
    """Unit of a figure by its name; "" for a share."""
    words = name.split("_")
    if words[-1] in ("speed", "share"):
        return "m/s" if words[-1] == "speed" else ""
    return next((unit for word, unit in _UNITS.items() if word in words), "m")


@dataclass(frozen=True)
class Since:
    """A run from the order on, each (M,): t [s] since the order, track, heading change, motion, actuators.

    advance, transfer: ahead and to starboard of the ship at the order [m]; path: length of the track [m];
    change: of heading, clockwise [rad]; u, v [m/s], r [rad/s], delta [rad].
    """

    t: np.ndarray
    advance: np.ndarray
    transfer: np.ndarray
    path: np.ndarray
    change: np.ndarray
    u: np.ndarray
    v: np.ndarray
    r: np.ndarray
    delta: np.ndarray


def since(trial: Trial, order_time: float) -> Since:
    """The rows of ``trial`` with heading and speed from ``order_time`` [s after the first sample] on."""
    t = trial.t - trial.t[0]
    psi, u, v = trial.psi_unwrapped, trial["u"], trial["v"]
    good = np.isfinite(psi) & np.isfinite(u) & np.isfinite(v)
    if trial.has_position:
        good &= np.isfinite(trial["x"]) & np.isfinite(trial["y"])
    start = min(max(order_time, 0.0), float(t[good][-1]))  # the order itself lies between two samples
    times = np.concatenate([[start], t[good & (t > start + 1e-9)]])

    def at(values: np.ndarray) -> np.ndarray:
        fine = good & np.isfinite(values)
        return np.interp(times, t[fine], values[fine])

    psi, u, v = at(psi), at(u), at(v)  # continuous psi: a line between two wrapped headings may cross north
    if trial.has_position:
        x, y = at(trial["x"]), at(trial["y"])
    else:
        x = integral(times, u * np.cos(psi) - v * np.sin(psi))
        y = integral(times, u * np.sin(psi) + v * np.cos(psi))
    # from here on in the axes of the ship at the order: ahead and to starboard
    x, y, c, s = x - x[0], y - y[0], math.cos(psi[0]), math.sin(psi[0])
    return Since(
        t=times - start,
        advance=x * c + y * s,
        transfer=y * c - x * s,
        path=integral(times, np.hypot(u, v)),
        change=psi - psi[0],
        u=u,
        v=v,
        r=at(trial["r"]),
        delta=at(trial.rudder),
    )


def _when(change: np.ndarray, level: float) -> float | None:
    """Fractional row at which ``change`` first reaches ``level`` > 0, None if it never does."""
    reached = np.flatnonzero(change >= level)
    if len(reached) == 0:
        return None
    k = int(reached[0])
    return 0.0 if k == 0 else k - 1 + (level - change[k - 1]) / (change[k] - change[k - 1])


def _at(row: float | None, **series: np.ndarray) -> dict[str, float]:
    """Name -> value of each series at a fractional row; empty where there is none."""
    return {} if row is None else {k: float(np.interp(row, np.arange(len(v)), v)) for k, v in series.items()}


def turning_figures(run: Since, rudder: float) -> dict[str, float]:
    """advance, transfer (at 90 deg), tactical_diameter (at 180 deg) [m] and the times they take [s]. run: from the
    order on; rudder [rad] gives the side."""
    side = math.copysign(1.0, rudder)
    quarter, half = (_when(side * run.change, angle) for angle in (math.pi / 2, math.pi))
    figures = _at(quarter, advance=run.advance, transfer=side * run.transfer, time_90=run.t)
    return figures | _at(half, tactical_diameter=side * run.transfer, time_180=run.t)


def steady_turn_figures(run: Since, rudder: float) -> dict[str, float]:
    """steady_speed [m/s], steady_rate [rad/s], steady_drift [rad] and steady_diameter [m], means over the last 90 deg.

    Empty unless the heading changes by 270 deg; wind or current shift these means (a whole turn would cancel them).
    run: from the order on; rudder [rad] gives the side.
    """
    change = math.copysign(1.0, rudder) * run.change
    largest = float(change.max())
    if largest < 1.5 * math.pi:
        return {}
    rows = change >= largest - math.pi / 2  # by heading, not by time: a slower turn is not measured over less of it
    u, v, r = (float(values[rows].mean()) for values in (run.u, run.v, run.r))
    speed = math.hypot(u, v)
    figures = {"steady_speed": speed, "steady_rate": r, "steady_drift": math.atan2(-v, u)}  # drift beta > 0: v < 0
    return figures | ({"steady_diameter": 2 * speed / abs(r)} if r else {})  # U = r R


def zigzag_figures(run: Since, rudder: float, heading: float) -> dict[str, float]:
    """overshoot_1, overshoot_2, ... [rad]: largest heading after each counter order, less the switch one.

    run: from the order on; rudder [rad] gives the first side, heading [rad] > 0 is the switch heading. An overshoot
    counts once the heading has come back to the switch heading.
    """
    change = run.change
    side, row, figures = math.copysign(1.0, rudder), 0, {}
    for k in range(1, len(change)):  # k: number of the counter order, ``row`` where it is given
        beyond = np.flatnonzero(side * change[row:] >= heading)
        if len(beyond) == 0:
            break
        row += int(beyond[0])
        back = np.flatnonzero(side * change[row:] < heading)
        if len(back) == 0:
            break
        end = row + int(back[0])
        figures[f"overshoot_{k}"] = float((side * change[row:end]).max() - heading)
        row, side = end, -side
    return figures


# Samples of the parabola that takes the noise from a measured heading; it leaves a peak its height. Set by hand.
SMOOTHED = 9


def parabolic(values: np.ndarray, width: int) -> np.ndarray:
    """``values`` (N,) smoothed by the parabola through the ``width`` samples (odd, at most N) about each, (N,); at the
    ends by that through the outermost (Savitzky & Golay 1964). That of ``scipy.signal``, which is slow to import."""
    half = width // 2
    powers = np.vander(np.arange(-half, half + 1.0), 3)
    fit = np.linalg.pinv(powers)  # (3, width): coefficients of the parabola
    ends = [powers @ (fit @ part) for part in (values[:width], values[-width:])]
    inner = np.convolve(values, fit[2, ::-1], "valid")
    return np.concatenate([ends[0][:half], inner, ends[1][half + 1 :]])


def overshoot_figures(trial: Trial, rudder: float, reversals: tuple[float, ...], end: float) -> dict[str, float]:
    """overshoot_1, ... [rad] of a measured zigzag: heading gained after each reversal of the rudder at its own heading,
    that of the counter order where orders were logged, which the rudder follows late.

    rudder [rad] gives the first side; reversals, end: times [s after the first sample]. The last one counts only if
    a fifth of it has gone again before the hold ends. trial: the run.
    """
    t, psi, reversals = trial.t - trial.t[0], trial.psi_unwrapped, _ordered(trial, rudder, reversals)
    good = np.isfinite(psi)
    t, psi = t[good], psi[good]
    if len(t) > SMOOTHED:
        psi = parabolic(psi, SMOOTHED)
    figures, side = {}, math.copysign(1.0, rudder)
    for k, begin in enumerate(reversals):
        stop = reversals[k + 1] if k + 1 < len(reversals) else end
        gained = side * (psi[(t >= begin) & (t <= stop)] - np.interp(begin, t, psi))
        if len(gained) > 2 and gained[-1] < 0.8 * gained.max():  # set by hand: by then the peak is passed, noise or not
            figures[f"overshoot_{k + 1}"] = float(gained.max())
        side = -side
    return figures


def _ordered(trial: Trial, rudder: float, reversals: tuple[float, ...]) -> tuple[float, ...]:
    """The times of the orders behind ``reversals`` of a ``rudder`` [rad] of a ``trial`` [s after the first sample];
    those of the rudder itself where no order stands between one and the one before."""
    if "delta_order" not in trial.columns:
        return reversals
    t = trial.t - trial.t[0]
    over = np.flatnonzero(np.abs(np.diff(trial["delta_order"])) > abs(rudder))  # a counter order goes to the other side
    spans = zip((0.0, *reversals), reversals, strict=False)
    # a rudder that moves between two rows moves before the row that shows its order
    given = [t[over[(t[over] >= before) & (t[over] < moved)] + 1] for before, moved in spans]
    return tuple(float(min(own[-1], moved)) if len(own) else moved for own, moved in zip(given, reversals, strict=True))


# Change of heading at which the initial turning ability is read [rad] (IMO MSC.137(76), 5.3.2)
INITIAL_TURN = math.radians(10.0)


def initial_turning_figures(run: Since, rudder: float) -> dict[str, float]:
    """initial_turning_track [m]: way along the track until the heading has changed by 10 deg, and time_10 [s].

    The criterion asks for 10 deg of rudder: the first execute of a 10/10 zigzag serves.
    run: from the order on; rudder [rad] gives the side.
    """
    row = _when(math.copysign(1.0, rudder) * run.change, INITIAL_TURN)
    return _at(row, initial_turning_track=run.path, time_10=run.t)


def stopping_figures(run: Since, least: float = 0.0) -> dict[str, float]:
    """track_reach (along the path), head_reach, lateral_deviation [m] and stopping_time [s] until headway is lost. run:
    from the order on; least: share of the speed at the order that is the end of it."""
    stop = _when(run.u[0] - run.u, (1 - least) * run.u[0]) if run.u[0] > 0 else None  # u falls to ``least`` u_0
    return _at(stop, track_reach=run.path, head_reach=run.advance, lateral_deviation=run.transfer, stopping_time=run.t)


def pull_out_figures(run: Since) -> dict[str, float]:
    """steady_rate under rudder, residual_rate after it went back to midships [rad/s], and their share.

    Means over the last tenth of each hold of a run from the order on. A ship that is stable on course decays to the
    same small rate from either side; one that keeps turning to the side it came from is unstable (MSC/Circ.1053).
    """
    _, rates = steady_rates(run)
    if len(rates) < 2:
        return {}
    first, last = float(rates[0]), float(rates[-1])
    return {"steady_rate": first, "residual_rate": last, "residual_share": last / first}


def heading_figures(run: Since, heading: float) -> dict[str, float]:
    """Root mean squares of the error of the heading and of the rudder [rad] of a controller that was ordered a change
    of ``heading`` [rad], over a run from the order on (Wakita et al. 2025, section 5.4); the latter where there is a
    rudder: pods have none."""
    values = {"rms_heading_error": run.change - heading} | ({"rms_rudder": run.delta} if run.delta.any() else {})
    return {name: float(np.sqrt(integral(run.t, x**2)[-1] / run.t[-1])) for name, x in values.items()}


# A rudder of a spiral or pull-out is held while it stays this near to its angle [rad]; the turn rate is steady in this
# share of a hold, its last. Set by hand.
HELD, TAIL = math.radians(0.25), 0.1


def steady_rates(run: Since) -> tuple[np.ndarray, np.ndarray]:
    """Rudder angles [rad] and mean turn rates of the last tenth [rad/s] of the holds of a ``run``, (K,) each. Holds
    shorter than a tenth of the longest (the rudder on its way) are left out."""
    stretches = held_stretches(run.t, run.delta, tolerance=HELD)
    holds = [h for h in stretches if h.seconds >= TAIL * max(other.seconds for other in stretches)]
    tails = [(run.t >= h.end - TAIL * h.seconds) & (run.t <= h.end) for h in holds]
    return np.array([h.angle for h in holds]), np.array([float(run.r[rows].mean()) for rows in tails])


def spiral_branches(run: Since) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rudder angles [rad], rising, and steady turn rates [rad/s], (K,) each, of the way to the outermost angle of the
    other side and of the way back, of a ``run`` with the rudder in steps from the order on; none of under three."""
    rudder, rate = steady_rates(run)
    if len(rudder) < 3:
        return []
    turn = int(np.argmin((np.sign(rudder[0]) or 1.0) * rudder))
    ways = (np.arange(turn + 1), np.arange(turn, len(rudder)))
    return [(rudder[rows], rate[rows]) for rows in (way[np.argsort(rudder[way])] for way in ways)]


def spiral_figures(run: Since) -> dict[str, float]:
    """loop_height [rad/s], loop_width [rad], rate_at_midships (mean of both branches, [rad/s]).

    Height: largest difference of the turn rates of the two branches at the same rudder angle. Width: difference of
    the rudder angles at which the branches change the side to which the ship turns; 0 for a ship that is stable on
    course, up to half a step on each side where the rudder went in steps. Absent where the spiral lacks the branch.
    run: from the order on.
    """
    branches = spiral_branches(run)
    if not branches:
        return {}
    (there, first), (back, second) = branches
    low, high = max(there[0], back[0]), min(there[-1], back[-1])
    if len(there) < 2 or len(back) < 2 or low >= high:
        return {}
    # the difference of two polygons is largest at a corner of one of them
    grid = np.unique(np.concatenate([there, back]))
    grid = grid[(grid >= low - 1e-9) & (grid <= high + 1e-9)]
    gap = np.interp(grid, there, first) - np.interp(grid, back, second)
    figures = {"loop_height": float(np.abs(gap).max())}
    crossings = [_crossing(*branch) for branch in branches]
    if crossings[0] is not None and crossings[1] is not None:
        figures["loop_width"] = abs(crossings[0] - crossings[1])
    if low <= 0 <= high:
        figures["rate_at_midships"] = float(0.5 * (np.interp(0, there, first) + np.interp(0, back, second)))
    return figures


def _crossing(rudder: np.ndarray, rate: np.ndarray) -> float | None:
    """Rudder angle at which the rate changes sign, by linear interpolation; None if it never does."""
    rows = np.flatnonzero((rate[:-1] < 0) & (rate[1:] >= 0))
    if len(rows) == 0:
        return None
    k = int(rows[0])
    return float(rudder[k] - rate[k] * (rudder[k + 1] - rudder[k]) / (rate[k + 1] - rate[k]))
