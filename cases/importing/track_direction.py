"""What the logs of one run say of each other: exchanged axes, a lost hemisphere, wrong units and clocks that differ are
told by positions, course, heading and speed.

Velocities that are derived from such positions agree with them, so no later check can tell. Course over ground follows
heading: between both lies the drift angle, which makes the course late by a few per cent of the period in which the
ship swings, and never early. What lies beyond, or changes along the run, is a matter of clocks.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cases.importing.clocks import GPS_AHEAD
from cases.importing.import_map import ImportMap, OpenQuestion
from cases.importing.log_columns import Log
from cases.importing.vocabulary import factor, known_units
from cases.trial import unwrapped
from mmg.messages import Message

PAIRS = (("latitude", "longitude"), ("x", "y"))
# Displacements over these parts of a run are looked at: long ones stand out of noise, short ones follow turns.
SPANS = (100, 30, 12)  # set by hand
# Most that the mean cosine between displacement and direction lacks of one where a reading fits, and so many times this
# of the labels where they are refuted.
FITS, WORSE = 0.05, 8.0  # set by hand
# How positions may be meant, and which of both then needs a sign.
READINGS = {"": "", "exchanged": "", "with another sign of {a}": "a", "with another sign of {b}": "b",
            "with other signs of {a} and {b}": "ab"}  # fmt: skip


def check_direction(columns: Mapping[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap) -> None:
    """Raises OpenQuestion where positions go along course and heading only once they are read in another way. columns:
    quantities (N,) of the run at even times; logs: it came from; chosen: the map, which is believed where it names a
    column of positions."""
    unitless = {quantity for log in logs for quantity in log.unitless}
    directions = {name: columns[name] for name in ("cog", "psi") if name in columns and name not in unitless}
    derived = not {"u", "v"} <= set(columns)  # logged ones tell mmg check more
    for a, b in PAIRS if directions and derived else ():
        log = next((log for log in logs if {a, b} <= set(log.of)), None)
        if log is None or not {a, b} <= set(columns) or {a, b} & set(chosen.columns_of(log.table.path)):
            continue
        meant = _meant(columns[a], columns[b], directions, globe=a == "latitude")
        if not meant:
            continue
        labelled: dict[str, dict[str, Any]] = {q: {"from": log.of[q].header, "unit": log.of[q].unit} for q in (a, b)}
        signs = {a: "a" in READINGS[meant], b: "b" in READINGS[meant]}
        other = {name: {**column, "sign": -1} for name, column in labelled.items() if signs[name]} or {
            a: labelled[b],
            b: labelled[a],
        }
        way, first, second = meant.format(a=a, b=b), log.of[a].header, log.of[b].header
        ways = " and ".join({"cog": "course", "psi": "heading"}[name] for name in directions)
        words = f"the ship goes along her {ways} where '{first}' and '{second}' are read {way}; correct the file"
        choices = {way: {"columns": other}, f"as they are, with a wrong {ways}": {"columns": labelled}}
        raise OpenQuestion(log.table.path, words, choices)


def _meant(a: np.ndarray, b: np.ndarray, directions: Mapping[str, np.ndarray], globe: bool) -> str:
    """Which of READINGS lets positions ``a`` to the north and ``b`` to the east, (N,) each, go along the ``directions``
    [rad, (N,) each]; "" where they do as they are, and where nothing shows it. globe: whether they are degrees of
    latitude and longitude."""
    pairs = dict(zip(READINGS, ((a, b), (b, a), (-a, b), (a, -b), (-a, -b)), strict=True))
    best: tuple[float, str] = (FITS, "")
    for span in SPANS:
        along = {
            name: {meant: _along(*pair, direction, span, globe) for meant, pair in pairs.items()}
            for name, direction in directions.items()
        }
        for meant in list(pairs)[1:]:
            if any(fits[meant].real <= fits[""].real for fits in along.values()):  # course and heading must agree
                continue
            name, fits = next(iter(along.items()))  # of both, the course judges: it has no drift angle
            labels = 1 - (fits[""].real if name == "cog" else abs(fits[""]))  # a ship may go astern, or crabwise
            other = 1 - fits[meant].real
            if other < best[0] and labels > max(FITS, WORSE * other):
                best = (other, meant)
    return best[1]


def _along(a: np.ndarray, b: np.ndarray, direction: np.ndarray, span: int, globe: bool) -> complex:
    """Mean of exp(i (course made good - ``direction``)), (N,) [rad], over displacements of a ``span``-th of the run."""
    k = max(1, len(a) // span)
    north, east = a[k:] - a[:-k], (b[k:] - b[:-k]) * (np.cos(np.radians(a[k:])) if globe else 1.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.exp(1j * direction)))])
    displaced, ahead = north + 1j * east, total[k + 1 :] - total[1:-k]  # north + i east, as exp(i direction)
    good = np.isfinite(displaced) & np.isfinite(ahead)
    size = float(np.abs(displaced[good]) @ np.abs(ahead[good]))
    return complex(np.conj(ahead[good]) @ displaced[good]) / size if size > 0 else 0j  # long displacements weigh more


# Relative difference of a unit that fits, and least one of all others.
CLOSE, APART = 0.10, 0.25  # set by hand: knots and m/s, feet and metres differ by more
PARTS = 30  # Of a run, over which distances and turns are compared. Set by hand.
# Units that are read where they are written, but not looked for: other ones lie too near.
RARE = ("rad/min", "mrad/s", "ft/s", "cm/s", "mm/s")
TRUTH = {"r": "the heading changes", "psi": "the course changes"}


def by_evidence(quantity: str, values: np.ndarray, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> tuple[str, str]:
    """(unit, what shows it) of a ``quantity`` whose ``values`` (N,) have no unit; ("", "") where nothing shows it. t:
    (N,) even times [s]; columns: of the same run, with known units."""
    slope = times_as_much(quantity, values, t, columns)
    off = {unit: abs(np.log(slope / scale)) for unit, scale in known_units(quantity).items() if unit not in RARE}
    ranked = sorted(off, key=lambda unit: off[unit])
    if not ranked or not off[ranked[0]] < CLOSE or off[ranked[1]] < APART:
        return "", ""
    what = TRUTH.get(quantity, "the positions move")
    return ranked[0], f"{what} {slope / known_units(quantity)[ranked[0]]:.2f} times as fast"


def check_units(
    t: np.ndarray, columns: Mapping[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap
) -> list[Message]:
    """What is said where a speed, turn rate or heading does not fit the positions, the heading or the course. columns:
    (N,) at the even times ``t`` (N,) [s]; logs: they came from; chosen: the map, which is believed. Raises OpenQuestion
    where they would fit in other units than those that are written."""
    said = []
    for log, quantity in ((log, q) for log in logs for q in ("sog", "u", "r", "psi") if q in log.of and q in columns):
        given = chosen.columns_of(log.table.path)
        slope = times_as_much(quantity, columns[quantity], t, columns)
        if quantity in {*log.unitless, *given} or not abs(np.log(slope)) > APART:  # NaN: nothing shows it
            continue
        header, unit = log.of[quantity].header, log.of[quantity].unit
        places = next((one for one in logs if {"x", "latitude"} & set(one.of)), log)
        pair = next((pair for pair in PAIRS if set(pair) <= set(places.of)), ())
        readings: list[tuple[tuple[str, ...], Log, float]] = [((quantity,), log, slope)]
        if quantity in ("sog", "u") and pair and not set(pair) & set(given):
            readings.append((pair, places, 1 / slope))
        choices = {}
        for names, source, times in readings:
            now = factor(names[0], source.of[names[0]].unit) or 1.0
            for other, scale in known_units(names[0]).items():
                # A number in ddmm grows by one a minute, 1 / 60 deg; its factor is that of the parted value.
                if abs(np.log(times * now / (scale if other != "ddmm" else 1 / 60))) < APART:
                    change = {name: {"from": source.of[name].header, "unit": other} for name in names}
                    choices[f"{', '.join(names)} in {other}"] = {"columns": change}
        words = f"{TRUTH.get(quantity, 'the positions move')} {slope:.4g} times as fast as '{header}' [{unit}] says"
        if choices:
            choices[f"as it is, in {unit}"] = {"columns": {quantity: {"from": header, "unit": unit}}}
            raise OpenQuestion(log.table.path, f"{words}; one of the units is wrong", choices)
        said.append(Message(words, "scale_doubtful"))
    return said


def times_as_much(quantity: str, values: np.ndarray, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> float:
    """How many times as far the ship goes or turns over parts of a run, by positions, heading or course, as the
    ``values`` (N,) of the ``quantity`` "sog", "u", "r" or "psi" say; NaN where both have little in common. columns:
    (N,) at the even times ``t`` [s]."""
    if quantity == "r" and "psi" in columns:
        path, rate = unwrapped(columns["psi"]), values
    elif quantity == "psi" and "cog" in columns:
        path, rate = unwrapped(columns["cog"]), np.gradient(unwrapped(values), t)
    elif quantity in ("sog", "u") and {"x", "y"} <= set(columns):
        known = (columns[name] for name in ("cog", "psi") if np.isfinite(columns.get(name, np.nan)).mean() > 0.5)
        path, rate = columns["x"] + 1j * columns["y"], values * np.exp(1j * next(known, 0.0))
    else:
        return np.nan
    good = np.isfinite(path) & np.isfinite(rate)
    if good.sum() < PARTS:
        return np.nan
    time, path, rate = t[good], path[good], rate[good]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
    k = len(time) // PARTS
    # Sizes, so that a wrong sign or frame, which other checks tell, is no wrong unit.
    far, said = np.abs(path[k:] - path[:-k]), np.abs(total[k:] - total[:-k])
    both, size = float(far @ said), float(far @ far) * float(said @ said)
    # The slope of ``far`` on ``said`` through zero; 0.8 is the least squared correlation. Set by hand.
    return both / float(said @ said) if size > 0 and both**2 > 0.8 * size else np.nan


# Times by which the course of a ship may be late, and usually is, in periods of its swinging; it is never early.
LATE, USUAL = 0.10, 0.05  # set by hand
CHANGE = 0.10  # Most that this time changes along a run with the speed of the ship, in periods. Set by hand.
# Standard errors beyond which a difference, and a drift, is no chance.
SIGMAS, SIGMAS_DRIFT = 2.0, 4.0  # set by hand: 5 % and 1 in 16,000 of normal errors are larger
LEAST_SWING = 0.1  # rad; heading that swings less tells nothing of clocks. Set by hand.
STEPS = 4000  # Most steps of a record that is compared. Set by hand: it bounds time.


@dataclass(frozen=True)
class Late:
    """By how much one log is late against another: ``offset`` [s] at the begin of the run, ``drift`` [s per s] and its
    standard error, standard error of the mean offset [s], and the ``period`` [s] of the swinging."""

    offset: float
    middle_std: float
    drift: float
    drift_std: float
    period: float


def clock_problems(logs: Sequence[Log], chosen: ImportMap) -> list[str]:
    """A line for each pair of ``logs`` of a run whose clocks differ or drift, with what to add to the map ``chosen``.
    None for files of whose clock it says something."""
    problems = []
    for gyro, other in itertools.permutations(logs, 2):
        names = gyro.table.path.name, other.table.path.name
        keys = {key for log in (gyro, other) for key in chosen.of(log.table.path).model_fields_set}
        if keys & {"clock_offset", "clock_drift"} or names[0] == names[1]:
            continue
        if (late := _course_late(gyro, other)) is not None:
            problems.append(_problem(late, min(gyro.t[-1], other.t[-1]) - max(gyro.t[0], other.t[0]), *names))
    return list(filter(None, problems))


def _course_late(gyro: Log, other: Log) -> Late | None:
    """By how much the course in the log ``other`` is late against the heading in the log ``gyro``. None where one of
    them lacks it, its unit is not known, or the ship swings too little."""
    if "psi" not in gyro.columns or "psi" in gyro.unitless or "psi" in other.columns:
        return None
    from scipy.ndimage import gaussian_filter1d

    first, last = max(gyro.t[0], other.t[0]), min(gyro.t[-1], other.t[-1])
    h = max(gyro.dt, other.dt, (last - first) / STEPS)
    t = np.arange(first, last, h)
    good = np.isfinite(gyro.columns["psi"])
    if len(t) < 50 or good.sum() < 50:
        return None
    psi = np.interp(t, gyro.t[good], np.unwrap(gyro.columns["psi"][good]))
    rate = np.gradient(psi, h)
    swing = float(np.std(psi - np.polyval(np.polyfit(t - first, psi, 1), t - first)))  # a steady turn shows no time
    bend = float(np.sqrt(np.mean(np.gradient(gaussian_filter1d(rate, 5, mode="nearest"), h) ** 2)))
    if swing < LEAST_SWING or bend == 0.0:
        return None
    period = 2 * np.pi * float(np.std(rate)) / bend  # of a sine of this rate and acceleration
    course = _course(other, t, max(2.0, period / h / 30))
    if course is None or period < 5 * h:
        return None
    return _fitted(t, psi, course, period)


def _fitted(t: np.ndarray, psi: np.ndarray, course: np.ndarray, period: float) -> Late | None:
    """Offset and drift by least squares of course(t) - psi(t - offset - drift (t - t_0)) - constant, from the best of
    a row of offsets. Errors are taken for independent every quarter of a period."""
    lags, duration, since = np.linspace(-0.5 * period, 0.5 * period, 81), float(t[-1] - t[0]), t - t[0]

    def compared(late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        good = np.isfinite(course) & (t - late >= t[0]) & (t - late <= t[-1])
        return good, (course - np.interp(t - late, t, psi))[good]

    both = [compared(np.full(len(t), lag)) for lag in lags]
    cost = [np.var(error) if good.sum() > 0.5 * len(t) else np.inf for good, error in both]
    best = int(np.argmin(cost))
    if not np.isfinite(cost[best]) or best in (0, len(lags) - 1):  # a least value at the edge is none
        return None
    offset, drift, rate = float(lags[best]), 0.0, np.gradient(psi, t)
    for _ in range(8):  # steps of Gauss and Newton; set by hand
        late = offset + drift * since
        good, error = compared(late)
        slope = -np.interp(t - late, t, rate)
        A = np.column_stack([np.ones(len(t)), slope, slope * since])[good]
        step, *_ = np.linalg.lstsq(A, error, rcond=None)
        offset, drift = offset + float(step[1]), drift + float(step[2])
        if good.sum() < 0.5 * len(t) or abs(offset) > period or abs(drift) > 0.5:
            return None
    residuals = error - A @ step
    scale = float(residuals @ residuals) / max(4 * duration / period - 3, 1.0)  # independent errors less 3 unknowns
    covariance = scale * np.linalg.pinv(A.T @ A)
    mean = np.array([0.0, 1.0, 0.5 * duration])  # the offset at half the time
    middle_std = float(np.sqrt(max(mean @ covariance @ mean, 0.0)))
    return Late(offset, max(middle_std, 0.005 * period), drift, float(np.sqrt(max(covariance[2, 2], 0.0))), period)


def _course(log: Log, t: np.ndarray, width: float) -> np.ndarray | None:
    """The course over ground in ``log`` at the times ``t`` (N,), unwrapped; None where there is none. width: of the
    smoothing of positions, in steps."""
    from scipy.ndimage import gaussian_filter1d

    known = {name: values for name, values in log.columns.items() if name not in log.unitless}
    if "cog" in known:
        good = np.isfinite(known["cog"])
        return np.interp(t, log.t[good], np.unwrap(known["cog"][good])) if good.sum() > 20 else None
    a, b = next((pair for pair in PAIRS if set(pair) <= set(known)), ("", ""))
    good = np.isfinite(known[a]) & np.isfinite(known[b]) if a else np.zeros(0, bool)
    if good.sum() < 20:
        return None
    narrower = np.cos(np.radians(np.median(known[a][good]))) if a == "latitude" else 1.0  # degrees of longitude
    place = np.interp(t, log.t[good], known[a][good] + 1j * known[b][good] * narrower)
    velocity = np.gradient(gaussian_filter1d(place, width, mode="nearest"))  # only its angle counts, not its unit
    return np.unwrap(np.angle(velocity))


def _problem(late: Late, duration: float, gyro: str, other: str) -> str:
    """The line on clocks that differ or drift, "" where they do not."""
    grown = late.drift * duration
    drifts = abs(grown) > max(CHANGE * late.period, SIGMAS_DRIFT * late.drift_std * duration)
    middle = late.offset + 0.5 * grown
    begin, margin = late.offset if drifts else middle, SIGMAS * late.middle_std
    differs = begin < -margin or begin > LATE * late.period + margin
    lines = {"clock_drift": late.drift} if drifts else {}
    lines |= {"clock_offset": begin - USUAL * late.period} if differs else {}
    if not lines:
        return ""
    if drifts:
        words = f"drift apart by {abs(grown):.2g} s in {duration:.0f} s, as heading and course show: that of {gyro} is "
        words += "slow" if grown > 0 else "fast"
    else:
        words = f"differ: the course changes {abs(middle):.2g} s {'before' if middle < 0 else 'after'}"
        gps = abs(abs(middle) - GPS_AHEAD) < max(0.5, 0.1 * late.period)
        words += f"{' (GPS time is 18 s ahead of UTC)' if gps else ''} the heading, which no ship does"
    line = ", ".join(f"{key} = {value:.2g}" for key, value in lines.items()) + " (or clock_offset = 0.0 to keep them)"
    return f'{gyro} and {other}: their clocks {words}; add to the map: [files."{gyro}"] {line}'
