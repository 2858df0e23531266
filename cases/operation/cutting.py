"""A log of months cut into windows under way: none of them across a gap, moored, with a broken or a touched stretch.

A window is manoeuvring where rudder, revolutions or turn rate changed in it; the others are steady. Lengths follow from
the ship: a window lasts as long as she takes for ``WINDOW`` lengths.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cases.checks.breaks import SWINGING
from cases.checks.stretches import broken_stretches
from cases.trial import RUDDERS, Trial
from mmg.motion.froude import reference_speed

WINDOW = 15.0
"""Length of a window in ship lengths travelled at the usual speed."""

USUAL = 0.15
"""Usual speed of a ship as a Froude number."""

STOPPED = 0.012
"""A ship slower than this Froude number, u / sqrt(g L), for half a window is moored, at anchor or adrift."""

GAP = 2.5
"""A step in time so many usual steps long is a gap."""

MOVED = {"rudder": 0.07, "n": 0.08, "turn": 0.1}
"""A window is manoeuvring where the rudder moves by this angle [rad] between its 5 % and 95 % quantiles, the
revolutions by this share of their largest value in the log, or the heading by this angle [rad]."""

NEEDED = ("psi", "u", "v", "r", "n")


@dataclass(frozen=True)
class LogWindow:
    """A window of a log. begin, end: [s] on its clock; manoeuvring: whether the ship was manoeuvred in it."""

    begin: float
    end: float
    manoeuvring: bool


@dataclass
class Cut:
    """How a log was cut.

    step: usual time between rows [s]; length: of a window [s]; windows: in order of time; seconds: of what became of
    the log, by words: "manoeuvring", "steady", "moored", "missing values", "too short", "gaps", and what was broken or
    touched; rows, begin, end: of the log.
    """

    step: float = 0.0
    length: float = 0.0
    windows: list[LogWindow] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    rows: int = 0
    begin: float = np.nan
    end: float = np.nan

    def add(self, what: str, seconds: float) -> None:
        """More ``seconds`` of ``what``."""
        self.seconds[what] = self.seconds.get(what, 0.0) + seconds


def cut_log(pieces: Iterable[Mapping[str, np.ndarray]], length: float) -> Cut:
    """Returns how a log given in ``pieces`` of canonical columns (N,), of a ship of this ``length`` [m], is cut.

    What is left over at the end of a piece is cut with the next one. The largest usual revolutions are those of what
    was read so far.
    """
    cut, rest, revolutions = Cut(), dict[str, np.ndarray](), 0.0
    slowest = STOPPED * reference_speed(length)
    for piece in pieces:
        t = piece["t"]
        if not cut.rows:
            cut.step, cut.begin = float(np.median(np.diff(t))) if len(t) > 1 else 1.0, float(t[0])
            cut.length = max(WINDOW * length / (USUAL * reference_speed(length)), 30 * cut.step)
        cut.rows, cut.end = cut.rows + len(t), float(t[-1])
        columns = _after(rest, piece)
        most = np.abs(columns["n"])
        revolutions = max(revolutions, float(np.quantile(most[np.isfinite(most)], 0.95)) if len(most) else 0.0)
        left = _cut_piece(columns, cut, slowest, revolutions)
        rest = {name: values[left:].copy() for name, values in columns.items()}
    if rest:
        _cut_piece(rest, cut, slowest, revolutions, last=True)
    return cut


def _cut_piece(
    columns: Mapping[str, np.ndarray], cut: Cut, slowest: float, revolutions: float, last: bool = False
) -> int:
    """Add the windows of ``columns`` (N,) to ``cut``; returns the row from which they are to be cut with what follows.

    slowest: speed below which a ship does not sail [m/s]; revolutions: largest usual ones; last: nothing follows.
    """
    t, rows = columns["t"], len(columns["t"])
    if not rows:
        return 0
    count = max(2, round(cut.length / cut.step))
    gap = np.diff(t) > GAP * cut.step
    needed = [name for name in columns if name in (*NEEDED, *RUDDERS, "wind_speed", "wind_direction")]
    missing = ~np.all([np.isfinite(columns[name]) for name in needed], axis=0)
    speed = np.nan_to_num(np.hypot(columns["u"], columns["v"]))
    moored = _mean(speed, max(1, count // 2)) < slowest
    state = np.where(moored, 1, np.where(missing, 2, 0))
    left = rows
    for first, end in _runs(state, gap):
        seconds = (end - first) * cut.step
        if state[first]:
            cut.add("moored" if state[first] == 1 else "missing values", seconds)
            continue
        left = _windows_of(columns, first, end, cut, count, revolutions, open_end=end == rows and not last)
    cut.add("gaps", float(np.diff(t)[gap].sum()))
    return left


def _windows_of(
    columns: Mapping[str, np.ndarray], first: int, end: int, cut: Cut, count: int, revolutions: float, open_end: bool
) -> int:
    """Add the windows of the rows ``first`` to ``end`` under way; returns the row from which they go on."""
    trial = Trial("log", {name: values[first:end] for name, values in columns.items()})
    bad = np.zeros(end - first, dtype=int)
    words = [""]
    for stretch in broken_stretches(trial) if end - first > count else ():
        words.append("touched: " + stretch.what if SWINGING in stretch.what else "broken: " + stretch.what)
        bad[(trial.t >= stretch.begin_s) & (trial.t <= stretch.end_s)] = len(words) - 1
    left = len(columns["t"])
    for a, b in _runs(bad, np.zeros(max(len(bad) - 1, 0), bool)):
        if bad[a]:
            cut.add(words[bad[a]], (b - a) * cut.step)
            continue
        whole = (b - a) // count
        for k in range(whole):
            rows = slice(first + a + k * count, first + a + (k + 1) * count)
            moved = _manoeuvring({name: values[rows] for name, values in columns.items()}, revolutions)
            begin = float(columns["t"][rows.start])
            cut.windows.append(LogWindow(begin, float(columns["t"][rows.stop - 1]), moved))
            cut.add("manoeuvring" if moved else "steady", count * cut.step)
        if open_end and b == len(bad):
            left = first + a + whole * count
        else:
            cut.add("too short", (b - a - whole * count) * cut.step)
    return left


def _manoeuvring(rows: Mapping[str, np.ndarray], revolutions: float) -> bool:
    """Whether the ship is manoeuvred in these rows."""

    def span(values: np.ndarray) -> float:
        low, high = np.quantile(values, (0.05, 0.95))
        return float(high - low)

    rudder = max(span(rows[name]) for name in RUDDERS if name in rows)
    return (
        rudder > MOVED["rudder"]
        or span(rows["n"]) > MOVED["n"] * max(revolutions, 1e-9)
        or span(np.unwrap(rows["psi"])) > MOVED["turn"]
    )


def _runs(state: np.ndarray, gap: np.ndarray) -> Iterator[tuple[int, int]]:
    """First row and row after the last of each stretch of equal ``state`` (N,) without a ``gap`` (N - 1,)."""
    edges = np.flatnonzero((np.diff(state) != 0) | gap) + 1
    bounds = [0, *edges.tolist(), len(state)]
    yield from ((a, b) for a, b in pairwise(bounds) if b > a)


def _after(rest: Mapping[str, np.ndarray], piece: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns (N,) of a ``piece`` behind the ``rest`` of the one before, which may be empty."""
    return {name: np.concatenate([rest[name], values]) if rest else values for name, values in piece.items()}


def _mean(values: np.ndarray, width: int) -> np.ndarray:
    """Means of ``values`` (N,) over ``width`` neighbours."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    rows = np.arange(len(values))
    low, high = np.maximum(rows - width // 2, 0), np.minimum(rows + width // 2 + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)


def window_rows(
    pieces: Iterable[Mapping[str, np.ndarray]], windows: Sequence[LogWindow]
) -> Iterator[tuple[LogWindow, dict[str, np.ndarray]]]:
    """Each of the ``windows``, in order of time, with its columns (N,), from a log given in ``pieces``."""
    rest, at = dict[str, np.ndarray](), 0
    for piece in pieces:
        if at == len(windows):
            return
        columns = _after(rest, piece)
        t = columns["t"]
        while at < len(windows) and windows[at].end <= t[-1]:
            rows = slice(int(np.searchsorted(t, windows[at].begin)), int(np.searchsorted(t, windows[at].end, "right")))
            yield windows[at], {name: values[rows] for name, values in columns.items()}
            at += 1
        keep = int(np.searchsorted(t, windows[at].begin)) if at < len(windows) else len(t)
        rest = {name: values[keep:].copy() for name, values in columns.items()}
