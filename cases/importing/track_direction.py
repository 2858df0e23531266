"""Which way the positions go, and how fast, against course, heading and speed over ground: exchanged axes, a lost
hemisphere and a wrong unit are told by it.

Velocities that are derived from such positions agree with them, so no later check can tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.log_columns import Log
from cases.importing.vocabulary import factor, known_units
from cases.inputs import integral
from mmg.messages import Message

PAIRS = (("latitude", "longitude"), ("x", "y"))
SPANS = (100, 30, 12)
"""Displacements over these parts of a run are looked at: long ones stand out of noise, short ones follow turns."""
FITS, WORSE = 0.05, 8.0
"""Most that the mean cosine between displacement and direction lacks of one where a reading fits, and so many times
this of the labels where they are refuted."""
UNIT, NOTED, SIGMAS = 0.2, 0.005, 4.0
"""Logarithm of a ratio of speeds from which a unit is wrong, share of an error of scale that is noted, and standard
errors that it must exceed."""
READINGS = {"": "", "exchanged": "", "with another sign of {a}": "a", "with another sign of {b}": "b",
            "with other signs of {a} and {b}": "ab"}  # fmt: skip
"""How positions may be meant, and which of both then needs a sign."""


def positions_problem(columns: Mapping[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap, where: str) -> str:
    """A line where positions go along course and heading only once they are read in another way, else "".

    columns: quantities (N,) of the run at even times; logs: it came from; chosen: the map, which is believed where it
    names a column of positions; where: the run, for the line.
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
        first, second = log.of[a].header, log.of[b].header
        line = " and ".join(
            f'{name} = {{ from = "{log.of[name].header}", sign = -1 }}'
            for name, short in ((a, "a"), (b, "b"))
            if short in READINGS[meant]
        )
        ways = " and ".join({"cog": "course", "psi": "heading"}[name] for name in directions)
        return (
            f"{where}: the ship goes along her {ways} where '{first}' and '{second}' are read "
            f"{meant.format(a=a, b=b)}; correct the file, or say in the map: [columns] "
            + (line or f'{a} = "{second}" and {b} = "{first}"')
            + f' (or {a} = "{first}" where they are right, and the {ways} not)'
        )
    return ""


def speed_problem(
    t: np.ndarray, columns: Mapping[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap, where: str
) -> tuple[str, list[Message]]:
    """A line where positions move at another speed than that over ground, by a factor beyond UNIT, else ""; and a
    notice on a scale error.

    t: (N,) even times [s]; columns: quantities (N,) in SI; logs: they came from; chosen: the map, whose columns
    are believed; where: the run, for the line.
    """
    if not {"x", "y", "sog"} <= set(columns):
        return "", []
    place, way = columns["x"] + 1j * columns["y"], integral(t, np.nan_to_num(columns["sog"]))
    k = max(1, len(place) // SPANS[0])
    moved, made = np.abs(place[k:] - place[:-k]), np.where(np.isfinite(columns["sog"][k:]), way[k:] - way[:-k], np.nan)
    good = np.isfinite(moved) & np.isfinite(made) & (made > 0.3 * np.nanmax(made, initial=0.0))
    if good.sum() < 10:
        return "", []
    ratios = moved[good] / made[good]
    ratio = float(np.median(ratios))
    pieces = [float(np.median(some)) for some in np.array_split(ratios, 10)]
    error = float(np.std(pieces, ddof=1)) / math.sqrt(len(pieces))
    if abs(math.log(max(ratio, 1e-9))) < UNIT:
        if abs(ratio - 1.0) < max(NOTED, SIGMAS * error):
            return "", []
        words = f"positions move {ratio:.3f} times as fast as the speed over ground says (standard error {error:.1g})"
        return "", [Message(f"{words}: a unit, or a grid whose scale is not one", "scale")]
    lines = {}
    for quantity, names, true in (("x", ("x", "y"), 1 / ratio), ("sog", ("sog",), ratio)):
        log = next((log for log in logs if set(names) <= set(log.of)), None)
        if log is None or quantity in chosen.columns_of(log.table.path):
            continue
        known, own = known_units(quantity), factor(quantity, log.of[quantity].unit or "") or 1.0
        off = {unit: abs(math.log(scale / (own * true))) for unit, scale in known.items()}
        unit = min(off, key=lambda unit: off[unit])
        if off[unit] < UNIT:
            parts = (f'{name} = {{ from = "{log.of[name].header}", unit = "{unit}" }}' for name in names)
            lines[quantity] = " and ".join(parts)
    words = f"{where}: the speed of the positions is {ratio:.3g} times the speed over ground: a wrong unit"
    return words + (f"; say it in the map: [columns] {', or '.join(lines.values())}" if lines else ""), []


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
