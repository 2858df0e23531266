"""A log of months in the Parquet files of a folder: read in pieces, never as a whole, cut into windows.

A part that is damaged is left out and said: overwritten bytes are seen where its writer kept a checksum of each page
(``write_page_checksum`` of pyarrow), else where they cannot be decoded. So is what overlaps or runs backwards in time.
Headers, units and the sidecar ``trials.toml`` are those of trial files (docs/reference/trials.md).

No window lies across a gap, moored, with a broken or a touched stretch. It is manoeuvring where rudder, revolutions or
turn rate changed in it; the others are steady. A window lasts as long as the ship takes for ``WINDOW`` lengths."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from cases.checks.breaks import SWINGING
from cases.checks.stretches import broken_stretches
from cases.criteria.measured_maneuvers import Execute, find_maneuvers, length_by_turns, ship_time, steering
from cases.io.campaigns import day_of
from cases.io.conventions import converted
from cases.io.read import match_headers
from cases.io.sidecar import NAME as SIDECAR
from cases.io.sidecar import SidecarEntry, read_sidecar, sidecar_entry
from cases.io.trial_table import checked_header
from cases.quantities import to_si
from cases.simulation.simulate import write_trial
from cases.trial import Span, Trial, inside, spans_left_out
from cases.trial_set import TrialSet
from mmg.errors import BadValue, Missing, Unreadable, UserError, reason
from mmg.messages import Message
from mmg.motion.flow import RUDDERS
from mmg.motion.froude import reference_speed

PIECE = 100_000  # Most rows that are held at a time. Set by hand: it bounds memory.


@dataclass
class OperationLog:
    """The readable parts of a ``folder``, in order of time. notices: what was converted or dropped, each sentence once;
    left_out: a sentence on every part that cannot be read."""

    folder: Path
    parts: list[Path] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def pieces(self) -> Iterator[dict[str, np.ndarray]]:
        """Canonical columns (N,) of at most PIECE rows: SI, radians, frames of the product, time increasing.

        All have the columns of the first part; one that a later part lacks is NaN there. A part that turns out to be
        damaged is left out from there on, which is said in ``left_out``. Raises UserError where no row is left.
        """
        last, any_row, names = -math.inf, False, list[str]()
        for part in self.parts:
            try:
                for columns in self._of(part):
                    names = names or list(columns)
                    if absent := [name for name in names if name not in columns]:
                        _once(self.notices, f"{part.name} has no {', '.join(absent)}, which parts before it have")
                    columns = {name: columns.get(name, np.full(len(columns["t"]), math.nan)) for name in names}
                    t = columns["t"]
                    good = np.isfinite(t)
                    # later than all rows before, those of the parts before included: overlaps are dropped
                    good &= t > np.maximum.accumulate(np.concatenate([[last], np.where(good, t, -math.inf)[:-1]]))
                    if not good.all():
                        _once(self.notices, f"{part.name}: rows without a time, or at a time that is past, are dropped")
                        columns = {name: values[good] for name, values in columns.items()}
                    if len(columns["t"]):
                        last, any_row = float(columns["t"][-1]), True
                        yield columns
            except UserError as error:
                _once(self.left_out, str(error))
        if not any_row:
            raise Unreadable(f"{self.folder}: no row can be read; {'; '.join(self.left_out[:3])}")

    def _of(self, path: Path) -> Iterator[dict[str, np.ndarray]]:
        import pyarrow as pa

        notices, entry = list[Message](), _entry(self.folder, path)
        try:
            for columns, factors in _batches(path, entry, notices, PIECE):
                if entry.sentinels:  # in units of the file, the columns are in SI
                    for name, values in columns.items():
                        values[np.isin(values, np.array(entry.sentinels) * factors[name])] = np.nan
                if not {*RUDDERS} & set(columns):
                    columns["delta"] = np.zeros(len(columns["t"]))  # windows are judged by a rudder as well
                for begin, end in entry.exclude or ():
                    keep = (columns["t"] < begin) | (columns["t"] > end)
                    columns = {name: values[keep] for name, values in columns.items()}
                if len(columns["t"]) > 1:
                    yield converted(columns, entry, notices)
        except (OSError, ValueError, pa.ArrowException) as error:
            raise Unreadable(f"{path}: is damaged ({reason(error)})") from None
        finally:
            for notice in notices:
                _once(self.notices, str(notice))


def _once(sentences: list[str], sentence: str) -> None:
    if sentence not in sentences:
        sentences.append(sentence)


def read_log(folder: str | Path) -> OperationLog:
    """The log in the Parquet files of ``folder`` and of the folders in it. Raises UserError where the folder does not
    exist, holds no Parquet file, or none that can be read."""
    import pyarrow as pa

    folder = Path(folder)
    if not folder.is_dir():
        raise Missing(f"{folder}: no such folder; give the folder of the Parquet files of the log")
    log, begins = OperationLog(folder), dict[Path, float]()
    files = sorted(path for path in folder.rglob("*.parquet") if path.is_file())
    if not files:
        raise Missing(f"{folder}: holds no .parquet files; write the log as Parquet, one file per day, say")
    for path in files:
        try:
            first, _ = next(_batches(path, _entry(folder, path), [], 1000, ["t"]))  # enough to put parts in order
            begins[path] = float(np.nanmin(first["t"], initial=math.inf))
        except UserError as error:
            log.left_out.append(str(error))
        except (OSError, ValueError, pa.ArrowException) as error:
            log.left_out.append(f"{path}: is damaged ({reason(error)})")
    if not begins:
        raise Unreadable(f"{folder}: no part can be read; {log.left_out[0]}")
    log.parts = sorted(begins, key=lambda path: (begins[path], path))
    return log


def _batches(
    path: Path, entry: SidecarEntry, notices: list[Message], rows: int, names: Sequence[str] = ()
) -> Iterator[tuple[dict[str, np.ndarray], dict[str, float]]]:
    """Columns (N,) in SI of at most ``rows`` rows of a part at a time, and the factors of their units; all, or only
    those of these ``names``. Raises UserError, and as pyarrow does for what is damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path, page_checksum_verification=True)
    if not file.metadata.num_rows:
        raise Unreadable(f"{path}: is damaged or empty (it has no rows)")
    header = checked_header(path, list(file.schema_arrow.names))
    matched = match_headers(path, header, entry, notices)
    wanted = {name: header[index] for name, (index, _) in matched.items() if name in names or not names}
    factors = {name: to_si(name, matched[name][1], f"{path}: column '{cell}'") for name, cell in wanted.items()}
    for batch in file.iter_batches(rows, columns=list(wanted.values())):
        if pa.types.is_timestamp(batch.column(wanted["t"]).type):
            factors["t"] = 1.0  # ``_numbers`` makes seconds of them, whatever unit the header has
        yield {n: _numbers(path, cell, batch.column(cell)) * factors[n] for n, cell in wanted.items()}, factors


def _entry(folder: Path, path: Path) -> SidecarEntry:
    """What the sidecar beside the part ``path``, or else in the ``folder`` of the log, says."""
    if not (path.parent / SIDECAR).exists() and (folder / SIDECAR).exists():
        return read_sidecar(folder / SIDECAR).entry(path)
    return sidecar_entry(path)


def _numbers(path: Path, cell: str, values: object) -> np.ndarray:
    """An Arrow array as floats (N,), NaN where it is null; time stamps become seconds since 1970."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = values.type  # type: ignore[attr-defined]
    if pa.types.is_timestamp(kind):
        stamps = pc.cast(pc.cast(values, pa.timestamp("us")), pa.int64())  # whole us: a double holds those since 1970
        return np.asarray(pc.cast(stamps, pa.float64(), safe=False).to_numpy(zero_copy_only=False)) / 1e6
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise BadValue(f"{path}: column '{cell}' holds {kind}, which is no number")
    return np.array(pc.cast(values, pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=float)


WINDOW = 15.0  # Length of a window in ship lengths travelled at the usual speed. Set by hand.
USUAL = 0.15  # Usual speed of a ship as a Froude number. Set by hand: 16 kn of a ship of 320 m.
# A ship slower than this Froude number, u / sqrt(g L), for half a window is moored, at anchor or adrift. Set by hand:
# 1.3 kn of a ship of 320 m.
STOPPED = 0.012
GAP = 2.5  # A step in time so many usual steps long is a gap. Set by hand.
# A window is manoeuvring where the rudder moves by this angle [rad] between its 5 % and 95 % quantiles, the revolutions
# by this share of their largest value in the log, or the heading by this angle [rad]. Set by hand: 4 deg, 8 %, 6 deg.
MOVED = {"rudder": 0.07, "n": 0.08, "turn": 0.1}
NEEDED = ("psi", "u", "v", "r", "n")  # Columns without which a row says nothing; rudders and wind count where logged


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
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    rows: int = 0
    begin: float = np.nan
    end: float = np.nan


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
            # of 30 rows at least: fewer hardly have the 5 % quantiles of ``_manoeuvring``
            cut.length = max(WINDOW * length / (USUAL * reference_speed(length)), 30 * cut.step)
        cut.rows, cut.end = cut.rows + len(t), float(t[-1])
        columns = _after(rest, piece)
        most = np.abs(columns["n"])
        revolutions = max(revolutions, float(np.quantile(most[np.isfinite(most)], 0.95)) if len(most) else 0.0)
        resume = _cut_piece(columns, cut, slowest, revolutions)
        rest = {name: values[resume:].copy() for name, values in columns.items()}  # a view would keep the whole piece
    if rest:
        _cut_piece(rest, cut, slowest, revolutions, last=True)
    return cut


def _cut_piece(
    columns: Mapping[str, np.ndarray], cut: Cut, slowest: float, revolutions: float, last: bool = False
) -> int:
    """Add the windows of ``columns`` (N,) to ``cut``; returns the row from which they are to be cut with what follows.
    slowest: speed below which a ship does not sail [m/s]; revolutions: largest usual ones; last: nothing follows."""
    t, rows = columns["t"], len(columns["t"])
    if not rows:
        return 0
    count = max(2, round(cut.length / cut.step))
    gap = np.diff(t) > GAP * cut.step
    needed = [name for name in columns if name in (*NEEDED, *RUDDERS, "wind_speed", "wind_direction")]
    missing = ~np.all([np.isfinite(columns[name]) for name in needed], axis=0)
    speed, half = np.hypot(columns["u"], columns["v"]), max(1, count // 2)
    # mean of the speeds that are known, multiplied by their share: where none is, she is not known to be moored
    moored = _mean(np.nan_to_num(speed), half) < slowest * _mean(np.isfinite(speed), half)
    state = np.where(moored, 1, np.where(missing, 2, 0))  # what lacks while she is moored is no loss
    resume = rows
    for first, end in stretches(state, gap):
        if state[first]:
            cut.seconds["moored" if state[first] == 1 else "missing values"] += (end - first) * cut.step
            continue
        resume = _windows_of(columns, first, end, cut, count, revolutions, open_end=end == rows and not last)
    cut.seconds["gaps"] += float(np.diff(t)[gap].sum())
    return resume


def _windows_of(
    columns: Mapping[str, np.ndarray], first: int, end: int, cut: Cut, count: int, revolutions: float, open_end: bool
) -> int:
    """Add the windows of the rows ``first`` to ``end`` under way; returns the row from which they go on."""
    trial = Trial("log", {name: values[first:end] for name, values in columns.items()})
    bad = np.zeros(end - first, dtype=int)  # number of the stretch that a row belongs to, by ``words``; 0: sound
    words = [""]
    for stretch in broken_stretches(trial) if end - first > count else ():  # shorter than a window: nothing to gain
        words.append("touched: " + stretch.what if SWINGING in stretch.what else "broken: " + stretch.what)
        bad[(trial.t >= stretch.begin_s) & (trial.t <= stretch.end_s)] = len(words) - 1
    resume = len(columns["t"])
    for a, b in stretches(bad, np.zeros(max(len(bad) - 1, 0), bool)):
        if bad[a]:
            cut.seconds[words[bad[a]]] += (b - a) * cut.step
            continue
        windows = (b - a) // count
        for k in range(windows):
            rows = slice(first + a + k * count, first + a + (k + 1) * count)
            manoeuvring = _manoeuvring({name: values[rows] for name, values in columns.items()}, revolutions)
            begin = float(columns["t"][rows.start])
            cut.windows.append(LogWindow(begin, float(columns["t"][rows.stop - 1]), manoeuvring))
            cut.seconds["manoeuvring" if manoeuvring else "steady"] += count * cut.step
        if open_end and b == len(bad):
            resume = first + a + windows * count  # what is no window yet goes on in the next piece
        else:
            cut.seconds["too short"] += (b - a - windows * count) * cut.step
    return resume


def _manoeuvring(rows: Mapping[str, np.ndarray], revolutions: float) -> bool:
    """Whether the ship is manoeuvred in these rows."""

    def span(values: np.ndarray) -> float:
        low, high = np.quantile(values, (0.05, 0.95))  # single samples that are off move no quantile
        return float(high - low)

    rudder = max(span(rows[name]) for name in RUDDERS if name in rows)
    return (
        rudder > MOVED["rudder"]
        or span(rows["n"]) > MOVED["n"] * max(revolutions, 1e-9)
        or span(np.unwrap(rows["psi"])) > MOVED["turn"]
    )


def stretches(state: np.ndarray, gap: np.ndarray) -> Iterator[tuple[int, int]]:
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
    rows = np.arange(len(values))  # at the ends the mean is of the neighbours that there are
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


# Shares of her highest speed below which a ship lies at rest, and above which she has accelerated. Set by hand.
AT_REST, UNDER_WAY = 0.1, 0.9


@dataclass(frozen=True)
class CutTrial:
    """A ``trial`` cut out of a record, on its clock. order: "10/10", "-35", "" for what has none; order_s: when it was
    given [s]; exclude: what the record's sidecar leaves out of it, None where that says nothing; remarks: in words."""

    trial: Trial
    order: str
    order_s: float
    exclude: tuple[Span, ...] | None
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """What ``mmg cut --json`` prints of it."""
        names = {"name": self.trial.name, "file": f"{self.trial.name}.csv", "kind": self.trial.kind}
        times = {"begin_s": float(self.trial.t[0]), "order_s": self.order_s, "end_s": float(self.trial.t[-1])}
        return {**names, "order": self.order, **times, "remarks": list(self.remarks)}


def cut_record(record: Trial, length: float | None = None, prefix: str = "") -> list[CutTrial]:
    """The manoeuvres in a ``record`` as trials, in the order of time.

    length: of the ship [m], None takes it from her turn rates; prefix: of their names. What is broken is bridged in
    looking for manoeuvres; the trials have all rows. Raises UserError where there is none.
    """
    (sound,) = TrialSet((replace(record, kind=""),)).sound
    length = length or length_by_turns(sound)
    unit, parts, why = ship_time(sound, length), list[CutTrial](), ""
    for first, end in stretches(np.zeros(len(sound)), np.diff(sound.t) > max(unit, GAP * sound.dt)):
        piece, zero, last = _rows(sound, slice(first, end)), float(sound.t[first]), float(sound.t[first])
        executes: tuple[Execute, ...] = ()
        try:
            executes = find_maneuvers(piece, length)
        except UserError as error:
            why = why or str(error)
        several = sorted([*executes, *_accelerations(piece, executes)], key=lambda e: e.order_time)
        orders = [zero + execute.order_time for execute in several]
        for execute, order, after in zip(several, orders, [*orders[1:], math.inf], strict=False):
            stop = min(zero + execute.end, after - sound.dt)  # no row belongs to two trials
            # the approach before the order is as long as a window, as the ship is to run straight at a steady speed
            parts.append(_part(record, max(order - WINDOW * unit, last), stop, replace(execute, order_time=order)))
            last = stop + 0.5 * sound.dt
    if not parts:
        raise Missing(why or f"{record.name}: no manoeuvre found")
    parts.sort(key=lambda part: float(part.trial.t[0]))
    named = []
    for number, part in enumerate(parts, 1):
        words = [f"{prefix}{number:02d}", part.trial.kind, *part.order.split("/")]
        named.append(replace(part, trial=replace(part.trial, name="_".join(filter(None, words)))))
    return named


def _rows(trial: Trial, rows: slice | np.ndarray) -> Trial:
    columns = {name: values[rows] for name, values in trial.columns.items()}
    return replace(trial, columns=columns, whole=None, meta={**trial.meta, "bridged": ""})


def _part(record: Trial, begin: float, end: float, execute: Execute) -> CutTrial:
    """The rows of the ``record`` from ``begin`` to ``end`` [s]."""
    complete = record.whole or record
    trial = replace(_rows(complete, inside(complete, [(begin, end)])), kind=execute.kind)
    left_out = tuple((max(a, begin), min(b, end)) for a, b in spans_left_out(record) if a < end and b > begin)
    exclude = left_out if "left_out" in record.meta else None
    return CutTrial(trial, execute.order, execute.order_time, exclude, (*execute.notes, *execute.caveats))


def _accelerations(trial: Trial, others: Sequence[Execute]) -> list[Execute]:
    """Where the ship of a ``trial`` gathers way from rest, but for what belongs to ``others``."""
    t, u, n = trial.t - trial.t[0], np.nan_to_num(trial["u"]), np.nan_to_num(steering(trial)[1])
    fast, ahead, executes = float(u.max()), n > 0.05 * float(n.max()), []
    moves = (u > AT_REST * fast).astype(int)
    for start in np.flatnonzero(np.diff(moves) > 0) + 1 if fast > 0 else ():
        later = np.flatnonzero(moves[start:] == 0)
        end = start + (int(later[0]) if len(later) else len(u) - start)
        under_way = np.flatnonzero(u[start:end] >= UNDER_WAY * fast)
        if not len(under_way) or not ahead[start]:
            continue
        # she was ordered ahead where the revolutions last were not, before she moved
        order = int(np.flatnonzero(~ahead[:start])[-1]) if not ahead[:start].all() else 0
        a, b = float(t[order]), float(t[start + under_way[0]])
        if all(b < other.order_time or a > other.end for other in others):
            executes.append(Execute("acceleration", a, 0.0, (), b, 0.0, math.nan, ()))
    return executes


# Keys of a sidecar that say how a file is converted: the trials are canonical.
CONVERTED = {"columns", "units", "sign", "rudder_positive", "wind_direction", "velocity_frame", "heading_from", "lag",
             "sentinels", "reference_point", "name"}  # fmt: skip


def write_cut(parts: Sequence[CutTrial], folder: Path) -> None:
    """Write ``parts`` into an existing ``folder``, each as a canonical file, and what the sidecars of their records say
    of them as ``trials.toml``. Raises UserError where that is not possible."""
    import tomlkit

    files: dict[str, dict[str, Any]] = {}
    for part in parts:
        trial = part.trial
        of_record = SidecarEntry() if trial.path is None else sidecar_entry(trial.path)
        entry = of_record.model_dump(exclude_unset=True, exclude=CONVERTED)
        entry |= {"kind": trial.kind, "day": day_of(trial)}
        entry |= {} if part.exclude is None else {"exclude": [list(span) for span in part.exclude]}
        files[f"{trial.name}.csv"] = {key: value for key, value in entry.items() if value or key == "exclude"}
        in_file = json.loads(trial.meta.get("labels", "{}")) or trial.columns  # the rest is derived on reading again
        logged = {name: values for name, values in trial.columns.items() if name in in_file}
        write_trial(replace(trial, columns=logged), folder / f"{trial.name}.csv")
    words = "# Written by mmg cut; the files are canonical (SI, radians)\n"
    (folder / SIDECAR).write_text(words + tomlkit.dumps({"files": files}), encoding="utf-8")
