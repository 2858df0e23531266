"""What the columns of a file may be instead of what their headers say, and which of these readings a folder has: the
one with the best evidence of all its trials together.

What each trial says of a reading is a log-likelihood ratio: the logarithm of mean square misfits, piece by piece, of
positions against integrated velocities, heading against integrated turn rate, and turn rate against rudder. A choice
that differs from the headers costs COST for the folder; a trial that differs from its folder pays it by itself.

No reading mends a column that stands still over a whole record while others move, nor an input in a unit that does not
go with how quickly the ship turns. Two numbers without dimension hardly depend on the ship: the revolutions that her
propeller makes while her turn rate changes, n tau, and how far she turns in this time per rudder angle, r tau / delta.
From ships of 3 m to 320 m, models and real ones, mild zigzags to berthing, they are 16 to 130 and 0.1 to 1.6. Factors
of 60 and of 57 lie far outside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product, starmap
from typing import Any, NamedTuple

import numpy as np

from cases.evidence.signals import (
    FLOOR,
    PIECES,
    STEPS,
    Signals,
    Stats,
    evidence,
    independent,
    over_windows,
    relative,
    signals,
)
from cases.inputs import integral
from cases.quantities import DEG, KNOT, quantity, to_si, unit_by_factor
from cases.trial import Trial
from mmg.motion.flow import RUDDERS

# rad; a heading turns at least so far before its own column, or that of the turn rate, must have shown it.
TURNED = 0.1  # set by hand
QUARTER = math.pi / 2  # rad; turn of a track that no ship makes on one heading. Set by hand.
# rad; within it a frozen heading changes where it is made one of a local frame, over some kilometres. Set by hand.
MERIDIANS = 1e-3
# Share of the speed by which the velocity of the track varies before u must have shown it; half of it for v.
VARIED = 0.05  # set by hand
STANDS = 0.98  # Share of the rows with one value, from which a column stands still. Set by hand.


def standing(trial: Trial) -> dict[str, str]:
    """Column -> what says that it must have moved, of ``trial``, in words."""
    psi, r = trial.psi_unwrapped, trial["r"]
    still = {name for name in ("psi", "u", "v", "r", "x", "y") if name in trial and _stands(trial[name])}
    frozen = _stands(psi, MERIDIANS)
    out: dict[str, str] = {}
    if not (still or frozen) or len(trial) < 20:
        return out
    made = integral(trial.t, np.nan_to_num(r))
    integrated = _range(made)
    if "r" in still and _range(psi - made) > TURNED:  # in a steady circle the heading goes with the one turn rate
        out["r"] = f"the heading turns by {_range(psi):.2g} rad and not by {integrated:.2g}"
    if "psi" in still and integrated > TURNED:
        out["psi"] = f"the turn rate makes {integrated:.2g} rad"
    if frozen and {"x", "y"} <= set(trial.columns) and not {"x", "y"} & still:
        # in the axes of a heading that stands still: the course itself
        course = _range(np.unwrap(np.angle(_track(trial))))
        if course > QUARTER:
            out["psi"] = f"the track turns by {course:.2g} rad"
    speed = float(np.sqrt(np.nanmean(trial["u"] ** 2 + trial["v"] ** 2)))
    if {"x", "y"} <= still and speed * trial.duration > 1.0:
        out |= dict.fromkeys(("x", "y"), f"the ship runs at {speed:.2g} m/s")
    elif still and "x" in trial and "y" in trial and not {"x", "y", "psi"} & still:
        track = _track(trial)
        size = float(np.sqrt(np.mean(np.abs(track) ** 2)))
        if "u" in still and float(np.std(track.real)) > VARIED * size:
            out["u"] = f"the speed of the track varies by {float(np.ptp(track.real)):.2g} m/s"
        if "v" in still and float(np.std(track.imag)) > 0.5 * VARIED * size:
            out["v"] = f"the track drifts by up to {float(np.abs(track.imag).max()):.2g} m/s"
    return out


def _stands(values: np.ndarray, within: float = 0.0) -> bool:
    valid = values[np.isfinite(values)]
    return len(valid) > 0 and float(np.mean(np.abs(valid - np.median(valid)) <= within)) >= STANDS


def _range(values: np.ndarray) -> float:
    valid = values[np.isfinite(values)]
    return float(np.ptp(valid)) if len(valid) else 0.0


def _track(trial: Trial) -> np.ndarray:
    """Velocity of the track in body axes (M,), of pieces of a fiftieth of the record."""
    place, psi = trial["x"] + 1j * trial["y"], trial.psi_unwrapped
    good = np.isfinite(place) & np.isfinite(psi)
    t, place, psi = trial.t[good], place[good], psi[good]
    rows = max(len(t) // 50, 1)
    middle = psi[rows // 2 : rows // 2 + len(t) - rows]
    return np.asarray((place[rows:] - place[:-rows]) / (t[rows:] - t[:-rows]) * np.exp(-1j * middle))


REVOLUTIONS = (3.0, 600.0)  # Least and greatest n tau of rightly labelled revolutions. Set by hand.
# Least and greatest r tau / delta of a rightly labelled rudder, of a ship that follows her rudder. Set by hand.
RESPONSE = (0.025, 6.0)
FOLLOWS = 0.7  # Correlation of turn rate and rudder from which a ship follows it. Set by hand.
TURNS = 0.05  # rad; a heading that varies less says nothing of how quickly the ship turns. Set by hand.


def wrong_inputs(trial: Trial, turning: float | None) -> list[tuple[str, float, str]]:
    """(column, factor that makes it true, sentence) of revolutions and rudders of ``trial`` in a wrong unit. turning:
    correlation of the turn rate with the rudder, None where it is not known."""
    s = signals(trial)
    if s is None or not s.good.any() or float(np.std(s.psi[s.good])) < TURNS:
        return []
    # differences over a window: noise of a heading at the rows of the clock would rule that of neighbours
    span = STEPS * s.step
    use = s.good[STEPS:-STEPS]
    rate = (s.psi[STEPS:] - s.psi[:-STEPS]) / span
    change = (rate[STEPS:] - rate[:-STEPS]) / span
    valid = use[: len(change)]
    if valid.sum() < 10 or not float(np.mean(change[valid] ** 2)) > 0:
        return []
    tau = float(np.std(rate) / np.sqrt(np.mean(change[valid] ** 2)))  # s, in which the turn rate changes by its spread
    out = []
    for name in ("n", "n_2"):
        n = np.abs(trial[name][np.isfinite(trial[name])]) if name in trial else np.zeros(1)
        if np.sum(n > 0) >= max(0.5 * len(n), 1):
            made = float(np.median(n[n > 0])) * tau
            out += _outside(name, made, REVOLUTIONS, ("rps", "rpm", 60.0), "revolutions while the ship begins to turn")
    rudder = trial.rudder[np.isfinite(trial.rudder)]
    size = float(np.sqrt(np.mean(rudder**2))) if len(rudder) > 1 else 0.0
    # a rudder that changes from row to row by more than its size is at rest under a noisy sensor, as in a crash stop
    if turning is not None and abs(turning) >= FOLLOWS and size > float(np.sqrt(np.mean(np.diff(rudder) ** 2))):
        response = tau * float(np.sqrt(np.mean(rate**2))) / size
        for name in [name for name in RUDDERS if name in trial]:
            out += _outside(name, response, RESPONSE, ("degrees", "rad", math.pi / 180), "times the rudder is her turn")
    return out


def _outside(
    name: str, value: float, limits: tuple[float, float], units: tuple[str, str, float], what: str
) -> list[tuple[str, float, str]]:
    """What is said of the column ``name`` where a ``value`` of ``what`` lies outside the ``limits``. units: the first
    that it holds where the value is too small, though labelled as the second, and the factor of that."""
    low, high = limits
    if low <= value <= high:
        return []
    small, large, factor = units
    actual, labelled, by = (small, large, factor) if value < low else (large, small, 1 / factor)
    return [(name, by, f"{name} holds {actual} but is labelled {labelled}: there would be {value:.3g} {what}")]


# Keys of the sidecar and their values. A unit is given as the factor from what was read to what is true.
Keys = dict[str, Any]


class Frame(NamedTuple):
    """A reading of axes and signs. code: of the finding; meaning: in words; guess: velocity north + i east of the track
    (M,), or of what a mirrored or swapped track becomes; psi, r: what their signs become; keys: of the sidecar."""

    code: str
    meaning: str
    guess: Callable[[Signals], np.ndarray]
    psi: int
    r: int
    keys: Keys


def _turned(s: Signals) -> np.ndarray:
    return s.w * np.exp(1j * s.psi)


def _backwards(s: Signals) -> np.ndarray:
    return s.w * np.exp(-1j * s.psi)


# Name -> reading of axes and signs; the first is that of the headers.
FRAMES: Mapping[str, Frame] = {
    "body": Frame("", "u, v are body-axes velocities", _turned, 1, 1, {}),
    "earth": Frame("velocity_frame", "u, v are earth-fixed velocities (north, east)", lambda s: s.w, 1, 1,
                   {"velocity_frame": "earth"}),
    "earth_swapped": Frame("velocity_frame", "u, v are earth-fixed velocities (east, north)",
                           lambda s: s.w.imag + 1j * s.w.real, 1, 1,
                           {"velocity_frame": "earth", "columns": {"u": "v", "v": "u"}}),
    "turned_twice": Frame("velocity_frame", "u, v were body-axes velocities before they were turned by psi",
                          lambda s: s.w * np.exp(2j * s.psi), 1, 1, {"velocity_frame": "body"}),
    "v_to_port": Frame("sway_sign", "v is positive to port", lambda s: np.conj(s.w) * np.exp(1j * s.psi), 1, 1,
                       {"sign": {"v": -1}}),
    "y_to_west": Frame("mirrored_frame", "y is positive to port (west)", lambda s: np.conj(_turned(s)), 1, 1,
                       {"sign": {"y": -1}}),
    "mirrored": Frame("mirrored_frame", "psi, v and r are positive to port", lambda s: np.conj(_turned(s)), -1, -1,
                      {"sign": {"psi": -1, "v": -1, "r": -1}}),
    "all_mirrored": Frame("mirrored_frame", "y, psi, v and r are all mirrored (as in ROS, or east, north, up)", _turned,
                          -1, -1, {"sign": {"y": -1, "psi": -1, "v": -1, "r": -1}}),
    "psi_counter_clockwise": Frame("heading_sign", "psi is positive counter-clockwise", _backwards, -1, 1,
                                   {"sign": {"psi": -1}}),
    "psi_r_counter_clockwise": Frame("heading_sign", "psi and r are positive counter-clockwise", _backwards, -1, -1,
                                     {"sign": {"psi": -1, "r": -1}}),
    "u_astern": Frame("u_sign", "u is positive astern", lambda s: -np.conj(s.w) * np.exp(1j * s.psi), 1, 1,
                      {"sign": {"u": -1}}),
    "positions_swapped": Frame("swapped_positions", "x is east and y is north", lambda s: 1j * np.conj(_turned(s)),
                               1, 1, {"columns": {"x": "y", "y": "x"}}),
    "psi_from_east": Frame("heading_from_east", "psi is counted from east, counter-clockwise",
                           lambda s: 1j * _backwards(s), -1, 1, {"heading_from": "east", "sign": {"psi": -1}}),
    "psi_r_from_east": Frame("heading_from_east", "psi is counted from east, counter-clockwise, and r with it",
                             lambda s: 1j * _backwards(s), -1, -1,
                             {"heading_from": "east", "sign": {"psi": -1, "r": -1}}),
    "psi_from_east_clockwise": Frame("heading_from_east", "psi is counted from east, clockwise",
                                     lambda s: 1j * _turned(s), 1, 1, {"heading_from": "east"}),
}  # fmt: skip
# Factor that makes psi true -> what was mistaken.
HEADINGS: Mapping[float, str] = {
    1.0: "",
    DEG: "psi holds degrees but is labelled rad",
    1 / DEG: "psi holds radians but is labelled deg",
}
# Factor that makes u and v true -> what was mistaken.
SPEEDS: Mapping[float, str] = {
    1.0: "",
    KNOT: "u and v hold knots but are labelled m/s",
    1 / KNOT: "u and v hold m/s but are labelled kn",
    1 / 3.6: "u and v hold km/h but are labelled m/s",
    3.6: "u and v hold m/s but are labelled km/h",
}
# Factor that makes t true -> what was mistaken.
CLOCKS: Mapping[float, str] = {
    1.0: "",
    1e-3: "t holds milliseconds but is labelled s",
    60.0: "t holds minutes but is labelled s",
}
# Factor that makes r true -> what was mistaken.
RATES: Mapping[float, str] = {
    1.0: "",
    -1.0: "r has the opposite sign of the derivative of the heading",
    DEG: "r holds deg/s but is labelled rad/s",
    1 / DEG: "r holds rad/s but is labelled deg/s",
    1 / 60: "r holds deg/min but is labelled deg/s",
    DEG / 60: "r holds deg/min but is labelled rad/s",
    60.0: "r holds deg/s but is labelled deg/min",
}
# Factor that makes the rudder angle true -> what was mistaken.
RUDDER_SIGNS: Mapping[int, str] = {1: "", -1: "the rudder is positive to port"}
# Of each question, in the order of a ColumnReading.
CHOICES: tuple[Mapping[Any, Any], ...] = (FRAMES, HEADINGS, SPEEDS, CLOCKS, RATES, RUDDER_SIGNS)


class ColumnReading(NamedTuple):
    """One choice for each question: name of the frame, factors of psi, of (u, v), of t, of r and of delta."""

    frame: str = "body"
    heading: float = 1.0
    speed: float = 1.0
    clock: float = 1.0
    rate: float = 1.0
    rudder: int = 1

    @property
    def faults(self) -> int:
        """How many choices differ from what the headers say."""
        return sum(a != b for a, b in zip(self, ColumnReading(), strict=True))

    @property
    def turning(self) -> int:
        """Sign that makes r over delta true."""
        return FRAMES[self.frame].r * (-1 if self.rate < 0 else 1) * self.rudder

    @property
    def units(self) -> list[tuple[str, float]]:
        """(column, factor) of the units that differ from what the headers say."""
        factors = {"psi": self.heading, "u": self.speed, "t": self.clock, "r": abs(self.rate)}
        return [pair for pair in factors.items() if pair[1] != 1.0]

    def statements(self) -> list[tuple[str, str]]:
        """(code, what is mistaken) for each choice that differs from what the headers say."""
        frame = FRAMES[self.frame]
        out = [(frame.code, frame.meaning)] if frame.code else []
        words = (HEADINGS[self.heading], SPEEDS[self.speed], CLOCKS[self.clock])
        out += [("unit", text) for text in words if text]
        if RATES[self.rate]:
            out.append(("r_sign" if self.rate == -1 else "unit", RATES[self.rate]))
        return out + ([("rudder_sign", RUDDER_SIGNS[self.rudder])] if self.rudder == -1 else [])

    def keys(self) -> Keys:
        """Keys of the sidecar that make the columns true."""
        frame = FRAMES[self.frame].keys
        out: Keys = {**frame}
        if self.rate == -1:
            out["sign"] = {**frame.get("sign", {}), "r": -1}
        units = dict(self.units)
        if units:
            out["units"] = {**units, **({"v": units["u"]} if "u" in units else {})}
        if self.rudder == -1:
            out["rudder_positive"] = "port"
        return out


def readings() -> list[ColumnReading]:
    """All readings that compete: frame, unit of the heading, of the speeds and of the clock, two of them at most, each
    with every reading of r and of the rudder."""
    every = starmap(ColumnReading, product(*CHOICES))
    some = [r for r in every if r._replace(rate=1.0, rudder=1).faults <= 2]
    # r mirrored with its frame, and of another sign as well, would be r as it is
    return [r for r in some if FRAMES[r.frame].r == 1 or r.rate != -1]


# Nats by which another reading has to be better than that of the headers, for each choice that differs.
COST = 8.0  # set by hand
CLOSE = 4.0  # Readings that are closer than so many nats cannot be told apart. Set by hand.
# Usual standard deviations of a heading's offset [rad] and of the logarithm of a log's or a gyro's gain, left free.
OFF = (0.035, 0.03)  # set by hand
MOST_OFF = (0.09, 0.1)  # And the most that they are believed to be. Set by hand.
APART = 10.0  # What a trial pays for each choice in which it differs from its folder. Set by hand.
STRANGE = 6.0  # What a unit costs beside, that no header could have hidden behind the one that is written. Set by hand.
UNTOLD = 100.0  # What a reading costs of columns that were derived from those it would be wrong against. Set by hand.
ORDERS = 2  # Rudder orders that a turn rate answers in each piece of a record. Set by hand.
FLOOR_RUDDER = 0.05  # Of a turn rate a rudder explains no more than all but this share of the mean square. Set by hand.
# Relative misfit of the track, with the units of the headers, below which these are right: any other unit misses by
# more than half. Set by hand.
RIGHT = 0.25


@dataclass(frozen=True)
class Scores:
    """What one trial says: ``nats`` of each reading (less is better), of what is usual."""

    nats: np.ndarray  # (H,), less those of the headers
    misfit: dict[tuple[str, float, float], float]  # (frame, factor of psi, factor of the way) -> relative misfit


@dataclass(frozen=True)
class Judged:
    """The reading of one trial: itself, relative misfit of its track as labelled and with it, that of its folder, a
    rival that the folder cannot tell from it.

    odds: nats by which the reading is likelier than the headers over all files, or for a file that differs from its
    folder than what the folder has; agreed: whether it is no less likely than the headers in every file.
    """

    reading: ColumnReading
    before: float
    after: float
    folder: ColumnReading
    rival: ColumnReading | None = None
    odds: float = 0.0
    agreed: bool = True


@cache
def competitors() -> tuple[tuple[ColumnReading, ...], np.ndarray, np.ndarray]:
    """The readings, that of the headers first; how many choices differ from it (H,); pairs of them (H, H)."""
    ordered = sorted(readings(), key=lambda reading: reading.faults)
    codes = np.array([[list(table).index(choice) for table, choice in zip(CHOICES, r, strict=True)] for r in ordered])
    apart = np.zeros((len(ordered), len(ordered)), dtype=np.int8)  # of four million pairs
    for column in codes.T:
        apart += column[:, None] != column[None, :]
    return tuple(ordered), apart[0].astype(int), apart


@cache
def _keys() -> list[tuple[tuple[str, float, float], tuple[float, float], int]]:
    """What each reading asks the tables of tracks, spins and rudders for."""
    return [
        # a clock in other units changes way and turn as another unit of the rates does
        ((r.frame, r.heading, r.speed * r.clock), (r.heading, r.rate * frame.psi * frame.r * r.clock), r.turning)
        for r in competitors()[0]
        for frame in [FRAMES[r.frame]]
    ]


def scores(
    trial: Trial,
    record: Signals | None,
    turning: float | None,
    standing: Sequence[str] = (),
    labels: Mapping[str, str] | None = None,
) -> Scores:
    """What ``trial`` says of each reading.

    record: its ``signals``; turning: correlation of its turn rate with the rudder, None where it is not known;
    standing: columns that stand still and say nothing; labels: column -> unit in its header, without which they are
    those of a Trial.
    """
    keys, strange = _keys(), _unlikely_units(labels or {})
    track: dict[tuple[str, float, float], tuple[float, float]] = {}
    spin: dict[tuple[float, float], float] = {}
    blind = {"psi", "r"} & set(standing)
    lost = {"x", "y", "u", "v", "psi"} & set(standing)
    factors, rates = tuple({way[2] for way, _, _ in keys}), tuple({spun[1] for _, spun, _ in keys})
    for unit in HEADINGS:
        s = record if unit == 1.0 else signals(trial, unit)
        if s is None:
            continue
        if not blind and s.has_turn:
            stats = s.stats(over_windows(s.psi), s.summed(s.r))
            spin |= zip(((unit, rate) for rate in rates), free_nats(stats, np.array(rates), False), strict=True)
        if s.has_track and not lost:
            for name, frame in FRAMES.items():  # that of the headers first: it may show that its units are right
                stats = s.stats(over_windows(s.place), s.summed(frame.guess(s)))
                by = np.array(factors)
                plain = np.sqrt(np.average(relative(stats, by), axis=-1, weights=stats.measured + 1e-30))
                values = zip(free_nats(stats, by).tolist(), plain.tolist(), strict=True)
                track |= zip(((name, unit, factor) for factor in factors), values, strict=True)
                if len(factors) > 1 and track["body", 1.0, 1.0][1] < RIGHT:
                    factors = (1.0,)
        if factors == (1.0,):  # these units are right; what another one makes of them explains nothing
            break
    rudders = rudder_nats(turning)
    nats = np.array([track.get(way, (0.0, 0.0))[0] + spin.get(spun, 0.0) + rudders[sign] for way, spun, sign in keys])
    nats += STRANGE * np.array([len(strange.intersection(reading.units)) for reading in competitors()[0]])
    if "r" in trial.ancestors and not independent(trial, "turn"):  # it has the sign and the unit of the heading
        nats += UNTOLD * np.array([reading.rate != 1.0 for reading in competitors()[0]])
    if trial.has_position and not independent(trial, "track"):
        nats += UNTOLD * np.array([reading.frame not in ("body", "all_mirrored") for reading in competitors()[0]])
    return Scores(nats - nats[0], {key: value[1] for key, value in track.items()})


def judged(found: Sequence[Scores]) -> list[Judged]:
    """The reading of each trial of a folder, from the scores that were ``found`` of all of them."""
    hypotheses, faults, apart = competitors()
    if not found:
        return []
    table = np.array([s.nats for s in found])
    best_own = np.argmin(table + COST * faults, axis=1)
    # only the headers, what each trial alone would have, and the twenty best of all together are tried for the folder
    plausible = np.unique(np.concatenate([[0], best_own, np.argsort(table.sum(axis=0) + COST * faults)[:20]]))

    def each(h: int) -> np.ndarray:
        """Per trial, the reading that it has where its folder has ``h``."""
        return np.argmin(table + APART * apart[h], axis=1)

    def total(h: int) -> float:
        chosen = each(h)
        rows = np.arange(len(table))
        return float(COST * faults[h] + np.sum(table[rows, chosen] + APART * apart[h, chosen]))

    totals = {int(h): total(int(h)) for h in plausible}
    folder = min(totals, key=lambda h: (round(totals[h], 6), faults[h]))  # of equals that with the fewest faults
    together = table.sum(axis=0) + COST * faults
    if together[folder] > together[0]:
        folder = 0  # each file that differs may have reasons of its own, as a wind that turns a slow ship
    near = [h for h in np.argsort(together)[:20] if h != folder and together[h] - together[folder] < CLOSE]
    rival = hypotheses[int(near[0])] if near and folder else None
    agreed = bool((table[:, folder] <= table[:, 0] + 1e-6).all())
    out = []
    for s, h in zip(found, each(folder), strict=True):
        chosen = hypotheses[int(h)]
        odds = s.nats[folder] - s.nats[h] if h != folder else together[0] - table[:, folder].sum()
        before = s.misfit.get(("body", 1.0, 1.0), math.nan)
        after = s.misfit.get((chosen.frame, chosen.heading, chosen.speed * chosen.clock), math.nan)
        other = rival if h == folder else None
        out.append(Judged(chosen, before, after, hypotheses[folder], other, float(odds), agreed))
    return out


def free_nats(stats: Stats, by: float | np.ndarray = 1.0, turns: bool = True, floor: float = FLOOR) -> np.ndarray:
    """Nats (F,) of what is predicted in ``stats`` times ``by`` (F,): a gain, and an angle where it ``turns``, are left
    free at the price of what is usual. 0 where nothing is predicted. floor: as of ``evidence``. Of ``stats`` of many
    records, (..., PIECES) each, ``by`` and nats are (...)."""
    predicted = np.sum(stats.predicted, axis=-1)
    best = np.sum(stats.both, axis=-1) / np.where(predicted > 0, predicted, 1.0) / by  # least squares: gain and angle
    size = np.maximum(np.abs(best) if turns else np.real(best), 1e-9)
    gain = np.clip(np.log(size), -MOST_OFF[1], MOST_OFF[1])
    angle = np.clip(np.angle(best), -MOST_OFF[0], MOST_OFF[0]) if turns else np.zeros(np.shape(gain))
    usual = 0.5 * (angle / OFF[0]) ** 2 + 0.5 * (gain / OFF[1]) ** 2
    factor = by * np.exp(gain + 1j * angle if turns else gain)
    return np.where(predicted > 0, evidence(relative(stats, factor), floor) + usual, 0.0)


def _unlikely_units(labels: Mapping[str, str]) -> set[tuple[str, float]]:
    """(column, factor) of the units that its header cannot have been mistaken for."""
    choices = {"psi": HEADINGS, "u": SPEEDS, "t": CLOCKS, "r": {abs(factor) for factor in RATES}}
    out = set()
    for column, factors in choices.items():
        si_factor = to_si(column, labels.get(column) or quantity(column).unit, column)
        out |= {(column, factor) for factor in factors if not unit_by_factor(column, si_factor * factor)}
    return out


def rudder_nats(correlation: float | None) -> dict[int, float]:
    """Sign of the rudder -> nats, of a turn rate that follows it with this ``correlation``."""
    if correlation is None:
        return {1: 0.0, -1: 0.0}
    return {sign: ORDERS * PIECES * math.log(1 - max(sign * correlation, 0.0) ** 2 + FLOOR_RUDDER) for sign in (1, -1)}
