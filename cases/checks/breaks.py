"""Stretches of a record that are not to be believed by themselves: frozen or repeated values, trains of spikes, and a
turn rate that swings without cause.

Frozen: the same value again and again while the rest of the record says that it must change; repeated: a logger that
writes its last sample once more. Motion without cause: with inputs at rest the turn rate of a
ship goes to its steady value, past it at most once; one that swings to and fro, faster than her own rudder ever makes
it change, was made by something that the record does not hold: a hand, a line, the bank.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from cases.evidence.signals import MAD, independent, white_noise
from cases.inputs import integral
from cases.trial import Trial
from mmg.motion.flow import INPUTS

Break = tuple[int, int, str, tuple[str, ...]]  # First and last row, what, channels.
# Mismatch -> its own columns, and the rates whose integral they are compared with.
COLUMNS = {"psi": (("psi",), ("r",)), "position": (("x", "y"), ("u", "v"))}


def mismatches(trial: Trial) -> dict[str, np.ndarray]:
    """Channel of ``trial`` -> its difference from the integral of its rate, (N,). "psi" [rad]; "position" [m], north +
    i east, where there are positions; none of relatives."""
    t, psi = trial.t, filled(trial.psi_unwrapped)
    errors = {"psi": psi - integral(t, filled(trial["r"]))} if independent(trial, "turn") else {}
    if independent(trial, "track"):
        w = filled(trial["u"]) + 1j * filled(trial["v"])
        errors["position"] = filled(trial["x"]) + 1j * filled(trial["y"]) - integral(t, w * np.exp(1j * psi))
    return errors


def filled(values: np.ndarray) -> np.ndarray:
    """``values`` (N,) with missing samples by straight lines: a gap is no break."""
    good = np.isfinite(values)
    if good.all() or not good.any():
        return np.where(good, values, 0.0)
    rows = np.arange(len(values))
    return np.interp(rows, rows[good], values[good])


def usual_size(deviations: np.ndarray) -> float:
    """Standard deviation of a normal law with these absolute ``deviations`` (N,): by their median or, where it is more,
    by their 90 % quantile, as more than half of them are zero in a rounded column."""
    return max(MAD * float(np.median(deviations)), float(np.quantile(deviations, 0.9)) / 1.645)


def grain(values: np.ndarray) -> float:
    """Least difference between neighbours of ``values`` (N,), which a rounded column cannot tell apart; 0 where all of
    them are the same."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.quantile(steps, 0.01)) if len(steps) else 0.0  # no minimum: differences of rounding errors are less


def resolution(trial: Trial, columns: Sequence[str]) -> float:
    """``grain`` of the ``columns`` of ``trial`` together."""
    return math.hypot(*(grain(trial[name]) for name in columns))


def runs(flags: np.ndarray) -> np.ndarray:
    """First row and the row after the last of each run of true ``flags`` (M,), (runs, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], flags, [0]]).astype(int))).reshape(-1, 2)


# A value is frozen when it is repeated this many times as often as the longest repetition that is usual.
LONGEST = 4.0  # set by hand
USUAL = 0.8  # Share of the samples that lie in repetitions of usual length. Set by hand.
# Fewer repetitions, or fewer seconds, are a matter of rounding. Set by hand (2, 0 and 1, 1).
LEAST_ROWS, LEAST_S = 5, 1.2
# A velocity without noise that was frozen goes on with a jump of this many of its larger changes from row to row; one
# that does not was steady. Set by hand.
JUMP = 3.0
# Share of a record's median speed or turn rate above which a ship moves so that a frozen column must show it. Set by
# hand: at rest a value repeats itself.
AWAKE = 0.3
# Share of changes from row to row against the one before, from which a channel has noise (white noise: 2/3), so that it
# never repeats itself for long. Set by hand.
NOISY = 0.25
GROUPS = (("psi",), ("x", "y"), ("u", "v"), ("r",))
# Standard deviations of the integral of white noise that say nothing: one in 16,000 is larger by chance.
WANDER = 4.0  # set by hand


def frozen(trial: Trial, signals: Mapping[str, np.ndarray]) -> Iterator[Break]:
    """First and last row, what, and columns of each frozen stretch of ``trial``. signals: its ``mismatches``, each
    (N,)."""
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    # what must have changed the first column of a group, from another instrument than its own
    moves = {"psi": turn, "r": np.abs(np.gradient(trial.psi_unwrapped, trial.t)), "x": speed, "u": speed}
    for group in GROUPS:
        if any(name not in trial for name in group):
            continue
        same = np.all([np.diff(trial[name]) == 0 for name in group], axis=0)
        edges = runs(same)
        if not len(edges):
            continue
        lengths = edges[:, 1] - edges[:, 0]
        least = max(LEAST_ROWS, LEAST_S / trial.dt)
        motion = moves[group[0]]
        awake = AWAKE * float(np.nanmedian(motion))
        for k in np.flatnonzero(lengths >= least):
            first, last = edges[k]
            # compared with the other repetitions, as a long one would make itself usual
            if lengths[k] < LONGEST * usual_length(np.delete(lengths, k), len(trial) - lengths[k]):
                continue
            moving = motion[first : last + 1][np.isfinite(motion[first : last + 1])]
            awoken = len(moving) > 0 and float(np.median(moving)) > awake and _others_move(trial, group, first, last)
            awoken = awoken and _lacks(trial, signals, group, first, last)
            if awoken and (group[0] in ("psi", "x") or _resumes(trial, group, last)):
                yield int(first), int(last), f"{', '.join(group)} frozen", group


def _lacks(trial: Trial, signals: Mapping[str, np.ndarray], group: tuple[str, ...], first: int, last: int) -> bool:
    """Whether more of the motion is missing between the rows than rounded columns do not show. What the rates are off
    by throughout the rest of the record is not missing."""
    name = next(name for name, columns in COLUMNS.items() if group in columns)
    if name not in signals or not resolution(trial, group):
        return False
    mismatch, since = signals[name], trial.t[first : last + 1] - trial.t[first]
    off, rest = mismatch[first : last + 1] - mismatch[first], trial.duration - since[-1]
    drift = (mismatch[-1] - mismatch[0] - off[-1]) / rest if rest > since[-1] else 0.0  # bias of a rate, elsewhere
    missing = min(float(np.abs(off).max()), float(np.abs(off - drift * since).max()))
    place, rate = (resolution(trial, columns) for columns in COLUMNS[name])
    noise = white_noise([trial.states])
    placed, rated = (math.hypot(*noise[[NAMES.index(column) for column in columns]]) for columns in COLUMNS[name])
    wander = WANDER * (placed + rated * math.sqrt(float(since[-1]) * trial.dt))  # sigma dt sqrt(n), n = T / dt
    return missing > place + rate * float(since[-1]) + wander


def _resumes(trial: Trial, group: tuple[str, ...], last: int) -> bool:
    """Whether a column of the ``group`` has noise, or jumps after the row ``last``."""
    for name in group:
        change = np.diff(trial[name])
        steps = change[np.abs(change) > 0]
        if len(steps) < 2:
            continue
        if np.mean(np.sign(steps[1:]) != np.sign(steps[:-1])) > NOISY:
            return True
        if last < len(change) and np.abs(change[last]) > JUMP * np.percentile(np.abs(steps), 95):
            return True
    return False


def usual_length(lengths: np.ndarray, rows: int) -> float:
    """Length of a repetition that all but a few samples of the ``rows`` of a record do not exceed. lengths: of its
    repetitions (M,), in rows."""
    single = rows - lengths.sum()  # samples in no repetition, whose length counts as 1
    if not len(lengths) or single >= USUAL * rows:
        return 1.0
    lengths = np.sort(lengths)
    within = np.searchsorted(single + np.cumsum(lengths), USUAL * rows)
    return float(lengths[within.clip(max=len(lengths) - 1)])


def _others_move(trial: Trial, group: tuple[str, ...], first: int, last: int) -> bool:
    """Whether columns beside those of the ``group`` change between the rows: a record that repeats is a gap."""
    others = [name for names in GROUPS if names != group for name in names if name in trial]
    return any(np.any(np.diff(trial[name][first : last + 1]) != 0) for name in others)


NAMES = ("x", "y", "psi", "u", "v", "r")


def repeated(trial: Trial) -> Iterator[Break]:
    """First and last row, what, and columns of each stretch of ``trial`` in which the last sample of all states is
    repeated."""
    names = tuple(name for name in NAMES if name in trial)
    rows = np.column_stack([trial[name] for name in names])
    stands = runs((rows[1:] == rows[:-1]).all(axis=1))
    least = max(LEAST_ROWS, round(LEAST_S / trial.dt))
    if not len(stands):
        return
    speed, turn = np.hypot(trial["u"], trial["v"]), np.abs(trial["r"])
    awake = (speed > AWAKE * np.nanmedian(speed)) | (turn > AWAKE * np.nanmedian(turn))
    longest = LONGEST * usual_length(stands[:, 1] - stands[:, 0], len(trial))
    for first, last in stands[stands[:, 1] - stands[:, 0] >= max(least, longest)]:
        if awake[first] and last + 1 < len(trial):  # a record that ends so ends there
            yield int(first), int(last), "the last sample of all states is repeated", names


# Distance of a sample from the median of its neighbours, over the usual one, from which it is a spike. Set by hand.
SURE = 8.0
# Least size of a spike: share of the rms speed (u, v) or of the rms turn rate. Set by hand.
LEAST_SPIKE = {"u": 0.15, "v": 0.15, "r": 1.0}
LEAST = 4  # So many spikes make a train; fewer are the outliers that a robust loss is for. Set by hand.
APART = 3.0  # s, or so many samples: longest time between spikes of a train. Set by hand.
RARE = 0.05  # Share of samples from which spikes are the noise of the channel. Set by hand.


def around(values: np.ndarray, reach: int) -> np.ndarray:
    """The ``values`` (N,), each with ``reach`` neighbours on both sides, (N, 2 reach + 1), a view; the ends repeat. The
    filters of scipy.ndimage do the same, but take longer to import than the checks of a few files."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, reach, mode="edge"), 2 * reach + 1)


REACH = 3  # Neighbours on each side. Set by hand.


def spike_trains(trial: Trial) -> Iterator[Break]:
    """First and last row, what, and column of each train of spikes of ``trial``."""
    speed = np.nan_to_num(trial["u"]) ** 2 + np.nan_to_num(trial["v"]) ** 2
    for name in LEAST_SPIKE:
        values = trial[name]
        if not np.isfinite(values).all():
            continue
        rms = float(np.sqrt(np.mean(values**2 if name == "r" else speed)))
        off = np.abs(values - np.median(around(values, REACH), axis=1))
        usual = max(usual_size(off), 0.5 * grain(values))
        rows = np.flatnonzero(off > max(SURE * usual, LEAST_SPIKE[name] * rms))
        if len(rows) > RARE * len(values):
            continue
        apart = max(APART, APART * trial.dt)
        for train in np.split(rows, np.flatnonzero(np.diff(trial.t[rows]) > apart) + 1):
            if len(train) >= LEAST:
                yield int(train[0]), int(train[-1]), f"spikes of {name}", (name,)


# What turns a ship. The propeller does so by its flow on the rudder, and pushes her on.
STEERING = tuple(name for name in INPUTS if name not in ("n", "n_2", "pitch"))
SWINGING = "the turn rate swings while rudder and propeller rest"  # What is said of such a spell
SWINGS = 2  # So many swings beyond the first, which the last order may have caused. Set by hand (1, 0).
SWING = 0.5  # A swing changes the turn rate by this share of its root mean square over the record. Set by hand.
MOST = 0.9  # Share of the record beyond which a spell leaves no orders to compare with. Set by hand.
BEYOND_NOISE = 6.0  # And by so many standard deviations of its own noise, after smoothing. Set by hand.
# It does so faster than 95 % of the record, or by this factor where the propeller is stopped as well: nothing of the
# ship's own is left that turns her. Set by hand.
STOPPED = 0.15
# So it is only in spells up to this share of the record: one that lies stopped in swell swings all the time.
SHORTER = 0.4  # set by hand
AGREED = 0.5  # The heading turns with it, by at least this share: else the gyro swings, not the ship. Set by hand.
STILL = 1e-3  # Share of an input's largest value by which it may change from row to row at rest. Set by hand.
PROPELLERS = ("n", "n_2", "n_3", "n_4")
STANDS = 0.02  # Share of its largest revolutions up to which a propeller stands still. Set by hand.


def without_cause(trial: Trial) -> Iterator[Break]:
    """First and last row, what, and columns of each spell of rest of ``trial`` in which the turn rate swings. The spell
    counts from its beginning: when the hand took hold is not in the record."""
    width = max(5, round(1.0 / trial.dt)) | 1  # rows of a mean over about a second, odd so that it has a middle
    r = trial["r"]
    if not np.isfinite(r).all() or len(trial) < 10 * width:
        return
    smooth = np.mean(around(r, width // 2), axis=1)
    rate = np.abs(np.gradient(smooth, trial.t))
    turning = np.mean(around(np.gradient(trial.psi_unwrapped, trial.t), width // 2), axis=1)
    noise = float(np.std(r - smooth)) / np.sqrt(width)  # that of the mean over ``width`` samples of white noise
    size = max(SWING * float(np.sqrt(np.mean(r**2))), BEYOND_NOISE * noise)
    quick = float(np.quantile(rate, 0.95))
    for first, last in runs(~steered(trial)):
        if last - first < 3 * width or last - first > MOST * len(r):
            continue
        stopped = last - first <= SHORTER * len(r) and _stopped(trial, first, last)
        fast = quick * (STOPPED if stopped else 1.0)
        turns = _extrema(smooth[first : last + 1], size)
        swings = [
            (i, j)
            for i, j in pairwise(turns)
            if abs(smooth[first + j] - smooth[first + i]) > fast * (trial.t[first + j] - trial.t[first + i])
            and (turning[first + j] - turning[first + i]) / (smooth[first + j] - smooth[first + i]) > AGREED
        ]
        if sum(i > 0 for i, _ in swings) >= SWINGS:
            yield int(first), int(last), SWINGING, ("u", "v", "r")


def steered(trial: Trial) -> np.ndarray:
    """Whether something that turns the ship of ``trial`` moves from each row to the next, (N - 1,)."""
    out = np.zeros(len(trial) - 1, bool)
    for values in (trial[name] for name in STEERING if name in trial):
        out |= np.abs(np.diff(values)) > STILL * max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-9)
    return out


def _stopped(trial: Trial, first: int, last: int) -> bool:
    """Whether every propeller of ``trial`` is at rest between the rows."""
    names = [name for name in PROPELLERS if name in trial]
    return bool(names) and all(
        float(np.nanmax(np.abs(trial[name][first : last + 1]))) <= STANDS * float(np.nanmax(np.abs(trial[name])))
        for name in names
    )


def _extrema(values: np.ndarray, size: float) -> list[int]:
    """Rows where ``values`` turn back by more than ``size``, with the first row, and the last extremum."""
    low = high = 0  # rows of the least and of the greatest value since the last turning point
    rows, up = [0], None  # up: whether the values rise, None until they moved by ``size``
    for i, value in enumerate(values.tolist()):
        if value > values[high]:
            high = i
        if value < values[low]:
            low = i
        if up is not False and value < values[high] - size:
            if up:
                rows.append(high)
            up, low, high = False, i, i
        elif up is not True and value > values[low] + size:
            if up is False:
                rows.append(low)
            up, low, high = True, i, i
    if up is not None:
        rows.append(high if up else low)
    return rows
