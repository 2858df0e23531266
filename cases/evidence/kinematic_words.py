"""Faults of sensors that a kinematic check can find, and its results in words."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

SOME = 0.1
"""Share of the runs (and at least two) whose own value is reported where all together have none."""

ALIKE: tuple[Set[str], ...] = (
    {"lag", "gain_v", "arm_x"},
    {"heading", "bias_v"},
    {"gain_u", "bias_u"},
    {"gain_r", "bias_r"},
)
"""Faults that look much the same in a single run: the first at steady speed, where sway and turning go together, the
others where speed or turning rate hardly change."""

UNSEEN = (
    "what moves position and velocities alike cannot be seen without dynamics: heading_bias (u and v turn with the "
    "logged heading), gnss_delay (position and velocity equally late), antenna_offset (both of the same point)"
)


@dataclass(frozen=True)
class Quantity:
    """A fault of a sensor.

    unit as shown; threshold: the least size that matters; prior: standard deviation before the data; power: of the
    length by which threshold and prior grow; form: in words, with {} for the first of ``ends`` where the value is
    positive, else for the second; effect, parameter: of the library, "" where it has none; exact: the effect of the
    library does the same to the columns.
    """

    symbol: str
    unit: str
    threshold: float
    prior: float
    power: float
    form: str
    ends: tuple[str, str]
    effect: str = ""
    parameter: str = ""
    exact: bool = False

    def as_logged(self, value: float) -> float:
        """A fitted value as an error of the log: a gain is fitted as what corrects it."""
        return float(-value / (1 + value)) if self.symbol.startswith("gain") else float(value)

    def words(self, value: float) -> str:
        """What a value means."""
        return f"{self.form.format(self.ends[0 if value > 0 else 1])} by {_shown(abs(value), self.unit)}"


SIZE = ("large", "small")
COURSE = "the course of the position lies {} of u, v and psi"
POINT = "the position belongs to a point {} that of u and v"
DRIFT = "the position drifts {} against u and v (through the water?)"
TRACK = (
    Quantity(
        "lag", "s", 0.1, 1.0, 0.5, "logged u and v {} the position", ("lag", "lead"), "velocity_filter", "tau", True
    ),
    Quantity("gain_u", "", 0.005, 0.1, 0, "logged u is too {}", SIZE, "log_scale", "share", True),
    Quantity("gain_v", "", 0.03, 0.1, 0, "logged v is too {}", SIZE),
    Quantity("heading", "rad", 0.01, 0.1, 0, COURSE, ("clockwise", "counter-clockwise")),
    Quantity("arm_x", "m", 0.06, 0.3, 1, POINT, ("ahead of", "aft of"), "antenna_offset", "x"),
    Quantity("arm_y", "m", 0.06, 0.3, 1, POINT, ("to starboard of", "to port of"), "antenna_offset", "y"),
    Quantity("bias_u", "m/s", 0.005, 0.02, 0.5, "logged u is always too {}", SIZE),
    Quantity("bias_v", "m/s", 0.005, 0.02, 0.5, "logged v is always too {}", SIZE),
    Quantity("drift_x", "m/s", 0.01, 0.03, 0.5, DRIFT, ("north", "south")),
    Quantity("drift_y", "m/s", 0.01, 0.03, 0.5, DRIFT, ("east", "west")),
)
LAG = 0
"""Place of the lag in TRACK."""
TURN = (
    Quantity("lag_r", "s", 0.1, 1.0, 0.5, "logged r {} the heading", ("lags", "leads"), "gyro", "T", True),
    Quantity("gain_r", "", 0.005, 0.1, 0, "logged r is too {}", SIZE, "gyro", "share", True),
    Quantity("bias_r", "rad/s", 0.0005, 0.005, -0.5, "logged r is always too {}", SIZE),
)


@dataclass(frozen=True)
class Reading:
    """One quantity of one run or of all.

    value, std: in ``unit``; NaN when not checked. verdict: "found", "some runs" (found in several by themselves, not in
    all together), "none", "undetermined" (its size could matter unseen) or "not checked". effect, parameter: of the
    library, named when found, "" otherwise; exact: that effect does the same to the columns. rivals: symbols of other
    quantities that would explain a found one nearly as well. runs: names of those that show it by themselves; checked:
    number of runs that could have shown it.
    """

    symbol: str
    value: float
    std: float
    unit: str
    verdict: str
    sentence: str
    effect: str = ""
    parameter: str = ""
    exact: bool = False
    rivals: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    checked: int = 0


def reading(
    q: Quantity, value: float, std: float, verdict: str, rivals: Sequence[tuple[Quantity, float]] = ()
) -> Reading:
    """The reading of the quantity q with its sentence.

    value, std: fitted value and standard error [q.unit], NaN if not checked; verdict: as of ``Reading``; rivals: other
    quantities that would explain the same, and their values.
    """
    about, more = _shown(std, q.unit), q.form.format(q.ends[0])
    small = f"{more} ({'-' if value < 0 else ''}{_shown(abs(value), q.unit)} +- {about})"
    sentence = {
        "found": f"{q.words(value)} +- {about}",
        "none": f"not found: {small}",
        "undetermined": f"not determined by these runs: {small}",
        "not checked": f"not checked: {more}",
    }[verdict]
    if verdict != "found":
        return Reading(q.symbol, value, std, q.unit, verdict, sentence)
    effect, parameter, exact = q.effect, q.parameter, q.exact
    if q.symbol == "lag" and value < 0:
        effect, exact = "gnss_delay", False
        sentence += "; a late position (gnss_delay of the library makes u and v as late)"
    elif q.symbol == "lag_r" and value < 0:
        effect, parameter, exact = "", "", False
    elif q.symbol.startswith("arm"):
        sentence += ' (antenna_offset of the position alone; reference_point with applies_to = "position" corrects it)'
    elif effect:
        sentence += f" ({effect})"
    if rivals:
        sentence += f"; hardly to be told from: {', or '.join(other.words(size) for other, size in rivals)}"
    symbols = tuple(other.symbol for other, _ in rivals)
    return Reading(q.symbol, value, std, q.unit, verdict, sentence, effect, parameter, exact, symbols)


def pooled_with(pooled: Reading, runs: Sequence[tuple[str, Reading]], clear: Set[str]) -> Reading:
    """The ``pooled`` reading with the number of ``runs`` (name, reading) that agree, or that only some have the fault.

    clear: symbols found in all runs together; what looks alike in a single run is not counted.
    """
    checked = sum(r.verdict in ("found", "none") for _, r in runs)
    alike = set().union(*(group for group in ALIKE if pooled.symbol in group)) - {pooled.symbol}
    own = [(name, r) for name, r in runs if r.verdict == "found" and not clear & (alike | set(r.rivals))]
    if pooled.verdict == "found":
        names = tuple(name for name, r in runs if r.verdict == "found" and r.value * pooled.value > 0)
        sentence = f"{pooled.sentence} ({len(names)} of {checked} runs by themselves)"
        return replace(pooled, runs=names, checked=checked, sentence=sentence)
    some = max(([(name, r) for name, r in own if sign * r.value > 0] for sign in (1.0, -1.0)), key=len)
    if len(some) < max(2, SOME * checked):
        return replace(pooled, checked=checked)
    names, one = tuple(name for name, _ in some), some[0][1]
    q = next(q for q in (*TRACK, *TURN) if q.symbol == pooled.symbol)
    words = q.words(float(np.median([r.value for _, r in some])))
    effect = f" ({one.effect})" if one.effect else ""
    sentence = f"{words} (median) in {len(names)} of {checked} runs only: {', '.join(names)}{effect}"
    one = replace(one, value=pooled.value, std=pooled.std, verdict="some runs", sentence=sentence)
    return replace(one, runs=names, checked=checked)


def _shown(value: float, unit: str) -> str:
    """A size in the unit that people read: degrees, per cent."""
    if unit in ("rad", "rad/s"):
        return f"{math.degrees(value):.2g} {unit.replace('rad', 'deg')}"
    return f"{100 * value:.2g} %" if not unit else f"{value:.2g} {unit}"
