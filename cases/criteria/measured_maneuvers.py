"""Manoeuvres in a measured run, found from the data alone: where each begins and ends, and what was ordered.

The rudder of an approach wanders under autopilot or helmsman; that of a manoeuvre is held. Holds to
either side of one middle in turn, each reversed after the ship has turned to the rudder's side, are a zigzag of any
rudder and heading; holds in equal steps from side to side are a spiral; a hold over which the heading changes by 90 deg
is a turning test; revolutions that go astern from ahead until the way is off are a stop. A long record may hold several
of them. Stretches that were left out are bridged where they are short; a run in which they decide is refused.

Nothing is assumed of the angles: noise, a rudder that is slow to move and one that is logged with an offset are steps
all the same. The rudder begins to move when the heading has passed the one that was ordered, by what passes in a sample
and in the reaction of helmsman and steering gear. Orders are usual angles; another one is believed where the record
shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cases.evidence.signals import MAD
from cases.io.sidecar import line_for
from cases.trial import Trial, bridged, inside, spans_left_out
from mmg.errors import BadValue, Missing, UnknownName
from mmg.motion.flow import RUDDERS, STATES

# An angle is held while the rudder stays within 1 deg, 4 % of it or 3.5 times its noise, the most of them [rad]. Set
# by hand.
TOLERANCE = math.radians(1.0)
# Ship times L/U over which the angle that is held may creep: a rudder that moves on faster is not held.
MEMORY = 0.25  # set by hand
# Share of the longest hold of a manoeuvre below which a gap between two holds at one angle is a spike. Set by hand.
SHORTEST_HOLD = 0.1
# A hold beside a longer one of this angle [rad] at least is a helm that corrects where it lasts at most this share of
# it, and its angle lies between these shares of the other one's. Set by hand.
CORRECTION, CORRECTED, LEAST_CORRECTED = 0.2, (0.67, 2.0), math.radians(3.5)
# Share of its largest rate below which the rudder's movement to an angle has not begun: a helm that wanders before is
# slower than the order's movement. Set by hand.
SLOWEST = 0.3
# Shares of the way between two holds through which the line goes that tells when the rudder began to move. Set by hand.
FIRST, LATER = 0.1, 0.5


@dataclass(frozen=True)
class RudderStep:
    """A stretch in which the rudder is held. begin: when it began to move there; reached, end: of the stretch, all in
    s after the first sample; angle [rad]; began: False where the record begins with it."""

    begin: float
    reached: float
    end: float
    angle: float
    began: bool = True

    @property
    def seconds(self) -> float:
        """How long the rudder is held [s]."""
        return self.end - self.reached


def without_spikes(delta: np.ndarray, dt: float, ship_time: float) -> np.ndarray:
    """``delta`` (N,) without single samples that are off: a running median over a fortieth of the ship_time L/U [s], of
    three samples at least and nine at most; dt: sampling interval [s]."""
    size = 2 * min(max(round(0.0125 * ship_time / dt), 1), 4) + 1  # odd, so that the median has a middle
    return np.median(sliding_window_view(np.pad(delta, size // 2, mode="edge"), size), axis=1)


def held_stretches(
    t: np.ndarray, delta: np.ndarray, ship_time: float = 0.0, tolerance: float = TOLERANCE
) -> list[RudderStep]:
    """Stretches of the times ``t`` (N,) [s] in which the rudder ``delta`` (N,) [rad] is held, at any angle.

    ship_time: L/U [s], the scale of what is short; tolerance: least one of an angle that is held [rad]. Rows without a
    value are left out.
    """
    good = np.isfinite(delta)
    t, delta = t[good], delta[good]
    if len(t) < 4:
        return []
    dt = float(np.median(np.diff(t)))
    delta = without_spikes(delta, dt, ship_time)
    steps = np.diff(delta)
    noise = MAD * float(np.median(np.abs(steps - np.median(steps))))
    keep = math.exp(-dt / max(MEMORY * ship_time, 2 * dt))  # a first-order low pass: the level that is held
    runs, first, level, count = [], 0, float(delta[0]), 1
    for k in range(1, len(t) + 1):
        width = max(tolerance, 0.04 * abs(level), 3.5 * noise)
        if k == len(t) or abs(delta[k] - level) > width:
            runs.append((first, k))
            if k == len(t):
                break
            first, level, count = k, float(delta[k]), 1
            continue
        count += 1
        level += max(1.0 / count, 1 - keep) * (float(delta[k]) - level)  # a mean at first, then one that forgets
    shortest = max(2.5 * dt, 0.15 * ship_time)
    # without its first quarter, in which the rudder settles
    holds = [(a, b, float(np.median(delta[a + (b - a) // 4 : b]))) for a, b in runs if t[b - 1] - t[a] + dt >= shortest]
    middles = [0, *((a + b) // 2 for a, b, _ in holds)]
    # looked for before neighbours are joined: a helm that corrects has moved before the row where its hold begins
    begins = {a: _movement(t, delta, before, a, angle) for before, (a, _, angle) in zip(middles, holds, strict=False)}
    return [
        RudderStep(begins[a], float(t[a]), float(t[b - 1]), angle, k > 0 or abs(delta[0] - angle) > 2 * tolerance)
        for k, (a, b, angle) in enumerate(_joined(holds, t, tolerance, ship_time))
    ]


def _joined(
    runs: list[tuple[int, int, float]], t: np.ndarray, tolerance: float, ship_time: float
) -> list[tuple[int, int, float]]:
    """The ``runs`` (first row, row after the last, angle) in which neighbours are one, with the angle of the longer: at
    one angle with a spike between them, or to one side where the helm corrects its angle."""
    joined: list[tuple[int, int, float]] = []
    for run in runs:
        joined.append(run)
        while len(joined) > 1:
            (a, b, before), (c, d, after) = joined[-2:]
            gap, (first, second) = t[c] - t[b - 1], (t[b - 1] - t[a], t[d - 1] - t[c])
            short, long = (before, after) if first < second else (after, before)
            spike = abs(after - before) <= max(1.5 * tolerance, 0.1 * abs(before))
            spike &= bool(gap <= max(SHORTEST_HOLD * max(first, second), 3 * (t[1] - t[0])))
            brief = min(first, second) <= CORRECTION * max(first, second) and gap <= MEMORY * ship_time
            share = short / long if abs(long) >= LEAST_CORRECTED else 0.0
            if not spike and not (brief and CORRECTED[0] <= share <= CORRECTED[1]):
                break
            joined[-2:] = [(a, d, long)]  # and looks back again: three may be one
    return joined


def _movement(t: np.ndarray, delta: np.ndarray, floor: int, held: int, angle: float) -> float:
    """When the rudder began to move to the ``angle`` that it has from row ``held`` on [s], not before row ``floor``, in
    the middle of the hold before: a rudder that has left the tolerance of that has moved for some tenths of a second.
    The line through a tenth and a half of the order's movement meets the angle it came from at that time."""
    side = math.copysign(1.0, angle - delta[max(floor, held - 1)])
    t, path = t[floor : held + 1], side * delta[floor : held + 1]
    if held == 0 or len(path) < 2:
        return float(t[0])
    start, largest = len(path) - 1, 0.0
    span = max(0.5, 3 * float(np.median(np.diff(t))))  # s, of a mean rate: noise between two samples is no movement
    while start > 0:
        rate = float(path[start] - np.interp(t[start] - span, t, path)) / span
        largest = max(largest, rate)
        if rate < SLOWEST * largest or rate <= 0:
            break
        start -= 1
    # the mean rate ends within a span of the beginning; the rest of the way back goes sample by sample
    while start > 0 and path[start] - path[start - 1] >= SLOWEST * largest * (t[start] - t[start - 1]) > 0:
        start -= 1
    low, way = float(path[start]), side * angle - float(path[start])
    if way <= 0:
        return float(t[-1])
    first, later = (_crossing(t[start:], path[start:], low + share * way) for share in (FIRST, LATER))
    if later <= first:
        return first
    return max(float(t[0]), first - (later - first) * FIRST / (LATER - FIRST))  # the line carried back to no movement


def _crossing(t: np.ndarray, values: np.ndarray, level: float) -> float:
    """When ``values`` first reach ``level``, by linear interpolation [s]."""
    k = int(np.argmax(values >= level))
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - values[k - 1]) / (values[k] - values[k - 1]) * (t[k] - t[k - 1]))


# Angles that are ordered as a rule [deg] (ITTC 7.5-02-06-01, IMO MSC.137(76)).
STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
NAMED, SHARE = 0.6, 0.07  # A measured rudder is called one of STEPS within this [deg], or this share. Set by hand.
# Least standard error of a heading, gyros are read to 0.1 deg, and by which a helm orders too early or late [rad]. Set
# by hand.
RESOLUTION, HELM = math.radians(0.05), math.radians(0.25)
# Standard errors by which what the reversals show may be off a usual heading. Set by hand: 1.2 % of normal errors are
# larger.
LIKELY = 2.5


def nominal(angle: float) -> float:
    """The usual angle [deg] that an ``angle`` >= 0 [rad] stands for, or its whole degrees where it is none."""
    degrees = math.degrees(angle)
    near = min(STEPS, key=lambda step: abs(step - degrees))
    return near if abs(near - degrees) <= max(NAMED, SHARE * degrees) else float(round(degrees))


def ordered_heading(
    headings: np.ndarray, delays: np.ndarray, signs: np.ndarray, errors: np.ndarray, rudder: float
) -> float:
    """The change of heading [deg] at which the rudder of a zigzag was ordered over, to either side of one base course.

    headings: (D, K) at the time of each of K reversals of the rudder less each of D ``delays`` (D,) [s], those that are
    negative too early by the sampling [rad]; signs: signs of the turn (K,); errors: standard errors of the headings
    (K,) [rad]; rudder: as named [deg]. At one delay, whichever it is, the headings were as ordered, to within their own
    scatter. A usual heading is believed where it fits as well as any: first that of the rudder, as in the zigzags of
    the standard, then one of 5 deg and more, then that of the least squares, the delay among them (half of the largest
    is its standard error).
    """
    weights = 1 / errors**2

    def fit(degrees: float) -> tuple[float, float]:
        """Sum of squares in standard errors with the best delay, and that delay as a share of the largest."""
        base = headings - signs * math.radians(degrees)
        # the base course is the weighted mean; of one reversal it is the heading before, taken off already
        off = base - (base @ weights / weights.sum())[:, None] if len(signs) > 1 else base
        squares = off**2 @ weights
        best = int(np.argmin(squares))
        # the larger share of either sign: delays run from negative to positive
        return float(squares[best]), float(max(delays[best] / delays.max(), delays[best] / delays.min()))

    fits = {float(degrees): fit(degrees) for degrees in range(1, 90)}
    least = min(squares for squares, _ in fits.values())
    scatter = max(1.0, least / max(len(signs) - 2, 1))  # chi-squared by degrees of freedom: heading and base course
    usual = [step for step in STEPS if fits[step][0] <= least + LIKELY**2 * scatter]
    worth = {step: fits[step][0] / scatter + (2 * fits[step][1]) ** 2 for step in usual}
    if usual:
        return min(usual, key=lambda step: (step != rudder, step < 5, worth[step]))
    return min(fits, key=lambda degrees: (fits[degrees][0] > least + scatter, fits[degrees][1]))


KINDS = ("turning", "zigzag", "spiral", "crash-stop")
# The following angles [rad] are set by hand, between course keeping and the mildest manoeuvre: a zigzag 5/5.
LEAST_RUDDER = math.radians(4.0)  # Smaller rudder angles are course keeping
LEAST_STEP = math.radians(3.5)  # Half of the way between the two sides of a zigzag is at least this
# The middle between the two sides of a zigzag lies within this of zero: the zero of the rudder's log.
LARGEST_OFFSET = math.radians(4.0)
LEAST_CHANGE = math.radians(0.4)  # A rudder that is reversed before the heading has changed by this is no zigzag
# One that is reversed later than this is a turn to one side and a turn to the other.
LARGEST_CHANGE = math.radians(60.0)
# A zigzag has its second and third execute; with fewer it counts only where the run has no complete manoeuvre.
LEAST_HOLDS = 3  # set by hand
# Share of the time, from the first hold to the end of the last, in which the rudder of a manoeuvre is held.
LEAST_SHARE = 0.4  # set by hand
# Highest r L/U, by the speed of the approach, of ships of the library in standard manoeuvres: 0.15 to 0.6 [-]. Set by
# hand in that range.
TURN_RATE = 0.35
# A spiral has at least so many equal steps to one side, each held for at least so many L/U. Set by hand.
LEAST_STEPS, SPIRAL_HOLD = 3, 2.0
# Ship times L/U from the heading at which the rudder is ordered over to its first movement, at most: the reaction of
# helmsman and steering gear. UNVERIFIED: 1.2 s of a 3 m model, 6 s of a 320 m tanker. Set by hand.
REACTION = 0.15


@dataclass(frozen=True)
class Execute:
    """What was ordered in a run, and when.

    kind: "turning", "zigzag", "crash-stop", "spiral", "pull-out". order_time: of the order, s after the first sample.
    rudder: first angle, signed [rad], 0 for a stop; of a measured zigzag from the middle of its two sides. reversals:
    times of the following reversals of a measured rudder [s]; end: up to where the run counts [s]. heading: switch
    heading of a zigzag [rad], of a measured one the median over its reversals, step of a spiral, 0 else. speed: test
    speed V [m/s], of a measured run the mean over the stretch before the order. notes: what keeps a criterion from
    being judged, in words; caveats: what is to be told with its verdict. ordered: the heading of a measured zigzag at
    which the rudder was ordered over, as it is named [deg], 0 where that is ``heading``.
    """

    kind: str
    order_time: float
    rudder: float
    reversals: tuple[float, ...]
    end: float
    heading: float
    speed: float
    notes: tuple[str, ...]
    caveats: tuple[str, ...] = ()
    ordered: float = 0.0

    @property
    def steps(self) -> tuple[float, float]:
        """Rudder and heading [deg] as they were ordered: a usual angle within what the record can tell, else whole
        degrees; the second is the step of a spiral, and 0 for other than these."""
        return nominal(abs(self.rudder)), self.ordered or (nominal(self.heading) if self.heading else 0.0)

    @property
    def order(self) -> str:
        """What was ordered [deg]: "10/5", "-35", "15/5"; "" for a stop."""
        rudder, second = self.steps
        side = "-" if self.rudder < 0 else ""
        return f"{side}{rudder:g}" + f"/{second:g}" * (second > 0) if self.rudder else ""

    @property
    def title(self) -> str:
        """As a manoeuvre is named: "zigzag 10/5", "turning -35", "crash-stop"."""
        return f"{self.kind} {self.order}".strip()


def find_maneuvers(trial: Trial, length: float) -> tuple[Execute, ...]:
    """All manoeuvres of a measured (or simulated) run of a ship of this length [m], in the order of time.

    Their kinds are taken from the data, which says so where the trial's own kind differs. Raises UserError when no
    manoeuvre is found in the run, or when the trial says itself that it is something else (random, berthing, ...).
    trial: the run.
    """
    if trial.kind and trial.kind not in KINDS:
        words = f"a {trial.kind} run is none of {', '.join(KINDS)}; give its kind in trials.toml to read it as one"
        raise UnknownName(f"{trial.name}: {words}")
    t, (rudder, n), unit = trial.t - trial.t[0], steering(trial), ship_time(trial, length)
    (stops, complete), holds = find_stops(t, n, trial["u"]), held_stretches(t, rudder, unit)
    executes = _steered(trial, holds, stops if complete else [], unit)
    first = stops[0].order_time if stops else math.inf
    # Only a run without a complete manoeuvre is read as a part of one, or against its rudder.
    if not executes and not complete and any(abs(h.angle) >= LEAST_RUDDER and h.begin < first for h in holds):
        executes = _partial(trial, holds, unit) or _against_rudder(trial, holds, unit)
    executes += stops if complete or not executes else []
    if not executes:
        raise Missing(f"{trial.name}: no manoeuvre found: {_nothing(holds)}")
    result, before = [], 0.0
    for execute in sorted(executes, key=lambda e: e.order_time):
        result.append(_approached(trial, length, execute, before))
        before = execute.end
    return tuple(result)


def steering(trial: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Rudder angle [rad] and revolutions [1/s] of a ``trial``, (N,) each; of a ship that is steered by azimuth
    thrusters aft the angle that turns her alike."""
    pods = [trial.unwrapped(name) for name in trial.columns if name.startswith("azimuth")]
    # a thruster aft that is turned to starboard pushes the stern there, and turns her to port
    rudder = -np.mean(pods, axis=0) if pods and not any(map(trial.measured, RUDDERS)) else trial.rudder
    driven = [trial[name] for name in trial.columns if name.startswith("n_azimuth")]
    return rudder, np.mean(driven, axis=0) if driven and not trial.measured("n") else trial["n"]


def ship_time(trial: Trial, length: float) -> float:
    """L/U [s] of a ship of this ``length`` [m] at the speed of the faster part of ``trial``, Froude 0.1 at least."""
    return length / max(_usual_speed(trial), 0.1 * math.sqrt(9.81 * length))


def _usual_speed(trial: Trial) -> float:
    speed = np.hypot(trial["u"], trial["v"])
    return float(np.nanpercentile(speed, 80)) if np.isfinite(speed).any() else 0.0


def length_by_turns(trial: Trial) -> float:
    """Length [m] of a ship by the highest turn rates of her ``trial``, within a factor of two. Raises UserError where
    she does not turn."""
    rates = np.abs(trial["r"][np.isfinite(trial["r"])])
    fastest, speed = float(np.percentile(rates, 98)) if len(rates) else 0.0, _usual_speed(trial)
    if not (fastest > 0 and speed > 0):
        raise Missing(f"{trial.name}: the ship does not turn in this record; no manoeuvre can be found in it")
    return TURN_RATE * speed / fastest


def _steered(trial: Trial, holds: Sequence[RudderStep], stops: Sequence[Execute], unit: float) -> list[Execute]:
    """Complete zigzags, spirals and turning tests among ``holds``; those in a stop are part of it. unit: L/U [s]."""
    holds = [h for h in holds if not any(s.order_time <= h.begin <= s.end for s in stops)]
    executes, k = [], 0
    while k < len(holds):
        hold, count, steps = holds[k], _in_turn(trial, holds[k:], unit), _in_steps(holds[k:], unit)
        if count >= LEAST_HOLDS:
            executes.append(_zigzag(trial, holds[k : k + count], unit))
        elif steps > LEAST_STEPS:
            step, count, end = abs(holds[k + 1].angle - hold.angle), steps, holds[k + steps - 1].end
            executes.append(Execute("spiral", hold.begin, hold.angle, (), end, step, math.nan, ()))
        else:
            count = 1
            if abs(hold.angle) >= LEAST_RUDDER and _turned(trial, hold) >= math.pi / 2:
                executes.append(Execute("turning", hold.begin, hold.angle, (), hold.end, 0.0, math.nan, ()))
        k += count
    return executes


def _in_steps(holds: Sequence[RudderStep], unit: float) -> int:
    """How many of ``holds``, from the first on, are a spiral: equal steps to one side and back; 1 if none are.

    unit: L/U [s]."""
    steps = np.diff([h.angle for h in holds])
    if len(steps) < LEAST_STEPS or abs(holds[0].angle) < LEAST_RUDDER or abs(steps[0]) < math.radians(1.0):
        return 1
    count = back = 0
    for step, hold in zip(steps, holds[1:], strict=True):
        back += bool(step * steps[0] < 0) != bool(back)  # counts changes of the direction: one is the way back
        equal = abs(abs(step) - abs(steps[0])) <= max(math.radians(1.0), 0.2 * abs(steps[0]))  # set by hand
        if not equal or hold.seconds < SPIRAL_HOLD * unit or (back and count < LEAST_STEPS) or back > 1:
            break
        count += 1
    return count + 1 if count >= LEAST_STEPS else 1


def _partial(trial: Trial, holds: Sequence[RudderStep], unit: float) -> list[Execute]:
    """The manoeuvre of a run without a complete one: a zigzag of one reversal, else a turning test that ends early. The
    rudder must be held there for as long as in all other holds beyond LEAST_RUDDER together."""
    beyond = [h for h in holds if abs(h.angle) >= LEAST_RUDDER]
    if not beyond:
        return []
    seconds = sum(h.seconds for h in beyond)
    for k in range(len(holds) - 1):
        pair = holds[k : k + 2]
        if _in_turn(trial, pair, unit) > 1 and sum(h.seconds for h in pair) >= 0.5 * seconds:
            return [_zigzag(trial, pair, unit)]
    hold = max(beyond, key=lambda h: h.seconds)
    lasting = hold.seconds >= 0.5 * seconds
    if not lasting or _turned(trial, hold) < 5 * LEAST_CHANGE:  # 2 deg: more than course keeping
        return []
    turned = math.degrees(_turned(trial, hold))
    words = f"the heading changes by {turned:.0f} deg while the rudder is held: no turning test"
    return [Execute("turning", hold.begin, hold.angle, (), hold.end, 0.0, math.nan, (words,))]


def _against_rudder(trial: Trial, holds: Sequence[RudderStep], unit: float) -> list[Execute]:
    """Manoeuvres of a run in which the ship turns against the rudder as it is logged; none of them is judged."""
    words = "the ship turns against the rudder as it is logged: see its sign (mmg check)"
    executes = _steered(trial, [replace(hold, angle=-hold.angle) for hold in holds], [], unit)
    return [replace(execute, notes=(*execute.notes, words)) for execute in executes]


def _turned(trial: Trial, hold: RudderStep) -> float:
    """By how much the heading changes to the rudder's side from the order to the end of the ``hold`` [rad]."""
    first, last = _headings(trial, [hold.begin, hold.end])
    return math.copysign(1.0, hold.angle) * float(last - first)


def _in_turn(trial: Trial, holds: Sequence[RudderStep], unit: float) -> int:
    """How many of ``holds``, from the first on, are a zigzag; 1 if none are. unit: L/U [s]."""
    if len(holds) < 2:
        return 1
    middle, half = _middle_and_size(holds[:2])
    if abs(half) < LEAST_STEP or abs(middle) > max(LARGEST_OFFSET, 0.2 * abs(half)):
        return 1
    psi = _headings(trial, [h.begin for h in holds], unit)
    side, count = math.copysign(1.0, half), 1
    while count < len(holds):
        hold = holds[count]
        size = -side * (hold.angle - middle)
        change = side * (psi[count] - psi[count - 1])
        least = LEAST_CHANGE * (1 if count == 1 else 2)
        turned = not (change < least or change > LARGEST_CHANGE * (1 if count == 1 else 2))  # NaN: may have
        same = abs(size - abs(half)) <= max(math.radians(2.0), 0.15 * abs(half))
        # the rudder goes over at once: in twice a hold beside it, or 1.5 times the shortest way over so far
        gaps = [after.reached - before.end for before, after in pairwise(holds[: count + 1])]
        usual = gaps[-1] <= max(2.0 * min(hold.seconds, holds[count - 1].seconds), 1.5 * min(gaps))
        if not same or not usual or not turned:
            break
        side, count = -side, count + 1
    used = holds[:count]
    seconds = sum(h.seconds for h in used)
    return count if count > 1 and seconds >= LEAST_SHARE * (used[-1].end - used[0].reached) else 1


def _middle_and_size(holds: Sequence[RudderStep]) -> tuple[float, float]:
    """Middle of the two sides of ``holds`` in turn, and the first side from there, signed [rad]."""
    first, second = (float(np.median([h.angle for h in holds[k::2]])) for k in (0, 1))
    return 0.5 * (first + second), 0.5 * (first - second)


def _zigzag(trial: Trial, holds: Sequence[RudderStep], unit: float) -> Execute:
    """The zigzag of ``holds`` in turn. Its base course lies between the headings at reversals to either side, which
    also a record that begins with the rudder over has. unit: L/U [s]."""
    middle, half = _middle_and_size(holds)
    times = np.array([h.begin for h in holds[1:]])
    sides = math.copysign(1.0, half) * (-1.0) ** np.arange(len(times))
    valid = np.isfinite(_headings(trial, times, unit))
    if not valid.any():  # better a heading across a gap than none
        valid[:] = True
    psi, start = _headings(trial, times), float(_headings(trial, [holds[0].begin])[0])
    # half of the way between reversals to either side: the base course drops out
    swings = 0.5 * (sides[:-1] * (psi[:-1] - psi[1:]))[valid[:-1] & valid[1:]]
    heading = float(np.median(swings)) if len(swings) else float(sides[0] * (psi[0] - start))
    ordered = _ordered(trial, times[valid], sides[valid], unit, nominal(abs(half)), start)
    notes: tuple[str, ...] = ()
    if not holds[0].began and abs(sides[0] * (psi[0] - start) - heading) > max(0.25 * heading, math.radians(1.0)):
        notes = ("the record begins in the manoeuvre: which overshoot is the first is not known",)
    caveats = []
    if abs(middle) > math.radians(1.0):
        caveats.append(f"the rudder is logged {math.degrees(middle):+.1f} deg off: the middle of its two sides")
    return Execute("zigzag", holds[0].begin, half, tuple(times.tolist()), holds[-1].end, heading, math.nan, notes,
                   tuple(caveats), ordered)  # fmt: skip


def _ordered(trial: Trial, times: np.ndarray, signs: np.ndarray, unit: float, rudder: float, start: float) -> float:
    """The heading [deg] at which the ``rudder`` [deg] was ordered over, that moved at ``times`` (K,) [s] from
    turns with ``signs`` (K,). unit: L/U [s]; start: heading at the first execute [rad]."""
    t, good, (interval, noise) = trial.t - trial.t[0], np.isfinite(trial["r"]), _interval_and_noise(trial)
    rates = np.interp(times, t[good], trial["r"][good]) if good.any() else np.zeros(len(times))
    helm = HELM if len(times) < 4 else RESOLUTION  # the scatter of so few is not known from themselves
    errors = np.sqrt(noise**2 + helm**2 + (rates * interval) ** 2 / 12)  # an order falls anywhere in a sample
    delays = np.linspace(-interval, interval + REACTION * unit, 41)  # s; fine beside the helm's own scatter
    headings = _headings(trial, times - delays[:, None]) - (start if len(times) == 1 else 0.0)
    return ordered_heading(headings, delays, signs, errors, rudder)


@lru_cache(maxsize=1)
def _interval_and_noise(trial: Trial) -> tuple[float, float]:
    """Sampling interval [s] of the instruments, that nine of ten are below: longer than that of the rows where these
    lie on straight lines between the samples. And noise of the heading [rad]."""
    longest, psi = list[float](), _heading_series(trial)[1]
    for values in (psi, trial["r"][np.isfinite(trial["r"])]):  # rows where the slope changes are samples
        steps = np.diff(values)
        samples = np.flatnonzero(np.abs(np.diff(steps)) > 1e-6 * np.abs(steps[1:]))
        longest += [float(np.quantile(np.diff(samples), 0.9))] if len(samples) > 1 else []
    noise = MAD * float(np.median(np.abs(np.diff(psi, 3)))) / math.sqrt(20) if len(psi) > 3 else 0.0  # of 1, -3, 3, -1
    return trial.dt * min(longest, default=1.0), noise


def _headings(trial: Trial, times: Sequence[float] | np.ndarray, longest: float = math.inf) -> np.ndarray:
    """Headings [rad] at times after the first sample [s]; NaN within a gap that is longer than ``longest`` [s]."""
    t, psi = _heading_series(trial)
    after = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    return np.where(t[after] - t[after - 1] > longest, math.nan, np.interp(times, t, psi))


@lru_cache(maxsize=1)
def _heading_series(trial: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Times after the first sample [s] and continuous headings [rad] where there are any, (N,) each."""
    good = np.isfinite(trial["psi"])
    return trial.t[good] - trial.t[0], trial.psi_unwrapped[good]


def _approached(trial: Trial, length: float, execute: Execute, earliest: float) -> Execute:
    """``execute`` with its test speed and what is to be said of the approach and of the trial's own name."""
    speed, blocking, caveats = approach(trial, length, execute.order_time, earliest)
    notes = [*blocking, *execute.notes]
    if trial.kind in KINDS and trial.kind != execute.kind:
        notes.append(f"the run is called {trial.kind}, its data show a {execute.kind}")
    return replace(execute, speed=speed, notes=tuple(notes), caveats=(*caveats, *execute.caveats))


def _nothing(holds: Sequence[RudderStep]) -> str:
    """Why no manoeuvre is in a run with these ``holds``."""
    beyond = [h for h in holds if abs(h.angle) >= LEAST_RUDDER]
    words = "none turns the ship by 90 deg, and none is reversed at a change of heading"
    return f"of {len(beyond)} stretches of held rudder {words}" if beyond else "no rudder held at an angle above 4 deg"


# An approach is steady when its speed changes by less than 5 % and r L / U stays below 0.05. Set by hand.
STEADY_SPEED, STEADY_RATE = 0.05, 0.05
APPROACH_LENGTHS = 2.0  # Ship lengths before the execute over which the test speed is taken. Set by hand.
TURNING_RATE = 0.15  # A record that begins at r L / U above this begins in a manoeuvre. Set by hand.


def approach(trial: Trial, length: float, time: float, earliest: float) -> tuple[float, list[str], list[str]]:
    """Test speed [m/s] of a run of a ship of this ``length`` [m], ordered at ``time`` [s after the first sample].

    It is the mean over two ship lengths before the order. earliest: when what came before had ended [s]. Returns also
    what keeps a criterion from being judged, and what is only to be told, both in words. Speed is NaN where none is
    recorded. trial: the run.
    """
    t, speed, r = trial.t - trial.t[0], np.hypot(trial["u"], trial["v"]), trial["r"]
    good = np.isfinite(speed) & np.isfinite(r)
    if not good.any():
        return math.nan, ["no speed is recorded"], []
    # her speed now, to know how long two ship lengths take: by five samples, or by the first there is
    near = good & (t <= time + 1e-9) & (t >= time - 5 * trial.dt - 1e-9)
    if not near.any():
        near = good & (t <= t[good][np.argmin(np.abs(t[good] - time))] + 1e-9)
    now = max(float(np.median(speed[near])), 1e-9)
    stretch = APPROACH_LENGTHS * length / now
    rows = good & (t <= time + 1e-9) & (t >= max(time - stretch, earliest))
    if rows.sum() < 3:
        turn = float(np.median(r[near])) * length / now
        begun = f"the record begins in the manoeuvre, with r L/V = {turn:.2g}: lengths from the order are not known"
        unrecorded = f"no approach is recorded: V {now:.4g} m/s is the first speed of the record"
        return (now, [begun], []) if abs(turn) > TURNING_RATE else (now, [], [unrecorded])
    mean, seconds = float(speed[rows].mean()), float(np.ptp(t[rows]))
    blocking, caveats = [], []
    if seconds < 0.5 * stretch:
        caveats.append(f"only {seconds:.3g} s of approach are recorded, two ship lengths take {stretch:.3g} s")
    change = float(np.polyfit(t[rows], speed[rows], 1)[0]) * seconds / mean  # by a line: both ends are noisy
    turn = float(np.abs(r[rows]).mean()) * length / mean
    if abs(change) > STEADY_SPEED and seconds >= 0.1 * stretch:
        words = f"the speed changes by {100 * change:+.0f} % in the last {seconds:.3g} s"
        blocking.append(f"approach not steady: {words}")
    if turn > STEADY_RATE and seconds >= 0.1 * stretch:
        blocking.append(f"approach not straight: mean |r| L/V = {turn:.2g} in the last {seconds:.3g} s")
    return mean, blocking, caveats


def find_stops(t: np.ndarray, n: np.ndarray, u: np.ndarray) -> tuple[list[Execute], bool]:
    """Stops in a run of times ``t`` (N,) [s], revolutions ``n`` (N,) [1/s] and speed ahead ``u`` (N,) [m/s].

    Each is ordered where the revolutions ahead begin to fall that go astern. Complete ones, after which the way is off,
    and True; without any, one that the record does not finish, if revolutions then stay astern to its end, and False.
    """
    good = np.isfinite(n)
    t, n, u = t[good], n[good], u[good]
    ahead = float(np.percentile(n, 95)) if len(n) else 0.0
    astern = n < -0.05 * ahead  # less is a shaft that is stopped. Set by hand.
    edges = [0, *(np.flatnonzero(np.diff(astern)) + 1).tolist(), len(n)]
    stops: dict[float, tuple[Execute, bool]] = {}
    for first, last in pairwise(edges):
        forward = np.flatnonzero(n[:first] > 0)
        if ahead <= 0 or not astern[first] or not len(forward):
            continue
        standing = np.flatnonzero(n[: forward[-1] + 1] <= 0)  # before she went ahead the last time
        level = n[standing[-1] + 1 if len(standing) else 0 : forward[-1] + 1]
        level = np.median(level[level > 0.5 * level.max()])
        order = int(np.flatnonzero(n[:first] >= 0.97 * level)[-1])  # set by hand: below it they have begun to fall
        speeds = u[: order + 1][np.isfinite(u[: order + 1])]
        off = np.flatnonzero(u[order:] <= 0)
        stopped = len(speeds) > 0 and speeds[-1] > 0 and len(off) > 0 and order + off[0] <= min(last + 2, len(t) - 1)
        if stopped or last == len(t):
            stop = Execute("crash-stop", float(t[order]), 0.0, (), float(t[last - 1]), 0.0, math.nan, ())
            stops.setdefault(stop.order_time, (stop, bool(stopped)))
    complete = [stop for stop, stopped in stops.values() if stopped]
    return complete or [stop for stop, _ in stops.values()][-1:], bool(complete)


# The ship may turn by this over a stretch that is bridged by straight lines [rad]; IMO gives headings in whole degrees.
# Set by hand.
LARGEST_TURN = math.radians(5.0)
# Changes of heading at which a turning test is read [rad] (IMO MSC.137(76)): in between its track is not asked for.
READ_AT = (math.pi / 2, math.pi)


def without_broken_parts(trial: Trial, execute: Execute) -> tuple[Trial, Execute]:
    """``trial`` with its left-out stretches bridged by straight lines, and its ``execute`` up to one that cannot be.

    A zigzag counts up to the last reversal before that stretch; a turning test needs what it is read at. Raises
    UserError where a stretch decides in a manoeuvre of another kind: something else moved the ship in it, or she turned
    by more than LARGEST_TURN.
    """
    t = trial.t - trial.t[0]
    for first, last in spans_left_out(trial):
        rows = inside(trial, [(first, last)])
        if not rows.any() or t[rows][-1] < execute.order_time or t[rows][0] > execute.end:
            continue
        disturbed = not (bridged(trial) | ~rows).all()
        if not disturbed and _is_bridged(trial, execute, rows):
            continue
        before = [time for time in execute.reversals if time < t[rows][0]]
        if len(before) > 1:
            execute = replace(execute, reversals=tuple(before[:-1]), end=before[-1])
            break
        turns = f"she turns by more than {math.degrees(LARGEST_TURN):g} deg meanwhile"
        raise BadValue(
            f"{trial.name}: {first:.1f} to {last:.1f} s are left out, in the manoeuvre that is measured, and "
            f"{'something else moved the ship there' if disturbed else turns}; mend them, add to "
            f"{line_for(trial.path, trial.name, 'exclude = []')}, or add --unchecked"
        )
    return (_filled(trial) if spans_left_out(trial) else trial), execute


def _is_bridged(trial: Trial, execute: Execute, rows: np.ndarray) -> bool:
    """Whether straight lines over the ``rows`` (N,) change no figure of ``execute``."""
    psi, at = trial.psi_unwrapped, np.flatnonzero(rows)
    good = np.isfinite(psi)
    before, after = psi[: at[0]][good[: at[0]]], psi[at[-1] + 1 :][good[at[-1] + 1 :]]
    if not len(before) or not len(after):
        return False
    turn = abs(float(after[0] - before[-1]))
    if turn <= LARGEST_TURN or execute.kind != "turning" or trial.t[at[0]] - trial.t[0] <= execute.order_time:
        return turn <= LARGEST_TURN
    start = float(_headings(trial, [execute.order_time])[0])
    first, last = abs(float(before[-1]) - start), abs(float(after[0]) - start)
    fastest = float(np.nanmax(np.abs(trial["r"])))  # by which she may turn unseen
    unseen = fastest * float(trial.t[at[-1]] - trial.t[at[0]])
    return unseen < math.pi and not any(first < angle <= last for angle in READ_AT)


def _filled(trial: Trial) -> Trial:
    rows = inside(trial, spans_left_out(trial))
    columns = dict(trial.columns) | {"psi": trial.psi_unwrapped}
    for name in (name for name in STATES if name in columns):
        good = np.isfinite(columns[name])
        if good.any():
            values = np.interp(trial.t, trial.t[good], columns[name][good])
            columns[name] = np.where(rows & ~good, values, columns[name])
    return replace(trial, columns=columns)
