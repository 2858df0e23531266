"""One run out of its logs: a common clock, a local frame, units found, motion derived, conventions of the product."""

from __future__ import annotations

import datetime
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cases.importing.derived_motion import derived_velocities, resolution_of, widened
from cases.importing.import_map import ImportMap, OpenQuestion
from cases.importing.log_columns import Log
from cases.importing.raw_table import NOT_READ
from cases.importing.track_direction import by_evidence, check_direction, check_units, clock_problems
from cases.importing.vocabulary import BEYOND_A_TURN, factor
from cases.io.conventions import converted, through_north
from cases.io.read import lacking
from cases.io.sidecar import ReferencePoint, SidecarEntry
from cases.quantities import ORDERS, is_canonical, wraps
from cases.quantities import quantity as known
from cases.trial import MOST_ROWS
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, TooFewData, needed
from mmg.messages import Message
from mmg.motion.flow import RUDDERS

STATES = ("psi", "latitude", "x", "sog", "u", "r")  # Channels whose finest step is that of the run
DEGREE = 60 * 1852.0  # Metres in a degree of latitude: the nautical mile is a minute of it
CONVENTIONS = {"rudder_positive", "wind_direction", "velocity_frame"}  # Keys of the map that a sidecar has as well
REFERENCE_POINT = (  # What the map says of the antenna.
    'reference_point = { x = 12.0, y = 0.0, applies_to = "both" } (of the antenna from midship, in m forward and to '
    'starboard), or reference_point = "unknown"'
)
GAP = 2.5  # Gaps of a column beyond so many of its steps stay gaps. Set by hand.
LEAST_ROWS = 20  # Least rows of a run, and numbers of a column. Set by hand.
LARGE = 1e5  # m; positions beyond count from the first: a UTM northing is larger, a trial's area not. Set by hand.


@dataclass(frozen=True)
class ImportedRun:
    """A run as it is written: canonical ``columns`` (N,) in SI and radians with "t" from zero, standard errors ``std``
    of those that were derived, the logs it came from without their rows, its ``day`` (or ""), what was done, and the
    ``ancestors`` of columns that were not measured."""

    name: str
    columns: dict[str, np.ndarray]
    std: dict[str, float]
    logs: tuple[Log, ...]
    day: str
    notices: tuple[Message, ...]
    ancestors: dict[str, tuple[str, ...]] = field(default_factory=dict)


def assembled(name: str, logs: Sequence[Log], chosen: ImportMap, origin: tuple[float, float] | None) -> ImportedRun:
    """The run called ``name`` of these ``logs``, by the map ``chosen``. origin: latitude and longitude [deg] of the
    local frame, or None without any. Raises UserError where logs do not overlap, a unit stays unknown, or heading,
    motion, revolutions or rudder are missing: all that is wrong, at once."""
    logs = [with_units_of_size(log) for log in logs]
    where = " + ".join(log.name for log in logs)
    notices = [m for log in logs for m in log.notices]
    t, columns, steps, resolutions = _on_one_clock(logs, chosen, where, notices)
    # Exchanged axes and clocks that differ are asked for before velocities are derived: these would agree with them.
    check_direction(columns, logs, chosen)
    if problems := clock_problems(logs, chosen):
        raise BadValue("; ".join(problems))
    receiver = not {"latitude", "sog"}.isdisjoint(columns)  # asked before ``_place`` makes x and y of them
    _place(columns, logs, origin, where, notices)
    # Units are found by other columns, so positions must be metres by now.
    for log, quantity in [(one, q) for one in logs for q in one.unitless if q in columns]:
        others = {name: values for name, values in columns.items() if name not in log.unitless}
        unit, why = by_evidence(quantity, columns[quantity], t, others)
        if not unit:
            problems.append(str(log.unit_question(quantity)))
            continue
        columns[quantity] = columns[quantity] * (factor(quantity, unit) or 1.0)
        notices.append(Message(f"{quantity} from '{log.of[quantity].header}' is in {unit}: {why}", "unit_found"))
    if problems:
        raise Missing("; ".join(problems))
    point = chosen.reference_point if isinstance(chosen.reference_point, ReferencePoint) else None
    std: dict[str, float] = {}
    ancestors: dict[str, tuple[str, ...]] = {}
    if "psi" in columns:  # mended first: what is turned by it or derived from it would hold its faults
        columns["psi"], crossings = through_north(t, columns["psi"], columns.get("r"))
        if crossings:
            words = f"heading was interpolated straight through 360 at {crossings} crossings of north; mended"
            notices.append(Message(words, "heading_mended"))
        if "true_wind_angle" in columns and "wind_direction" not in columns:
            columns["wind_direction"] = columns["psi"] + columns["true_wind_angle"]
            ancestors["wind_direction"] = ("psi", "true_wind_angle")
            notices.append(Message("wind_direction is heading and angle of the true wind from the bow", "wind_angle"))
        derived = derived_velocities(t, columns, steps, resolutions, (point.x, point.y) if point else None)
        std, ancestors = derived.std, ancestors | derived.ancestors
        columns |= derived.columns
        notices += derived.said
    _require(where, columns, logs)
    notices += check_units(t, columns, logs, chosen)
    _ask_for_astern(columns, logs, chosen)
    computed = {"u", "v"} & set(ancestors)
    if point is None and (receiver or computed):
        std, words = widened(std, columns, computed, chosen.length)
        line = "" if chosen.reference_point else f"; say it in the map: {REFERENCE_POINT}"
        text = f"positions and speeds are not known to be those of midship: {words}{line}"
        notices.append(Message(text, "reference_point_unknown"))
    if "inputs" not in chosen.model_fields_set:
        words = 'actuators are taken as sensors measured them at each sample; of orders say inputs = "held" in the map'
        notices.append(Message(words, "inputs"))
    columns = {q: v for q, v in columns.items() if is_canonical(q)}
    canonical = converted({"t": t, **columns}, _conventions(chosen, point, computed), notices)
    for q in filter(wraps, canonical):  # winds in [0, 2 pi), headings and pods in (-pi, pi]
        canonical[q] = np.remainder(canonical[q], 2 * np.pi) if "wind" in q else np.angle(np.exp(1j * canonical[q]))
    first = logs[0].t[0] if logs[0].absolute else None
    day = datetime.datetime.fromtimestamp(first, datetime.timezone.utc).date().isoformat() if first is not None else ""
    sources = tuple(replace(log, t=log.t[:0].copy(), columns={}) for log in logs)  # copied: a view would hold all rows
    return ImportedRun(name, canonical, std, sources, day, tuple(dict.fromkeys(notices)), ancestors)


def _conventions(chosen: ImportMap, point: ReferencePoint | None, computed: Collection[str]) -> SidecarEntry:
    """What the map says of frames and signs; velocities that were ``computed`` are in body axes and at midship."""
    settings = chosen.model_dump(include=CONVENTIONS) | ({"velocity_frame": "body"} if computed else {})
    if point is not None and computed:  # ``derived_velocities`` has moved these to midship already
        of_position = point.applies_to in ("position", "both")
        point = point.model_copy(update={"applies_to": "position"}) if of_position else None
    return SidecarEntry(**settings, reference_point=point or ReferencePoint())


def _on_one_clock(
    logs: Sequence[Log], chosen: ImportMap, where: str, notices: list[Message]
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, float], dict[str, float]]:
    """Even times from zero [s], the columns of all logs at them, for as long as all of them run, the steps [s] at which
    the logs hold these, and to which the states were rounded."""
    first, last = max(log.t[0] for log in logs), min(log.t[-1] for log in logs)
    if last <= first:
        raise Conflict(f"{where}: their clocks do not overlap; give clock_offset of one of them in the map")
    states = [s for log in logs for name in STATES if name in log.columns and np.isfinite(s := log.step(name))]
    step = chosen.step or min(states or [log.dt for log in logs])
    if 0 < abs(round(step, 4) - step) < 1e-6:  # the last digits of a clock since 1970 are none
        step = round(step, 4) or step
    if last - first > MOST_ROWS * step:
        words = f"the clock runs over {last - first:.4g} s, in steps of {step:.4g} s more than {MOST_ROWS} rows"
        advice = "see whether it jumps, divide the log, or give a longer step in the map"
        raise OutOfRange(f"{where}: {words}; {advice}")
    t = np.arange(0.0, last - first + 1e-6 * step, step)  # with the last row, in spite of rounding
    columns: dict[str, np.ndarray] = {}
    taken: dict[str, Log] = {}
    for log in sorted(logs, key=lambda log: log.dt):  # of two that hold a quantity, the one sampled faster
        for quantity, values in log.columns.items():
            if quantity in taken:
                words = f"{quantity} is taken from {taken[quantity].name}, not from {log.name}, which is sampled slower"
                notices.append(Message(words, "doubled"))
                continue
            columns[quantity], taken[quantity] = _at(first + t, log, quantity, values), log
    if len(t) < LEAST_ROWS:
        raise TooFewData(f"{where}: only {len(t)} rows that all logs hold; at least {LEAST_ROWS} are needed")
    for quantity in [q for q, values in columns.items() if np.isfinite(values).sum() < LEAST_ROWS]:
        del columns[quantity]
        notices.append(Message(f"{quantity} holds fewer than {LEAST_ROWS} numbers and is left out", "column_empty"))
    if len(logs) > 1:
        words = f"joined on time: {last - first:.6g} s that all hold, every {step:g} s"
        notices.append(Message(f"{', '.join(log.table.path.name for log in logs)} {words}", "joined"))
    steps = {quantity: log.step(quantity) for quantity, log in taken.items()}
    grain = {q: resolution_of(taken[q].columns[q]) for q in ("y", "longitude", "cog", *STATES) if q in taken}
    if {"latitude", "longitude"} <= set(columns):
        steps["x"] = steps["latitude"]
        narrower = float(np.cos(np.radians(np.nanmedian(columns["latitude"]))))
        grain["x"], grain["y"] = DEGREE * grain["latitude"], DEGREE * narrower * grain["longitude"]  # m
    return t, columns, steps, grain


def _at(times: np.ndarray, log: Log, quantity: str, values: np.ndarray) -> np.ndarray:
    """A column at other ``times``: along a line between neighbours, an order as it stands."""
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(times), np.nan)
    t, y = log.t[good], values[good]
    if period := known(quantity).period:
        y = np.unwrap(y, period=period)
    if quantity in ORDERS:  # often logged where they change
        return np.where(times < t[0], np.nan, y[np.searchsorted(t, times + 1e-6, side="right") - 1])
    for end in (t[0], t[-1]):  # sums of steps miss the ends by their last digits
        times = np.where(np.abs(times - end) < 1e-6, end, times)
    out = np.interp(times, t, y, left=np.nan, right=np.nan)
    at = np.clip(np.searchsorted(t, times), 1, len(t) - 1)
    wide = (t[at] - t[at - 1]) > GAP * log.step(quantity)
    exact = (np.abs(times - t[at]) < 1e-6) | (np.abs(times - t[at - 1]) < 1e-6)  # samples at the edges of a gap hold
    out[wide & ~exact] = np.nan
    return out


def _place(
    columns: dict[str, np.ndarray], logs: Sequence[Log], origin: tuple[float, float] | None, where: str,
    notices: list[Message],
) -> None:  # fmt: skip
    """x and y of the local frame in place of latitude and longitude, or of eastings and northings."""
    zone = next((log.zone for log in logs if log.zone), "")
    if not {"latitude", "longitude"} <= set(columns):
        if not {"x", "y"} <= set(columns):
            return
        if not zone:
            return _count_from_start(columns, where, notices)
        columns["latitude"], columns["longitude"] = globe_positions(columns["x"], columns["y"], zone, where)
    assert origin is not None  # a log with positions on the globe has given one
    place = columns.pop("latitude"), columns.pop("longitude")
    columns["x"], columns["y"], turn = local_positions(*place, origin, where)
    for name in [name for name in columns if known(name).compass]:  # directions from true north to those of the frame
        columns[name] = columns[name] - turn
    words = f"positions in metres north and east of {origin[0]:.6f}, {origin[1]:.6f} deg"
    most = float(np.degrees(np.abs(turn).max(initial=0.0)))
    words += f"; directions from the north of that place, up to {most:.2g} deg off their own" if most > 0.01 else ""
    notices.append(Message(words, "local_frame"))


def _count_from_start(columns: dict[str, np.ndarray], where: str, notices: list[Message]) -> None:
    """Eastings and northings that are LARGE, from the first position on."""
    for name in ("x", "y"):
        finite = columns[name][np.isfinite(columns[name])]
        if len(finite) and np.ptp(finite) > LARGE:
            words = f"positions jump by over {LARGE / 1000:.0f} km; do they lie in two UTM zones? Divide the file"
            raise OutOfRange(f"{where}: {words}")
        if np.abs(finite).max(initial=0.0) > LARGE:
            start = round(float(finite[0]), -2)  # to 100 m: a number that a person recognises
            columns[name] = columns[name] - start
            notices.append(Message(f"{name} is counted from {start:.0f} m; grid north is taken for north", "offset"))


def _require(where: str, columns: dict[str, np.ndarray], logs: Sequence[Log]) -> None:
    """Raises UserError that says everything that is missing, and what became of the columns that are not used."""
    missing = lacking({"t", *columns})
    if not missing:
        return
    more = {"u": "u (or positions, or speed and course over ground)", "v": "v (likewise)", "r": "r (or heading)"}
    unsure = {header: what for log in logs for header, what in log.unsure.items()}
    unused = [str(a) for log in logs for a in log.accounts if not a.used_as and a.why != NOT_READ]
    header = next((h for h, what in unsure.items() if missing[0] in re.split(r"\W+", what)), "HEADER")
    line = f'say it in a map: [columns] {missing[0]} = "{header}"'
    lacks = f"{where}: missing {', '.join(more.get(m, m) for m in missing)}"
    raise Missing("; ".join([lacks, *unused[:12], line]))  # 12: display


STOPPED = 0.05  # Share of her speed below which a ship is not slowed down by her rudder alone. Set by hand.
SIDEWAYS = 0.05  # Share of the rows of a ship at speed in which she may go more sideways than ahead. Set by hand.


def _ask_for_astern(columns: dict[str, np.ndarray], logs: Sequence[Log], chosen: ImportMap) -> None:
    """Raises OpenQuestion where the ship stops or goes astern on revolutions that are never negative. Blades that turn
    and pods that turn round may do so; where she goes sideways or backwards from the beginning, heading or frame are
    wrong."""
    name = next((q for q in ("n", "n_azimuth") if q in columns), "")
    log = next((log for log in logs if name in log.of and name in log.columns), None)
    if log is None or name in chosen.columns_of(log.table.path) or "pitch" in columns:
        return
    complete = np.all([np.isfinite(columns[q]) for q in ("u", "v", name)], axis=0)
    u, v, n, psi = (columns[q][complete] for q in ("u", "v", name, "psi"))
    reversed_pods = any((np.cos(columns[q]) < 0).any() for q in ("azimuth", "azimuth_2") if q in columns)
    if not len(u) or n.min() < 0 or not n.any() or reversed_pods:
        return
    speed, first = np.hypot(u, v), int(np.argmax(u))  # from her fastest row on
    fast = speed > 0.5 * speed.max()
    if u[first] < 0.5 * speed.max() or np.mean(np.abs(v) > np.abs(u), where=fast) > SIDEWAYS:
        return
    # once she has turned by a right angle, a current on her beam may be on her bow
    is_straight = np.abs(np.unwrap(psi[first:]) - psi[first]) < 0.5 * np.pi
    # stopped under power, not by drifting
    if ((u[first:] < STOPPED * u[first]) & (n[first:] > 0.5 * n[first]) & is_straight).any():
        header = log.of[name].header
        words = f"the ship stops or goes astern on '{header}', which is never negative; has it lost the sign? Write it"
        right = {"columns": {name: {"from": header, "unit": log.of[name].unit}}}
        raise OpenQuestion(log.table.path, f"{words}, or a column with it", {"they are right": right})


def with_units_of_size(log: Log) -> Log:
    """The ``log`` with units that the size of its numbers shows: angles beyond a turn are degrees."""
    for q in log.unitless:
        si_unit, sizes = known(q).unit, np.abs(log.columns[q])
        largest, least = float(np.nanmax(sizes, initial=0.0)), float(np.nanmin(sizes, initial=np.inf))
        tests = (
            (wraps(q) and BEYOND_A_TURN < largest <= 361, "deg", "more than a turn in radians"),
            (q == "pitch" and 1.75 < largest <= 110, "deg", "more than 100 deg if in radians"),
            # 5: a rudder comes near amidships, where volts and per cent may have another number. Set by hand.
            (q in RUDDERS and least < 5 and 1.75 < largest <= 110, "deg", "more than 100 deg if in radians"),
            (si_unit == "m" and largest > 2e4, "m", "of the size of eastings and northings"),
            (si_unit == "rps" and 60 < largest < 5000, "rpm", "and no shaft turns as often in a second"),
        )
        for fits, unit, why in tests:
            if fits:
                log = log.with_unit(q, unit, f"up to {largest:g}, {why}")
                break
    return log


NORTHERNMOST = 89.9  # deg; nearer to a pole, meridians converge along the track of a ship. Set by hand.
FURTHEST = 200e3  # m from the origin; beyond, north and east of the frame are not those of the ship. Set by hand.


def local_positions(
    latitude: np.ndarray, longitude: np.ndarray, origin: tuple[float, float], where: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x north and y east [m] of positions (N,) [deg] in the transverse Mercator projection about ``origin`` (latitude,
    longitude) on the WGS 84 ellipsoid, and the convergence of meridians [rad]: the north of the frame lies so far to
    the right of that of the place.

    where: for messages. Raises UserError where pyproj is missing, for positions further than FURTHEST away and beyond
    NORTHERNMOST.
    """
    if np.nanmax(np.abs(latitude), initial=0.0) > NORTHERNMOST:
        words = "positions at a pole, where no direction is north; give x and y in a frame of their own"
        raise OutOfRange(f"{where}: {words}")
    lat, lon = origin
    frame = _projection(where, proj="tmerc", lat_0=lat, lon_0=lon, k=1.0)
    fixes = np.isfinite(latitude) & np.isfinite(longitude)
    east, north = frame(np.where(fixes, longitude, lon), np.where(fixes, latitude, lat))  # pyproj takes no NaN
    x, y = (np.where(fixes & np.isfinite(v), v, np.nan) for v in (north, east))
    if (furthest := np.nanmax(np.hypot(x, y), initial=0.0)) > FURTHEST:
        words = f"positions lie {furthest / 1000:.0f} km from the origin; import these runs by themselves"
        raise OutOfRange(f"{where}: {words}")
    good = np.flatnonzero(fixes)
    turn = np.radians(frame.get_factors(longitude[good], latitude[good]).meridian_convergence)
    return x, y, np.interp(np.arange(len(x)), good, turn) if len(good) else np.zeros(len(x))


BAND_S = (32.0, 40.0)  # Latitudes of the UTM band S [deg], which lies in the north (Snyder 1987, USGS PP 1395, p. 62)


def globe_positions(northing: np.ndarray, easting: np.ndarray, zone: str, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude [deg] of UTM ``northing`` and ``easting`` (N,) [m] in a ``zone`` such as "32N", with the
    hemisphere or the band. where: for messages. Raises UserError for a zone that is none, for an "S" that may be both,
    and where pyproj is missing."""
    match = re.fullmatch(r"\s*(\d{1,2})\s*([C-HJ-NP-X]?)\s*", zone.upper())
    if match is None or not 1 <= int(match[1]) <= 60:
        raise BadValue(f"{where}: '{zone}' is no UTM zone; write it as 32N")
    number, letter = int(match[1]), match[2]
    if not letter:  # the convergence of meridians has another sign on the other side of the equator
        raise BadValue(
            f"{where}: zone '{zone}' does not say which hemisphere; write {number}N, or its band in the south"
        )
    frame = _projection(where, proj="utm", zone=number, south=letter < "N" or letter == "S")
    longitude, latitude = (np.asarray(x) for x in frame(easting, northing, inverse=True))
    if letter == "S":
        north = np.asarray(_projection(where, proj="utm", zone=number)(easting, northing, inverse=True)[1])
        if BAND_S[0] <= float(np.nanmedian(north)) < BAND_S[1]:
            words = f"{np.nanmedian(north):.2g} deg north in band S, or {-np.nanmedian(latitude):.2g} deg south"
            raise BadValue(
                f"{where}: zone '{zone}' may be {words}; write {number}N, or its band in the south, {number}F"
            )
    return latitude, longitude


def _projection(where: str, **parameters: Any) -> Any:
    return needed("pyproj", f"{where}: a position in latitude and longitude").Proj(ellps="WGS84", **parameters)
