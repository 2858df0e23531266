"""A ship's own rates from her trials: steering gear, revolutions, approach speed, rudder of a straight course; and how
long her steering gear and her engine wait after an order, where orders were logged.

A steering gear that is at its limit moves the rudder along a straight line from one angle to the next, and at the same
rate each time; a hand or an autopilot does neither. Each move is fitted by stand, ramp, stand (least squares), so that
neither noise nor a sampling interval of half a move biases its rate. Held samples are means over their intervals.
Moves of one rate are the limit; without any that agree, the fastest is a lower bound and says no more. The same ramps
say when a move began, and a column of orders when it was ordered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cases.criteria.measured_maneuvers import find_maneuvers, steering
from cases.evidence.signals import MAD
from cases.inputs import is_sampled
from cases.maneuvers.definitions import Limits
from cases.maneuvers.self_propulsion import USUAL, diameter_for, has_engine
from cases.shipfiles.particulars import BY_RULE, MOST_DELAY, RATIOS
from cases.trial import Trial
from cases.trial_set import in_own_water
from mmg.errors import UserError
from mmg.messages import Message, listed
from mmg.motion.froude import time_scale
from mmg.ship import Ship

MEASURED = "measured in "  # How the source of a particular begins that was estimated from trials
LOWER_BOUND = ", a lower bound"  # How that of a rate ends that may be higher
BOUND = "rudder_rate_at_least"  # Code of a message on a rudder that moves faster than by rule, if not at its limit
# Samples over which slopes are taken to find moves: the fewest that show the largest slope above the noise.
WINDOWS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # set by hand: steps by a half at most
# Shares of the largest slope: the most that the noise of a slope may have, and the least of a move. Set by hand.
CLEAR, MOVING = 0.06, 0.3
VISIBLE = 8.0  # Least size of a move, by the noise (its standard deviation). Set by hand.
# Largest moves of a trial that are fitted: a zigzag has five, and each costs some hundredths of a second.
MOST = 5  # set by hand
# Largest change from a sample to the next, by that of the move: more of it is one step, as in a log of orders.
JUMP = 0.7  # set by hand
# A ramp whose rate counts lasts so many sampling intervals, has this relative standard error at most, and leaves an rms
# error of so many times the noise and this share of its size: half a sine leaves 0.026. Set by hand below that.
RESOLVED, SURE, STRAIGHT = 1.5, 0.05, (1.5, 0.01)
# A limit is shown by so many moves at least that agree to this share of their rate, and by this share of all moves of
# half the largest size in the trials that show it. Set by hand.
FEW, AGREE, MOSTLY = 2, 0.1, 0.5
FASTEST = 5.0  # Rates above so many times those by Froude's law are steps of orders. Set by hand.
# Particular, the column whose steps are its orders, and the highest order that counts: an engine that is stopped or
# reversed is what ``engine_delay`` is of.
DELAYS = (("rudder_delay", "delta_order", math.inf), ("engine_delay", "n_order", 0.0))
# Share by which a rate that the ship file states differs from the one measured for that to be said. Set by hand.
NOTED = 0.1
# Speeds of approach are one speed where they differ by this share at most; ship times L/U of an approach that are
# looked at. Set by hand.
ALIKE, APPROACH = 0.15, 1.0
# Least and largest usual diameter of a propeller by the draught [-].
USUAL_DIAMETER = next(usual for words, *_, usual in RATIOS if words == "D_P / d")
# A smaller mean rudder of straight approaches is zero [rad]: rudders are logged to a tenth of a degree, with noise. Set
# by hand.
LEAST_NEUTRAL = math.radians(0.25)


@dataclass(frozen=True)
class Ramp:
    """A move of an actuator: when it began [s, on the clock of the trial]; its rate and the standard error of that by
    it; size, positive where it rises; duration [s], rms error; trial."""

    begin: float
    rate: float
    error: float
    change: float
    seconds: float
    rms: float
    straight: bool
    resolved: bool
    trial: str

    @property
    def size(self) -> float:
        """Size of the move, without its sign."""
        return abs(self.change)


@dataclass(frozen=True)
class SlewRate:
    """Rate of an actuator by its fastest moves [its unit / s]; limit: moves agree in it, else it is a lower bound;
    trials: names of those that show it."""

    rate: float
    limit: bool
    trials: tuple[str, ...]


def slew_rate(ramps: Sequence[Ramp]) -> SlewRate | None:
    """The rate of an actuator whose largest moves in all trials are ``ramps``; None where no move is resolved by the
    samples, as in a log of orders."""
    resolved = [ramp for ramp in ramps if ramp.resolved]
    if not resolved:
        return None
    for fastest in sorted(resolved, key=lambda ramp: -ramp.rate):
        alike = [ramp for ramp in resolved if ramp.straight and abs(ramp.rate / fastest.rate - 1) <= AGREE]
        names = {ramp.trial for ramp in alike}  # slow moves of others, such as pods turned by hand, deny nothing
        theirs = [ramp for ramp in ramps if ramp.trial in names]
        # a ramp that begins in a move has no size of its own
        largest = max((ramp.size for ramp in theirs if ramp.resolved), default=0.0)
        large = [ramp for ramp in theirs if ramp.size >= 0.5 * largest]
        enough = len(alike) >= FEW and sum(ramp in alike for ramp in large) >= MOSTLY * len(large)
        if fastest.straight and enough:
            weights = np.array([ramp.error**2 + 0.01**2 for ramp in alike]) ** -1  # 1 %: no move alone decides
            rate = float(np.average([ramp.rate for ramp in alike], weights=weights))
            return SlewRate(rate, True, tuple(dict.fromkeys(ramp.trial for ramp in alike)))
    fastest = max(resolved, key=lambda ramp: ramp.rate * (1 - 2 * ramp.error))
    return SlewRate(fastest.rate * (1 - 2 * fastest.error), False, (fastest.trial,))  # what it surely is


def order_delay(
    moves: Sequence[tuple[Trial, Sequence[Ramp], np.ndarray]], highest: float = math.inf
) -> tuple[float, tuple[str, ...]] | None:
    """Time from a step of the orders of an actuator until it moves [s], and the trials that show it.

    moves: trials with its largest moves and its orders (N,) in each; highest: a move to an order above it does not
    count. The median of all straight moves that one step ordered, as the begin of others is not known; None where fewer
    than FEW were, and where it is not above twice its standard error, to which the interval between samples belongs.
    """
    measured: list[tuple[float, float, str]] = []
    for trial, ramps, order in moves:
        for ramp in (one for one in ramps if one.resolved and one.straight):
            way, t = np.sign(ramp.change) * order, trial.t
            jumps = way[2:] - way[:-2]  # over two intervals: a step may lie between two samples of a grid
            steps = np.flatnonzero((np.abs(jumps) >= JUMP * ramp.size) & (t[:-2] <= ramp.begin))
            # the last step before the move, where it is to the side of the move; it lies where half of it is made
            if len(steps) and jumps[k := steps[-1]] > 0 and order[k + 2] <= highest:
                at = np.interp(0.5 * (way[k] + way[k + 2]), way[k : k + 3], t[k : k + 3])
                measured.append((ramp.begin - float(at), trial.dt, trial.name))
    if len(measured) < FEW:
        return None
    delays, intervals = np.array([(delay, dt) for delay, dt, _ in measured]).T
    delay = float(np.median(delays))
    # scatter of the delays, and of a step that lies anywhere within a sampling interval (uniform: 1/sqrt(12))
    scatter = math.hypot(MAD * float(np.median(np.abs(delays - delay))), float(intervals.mean()) / math.sqrt(12))
    known = delay > 2 * scatter / math.sqrt(len(delays))
    return (delay, tuple(dict.fromkeys(name for *_, name in measured))) if known else None


@lru_cache(maxsize=1)  # of the trials of a session, that are fitted again and again
def _logged_ramps(trials: tuple[Trial, ...]) -> list[tuple[Trial, list[list[Ramp]]]]:
    """Those of the ``trials`` that log rudder and revolutions, and the largest moves of both (``ramps_of``)."""
    logged = [t for t in trials if np.isfinite(np.column_stack(steering(t))).any(axis=0).all()]
    return [(trial, [ramps_of(trial, values) for values in steering(trial)]) for trial in logged]


def ramps_of(trial: Trial, values: np.ndarray) -> list[Ramp]:
    """The largest moves in a column of ``values`` (N,) of a ``trial``, with the reading of its samples that fits."""
    good = np.isfinite(values)
    t, values = trial.t[good], values[good]
    if len(t) < 6 or np.ptp(values) == 0:
        return []
    noise = MAD * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6)  # of 1, -2, 1: a ramp leaves nothing
    noise = max(noise, 1e-4 * float(np.ptp(values)))  # a log without noise is rounded, too
    moves = _moves(t, values, noise)
    sampled = is_sampled(trial)
    readings = [True, False] if sampled is None else [sampled]  # the sidecar says which, else the better fit
    fits: list[tuple[float, list[Ramp]]] = []
    for reading in readings:
        ramps = [_fitted(trial, t, values, move, noise, not reading) for move in moves]
        fits.append((sum(ramp.rms**2 for ramp in ramps), ramps))
    return min(fits, key=lambda one: one[0])[1]


def _moves(t: np.ndarray, values: np.ndarray, noise: float) -> list[tuple[int, int, int, int]]:
    """The largest moves that samples resolve: first row of the stand before, first and last of the move, last of the
    stand after."""
    dt = float(np.median(np.diff(t)))
    for window in (w for w in WINDOWS if w <= len(t) // 3):
        times = sliding_window_view(t, window)
        times = times - times.mean(axis=1, keepdims=True)
        slopes = (times * sliding_window_view(values, window)).sum(axis=1) / (times**2).sum(axis=1)
        largest = float(np.abs(slopes).max())
        if noise / dt * math.sqrt(12 / (window * (window**2 - 1))) <= CLEAR * largest:  # standard error of a slope
            break
    else:
        return []
    # -1, 0, 1: whether the actuator falls, stands or rises in the window that begins at a row
    way = np.where(np.abs(slopes) > MOVING * largest, np.sign(slopes), 0.0)
    edges, half = np.flatnonzero(np.diff(way, prepend=0.0, append=0.0)), (window - 1) // 2
    spans = [(int(a) + half, int(b) - 1 + window - 1 - half) for a, b in pairwise(edges) if way[a]]
    moves = []
    for k, (a, b) in enumerate(spans):
        floor = spans[k - 1][1] if k else 0
        ceiling = spans[k + 1][0] if k + 1 < len(spans) else len(t) - 1
        stand = max(3, b - a)  # rows of the stands on both sides: as long as the move, as far as the next moves
        first, last = max(min(floor, a), a - stand, 0), min(max(ceiling, b), b + stand)
        if last - first >= 4:
            size = abs(float(np.median(values[b : last + 1]) - np.median(values[first : a + 1])))
            jump = float(np.abs(np.diff(values[first : last + 1])).max())
            moves += [(size, (first, a, b, last))] if jump < JUMP * size else []
    moves = sorted(moves, key=lambda one: -one[0])[:MOST]
    return [move for size, move in moves if size > VISIBLE * noise]


def _fitted(
    trial: Trial, t: np.ndarray, values: np.ndarray, move: tuple[int, int, int, int], noise: float, held: bool
) -> Ramp:
    """The ramp of least squares in a ``move``, as of ``_moves``; held: samples are means over their intervals."""
    from scipy.optimize import least_squares  # late: it is slow to import

    first, a, b, last = move
    a, b, t, y = a - first, b - first, t[first : last + 1], values[first : last + 1]
    low, high = float(np.median(y[: a + 1])), float(np.median(y[b:]))
    side, size, dt = math.copysign(1.0, high - low), abs(high - low), float(np.median(np.diff(t)))

    def error(p: np.ndarray) -> np.ndarray:
        return p[0] + side * _ramp(t, p[1], math.exp(p[2]), p[3], held) - y

    best = None
    for factor in (1.0, 1.6):  # what is read as a move is somewhat longer than the ramp in it
        rate = factor * size / max(float(t[b] - t[a]), 0.5 * dt)
        begin = 0.5 * (t[a] + t[b]) - 0.5 * size / rate - 0.5 * dt * held  # means lie half a sample later
        bounds = [-np.inf, -np.inf, math.log(rate) - 3, 0.3 * size], [np.inf, np.inf, math.log(rate) + 3, 3 * size]
        scale = [size, dt + size / rate, 1.0, size]
        fit = least_squares(error, [low, begin, math.log(rate), size], x_scale=scale, bounds=bounds, max_nfev=40)
        best = fit if best is None or fit.cost < best.cost else best
        rms = math.sqrt(2 * best.cost / max(len(t) - 4, 1))
        if rms <= math.hypot(STRAIGHT[0] * noise, STRAIGHT[1] * float(best.x[3])):
            break
    assert best is not None
    rate, size, J = math.exp(best.x[2]), float(best.x[3]), np.asarray(best.jac)
    # parameters: level, begin [s], log of the rate, size; so the error of the third is a share of the rate
    scaled = J * [1.0, dt + size / rate, 1.0, 1.0]  # seconds beside angles
    determined = np.linalg.matrix_rank(scaled, tol=1e-6 * size) == 4
    relative = float(np.linalg.norm(np.linalg.pinv(scaled)[2])) * max(noise, rms) if determined else math.inf
    resolved = size / rate >= RESOLVED * dt and relative <= SURE
    straight = rms <= math.hypot(STRAIGHT[0] * noise, STRAIGHT[1] * size)
    return Ramp(float(best.x[1]), rate, relative, side * size, size / rate, rms, straight, resolved, trial.name)


def _ramp(t: np.ndarray, begin: float, rate: float, size: float, held: bool) -> np.ndarray:
    """A ramp from 0 to ``size`` at the times ``t`` (N,) [s], or its means from each to the next."""
    if not held:
        return np.clip(rate * (t - begin), 0.0, size)
    since = np.append(t, 2 * t[-1] - t[-2]) - begin  # the last mean needs an end, too
    # integral of the ramp: a parabola while it rises, then a line
    area = np.where(rate * since < size, 0.5 * rate * np.clip(since, 0, None) ** 2, size * (since - 0.5 * size / rate))
    return np.diff(area) / np.diff(since)


def with_own_rates(ship: Ship, trials: Sequence[Trial]) -> tuple[Ship, list[Message]]:
    """The ``ship`` with what her ``trials`` show of her particulars ``rudder_rate``, ``propeller_rate``,
    ``approach_speed``, ``neutral_rudder``, of ``rudder_delay`` and ``engine_delay`` where they hold orders and, where
    only a rule of thumb says it, of ``D_P``; and messages on them.

    What the ship file states otherwise stays, and a difference is said. A ship whose model has actuators takes orders,
    whose rates say nothing.
    """
    if "actuators" in ship.components:
        return ship, []
    estimates: dict[str, tuple[float, tuple[str, ...]]] = {}
    bounds: list[str] = []  # names of rates that may be higher
    messages = []
    logged, usual = _logged_ramps(tuple(trials)), Limits.for_length(ship.particulars["L"])
    rates = ("rudder_rate", usual.rudder_rate), ("propeller_rate", usual.propeller_rate)
    engine = USUAL["engine_delay"][3] if has_engine(ship) else 0.0
    most = {"rudder_delay": MOST_DELAY * time_scale(ship.particulars["L"]), "engine_delay": engine}
    for k, ((name, rule), (late, column, highest)) in enumerate(zip(rates, DELAYS, strict=True)):  # rudder, propeller
        moves = [(trial, ramps[k]) for trial, ramps in logged]
        slew = slew_rate([ramp for _, ramps in moves for ramp in ramps])
        known = slew is not None and slew.limit and slew.rate <= FASTEST * rule
        if slew and (known or rule < slew.rate <= FASTEST * rule):  # a gear is not slower than it was seen to be
            estimates[name] = slew.rate, slew.trials
            bounds += [] if known else [name]
        if k == 0 and not known and name not in ship.particulars and logged:
            messages.append(Message(_by_rule(ship, slew), BOUND if name in bounds else "rudder_rate_by_rule"))
        delay = order_delay([(trial, ramps, trial[column]) for trial, ramps in moves if column in trial], highest)
        if delay and delay[0] <= most[late]:
            estimates[late] = delay
    estimates |= _of_approaches(ship, trials)
    particulars, sources = dict(ship.particulars), dict(ship.sources)
    for name, (value, names) in estimates.items():
        stated = name in particulars and not sources.get(name, "").startswith((MEASURED, BY_RULE))
        if not stated:
            source = f"{MEASURED}{listed(names)}{LOWER_BOUND * (name in bounds)}"
            particulars[name], sources[name] = value, source
        elif abs(particulars[name] / value - 1) > NOTED and not (name in bounds and particulars[name] > value):
            text = f"{name} is {particulars[name]:.3g} in the ship file, {value:.3g} by {listed(names)}; it stays"
            messages.append(Message(text, f"{name}_differs"))
    rules = tuple(f"{name} = " for name in estimates)  # of a starting ship, that the trials replace
    notices = tuple(note for note in ship.notices if not str(note).startswith(rules))
    return replace(ship, particulars=particulars, sources=sources, notices=notices), messages


def with_speed_through_water(
    ship: Ship, trials: Sequence[Trial], per_run: Mapping[str, Mapping[str, Any]] | None = None
) -> Ship:
    """The calibrated ``ship`` whose approach speed, where her ``trials`` showed it, is that through the water of the
    current in her, or of those that runs have of their own; per_run: as in her result.json."""
    north, east = (ship.coefficients[s].value if s in ship.coefficients else 0.0 for s in ("current.x", "current.y"))
    own = in_own_water(trials, per_run)
    moved = [trial.through_water(north, east) for trial in own] if north or east else own
    is_measured = ship.sources.get("approach_speed", "").startswith(MEASURED)
    if not is_measured or all(trial is other for trial, other in zip(moved, trials, strict=True)):
        return ship
    speeds = {k: value for k, (value, _) in _of_approaches(ship, moved).items() if k == "approach_speed"}
    return replace(ship, particulars={**ship.particulars, **speeds})


def _by_rule(ship: Ship, slew: SlewRate | None) -> str:
    """What is said where the trials of ``ship`` do not show the rate of her rudder; slew: the fastest that they do."""
    rule = math.degrees(Limits.for_length(ship.particulars["L"]).rudder_rate)
    used, seen = f"{rule:.3g} deg/s by Froude's law", math.degrees(slew.rate) if slew else 0.0
    least = f", at least {seen:.3g} deg/s in {slew.trials[0]}" if slew else ""
    if slew and seen > FASTEST * rule:
        least = f": it jumps in {slew.trials[0]}, as orders do"
    elif seen > rule:
        used = f"these, as {used} are less"
    return (
        f"the trials do not show the rate of the rudder{least}; manoeuvres are simulated with {used}: give "
        "rudder_rate [rad/s] in the ship file where it is known"
    )


def _of_approaches(ship: Ship, trials: Sequence[Trial]) -> dict[str, tuple[float, tuple[str, ...]]]:
    """Particulars of the ``ship`` that the steady runs before the manoeuvres of ``trials`` show, and in which trials,
    where most of these have one speed. Where D_P is by rule: the diameter [m] with which she keeps that speed at the
    revolutions of the runs, if that is a usual one; not so before a gear."""
    runs: list[tuple[float, float, float, str]] = []  # speed [m/s], mean rudder [rad], mean n [1/s], name of the trial
    for trial in trials:
        with suppress(UserError):
            execute = find_maneuvers(trial, ship.particulars["L"])[0]
            since = trial.t - trial.t[0] - execute.order_time
            if math.isfinite(execute.speed) and execute.speed > 0:
                before = (since < 0) & (since > -APPROACH * ship.particulars["L"] / execute.speed)
                valid = (x[before][np.isfinite(x[before])] for x in steering(trial))
                rudder, n = (float(np.mean(x)) if len(x) else 0.0 for x in valid)
                runs.append((execute.speed, rudder, n, trial.name))
    usual = float(np.median([speed for speed, *_ in runs])) if runs else math.nan
    alike = [run for run in runs if abs(run[0] / usual - 1) <= ALIKE]
    if len(alike) <= 0.5 * len(runs):  # runs at several speeds have no speed of approach
        return {}
    *columns, names = zip(*alike, strict=True)
    speed, rudder, n = (float(np.median(column)) for column in columns)
    estimates = {"approach_speed": speed}
    if abs(rudder) > LEAST_NEUTRAL:
        estimates["neutral_rudder"] = rudder
    if ship.sources.get("D_P", "").startswith((BY_RULE, MEASURED)) and n > 0:
        with suppress(UserError):
            diameter = diameter_for(ship, speed, n)
            if USUAL_DIAMETER[0] <= diameter / ship.particulars["d"] <= USUAL_DIAMETER[1]:
                estimates["D_P"] = float(f"{diameter:.4g}")
    return {name: (value, names) for name, value in estimates.items()}
