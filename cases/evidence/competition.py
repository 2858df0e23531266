"""Which reading of the columns the trials of a folder have: the one with the best evidence of all of them together.

What each trial says of a reading is a log-likelihood ratio: the logarithm of mean square misfits, piece by piece, of
positions against integrated velocities, heading against integrated turn rate, and turn rate against rudder. A choice
that differs from the headers costs COST for the folder; a trial that differs from its folder pays it by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

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
    """The reading of one trial: itself, relative misfit of its track as labelled and with it, that of its folder, a
    rival that the folder cannot tell from it."""

    reading: ColumnReading
    before: float
    after: float
    folder: ColumnReading
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


@dataclass(frozen=True)
class _Keys:
    """What each of H readings asks a table for: one of the ``keys``, ``which`` (H,)."""

    keys: tuple[Any, ...]
    which: np.ndarray

    @classmethod
    def of(cls, each: Iterable[Any]) -> _Keys:
        """From the key that each reading asks for."""
        number: dict[Any, int] = {}
        which = np.array([number.setdefault(key, len(number)) for key in each])
        return cls(tuple(number), which)

    def found(self, table: Mapping[Any, float]) -> np.ndarray:
        """What each reading finds in the ``table``, (H,), 0 where it has nothing."""
        return np.array([table.get(key, 0.0) for key in self.keys])[self.which]


@cache
def _keys_of_readings() -> tuple[_Keys, _Keys, _Keys, dict[tuple[str, float], np.ndarray]]:
    """What readings ask the tables of tracks, spins and rudders for, and which of them have each unit, (H,)."""
    each = competitors()[0]
    tracks = _Keys.of((r.frame, r.heading, r.speed * r.clock) for r in each)
    spins = _Keys.of((r.heading, r.rate * FRAMES[r.frame].psi * FRAMES[r.frame].r * r.clock) for r in each)
    units = [set(r.units) for r in each]
    having = {unit: np.array([unit in own for own in units]) for unit in set().union(*units)}
    return tracks, spins, _Keys.of(r.turning for r in each), having


def scores(
    trial: Trial, turning: float | None, standing: Sequence[str] = (), labels: Mapping[str, str] | None = None
) -> Scores:
    """What ``trial`` says of each reading.

    turning: correlation of its turn rate with the rudder, None where it is not known; standing: columns that stand
    still and say nothing; labels: column -> unit in its header, without which they are those of a Trial.
    """
    tracks, spins, rudders, units = _keys_of_readings()
    strange = _unlikely_units(labels or {})
    track: dict[tuple[str, float, float], tuple[float, float]] = {}
    spin: dict[tuple[float, float], float] = {}
    blind = {"psi", "r"} & set(standing)
    lost = {"x", "y", "u", "v", "psi"} & set(standing)
    factors, rates = tuple({key[2] for key in tracks.keys}), tuple({key[1] for key in spins.keys})
    for unit in HEADINGS:
        s = signals(trial, unit)
        if s is None:
            continue
        if not blind:
            stats = s.stats(over_windows(s.psi), s.summed(s.r))
            spin |= zip(((unit, rate) for rate in rates), _spun(stats, rates), strict=True)
        if s.has_track and not lost:
            for name, frame in FRAMES.items():
                stats = s.stats(s.way(), s.summed(frame.guess(s)))
                track |= zip(((name, unit, factor) for factor in factors), _tracked(stats, factors), strict=True)
                if len(factors) > 1 and track["body", 1.0, 1.0][1] < RIGHT:
                    factors = (1.0,)
        if factors == (1.0,):  # these units are right; what another one makes of them explains nothing
            break
    nats = tracks.found({key: value[0] for key, value in track.items()}) + spins.found(spin)
    nats += rudders.found(_rudder(turning)) + STRANGE * sum(units[unit] for unit in strange if unit in units)
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
        out.append(Judged(chosen, before, after, hypotheses[folder], rival if h == folder else None))
    return out


def _tracked(stats: Stats, factors: Sequence[float]) -> list[tuple[float, float]]:
    """(nats, relative misfit) of predicted ways times each of the ``factors``, the heading's offset and the log's gain
    left free within what is usual."""
    both, predicted, by = complex(np.sum(stats.both)), float(np.sum(stats.predicted)), np.array(factors)
    if not predicted > 0 or not abs(both) > 0:
        return [(float(evidence(np.ones(PIECES))), 1.0)] * len(by)
    best = both / (predicted * by)
    angle = np.clip(np.angle(best), -MOST_OFF[0], MOST_OFF[0])
    gain = np.clip(np.log(np.abs(best)), -MOST_OFF[1], MOST_OFF[1])
    prior = 0.5 * (angle / OFF[0]) ** 2 + 0.5 * (gain / OFF[1]) ** 2
    nats = evidence(relative(stats, by * np.exp(gain + 1j * angle))) + prior
    plain = np.average(relative(stats, by), axis=-1, weights=stats.measured + 1e-30)
    return list(zip(nats.tolist(), np.sqrt(plain).tolist(), strict=True))


def _spun(stats: Stats, factors: Sequence[float]) -> list[float]:
    """Nats of integrated turn rates times each of the ``factors``, the gain of the gyro left free within what is
    usual."""
    both, predicted, by = float(np.real(np.sum(stats.both))), float(np.sum(stats.predicted)), np.array(factors)
    gain = both / (predicted * by) if predicted > 0 else np.ones(len(by))
    gain = np.clip(gain, 1 - 3 * GYRO, 1 + 3 * GYRO)
    nats: list[float] = (evidence(relative(stats, by * gain)) + 0.5 * ((gain - 1) / GYRO) ** 2).tolist()
    return nats


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
