"""Where a manoeuvre begins in a measured run: cutting off the approach, and what was ordered, from the data alone.

The rudder of an approach wanders under autopilot or helmsman; that of a manoeuvre is held. The execute is the moment
at which the rudder begins to move to the first angle that it then holds: long enough, and as large as the angle at
which it spends most of its time. One side held is a turning test, sides in turn are a zigzag, revolutions that go
astern from ahead are a stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cases.trial import Trial
from mmg.errors import UserError

KINDS = ("turning", "zigzag", "crash-stop")

LEAST_RUDDER = math.radians(4.0)
"""Smaller rudder angles are course keeping [rad]."""

LEAST_CHANGE = math.radians(2.0)
"""A rudder that is reversed before the heading has changed by this is no zigzag [rad]."""

TOLERANCE = math.radians(1.0)
"""An angle is held while the rudder stays within 1 deg, or 4 % of it where that is more [rad]."""

SHORTEST_HOLD = 0.1
"""Share of the longest hold below which a hold is the rudder passing by."""

LEAST_SHARE = 0.5
"""Share of the time, from the first hold to the end of the last, in which the rudder of a manoeuvre is held."""

SLOWEST_MOVE = 0.3
"""Share of its largest rate below which the rudder's movement to an angle has not begun."""

STEADY_SPEED, STEADY_RATE = 0.05, 0.05
"""An approach is steady when its speed changes by less than 5 % and r L / U stays below 0.05."""

APPROACH_LENGTHS = 2.0
"""Ship lengths before the execute over which the test speed is taken."""


@dataclass(frozen=True)
class Execute:
    """What was ordered in a run, and when.

    kind: "turning", "zigzag", "crash-stop", "spiral", "pull-out". order_time: of the order, s after the first sample.
    rudder: first angle, signed [rad], 0 for a stop. reversals: times of the following reversals of a measured rudder
    [s]; end: up to where the run counts [s]. heading: switch heading of a zigzag [rad], of a measured one the median
    over its reversals, 0 else. speed: test speed V [m/s], of a measured run the mean over the stretch before the order.
    notes: what keeps a criterion from being judged, in words.
    """

    kind: str
    order_time: float
    rudder: float
    reversals: tuple[float, ...]
    end: float
    heading: float
    speed: float
    notes: tuple[str, ...]


def find_maneuver(trial: Trial, length: float, kind: str = "") -> Execute:
    """The execute of a measured (or simulated) run of a ship of this length [m].

    kind: "turning", "zigzag" or "crash-stop"; "" takes it from the data, and says so where the trial's own kind
    differs. Raises UserError when no manoeuvre is found in the run, or one of another kind than asked for, or when
    the trial says itself that it is something else (random, berthing, ...) and no kind is asked for.
    """
    if not kind and trial.kind and trial.kind not in KINDS:
        raise UserError(f"{trial.name}: a {trial.kind} run is none of {', '.join(KINDS)}; say which to read it as one")
    t = trial.t - trial.t[0]
    stop = None if kind in ("turning", "zigzag") else _reversal_of_propeller(t, trial["n"])
    holds = [] if kind == "crash-stop" else _holds(t, trial.rudder)
    if stop is not None and not any(begin < stop for begin, _, _ in holds):
        return _execute(trial, length, "crash-stop", stop, 0.0, [], float(t[-1]))
    if not holds:
        held = "rudder held at an angle above 4 deg"
        what = "revolutions that go astern from ahead" if kind == "crash-stop" else held
        raise UserError(f"{trial.name}: no {kind or 'manoeuvre'} found: no {what}")
    used = holds[: _turns_in_reply(trial, holds)]
    found = "zigzag" if len(used) > 1 else "turning"
    if kind and kind != found:
        where = "on both sides in turn" if len(used) > 1 else "on one side"
        raise UserError(f"{trial.name}: looked for a {kind} test, but the rudder is held {where}")
    return _execute(trial, length, found, used[0][0], used[0][2], [h[0] for h in used[1:]], used[-1][1])


def _turns_in_reply(trial: Trial, holds: list[tuple[float, float, float]]) -> int:
    """How many holds, from the first on, are a zigzag: sides in turn, and the ship has turned to the rudder's side."""
    begins = _headings(trial, [begin for begin, _, _ in holds])
    run = 1
    while run < len(holds):
        side = math.copysign(1.0, holds[run - 1][2])
        if side * holds[run][2] > 0 or side * (begins[run] - begins[0]) < LEAST_CHANGE:
            break
        run += 1
    return run


def _headings(trial: Trial, times: list[float]) -> np.ndarray:
    """Headings [rad] at times after the first sample [s]."""
    good = np.isfinite(trial["psi"])
    return np.interp(times, trial.t[good] - trial.t[0], trial.psi_unwrapped[good])


def _execute(
    trial: Trial, length: float, kind: str, time: float, rudder: float, reversals: list[float], end: float
) -> Execute:
    heading = 0.0
    if reversals:
        change = _headings(trial, reversals) - _headings(trial, [time])
        sides = math.copysign(1.0, rudder) * (-1.0) ** np.arange(len(reversals))
        heading = float(np.median(sides * change))
    speed, notes = _approach(trial, length, time)
    if trial.kind in KINDS and trial.kind != kind:
        notes.append(f"the run is called {trial.kind}, its data show a {kind}")
    return Execute(kind, time, rudder, tuple(reversals), end, heading, speed, tuple(notes))


def _approach(trial: Trial, length: float, time: float) -> tuple[float, list[str]]:
    """Test speed [m/s] over two ship lengths before the order, and what was not steady about it."""
    t = trial.t - trial.t[0]
    speed, r = np.hypot(trial["u"], trial["v"]), trial["r"]
    good = np.isfinite(speed) & np.isfinite(r)
    near = good & (t <= time) & (t >= time - 5 * trial.dt - 1e-9)
    if not near.any():
        return math.nan, ["no speed is recorded before the order"]
    now = max(float(np.median(speed[near])), 1e-9)
    stretch = APPROACH_LENGTHS * length / now
    rows = good & (t <= time) & (t >= time - stretch)
    mean, seconds, notes = float(speed[rows].mean()), float(np.ptp(t[rows])), []
    if seconds < 0.5 * stretch:
        notes.append(f"only {seconds:.3g} s of approach are recorded, two ship lengths take {stretch:.3g} s")
    if rows.sum() > 2:
        change = float(np.polyfit(t[rows], speed[rows], 1)[0]) * seconds / mean
        if abs(change) > STEADY_SPEED:
            notes.append(f"approach not steady: the speed changes by {100 * change:+.0f} % in the last {seconds:.3g} s")
    turn = float(np.abs(r[rows]).mean()) * length / mean
    if turn > STEADY_RATE:
        notes.append(f"approach not straight: mean |r| L/V = {turn:.2g} in the last {seconds:.3g} s")
    return mean, notes


def _holds(t: np.ndarray, delta: np.ndarray) -> list[tuple[float, float, float]]:
    """(begin of the movement [s], end [s], angle [rad]) of each stretch in which the rudder is held at the angle
    of the manoeuvre: the absolute angle, at least 4 deg, at which it spends most time."""
    good = np.isfinite(delta)
    t, delta = t[good], delta[good]
    size = np.abs(delta)
    if len(t) < 3 or not (size >= LEAST_RUDDER).any():
        return []
    width = math.radians(0.5)
    weights = np.gradient(t)[size >= LEAST_RUDDER]
    bins = np.round(size[size >= LEAST_RUDDER] / width).astype(int)
    time_at = np.convolve(np.bincount(bins, weights), [1, 1, 1], "same")
    angle = float(np.median(size[np.abs(size - width * int(np.argmax(time_at))) <= 1.5 * width]))
    side = np.where(np.abs(size - angle) <= max(TOLERANCE, 0.04 * angle), np.sign(delta), 0.0)
    edges = np.flatnonzero(np.diff(side)) + 1
    starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(t)]])
    runs = [(a, b) for a, b in zip(starts, ends, strict=True) if side[a] != 0 and b - a > 1]
    longest = max((t[b - 1] - t[a] for a, b in runs), default=0.0)
    runs = _joined([(a, b) for a, b in runs if t[b - 1] - t[a] >= SHORTEST_HOLD * longest], side, t, longest)
    if not runs or sum(t[b - 1] - t[a] for a, b in runs) < LEAST_SHARE * (t[runs[-1][1] - 1] - t[runs[0][0]]):
        return []
    return [(_begin(t, delta, a), float(t[b - 1]), float(np.median(delta[a:b]))) for a, b in runs]


def _joined(runs: list[tuple[int, int]], side: np.ndarray, t: np.ndarray, longest: float) -> list[tuple[int, int]]:
    """Neighbouring stretches of one side with a short gap between them are one: a spike, not a reversal."""
    joined: list[tuple[int, int]] = []
    for a, b in runs:
        if joined and side[joined[-1][0]] == side[a] and t[a] - t[joined[-1][1] - 1] < SHORTEST_HOLD * longest:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined


def _begin(t: np.ndarray, delta: np.ndarray, held: int) -> float:
    """When the rudder began to move to the angle that it reaches at row ``held`` [s].

    Back in time for as long as the rate over half a second (or three samples) before is at least 30 % of the largest
    on the way, then from sample to sample: a helm that wanders before the order is slower than the order's movement.
    """
    side, span = np.sign(delta[held]), max(0.5, 3 * float(np.median(np.diff(t))))

    def rate(k: int) -> float:
        return float(side * (delta[k] - np.interp(t[k] - span, t, delta)) / span)

    k, largest = held, 0.0
    while k > 0:
        now = rate(k)
        largest = max(largest, now)
        if now < SLOWEST_MOVE * largest or now <= 0:
            break
        k -= 1
    while k > 0 and side * (delta[k] - delta[k - 1]) >= SLOWEST_MOVE * largest * (t[k] - t[k - 1]) > 0:
        k -= 1
    return float(t[k])


def _reversal_of_propeller(t: np.ndarray, n: np.ndarray) -> float | None:
    """When revolutions that were ahead begin to go astern and stay there [s]; None if they do not."""
    good = np.isfinite(n)
    t, n = t[good], n[good]
    ahead = float(np.percentile(n, 95)) if len(n) else 0.0
    astern = np.flatnonzero(n < -0.05 * ahead)
    if ahead <= 0 or len(astern) == 0:
        return None
    first = int(astern[0])
    before = np.flatnonzero(n[:first] > 0)
    if len(before) == 0 or (n[first:] > 0.05 * ahead).any():
        return None
    level = float(np.median(n[:first][n[:first] > 0.5 * n[before].max()]))
    steady = np.flatnonzero(n[:first] >= 0.97 * level)
    return float(t[steady[-1]])
