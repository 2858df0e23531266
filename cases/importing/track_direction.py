"""Which way the positions go and how fast, against course, heading and speed: exchanged axes, a lost hemisphere and
wrong units are told by it.

Velocities that are derived from such positions agree with them, so no later check can tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cases.importing.import_map import ImportMap, OpenQuestion
from cases.importing.log_columns import Log
from cases.importing.vocabulary import factor, known_units
from cases.trial import unwrapped
from mmg.messages import Message

PAIRS = (("latitude", "longitude"), ("x", "y"))
SPANS = (100, 30, 12)
"""Displacements over these parts of a run are looked at: long ones stand out of noise, short ones follow turns."""
FITS, WORSE = 0.05, 8.0
"""Most that the mean cosine between displacement and direction lacks of one where a reading fits, and so many times
this of the labels where they are refuted."""
READINGS = {"": "", "exchanged": "", "with another sign of {a}": "a", "with another sign of {b}": "b",
            "with other signs of {a} and {b}": "ab"}  # fmt: skip
"""How positions may be meant, and which of both then needs a sign."""


def check_direction(columns: Mapping[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap) -> None:
    """Raises OpenQuestion where positions go along course and heading only once they are read in another way.

    columns: quantities (N,) of the run at even times; logs: it came from; chosen: the map, which is believed where it
    names a column of positions.
    """
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
        own: dict[str, dict[str, Any]] = {
            name: {"from": log.of[name].header, "unit": log.of[name].unit} for name in (a, b)
        }
        signs = {a: "a" in READINGS[meant], b: "b" in READINGS[meant]}
        other = {name: {**column, "sign": -1} for name, column in own.items() if signs[name]} or {a: own[b], b: own[a]}
        way, first, second = meant.format(a=a, b=b), log.of[a].header, log.of[b].header
        ways = " and ".join({"cog": "course", "psi": "heading"}[name] for name in directions)
        raise OpenQuestion(
            log.table.path,
            f"the ship goes along her {ways} where '{first}' and '{second}' are read {way}; correct the file",
            {way: {"columns": other}, f"as they are, with a wrong {ways}": {"columns": own}},
        )


def _meant(a: np.ndarray, b: np.ndarray, directions: Mapping[str, np.ndarray], globe: bool) -> str:
    """Which of READINGS lets positions ``a`` to the north and ``b`` to the east, (N,) each, go along the
    ``directions`` [rad, (N,) each]; "" where they do as they are, and where nothing shows it.

    globe: whether they are degrees of latitude and longitude.
    """
    pairs = dict(zip(READINGS, ((a, b), (b, a), (-a, b), (a, -b), (-a, -b)), strict=True))
    found: tuple[float, str] = (FITS, "")
    for span in SPANS:
        along = {
            name: {meant: _along(*pair, direction, span, globe) for meant, pair in pairs.items()}
            for name, direction in directions.items()
        }
        for meant in list(pairs)[1:]:
            if any(fits[meant].real <= fits[""].real for fits in along.values()):
                continue
            name, fits = next(iter(along.items()))
            labels = 1 - (fits[""].real if name == "cog" else abs(fits[""]))  # a ship may go astern, or crabwise
            other = 1 - fits[meant].real
            if other < found[0] and labels > max(FITS, WORSE * other):
                found = (other, meant)
    return found[1]


def _along(a: np.ndarray, b: np.ndarray, direction: np.ndarray, span: int, globe: bool) -> complex:
    """Mean of exp(i (course made good - ``direction``)), (N,) [rad], over displacements of a ``span``-th of the run."""
    k = max(1, len(a) // span)
    north, east = a[k:] - a[:-k], (b[k:] - b[:-k]) * (np.cos(np.radians(a[k:])) if globe else 1.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.exp(1j * direction)))])
    moved, ahead = north + 1j * east, total[k + 1 :] - total[1:-k]
    good = np.isfinite(moved) & np.isfinite(ahead)
    size = float(np.abs(moved[good]) @ np.abs(ahead[good]))
    return complex(np.conj(ahead[good]) @ moved[good]) / size if size > 0 else 0j


CLOSE, APART = 0.10, 0.25
"""Relative difference of a unit that fits, and least one of all others."""
PARTS = 30
"""Of a run, over which distances and turns are compared."""
RARE = ("rad/min", "mrad/s", "ft/s", "cm/s", "mm/s")
"""Units that are read where they are written, but not looked for: other ones lie too near."""
TRUTH = {"r": "the heading changes", "psi": "the course changes"}


def by_evidence(quantity: str, values: np.ndarray, t: np.ndarray, columns: Mapping[str, np.ndarray]) -> tuple[str, str]:
    """(unit, what shows it) of a ``quantity`` whose ``values`` (N,) have no unit; ("", "") where nothing shows it.

    t: (N,) even times [s]; columns: of the same run, with known units.
    """
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
    """What is said where a speed, turn rate or heading does not fit the positions, the heading or the course. Raises
    OpenQuestion where it would in other units than those that are written."""
    said = []
    for log, quantity in ((log, q) for log in logs for q in ("sog", "u", "r", "psi") if q in log.of and q in columns):
        given = chosen.columns_of(log.table.path)
        slope = times_as_much(quantity, columns[quantity], t, columns)
        if quantity in {*log.unitless, *given} or not abs(np.log(slope)) > APART:
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
    """How many times as far the ship goes or turns over parts of a run, by positions, heading or course, as a speed,
    turn rate or heading ``values`` (N,) of it says; NaN where both have little in common.

    columns: (N,) at the even times ``t`` [s].
    """
    if quantity == "r" and "psi" in columns:
        moved, rate = unwrapped(columns["psi"]), values
    elif quantity == "psi" and "cog" in columns:
        moved, rate = unwrapped(columns["cog"]), np.gradient(unwrapped(values), t)
    elif quantity in ("sog", "u") and {"x", "y"} <= set(columns):
        way = next(
            (columns[name] for name in ("cog", "psi") if np.isfinite(columns.get(name, np.nan)).mean() > 0.5), 0.0
        )
        moved, rate = columns["x"] + 1j * columns["y"], values * np.exp(1j * way)
    else:
        return np.nan
    good = np.isfinite(moved) & np.isfinite(rate)
    if good.sum() < PARTS:
        return np.nan
    time, moved, rate = t[good], moved[good], rate[good]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))])
    k = len(time) // PARTS
    far, said = np.abs(moved[k:] - moved[:-k]), np.abs(total[k:] - total[:-k])
    both, size = float(far @ said), float(far @ far) * float(said @ said)
    return both / float(said @ said) if size > 0 and both**2 > 0.8 * size else np.nan
