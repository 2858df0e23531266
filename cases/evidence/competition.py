"""Which reading of the columns the trials of a folder have: the one with the best evidence of all of them together.

What each trial says of a reading is a log-likelihood ratio: the logarithm of mean square misfits, piece by piece, of
positions against integrated velocities, heading against integrated turn rate, and turn rate against rudder. A choice
that differs from the headers costs COST for the folder; a trial that differs from its folder pays it by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from cases.evidence.readings import CLOCKS, FRAMES, HEADINGS, RATES, SPEEDS, ColumnReading, readings
from cases.evidence.signals import PIECES, Stats, evidence, over_windows, relative, signals
from cases.io.units import si_unit, to_si, unit_by_factor
from cases.trial import Trial

COST = 8.0
"""Nats by which another reading has to be better than that of the headers, for each choice that differs."""

CLOSE = 4.0
"""Readings that are closer than so many nats cannot be told apart."""

OFF = (0.035, 0.03)
"""Usual standard deviations of a heading's offset [rad] and of the logarithm of a log's gain, which are left free."""

MOST_OFF = (0.09, 0.1)
"""And the most that they are believed to be."""

GYRO = 0.03
"""Usual deviation of a gyro's gain from one."""

APART = 10.0
"""What a trial pays for each choice in which it differs from its folder."""

STRANGE = 6.0
"""What a unit costs beside, that no header could have hidden behind the one that is written."""

ORDERS = 2
"""Rudder orders that a turn rate answers in each piece of a record."""

FLOOR_RUDDER = 0.05
"""Of a turn rate a rudder explains no more than all but this share of the mean square."""


RIGHT = 0.25
"""Relative misfit of the track, with the units of the headers, below which these are right: any other unit misses by
more than half."""


@dataclass(frozen=True)
class Scores:
    """What one trial says: ``nats`` of each reading (less is better), of what is usual."""

    nats: np.ndarray
    misfit: dict[tuple[str, float, float], float]


@dataclass(frozen=True)
class Judged:
    """The reading of one trial: itself, relative misfit of its track as labelled and with it, a rival that the folder
    cannot tell from it."""

    reading: ColumnReading
    before: float
    after: float
    rival: ColumnReading | None = None


@cache
def competitors() -> tuple[tuple[ColumnReading, ...], np.ndarray, np.ndarray]:
    """The readings, that of the headers first; how many choices differ from it (H,); pairs of them (H, H)."""
    found = sorted(readings(), key=lambda reading: reading.faults)
    table = {value: i for i, value in enumerate(dict.fromkeys(v for r in found for v in r.choices))}
    codes = np.array([[table[value] for value in r.choices] for r in found], dtype=np.int16)
    apart = np.zeros((len(found), len(found)), dtype=np.int8)  # of four million pairs
    for column in codes.T:
        apart += column[:, None] != column[None, :]
    return tuple(found), apart[0].astype(int), apart


@cache
def _rates() -> tuple[float, ...]:
    """Factors of the turn rate against the heading, of all readings."""
    return tuple({r.rate * FRAMES[r.frame].psi * FRAMES[r.frame].r * r.clock for r in competitors()[0]})


def scores(
    trial: Trial, turning: float | None, standing: Sequence[str] = (), labels: Mapping[str, str] | None = None
) -> Scores:
    """What ``trial`` says of each reading.

    turning: correlation of its turn rate with the rudder, None where it is not known; standing: columns that stand
    still and say nothing; labels: column -> unit in its header, without which they are those of a Trial.
    """
    found = competitors()[0]
    nats = np.zeros(len(found))
    strange = _unlikely_units(labels or {})
    turned = _rudder(turning)
    track: dict[tuple[str, float, float], tuple[float, float]] = {}
    spin: dict[tuple[float, float], float] = {}
    blind = {"psi", "r"} & set(standing)
    lost = {"x", "y", "u", "v", "psi"} & set(standing)
    factors = {r.speed * r.clock for r in found}
    for unit in HEADINGS:
        s = signals(trial, unit)
        if s is None:
            continue
        if not blind:
            stats = s.stats(over_windows(s.psi), s.summed(s.r))
            for factor in _rates():
                spin[unit, factor] = _spun(stats, factor)
        if s.has_track and not lost:
            for name, frame in FRAMES.items():
                stats = s.stats(s.way(), s.summed(frame.guess(s)))
                for factor in factors:
                    track[name, unit, factor] = _tracked(stats, factor)
                if len(factors) > 1 and track["body", 1.0, 1.0][1] < RIGHT:
                    factors = {1.0}
        if factors == {1.0}:  # these units are right; what another one makes of them explains nothing
            break
    for i, r in enumerate(found):
        axes = FRAMES[r.frame]
        nats[i] = track.get((r.frame, r.heading, r.speed * r.clock), (0.0, 0.0))[0]
        nats[i] += spin.get((r.heading, r.rate * axes.psi * axes.r * r.clock), 0.0)
        nats[i] += turned[r.turning] + STRANGE * sum(pair in strange for pair in r.units)
    return Scores(nats - nats[0], {key: value[1] for key, value in track.items()})


def judged(found: Sequence[Scores]) -> list[Judged]:
    """The reading of each trial of a folder, from the scores that were ``found`` of all of them."""
    hypotheses, faults, apart = competitors()
    if not found:
        return []
    own = np.array([s.nats for s in found])
    best_own = np.argmin(own + COST * faults, axis=1)
    plausible = np.unique(np.concatenate([[0], best_own, np.argsort(own.sum(axis=0) + COST * faults)[:20]]))

    def each(h: int) -> np.ndarray:
        """Per trial, the reading that it has where its folder has ``h``."""
        return np.argmin(own + APART * apart[h], axis=1)

    def total(h: int) -> float:
        chosen = each(h)
        rows = np.arange(len(own))
        return float(COST * faults[h] + np.sum(own[rows, chosen] + APART * apart[h, chosen]))

    totals = {int(h): total(int(h)) for h in plausible}
    folder = min(totals, key=lambda h: (round(totals[h], 6), faults[h]))
    together = own.sum(axis=0) + COST * faults
    near = [h for h in np.argsort(together)[:20] if h != folder and together[h] - together[folder] < CLOSE]
    rival = hypotheses[int(near[0])] if near and folder else None
    out = []
    for s, h in zip(found, each(folder), strict=True):
        chosen = hypotheses[int(h)]
        before = s.misfit.get(("body", 1.0, 1.0), math.nan)
        after = s.misfit.get((chosen.frame, chosen.heading, chosen.speed * chosen.clock), math.nan)
        out.append(Judged(chosen, before, after, rival if h == folder else None))
    return out


def _tracked(stats: Stats, factor: float) -> tuple[float, float]:
    """(nats, relative misfit) of predicted ways times ``factor``, the heading's offset and the log's gain left free
    within what is usual."""
    both, predicted = complex(np.sum(stats.both)), float(np.sum(stats.predicted))
    if not predicted > 0 or not abs(both) > 0:
        return float(evidence(np.ones(PIECES))), 1.0
    best = both / (predicted * factor)
    angle = float(np.clip(math.atan2(best.imag, best.real), -MOST_OFF[0], MOST_OFF[0]))
    gain = float(np.clip(math.log(abs(best)), -MOST_OFF[1], MOST_OFF[1]))
    prior = 0.5 * (angle / OFF[0]) ** 2 + 0.5 * (gain / OFF[1]) ** 2
    misfit = relative(stats, factor * math.exp(gain) * complex(math.cos(angle), math.sin(angle)))
    plain = relative(stats, factor)
    return float(evidence(misfit)) + prior, math.sqrt(float(np.average(plain, weights=stats.measured + 1e-30)))


def _spun(stats: Stats, factor: float) -> float:
    """Nats of integrated turn rates times ``factor``, the gain of the gyro left free within what is usual."""
    both, predicted = float(np.real(np.sum(stats.both))), float(np.sum(stats.predicted))
    gain = both / (predicted * factor) if predicted > 0 else 1.0
    gain = float(np.clip(gain, 1 - 3 * GYRO, 1 + 3 * GYRO))
    return float(evidence(relative(stats, factor * gain))) + 0.5 * ((gain - 1) / GYRO) ** 2


def _unlikely_units(labels: Mapping[str, str]) -> set[tuple[str, float]]:
    """(column, factor) of the units that its header cannot have been mistaken for."""
    choices = {"psi": HEADINGS, "u": SPEEDS, "t": CLOCKS, "r": {abs(factor) for factor in RATES}}
    out = set()
    for column, factors in choices.items():
        own = to_si(column, labels.get(column) or si_unit(column), column)
        out |= {(column, factor) for factor in factors if not unit_by_factor(column, own * factor)}
    return out


def _rudder(correlation: float | None) -> dict[int, float]:
    """Sign of the rudder -> nats, of a turn rate that follows it with this ``correlation``."""
    if correlation is None:
        return {1: 0.0, -1: 0.0}
    return {sign: ORDERS * PIECES * math.log(1 - max(sign * correlation, 0.0) ** 2 + FLOOR_RUDDER) for sign in (1, -1)}
