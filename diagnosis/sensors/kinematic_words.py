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
    length by which threshold and prior grow; more, less: words for a positive and a negative value; effect, parameter:
    of the library, "" where it has none; exact: the effect of the library does the same to the columns.
    """

    symbol: str
    unit: str
    threshold: float
    prior: float
    power: float
    more: str
    less: str
    effect: str = ""
    parameter: str = ""
    exact: bool = False

    def as_logged(self, value: float) -> float:
        """A fitted value as an error of the log: a gain is fitted as what corrects it."""
        return float(-value / (1 + value)) if self.symbol.startswith("gain") else float(value)

    def words(self, value: float) -> str:
        """What a value means."""
        return f"{self.more if value > 0 else self.less} by {_shown(abs(value), self.unit)}"


TRACK = (
    Quantity("lag", "s", 0.1, 1.0, 0.5, "logged u and v lag the position", "logged u and v lead the position",
             "velocity_lag", "tau", True),
    Quantity("gain_u", "", 0.005, 0.1, 0, "logged u is too large", "logged u is too small", "log_scale", "share", True),
    Quantity("gain_v", "", 0.03, 0.1, 0, "logged v is too large", "logged v is too small"),
    Quantity("heading", "rad", 0.01, 0.1, 0, "the course of the position lies clockwise of u, v and psi",
             "the course of the position lies counter-clockwise of u, v and psi"),
    Quantity("arm_x", "m", 0.06, 0.3, 1, "the position belongs to a point ahead of that of u and v",
             "the position belongs to a point aft of that of u and v", "antenna_offset", "x"),
    Quantity("arm_y", "m", 0.06, 0.3, 1, "the position belongs to a point to starboard of that of u and v",
             "the position belongs to a point to port of that of u and v", "antenna_offset", "y"),
    Quantity("bias_u", "m/s", 0.005, 0.02, 0.5, "logged u is always too large",
             "logged u is always too small"),
    Quantity("bias_v", "m/s", 0.005, 0.02, 0.5, "logged v is always too large",
             "logged v is always too small"),
    Quantity("drift_x", "m/s", 0.01, 0.03, 0.5, "the position drifts north against u and v (through the water?)",
             "the position drifts south against u and v (through the water?)"),
    Quantity("drift_y", "m/s", 0.01, 0.03, 0.5, "the position drifts east against u and v (through the water?)",
             "the position drifts west against u and v (through the water?)"),
)  # fmt: skip
TURN = (
    Quantity("lag_r", "s", 0.1, 1.0, 0.5, "logged r lags the heading", "logged r leads the heading", "gyro", "T", True),
    Quantity("gain_r", "", 0.005, 0.1, 0, "logged r is too large", "logged r is too small", "gyro", "share", True),
    Quantity("bias_r", "rad/s", 0.0005, 0.005, -0.5, "logged r is always too large",
             "logged r is always too small"),
)  # fmt: skip


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
    size, about = _shown(abs(value), q.unit), _shown(std, q.unit)
    sentence = {
        "found": f"{q.words(value)} +- {about}",
        "none": f"not found: {q.more} ({'-' if value < 0 else ''}{size} +- {about})",
        "undetermined": f"not determined by these runs: {q.more} ({'-' if value < 0 else ''}{size} +- {about})",
        "not checked": f"not checked: {q.more}",
    }[verdict]
    if verdict != "found":
        return Reading(q.symbol, value, std, q.unit, verdict, sentence)
    effect, parameter, exact = q.effect, q.parameter, q.exact
    if q.symbol == "lag" and value < 0:
        effect, exact = "gnss_delay", False
        sentence += "; a late position (gnss_delay of the library makes u and v as late)"
    elif q.symbol == "lag_r" and value < 0:
        effect = parameter = ""
        exact = False
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
    by_sign = {s: [(name, r) for name, r in own if s * r.value > 0] for s in (1.0, -1.0)}
    if pooled.verdict == "found":
        names = tuple(name for name, r in runs if r.verdict == "found" and r.value * pooled.value > 0)
        sentence = f"{pooled.sentence} ({len(names)} of {checked} runs by themselves)"
        return replace(pooled, runs=names, checked=checked, sentence=sentence)
    some = max(by_sign.values(), key=len)
    if len(some) < max(2, SOME * checked):
        return replace(pooled, checked=checked)
    names, one = tuple(name for name, _ in some), some[0][1]
    q = next(q for q in (*TRACK, *TURN) if q.symbol == pooled.symbol)
    words = q.words(float(np.median([r.value for _, r in some])))
    effect = f" ({one.effect})" if one.effect else ""
    return replace(
        one,
        value=pooled.value,
        std=pooled.std,
        verdict="some runs",
        sentence=f"{words} (median) in {len(names)} of {checked} runs only: {', '.join(names)}{effect}",
        runs=names,
        checked=checked,
    )


def _shown(value: float, unit: str) -> str:
    """A size in the unit that people read: degrees, per cent."""
    if unit in ("rad", "rad/s"):
        return f"{math.degrees(value):.2g} {unit.replace('rad', 'deg')}"
    return f"{100 * value:.2g} %" if not unit else f"{value:.2g} {unit}"
