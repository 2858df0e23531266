"""From the numbers of a file to those of the product: cells that stand for nothing, headings that were interpolated
through north, sign, lag, velocity frame, reference point, wind; and units that the numbers themselves refute.

Of units only contradictions are reported, never guesses: a rudder angle is compared with the largest one a rudder can
take, a heading with the integral of the yaw rate. A heading resampled as numbers from 0
to 360 goes the long way round, through south: the turn rate, or the rest of the record, says that the ship did not.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from cases.inputs import integral
from cases.io.sidecar import SidecarEntry
from cases.quantities import DEG, REVOLUTIONS_LIMIT, RUDDER_LIMIT, UNITS, quantity, wraps
from cases.trial import unwrapped
from mmg.errors import OutOfRange
from mmg.messages import Message
from mmg.motion.flow import RUDDERS
from mmg.motion.frames import true_wind

SENTINEL = "sentinel"  # Code of the notice on numbers that stand for no value
# Listed by hand from logs that were met.
_NINES = (99.0, 99.9, 99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 999999.0)
WELL_KNOWN = (  # Numbers that loggers write where they have none; those of AIS are among them.
    *(sign * nines for nines in _NINES for sign in (-1, 1)),
    *(number / 10**k for number in (32767, -32768, 65535) for k in range(3)),  # of two bytes, also in tenths
    *(2147483647.0, -2147483648.0, 1e30, -1e30, 181.0, 91.0, 511.0, 102.3, 360.1),
)
JUMP = 20.0  # Larger changes from row to row by which a column jumps to a number that stands for none. Set by hand.
STEP_OF_INPUT = 1.0  # The same of a zero of an actuator in a row in which a state jumped to zero. Set by hand.
LARGER = 0.95  # The larger changes from row to row: this quantile of them. Set by hand.


def masked(
    columns: Mapping[str, np.ndarray], wanted: Mapping[str, tuple[int, float]], further: Sequence[float]
) -> tuple[dict[str, np.ndarray], Counter[tuple[str, float]]]:
    """``columns``, name -> (N,), in which what stands for no value is missing, and how often which number did. wanted:
    name -> (number of the column, factor by which its values were multiplied); further: as in ``sentinels_in``."""
    out, counts = dict(columns), Counter[tuple[str, float]]()
    for name, values in columns.items():
        factor = wanted[name][1]
        if name == "t" or not np.isfinite(values).any():
            continue
        # The number as it stands in the file, without the last digits of the conversion.
        for number, rows in sentinels_in(values if factor == 1 else np.round(values / factor, 6), further).items():
            out[name] = np.where(rows, np.nan, out[name])
            counts[name, number] += int(rows.sum())
    return out, counts


def remarks(counts: Mapping[tuple[str, float], int]) -> list[Message]:
    """A notice on each column and number of the ``counts`` that ``masked`` gives."""
    what = "which stands for no value; taken as missing"
    return [Message(f"{name}: {n} samples hold {number:g}, {what}", SENTINEL) for (name, number), n in counts.items()]


def sentinels_in(values: np.ndarray, further: Sequence[float] = ()) -> dict[float, np.ndarray]:
    """Number that stands for no value -> rows (N,) of ``values`` (N,) that hold it. further: numbers that are known to
    stand for none. One that is only well known counts where the column jumps to it and back, and never where most rows
    hold it."""
    out = {float(number): values == number for number in further if (values == number).any()}
    present = values[np.isfinite(values)]
    for number in np.setdiff1d(values[np.isin(values, WELL_KNOWN)], further).tolist():
        here = present == number
        rest = present[~here]
        if len(rest) < max(10, 0.5 * len(present)):  # most rows hold it: a measurement
            continue
        usual = max(float(np.quantile(np.abs(np.diff(rest)), LARGER)), 1e-9 * abs(number))
        edges = np.flatnonzero(np.diff(here.astype(int)))  # the rows before each jump to it, and back
        off = np.abs(np.where(here[edges], present[edges + 1], present[edges]) - number)
        if len(off) and float(np.median(off)) > JUMP * usual:
            out[float(number)] = values == number
    return out


def without_dropouts(
    channels: Mapping[str, np.ndarray], states: Sequence[str]
) -> tuple[dict[str, np.ndarray], Counter[tuple[str, float]]]:
    """The ``channels``, quantity -> (N,), with NaN for zeros of a logger that had no value, and how many of each.
    states: quantities that cannot jump to zero and back, as a heading or a speed; a rudder and revolutions can, and
    their zeros count only in rows in which those of a state do."""
    zeros = {q: _dropouts(q, values, JUMP if q in states else STEP_OF_INPUT) for q, values in channels.items()}
    none = np.zeros(len(next(iter(channels.values()), ())), dtype=bool)
    rows = np.any([none, *(zeros[name] for name in states if name in zeros)], axis=0)  # in which a state dropped out
    counts = Counter({(name, 0.0): int((lost & rows).sum()) for name, lost in zeros.items() if (lost & rows).any()})
    return {name: np.where(zeros[name] & rows, np.nan, values) for name, values in channels.items()}, counts


def _dropouts(name: str, values: np.ndarray, jump: float) -> np.ndarray:
    """Rows (N,) where ``values`` (N,) jump to zero and back by ``jump`` of their larger changes from row to row."""
    out = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    zero = values[known] == 0
    rest = values[known][~zero]
    if not zero.any() or len(rest) < max(10, 0.5 * len(known)):
        return out
    turn = quantity(name).period and (360.0 if np.abs(rest).max() > 7 else quantity(name).period)  # 7 > 2 pi: degrees
    changes = np.abs(np.remainder(np.diff(rest) + turn / 2, turn) - turn / 2) if turn else np.abs(np.diff(rest))
    size = np.minimum(np.abs(rest) % turn, -np.abs(rest) % turn) if turn else np.abs(rest)
    at = np.cumsum(~zero)[zero]  # number of values before each zero
    sides = np.append(0.0, size)[at], np.append(size, 0.0)[at]  # a ship may begin and end at rest
    out[known[zero]] = np.minimum(*sides) > jump * max(float(np.quantile(changes, LARGER)), 1e-9)
    return out


MOST = 20  # False samples of a crossing at most: a record resampled by more is no interpolation. Set by hand.
QUICK = 8.0  # A step that is so many times the greater ones of the record is none of the ship. Set by hand.
NEAR = 0.15  # rad; the short way between the ends of a crossing, less the integrated r, is no more. Set by hand.


def through_north(t: np.ndarray, psi: np.ndarray, r: np.ndarray | None) -> tuple[np.ndarray, int]:
    """``psi`` (N,) [rad] without false samples between the ends of each crossing of north, and how many crossings had
    such. t: (N,) [s]; r: measured turn rate (N,) [rad/s], or None; NaN where something is missing."""
    if len(psi) < 10:
        return psi, 0
    angle = np.mod(psi, 2 * math.pi)
    step = np.diff(angle)
    short = np.angle(np.exp(1j * step))  # (N-1,) steps the short way round
    turned = integral(t, np.nan_to_num(r if r is not None else np.zeros(len(psi))))
    off = np.abs(short - np.diff(turned)) if r is not None else np.abs(short)
    usual = float(np.nanquantile(off, 0.75)) if np.isfinite(off).any() else 0.0
    quick = off > max(QUICK * usual, 0.5 * NEAR)
    out, count, row = psi.copy(), 0, 0
    while row < len(step):
        if not quick[row]:
            row += 1
            continue
        end = row  # of the run of quick steps in one direction
        while end < len(step) and quick[end] and step[end] * step[row] > 0:
            end += 1
        way, back = float(angle[end] - angle[row]), float(turned[end] - turned[row])
        straight = float(np.angle(np.exp(1j * way)))
        through_south = 1 < end - row <= MOST + 1 and abs(way) > math.pi
        # 0.1: the turn rate over a crossing may be a tenth wrong. Set by hand.
        if through_south and abs(straight - back) < NEAR + (0.1 * abs(back) if r is not None else 0.0):
            share = (t[row + 1 : end] - t[row]) / (t[end] - t[row])
            along = turned[row + 1 : end] - turned[row] if r is not None else 0.0 * share
            out[row + 1 : end] = psi[row] + along + share * (straight - back)  # and the rest evenly
            count += 1
        row = max(end, row + 1)
    return out, count


STEADIER = 0.2  # Difference of steadiness, length of the mean over mean length, that tells units apart. Set by hand.
_DIRECTIONS = tuple(name for name in UNITS if wraps(name) and "wind" in name)
_CAUSES = {
    (DEG, 1.0): "psi holds degrees but is labelled rad (or r holds rad/s but is labelled deg/s)",
    (1.0, DEG): "r holds deg/s but is labelled rad/s (or psi holds radians but is labelled deg)",
}


def _steadier_in_radians(columns: Mapping[str, np.ndarray], name: str) -> bool:
    """Whether the wind over ground is steadier where the direction ``name`` holds radians, which may go on beyond a
    turn as the ship turns, than where it holds degrees."""
    speed = columns.get(name.replace("direction", "speed"), np.ones(len(columns[name])))
    steady = []
    for unit in (1.0, DEG):
        air = -speed * np.exp(1j * columns[name] * unit)  # where it goes, north + i east or ahead + i to starboard
        if name.startswith("apparent") and {"psi", "u", "v"} <= set(columns):  # over ground, in the earth frame
            air = (air + columns["u"] + 1j * columns["v"]) * np.exp(1j * columns["psi"])
        air = air[np.isfinite(air)]
        steady.append(abs(air.mean()) / max(float(np.abs(air).mean()), 1e-12) if len(air) else 0.0)
    return steady[0] > steady[1] + STEADIER


def heading_and_rate(columns: Mapping[str, np.ndarray]) -> str:
    """One sentence where change of heading over some seconds and integral of r over the same seconds, of either sign,
    have nothing in common but in other units; "" elsewhere. columns: t [s], psi, r (N,): of a log that is too long for
    ``mmg check``."""
    t, psi, r = columns["t"], columns["psi"], columns["r"]
    good = np.isfinite(psi) & np.isfinite(r)
    t, psi, turned = t[good], psi[good], integral(t[good], r[good])
    for lag in (20, 50, 100) if len(t) >= 20 else ():  # samples: short ones follow turns, long ones stand out of noise
        lag = max(1, min(lag, len(t) // 10))
        usable = (t[lag:] - t[:-lag]) < 3 * lag * np.median(np.diff(t))
        turn, misfit = (turned[lag:] - turned[:-lag])[usable], {}
        for units in ((1.0, 1.0), *_CAUSES):
            heading, other = np.unwrap(psi * units[0]), turn * units[1]
            change = (heading[lag:] - heading[:-lag])[usable]
            size = math.sqrt(float(np.mean(change**2) + np.mean(other**2)))
            rms = min(math.sqrt(float(np.mean(error**2))) for error in (change - other, change + other))
            misfit[units] = rms / size if size > 1e-9 else 0.0
        best = min(misfit, key=lambda units: misfit[units])
        if misfit[1.0, 1.0] >= 0.9 and misfit[best] <= 0.4:  # 1 is "nothing in common". Set by hand.
            return f"{_CAUSES[best]}; correct the unit"
    return ""


def mislabelled(columns: Mapping[str, np.ndarray]) -> list[tuple[str, float, str]]:
    """(column, factor that makes it true, sentence) of revolutions, rudders and wind directions in a unit that no ship
    allows. columns: canonical name -> (N,) in house units; those of revolutions, rudders and wind are looked at, with
    psi, u and v."""
    wrong = []
    for name in (name for name in ("n", "n_2", *RUDDERS, "delta_order", *_DIRECTIONS) if name in columns):
        size = np.abs(columns[name])
        if not np.isfinite(size).any():
            continue
        largest, usual, typical = (float(np.nanpercentile(size, share)) for share in (100, 75, 90))
        if name in ("n", "n_2"):
            beyond, unit, factor = usual > REVOLUTIONS_LIMIT, "rpm", 1 / 60
            words = f"{name} is {usual:.4g} rps a quarter of the time: are these rpm labelled rps?"
        else:
            if name in _DIRECTIONS:  # two turns: a direction may go on beyond one
                beyond = typical > 4 * math.pi and not _steadier_in_radians(columns, name)
            else:
                beyond = largest > RUDDER_LIMIT
            unit, factor = "deg", DEG
            words = f"{name} reaches {largest:.4g} rad: are these degrees labelled rad?"
        if beyond:
            wrong.append((name, factor, f"{words} (label the column '{name} [{unit}]')"))
    return wrong


def converted(columns: Mapping[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> dict[str, np.ndarray]:
    """Columns with the signs, frames and reference point of the product.

    columns: canonical name -> (N,) in SI and radians; entry: what the sidecar says of the file; notices: each step
    adds one. Order: signs, heading, lags, velocity frame, reference point, wind. Raises UserError where no row is left
    after the lags.
    """
    out = dict(columns)
    _turn_signs(out, entry, notices)
    if entry.heading_from == "east":
        out["psi"] = out["psi"] + math.pi / 2
        notices.append(Message("psi turned by 90 deg: the file counts it from east", "heading_from"))
    out = _in_time(out, entry, notices)
    if entry.velocity_frame == "earth":
        north, east, psi = out["u"], out["v"], out["psi"]
        out["u"] = north * np.cos(psi) + east * np.sin(psi)
        out["v"] = -north * np.sin(psi) + east * np.cos(psi)
        notices.append(Message("u, v turned from the earth frame into body axes by psi", "velocity_frame"))
    _move_to_midship(out, entry, notices)
    _wind(out, entry, notices)
    if not ("x" in out and "y" in out):
        text = "no position: the track, lags of u and v, and position scores are not available"
        notices.append(Message(text, "no_position"))
    return out


def _turn_signs(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    turned = [(name, " (sidecar)") for name, sign in entry.sign.items() if sign == -1]
    port = (*RUDDERS, "delta_order") if entry.rudder_positive == "port" else ()
    for name, why in (*turned, *((name, ": positive to port in the file") for name in port)):  # both: twice
        if name in out:
            out[name] = -out[name]
            notices.append(Message(f"{name} changed sign{why}", "sign"))


def _in_time(columns: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> dict[str, np.ndarray]:
    """Columns that are late, taken back in time by straight lines between samples; rows that then lack one are cut. u
    and v that were made with a late heading are turned by what it was off."""
    lags = {name: seconds for name, seconds in entry.lag.items() if name in columns and seconds}
    if not lags:
        return columns
    t, out = columns["t"], dict(columns)
    keep = np.ones(len(t), bool)
    for name, seconds in lags.items():
        at = t + seconds
        keep &= (at >= t[0]) & (at <= t[-1])
        values = unwrapped(columns[name]) if wraps(name) else columns[name]
        good = np.isfinite(values)
        if good.any():
            near = np.interp(at, t, good.astype(float))  # less than 1 beside a missing sample: gaps stay gaps
            out[name] = np.where(near > 0.999, np.interp(at, t[good], values[good]), np.nan)
        if wraps(name) and name != "psi":
            out[name] = np.remainder(out[name], 2 * math.pi)
        notices.append(Message(f"{name} taken back by {seconds:g} s (lag in trials.toml)", "lag"))
    if "psi" in lags and all("psi" in entry.derived.get(name, ()) and name not in lags for name in ("u", "v")):
        w = (columns["u"] + 1j * columns["v"]) * np.exp(1j * (columns["psi"] - out["psi"]))
        out["u"], out["v"] = w.real, w.imag
    if keep.sum() < 2:
        longest = max(map(abs, lags.values()))
        raise OutOfRange(f"lag in trials.toml: no row is left after {longest:g} s of {t[-1] - t[0]:g} s")
    return {name: values[keep] for name, values in out.items()}


def _move_to_midship(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    """Positions and velocities of the measured point P = (l_x, l_y) taken to midship. x0 = x_P - l_x cos psi + l_y sin
    psi, y0 = y_P - l_x sin psi - l_y cos psi; u = u_P + l_y r, v = v_P - l_x r."""
    point = entry.reference_point
    l_x, l_y = point.x, point.y
    if l_x == 0.0 and l_y == 0.0:
        return
    if point.applies_to in ("position", "both") and "x" in out and "y" in out:
        c, s = np.cos(out["psi"]), np.sin(out["psi"])
        out["x"] = out["x"] - l_x * c + l_y * s
        out["y"] = out["y"] - l_x * s - l_y * c
        notices.append(Message(f"positions taken from ({l_x:g}, {l_y:g}) m to midship", "reference_point"))
    if point.applies_to in ("velocity", "both"):
        out["u"] = out["u"] + l_y * out["r"]
        out["v"] = out["v"] - l_x * out["r"]
        notices.append(Message(f"velocities taken from ({l_x:g}, {l_y:g}) m to midship", "reference_point"))


def _wind(out: dict[str, np.ndarray], entry: SidecarEntry, notices: list[Message]) -> None:
    """Directions turned to *coming from*; true wind derived where only the apparent one is given."""
    if entry.wind_direction == "to":
        for name in ("wind_direction", "apparent_wind_direction"):
            if name in out:
                out[name] = (out[name] + math.pi) % (2 * math.pi)
                text = f"{name} turned by 180 deg: the file says where the wind goes to"
                notices.append(Message(text, "wind_direction"))
    for pair in (("wind_speed", "wind_direction"), ("apparent_wind_speed", "apparent_wind_direction")):
        present = [name for name in pair if name in out]
        if len(present) == 1:
            del out[present[0]]
            text = f"{present[0]} left out: of {pair[0]} and {pair[1]} the file has only one"
            notices.append(Message(text, "wind_incomplete"))
    if "wind_speed" in out:
        return
    if "apparent_wind_speed" in out:
        out["wind_speed"], out["wind_direction"] = true_wind(
            out["apparent_wind_speed"], out["apparent_wind_direction"], out["psi"], out["u"], out["v"]
        )
        notices.append(Message("true wind derived from the apparent wind, u, v and psi", "true_wind_derived"))
    else:
        notices.append(Message("no wind: the air is taken to be calm; a ship under way feels her own wind", "no_wind"))
