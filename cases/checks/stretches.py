"""Broken stretches: where heading, positions, velocities and inputs of a record contradict each other for a while.

No ship model: the change of the heading is compared with the integrated turn rate, that of the positions with the
integrated velocities, each channel with its own past, and the turn rate with what could cause it, by its swiftness or
by how it answers the rudder elsewhere. What is usual is taken from the same record: medians of the absolute
innovations, which a few broken seconds do not move.

Steps are innovations of a few samples. Drifts: the mismatch is summed up along the record; over a sound time of any
length it changes by little, which grows with the time as noise and small errors of scale do, and is taken from the same
record over a few seconds. The stretch is where it changes most for its length (the scan statistic of a change of mean).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cases.checks import breaks, single
from cases.checks.breaks import SWINGING, Break, filled, grain
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, Found
from cases.evidence.signals import densest
from cases.inputs import integral
from cases.trial import Trial, left_out

# Samples on each side of a step, at the record's own rate, but at least ``LEAST`` seconds. Set by hand (1, 1).
STEP = 10
LEAST = 0.5  # s; the shortest side of a step: below it the noise of satellite positions rules. Set by hand.
# Innovation over the usual one of the record from which a channel is broken by itself. A white innovation reaches 5
# once in a million samples. Satellite positions have heavy tails, which the velocities that come from them share; a
# turn rate follows a rudder order within a few samples. Set by hand above these.
SURE = {"psi": 8.0, "position": 45.0, "sharp position": 45.0, "u, v": 30.0, "sharp u, v": 45.0, "sharp r": 60.0}
# Least size of a break: this share of what the ship turns or travels in one side of a step (psi, position), or of the
# root mean square of the channel. Records without noise would be broken at each rudder order otherwise. Set by hand.
MATTERS = {"psi": 0.25, "position": 0.5, "sharp position": 0.5, "u, v": 0.2, "sharp u, v": 0.2, "sharp r": 1.0}
# Channel -> what its step means, and its columns.
WORDS = {
    "psi": ("the heading jumps against the integrated turn rate", ("psi",)),
    "position": ("the position jumps against the integrated velocities", ("x", "y")),
    "sharp position": ("the position jumps against the integrated velocities", ("x", "y")),
    "u, v": ("the velocities jump", ("u", "v")),
    "sharp u, v": ("the velocities jump", ("u", "v")),
    "sharp r": ("the turn rate jumps", ("r",)),
}
# Channel -> what its drift means, and its columns.
DRIFTING = {
    "psi": ("heading and turn rate drift apart", ("psi", "r")),
    "position": ("positions and velocities drift apart", ("x", "y", "u", "v")),
}
# Share of the record beyond which drifts are no stretches of it: the frame, sign or unit of a column is wrong. Set by
# hand.
LARGEST_SHARE = {"psi": 0.7, "position": 0.25}
BACK = 20.0  # s; drifts that undo each other within this time are one stretch. Set by hand.
PAIR = 15  # A jump and one that undoes it, so many sides of a step apart or less, are one stretch. Set by hand (0, 1).
# The stretch reaches as far as the innovation stays above this share of what it was found by. Set by hand.
ALIKE = 0.35
# A turn rate answers a rudder that was logged as at rest where it swings to both sides by this share of its root mean
# square elsewhere, and by so many times what the rudder leaves of it there. Set by hand.
ANSWERS, UNEXPLAINED = 0.5, 3.0
FOLLOWS = 0.7  # Correlation of turn rate and rudder from which the rudder tells how she turns. Set by hand.
UNSTEERED = "the turn rate swings to both sides while the rudder rests"  # What is said of such a spell
MUCH = 0.1  # Share of a record from which a channel that stands still is a doubt about all of it. Set by hand.
JOIN = 3.0  # s, or so many sides of a step: breaks closer together are one stretch. Set by hand (0, 1).


@dataclass(frozen=True)
class BrokenStretch:
    """A part of a record that is not to be believed.

    begin_s, end_s: on the clock of the file; what: one clause in words; channels: names of the columns concerned;
    moved: whether something beside inputs and weather moved the ship, rather than an instrument that broke, or
    positions count from elsewhere after it: no prediction may run over it.
    """

    begin_s: float
    end_s: float
    what: str
    channels: tuple[str, ...]
    moved: bool = False


def broken_stretches(trial: Trial) -> list[BrokenStretch]:
    """The broken stretches of ``trial`` in order of time, none of them overlapping."""
    return _stretches(trial)[0]


def _stretches(trial: Trial) -> tuple[list[BrokenStretch], list[Break]]:
    """The broken stretches of ``trial``, and those of columns that are held, each by itself: joined with other breaks
    they have no length of their own."""
    if len(trial) < 8 * STEP:
        return [], []
    side = max(STEP, round(LEAST / trial.dt))
    signals = breaks.mismatches(trial)
    held = [*breaks.frozen(trial, signals), *_unsteered(trial)]
    intervals = [_tight(step, signals, side // 4) for step in _steps(trial, signals, side)]
    intervals += [*held, *breaks.repeated(trial), *breaks.spike_trains(trial), *breaks.without_cause(trial)]
    intervals += list(_drifting(trial, signals, intervals))  # last: what a step explains is no drift
    reach = max(JOIN, side * trial.dt)
    return [
        BrokenStretch(
            float(trial.t[first]),
            float(trial.t[last]),
            _sized(what, signals, first, last),
            channels,
            SWINGING in what or UNSTEERED in what or _stays(what, signals, first, last),
        )
        for first, last, what, channels in _joined(trial.t, sorted(intervals), reach)
    ], held


def _answer(trials: Sequence[Trial]) -> tuple[float, float] | None:
    """Time [s] in which the ship of ``trials`` answers her rudder, and turn rate [rad/s] that only an answer exceeds:
    medians of those in which she follows it; None without any."""
    known = []
    for trial in trials:
        correlation, seconds = single.following(trial)
        if correlation is not None and abs(correlation) >= FOLLOWS:
            beyond = max(ANSWERS, UNEXPLAINED * math.sqrt(1 - correlation**2))
            known.append((seconds, beyond * math.sqrt(float(np.nanmean(trial["r"] ** 2)))))
    return tuple(np.median(known, axis=0).tolist()) if known else None


def _swings(trial: Trial, first: int, last: int, seconds: float, size: float) -> bool:
    """Whether the turn rate of ``trial`` exceeds ``size`` [rad/s] to both sides between the rows, once the ship has
    answered the last order for so many ``seconds``, at speed and with revolutions ahead that are the same on all
    shafts. A mean over these takes waves off."""
    smooth = np.mean(breaks.around(filled(trial["r"]), max(round(seconds / 2 / trial.dt), 1)), axis=1)
    shafts = np.stack([np.zeros(len(trial)), *(trial[name] for name in breaks.PROPELLERS if name in trial)])
    n = shafts[1:] if len(shafts) > 1 else shafts
    alike = np.ptp(n, axis=0) <= 0.1 * np.nanmax(np.abs(n), initial=0.0)
    rows = alike & ((n.min(axis=0) > 0) | (len(shafts) == 1)) & (trial.t >= trial.t[first] + seconds)
    rows &= trial["u"] > single.AHEAD * float(np.nanquantile(trial["u"], 0.95))
    turn = smooth[first : last + 1][rows[first : last + 1]]
    return bool(np.max(turn, initial=0.0) > size and np.min(turn, initial=0.0) < -size)


def _unsteered(trial: Trial) -> Iterator[Break]:
    """First and last row, what, and column of each spell of ``trial`` in which the turn rate swings, though all that
    steers rests, as it does by the rudder elsewhere: a logger held the rudder. The spell counts from its beginning."""
    r = filled(trial["r"])
    least = 0.5 * ANSWERS * float(np.sqrt(np.mean(r**2)))  # elsewhere she may turn less: looked at, not judged
    for first, last in breaks.runs(~breaks.steered(trial)) if "delta" in trial else ():
        if min(r[first : last + 1].max(), -r[first : last + 1].min()) > least > 0:
            answer = _answer([left_out(trial, [(float(trial.t[first]), float(trial.t[last]))], "")])
            if answer and _swings(trial, first, last, *answer):
                yield int(first), int(last), UNSTEERED, ("delta",)


def held_rudders(trials: Sequence[Trial]) -> list[list[Found]]:
    """For each of ``trials`` of one ship: a contradiction where all that steers rests throughout while the turn rate
    swings as it does by the rudder in others."""
    moves = [bool(breaks.steered(trial).any()) for trial in trials]
    answer = _answer([trial for trial, so in zip(trials, moves, strict=True) if so]) if not all(moves) else None
    text = "delta is frozen, while the turn rate swings to both sides as it does by the rudder in other files"
    return [
        [(CONTRADICTORY, "frozen_channel", text)]
        if answer and not so and "delta" in trial and _swings(trial, 0, len(trial) - 1, *answer)
        else []
        for trial, so in zip(trials, moves, strict=True)
    ]


def _stays(what: str, signals: Mapping[str, np.ndarray], first: int, last: int) -> bool:
    """Whether the position, where ``what`` says that it jumps, ends nearer to the jump than to where it was."""
    if "position" not in signals or WORDS["position"][0] not in what:
        return False
    jump = np.abs(signals["position"][first : last + 1] - signals["position"][first])
    return bool(jump[-1] > 0.5 * jump.max())


def _sized(what: str, signals: Mapping[str, np.ndarray], first: int, last: int) -> str:
    """``what`` is said of the rows, with how far heading and position jump."""
    for name, signal in signals.items():
        size = float(np.abs(signal[first : last + 1] - signal[first]).max())
        shown = f"{size:.3g} m" if name == "position" else f"{math.degrees(size):.3g} deg"
        what = what.replace(WORDS[name][0], f"{WORDS[name][0]} by {shown}")
    return what


def _drifting(trial: Trial, signals: Mapping[str, np.ndarray], known: Sequence[Break]) -> Iterator[Break]:
    """Breaks of heading or position that no step shows, besides the ``known`` ones."""
    way = float(np.sqrt(np.mean(filled(trial["u"]) ** 2 + filled(trial["v"]) ** 2)))
    rows = [(first, last) for first, last, *_ in known]
    explained = list(rows)  # counts no more
    for name, signal in signals.items():
        rounded = breaks.resolution(trial, breaks.COLUMNS[name][0])
        travelled = integral(trial.t, np.abs(filled(trial["r"]))) if name == "psi" else way * trial.t
        intervals = list(there_and_back(drifts(trial.t, signal, name, travelled, rows, rounded), trial.t, BACK))
        drifting = np.zeros(len(trial), bool)
        for first, last in intervals:
            drifting[first : last + 1] = True
        for first, last in explained:
            drifting[first : last + 1] = False
        if drifting.mean() <= LARGEST_SHARE[name]:
            yield from ((first, last, *DRIFTING[name]) for first, last in intervals)
            explained += intervals


def _tight(broken: Break, signals: Mapping[str, np.ndarray], margin: int) -> Break:
    """A step of heading or position without the sound rows around, beyond a ``margin``, which its sides take in."""
    first, last, what, channels = broken
    name = next((n for n in signals if WORDS[n][0] == what), None)
    if name is None:
        return broken
    begin, end = tightened(signals[name], first, last)
    return max(begin - margin, first), min(end + margin, last), what, channels


def stretch_findings(trial: Trial) -> tuple[dict[str, Any], list[Found]]:
    """The broken stretches of a ``trial``, and a sentence on each. Nothing is left to decide, as they are left out: the
    verdict on the rest of the record is what counts."""
    stretches, held = _stretches(trial)
    still: dict[str, float] = {}
    for first, last, _, group in held:
        name, seconds = ", ".join(group), float(trial.t[last] - trial.t[first])
        still[name] = still.get(name, 0.0) + seconds / trial.duration
    findings = [
        (
            INFO,
            "broken_stretch",
            f"Broken from {s.begin_s:.1f} to {s.end_s:.1f} s ({', '.join(s.channels)}): {s.what}; left out of fits and "
            "scores, unless exclude in trials.toml names other stretches ([]: none).",
        )
        for s in stretches
    ]
    for names, share in still.items():
        if share > MUCH:
            stand = "stand" if ", " in names else "stands"
            findings.append((DOUBTFUL, "frozen_channel", f"{names} {stand} still for {share:.0%} of the record."))
    return {"broken": [asdict(s) for s in stretches]}, findings


def innovations(trial: Trial, errors: Mapping[str, np.ndarray], side: int) -> dict[str, tuple[np.ndarray, float]]:
    """Channel -> (its steps (N,), their usual size): what a step of the record adds to what the rest of it says.

    trial: the record; errors: its ``mismatches``; side: samples on each side of a step. A step is the mean after a row
    minus the mean before it, less what the means further out lead to expect, of psi - integral of r, position -
    integral of (u, v), and of (u, v); of single samples of (u, v) and of r it is what the neighbours on both sides do
    not lead to expect.
    """
    r, w = filled(trial["r"]), filled(trial["u"]) + 1j * filled(trial["v"])
    signals = {"u, v": (w, side), "sharp u, v": (w, 1), "sharp r": (r, 1)}
    if "psi" in errors:
        signals = {"psi": (errors["psi"], side), **signals}
    if "position" in errors:
        signals |= {"position": (errors["position"], side), "sharp position": (errors["position"], 1)}
    # motion that a step is compared with, and the time [s] over which it adds up to the unit of the step
    moves = {"psi": (r, side * trial.dt), "u, v": (w, 1.0), "r": (r, 1.0), "position": (w, side * trial.dt)}
    out = {}
    for name, (signal, rows) in signals.items():
        step = _level(signal, rows) if name == "psi" else _step(signal, rows)
        rounding = 0.5 * max(grain(trial[column]) for column in WORDS[name][1])
        usual = max(breaks.usual_size(np.abs(step)[2 * rows : -2 * rows]), rounding, 1e-9)
        motion, seconds = moves[name.removeprefix("sharp ")]
        least = MATTERS[name] * seconds * float(np.sqrt(np.mean(np.abs(motion) ** 2)))
        out[name] = (step, max(usual, least / SURE[name]))  # so that no step below ``least`` reaches SURE
    return out


def _steps(trial: Trial, signals: Mapping[str, np.ndarray], side: int) -> Iterator[Break]:
    """Breaks of one channel by itself."""
    steps = innovations(trial, signals, side)
    ratio = {name: np.abs(step) / usual for name, (step, usual) in steps.items()}
    for name, (what, channels) in WORDS.items():
        if name in ratio:
            peaks = _peaks(ratio[name], SURE[name], 2)
            if name.removeprefix("sharp ") in signals:
                peaks = [run for run in peaks if _changes(signals[name.removeprefix("sharp ")], steps[name][0], *run)]
            step = steps[name][0]
            # a channel that jumps off and back again is wrong all the way between
            jumps = [(a, b, complex(step[a + int(np.argmax(np.abs(step[a : b + 1])))])) for a, b in peaks]
            pairs = there_and_back(jumps, trial.t, side * trial.dt * PAIR, 0.5)
            yield from ((first, last, what, channels) for first, last in pairs)


def _changes(signal: np.ndarray, step: np.ndarray, first: int, last: int) -> bool:
    """Whether the ``signal`` (N,) itself changes between the rows, by half of its ``step`` (N,): beside a jump the
    trend around is wrong, and the step a jump that is not there."""
    inside = slice(first, last + 1)
    return bool(np.ptp(np.abs(signal[inside] - signal[first])) >= 0.5 * np.abs(step[inside]).max())


def _peaks(size: np.ndarray, limit: float, margin: int) -> list[tuple[int, int]]:
    """First and last row of each run of ``size`` (N,) that reaches ``limit``: its rows above half its peak, and half a
    ``margin`` on both sides."""
    out = []
    for first, last in breaks.runs(size > ALIKE * limit):
        peak = float(size[first:last].max())
        if peak >= limit:
            high = first + np.flatnonzero(size[first:last] >= 0.5 * peak)
            out.append((max(int(high[0]) - margin // 2, 0), min(int(high[-1]) + margin // 2, len(size) - 1)))
    return out


def _joined(t: np.ndarray, ordered: Sequence[Break], reach: float) -> list[Break]:
    """Breaks, ``ordered`` by time, closer together than ``reach`` [s] as one; what and channels of all of them."""
    out: list[Break] = []
    for first, last, what, channels in ordered:
        if out and t[first] - t[out[-1][1]] <= reach:
            begun, ended, words, names = out[-1]
            words = words if what in words else f"{words}; {what}"
            out[-1] = (begun, max(ended, last), words, tuple(dict.fromkeys(names + channels)))
        else:
            out.append((first, last, what, channels))
    return out


def _step(values: np.ndarray, m: int) -> np.ndarray:
    """Step at each row (N,): mean of m samples after minus m before, less the trend of the m beyond on both sides."""
    total, rows = np.concatenate([[0.0], np.cumsum(values)]), np.arange(2 * m, len(values) - 2 * m)
    means = [(total[rows + (k + 1) * m] - total[rows + k * m]) / m for k in (-2, -1, 0, 1)]
    out = np.zeros(len(values), values.dtype)  # 0 at the ends, where a side is not complete
    out[rows] = means[2] - means[1] - 0.5 * (means[3] - means[2] + means[1] - means[0])
    return out


def _level(values: np.ndarray, m: int) -> np.ndarray:
    """Change of level at each row (N,): mean of m samples after minus m before, less a third of them around the row;
    less the median of it, the drift of the record."""
    gap = max(m // 3, 1)
    total, rows = np.concatenate([[0.0], np.cumsum(values)]), np.arange(m + gap, len(values) - m - gap)
    out = np.zeros(len(values), values.dtype)
    out[rows] = (total[rows + gap + m] - total[rows + gap] - total[rows - gap] + total[rows - gap - m]) / m
    out[rows] -= np.median(out[rows])
    return out


# Lengths that are compared. Set by hand (1, 0).
SECONDS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 50.0, 60.0, 75.0, 95.0)
# Longer times are judged by what is usual over this, as a drift of a minute may be half of the record.
SHORT = 5.0  # set by hand (1, 2)
# Power of the time by which the usual change grows beyond SHORT: .5 is that of white noise in the rate. Set by hand.
GROWTH = {"psi": 0.5, "position": 0.8}
# Time [s] and change over the usual one from which it is broken, between them by straight lines. The sound parts of
# real records of a model reach 17, 14, 13 and 9 in heading over 2, 5, 10 and 20 s, and 25, 13, 8 and 5 in position, by
# the tails of satellite positions. Set by hand above these.
LIMIT = {
    "psi": ((1.0, 28.0), (2.0, 22.0), (5.0, 18.0), (10.0, 18.0), (20.0, 18.0)),
    "position": ((1.0, 60.0), (2.0, 30.0), (5.0, 17.0), (10.0, 12.0), (20.0, 10.0)),
}
# Share of the changes by which the usual one is known: most of them may lie in a drift. Set by hand (8, 1).
DENSE = 0.35
# What makes that share the median of a normal law, of headings and of positions in the plane. Ratios of the quantiles
# .5 and DENSE of half a normal law and of Rayleigh's law, not set by hand.
AS_MEDIAN = (1.486, 1.268)
LEAST_TURN = 0.1  # rad; a heading that is off by less is not broken. Set by hand.
LEAST_WAY = 0.1  # A position that is off by less than this share of the way is not broken. Set by hand.
CORE = 0.08  # Share of the change that may lie outside the stretch at each end. Set by hand (1, 1).
MOST = 12  # Stretches of one channel in a record; one with more has no sound part to compare with. Set by hand.
MANY = 50000  # Of more rows than this some are enough to know what is usual. Set by hand.
Drift = tuple[int, int, complex]  # First and last row, and the change.


def drifts(
    t: np.ndarray,
    mismatch: np.ndarray,
    channel: str,
    travelled: np.ndarray,
    known: Sequence[tuple[int, int]],
    rounded: float,
) -> list[Drift]:
    """The stretches of a record in which its ``mismatch`` (N,) drifts by more than is usual, in order of time.

    t: (N,) [s]; channel: "psi" or "position"; travelled: (N,) what the ship has turned [rad] or run [m] by then; known:
    first and last rows of stretches that were found before, in which nothing is looked for; rounded: resolution of
    heading [rad] or position [m], by which they are off in any case.
    """
    steps = np.diff(mismatch)
    for first, last in known:
        steps[max(first - 1, 0) : last + 1] = 0.0
    usual = _usual(t, np.concatenate([[0.0], np.cumsum(steps)]), channel, travelled)
    intervals: list[Drift] = []
    while len(intervals) < MOST:
        total = np.concatenate([[0.0], np.cumsum(steps)])
        one = _largest(t, total, usual, channel, travelled, rounded)
        if one is None:
            break
        intervals.append(one)
        steps[one[0] : one[1]] = 0.0  # so that the next one is looked for in what is left
    return sorted(intervals, key=lambda drift: drift[0])


def _usual(t: np.ndarray, total: np.ndarray, channel: str, travelled: np.ndarray) -> dict[float, tuple[float, complex]]:
    """Time -> the usual change over it and its median, of those of SECONDS that fit into the record twice: that of all
    rows, or, where it is more, of those in which the ship has ``travelled`` most."""
    usual: dict[float, tuple[float, complex]] = {}
    dt = float(np.median(np.diff(t)))
    for seconds in SECONDS:
        rows = round(seconds / dt)
        if rows < 2 or len(t) <= 2 * rows:
            continue
        some = slice(None, None, max(1, len(total) // MANY))
        change, way = (values[rows:][some] - values[:-rows][some] for values in (total, travelled))
        plane = np.iscomplexobj(change)
        centre = complex(densest(change.real, DENSE), densest(change.imag, DENSE) if plane else 0.0)
        off = np.abs(change - centre)
        sizes = [float(np.quantile(each, DENSE)) for each in (off, off[way >= 0.5 * way.max()])]
        size = AS_MEDIAN[plane] * max(sizes)
        if seconds > SHORT and SHORT in usual:  # SECONDS rise, so that SHORT came before
            base, drift = usual[SHORT]
            size, centre = min(size, base * (seconds / SHORT) ** GROWTH[channel]), drift * seconds / SHORT
        usual[seconds] = (max(size, 1e-9), centre)
    return usual


def _largest(
    t: np.ndarray,
    total: np.ndarray,
    usual: dict[float, tuple[float, complex]],
    channel: str,
    travelled: np.ndarray,
    rounded: float,
) -> Drift | None:
    """What drifts most for its length among what is beyond the limit; None where nothing is."""
    dt, best, most = float(np.median(np.diff(t))), None, 0.0
    times, limits = zip(*LIMIT[channel], strict=True)
    for seconds, (size, centre) in usual.items():
        rows = round(seconds / dt)
        change = np.abs(total[rows:] - total[:-rows] - centre)
        least = rounded + (LEAST_TURN if channel == "psi" else LEAST_WAY * (travelled[rows:] - travelled[:-rows]))
        change = np.where(change > least, change, 0.0)
        at = int(np.argmax(change))
        value = float(change[at])
        # among lengths the change by the root of the time: what white noise of the rate adds up to
        if value > float(np.interp(seconds, times, limits)) * size and value / np.sqrt(seconds) > most:
            best, most = (at, at + rows), value / np.sqrt(seconds)
    return _cut(total, *best) if best else None


def _cut(total: np.ndarray, first: int, last: int) -> Drift:
    """The part of the rows from ``first`` to ``last`` in which the sum changes, and the change."""
    change = complex(total[last] - total[first])
    if change == 0:
        return first, last, change
    share = ((total[first : last + 1] - total[first]) / change).real
    half = int(np.argmax(share >= 0.5))
    begin = np.flatnonzero(share[: half + 1] <= CORE)
    end = half + np.flatnonzero(share[half:] >= 1 - CORE)
    return first + int(begin[-1] if len(begin) else 0), first + int(end[0] if len(end) else last - first), change


def tightened(total: np.ndarray, first: int, last: int) -> tuple[int, int]:
    """The rows from ``first`` to ``last`` between which the sum ``total`` (N,) changes, without the sound ones around.
    A sum that comes back changes as long as it is away by a quarter of the farthest."""
    away = np.abs(total[first : last + 1] - total[first])
    farthest = float(away.max())
    if away[-1] >= 0.5 * farthest > 0:
        return _cut(total, first, last)[:2]
    far = first + np.flatnonzero(away > 0.25 * farthest)
    return (max(int(far[0]) - 1, first), min(int(far[-1]) + 1, last)) if len(far) else (first, last)


def there_and_back(
    found: Sequence[Drift], t: np.ndarray, longest: float, alike: float = 0.4
) -> Iterator[tuple[int, int]]:
    """First and last row of each of the ``found`` drifts, together with the next one where that undoes it, but for a
    share ``alike``, within ``longest`` [s] of the times t (N,)."""
    rest = list(found)
    while rest:
        first, last, change = rest.pop(0)
        if rest:
            begin, end, other = rest[0]
            if t[begin] - t[last] <= longest and abs(change + other) < alike * max(abs(change), abs(other)):
                last = end
                rest.pop(0)
        yield first, last
