"""A log of months in the Parquet files of a folder, read in pieces in order of time; never as a whole.

A part that is damaged is left out and said: overwritten bytes are seen where its writer kept a checksum of each page
(``write_page_checksum`` of pyarrow), else where they cannot be decoded. So is what overlaps or runs backwards in time.
Headers, units and the sidecar ``trials.toml`` are those of trial files (docs/reference/trials.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cases.io.conventions import converted
from cases.io.headers import match_headers
from cases.io.sidecar import NAME, SidecarEntry, read_sidecar, sidecar_entry
from cases.io.trial_table import checked_header
from cases.io.units import to_si
from cases.trial import RUDDERS
from mmg.errors import BadValue, Missing, Unreadable, UserError
from mmg.messages import Message

PIECE = 100_000
"""Most rows that are held at a time."""


@dataclass(frozen=True)
class Part:
    """One Parquet file of a log. path: of it; begin: time of its first row [s]."""

    path: Path
    begin: float


@dataclass
class OperationLog:
    """The readable parts of a ``folder``, in order of time.

    notices: what was converted or dropped, each sentence once; left_out: a sentence on every part that cannot be read.
    """

    folder: Path
    parts: list[Part] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def pieces(self) -> Iterator[dict[str, np.ndarray]]:
        """Canonical columns (N,) of at most PIECE rows: SI, radians, frames of the product, time increasing.

        All have the columns of the first part; one that a later part lacks is NaN there. A part that turns out to be
        damaged is left out from there on, which is said in ``left_out``. Raises UserError
        where no row is left.
        """
        last, any_row, names = -math.inf, False, list[str]()
        for part in self.parts:
            try:
                for columns in self._of(part):
                    names = names or list(columns)
                    if absent := [name for name in names if name not in columns]:
                        self._say(f"{part.path.name} has no {', '.join(absent)}, which parts before it have")
                    columns = {name: columns.get(name, np.full(len(columns["t"]), math.nan)) for name in names}
                    t = columns["t"]
                    good = np.isfinite(t)
                    good &= t > np.maximum.accumulate(np.concatenate([[last], np.where(good, t, -math.inf)[:-1]]))
                    if not good.all():
                        self._say(f"{part.path.name}: rows without a time, or at a time that is past, are dropped")
                        columns = {name: values[good] for name, values in columns.items()}
                    if len(columns["t"]):
                        last, any_row = float(columns["t"][-1]), True
                        yield columns
            except UserError as error:
                self._leave_out(str(error))
        if not any_row:
            raise Unreadable(f"{self.folder}: no row can be read; {'; '.join(self.left_out[:3])}")

    def _of(self, part: Part) -> Iterator[dict[str, np.ndarray]]:
        import pyarrow as pa
        import pyarrow.parquet as pq

        path, notices = part.path, list[Message]()
        entry = _entry(self.folder, path)
        try:
            file = pq.ParquetFile(path, page_checksum_verification=True)
            header = checked_header(path, list(file.schema_arrow.names))
            matched = match_headers(path, header, entry, notices)
            wanted = {name: header[index] for name, (index, _) in matched.items()}
            factors = {name: to_si(name, unit, f"{path}: column '{wanted[name]}'")
                       for name, (_, unit) in matched.items()}  # fmt: skip
            for batch in file.iter_batches(PIECE, columns=list(wanted.values())):
                if pa.types.is_timestamp(batch.column(wanted["t"]).type):
                    factors["t"] = 1.0
                columns = {
                    name: _numbers(path, cell, batch.column(cell)) * factors[name] for name, cell in wanted.items()
                }
                if entry.sentinels:
                    for name, values in columns.items():
                        values[np.isin(values, np.array(entry.sentinels) * factors[name])] = np.nan
                if not {*RUDDERS} & set(columns):
                    columns["delta"] = np.zeros(len(columns["t"]))
                for begin, end in entry.exclude or ():
                    keep = (columns["t"] < begin) | (columns["t"] > end)
                    columns = {name: values[keep] for name, values in columns.items()}
                if len(columns["t"]) > 1:
                    yield converted(columns, entry, notices)
        except (OSError, ValueError, pa.ArrowException) as error:
            raise Unreadable(f"{path}: is damaged ({_short(error)})") from None
        finally:
            for notice in notices:
                self._say(str(notice))

    def _say(self, sentence: str) -> None:
        if sentence not in self.notices:
            self.notices.append(sentence)

    def _leave_out(self, sentence: str) -> None:
        if sentence not in self.left_out:
            self.left_out.append(sentence)


def read_log(folder: str | Path) -> OperationLog:
    """The log in the Parquet files of ``folder`` and of the folders in it.

    Raises UserError where the folder does not exist, holds no Parquet file, or none that can be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = Path(folder)
    if not folder.is_dir():
        raise Missing(f"{folder}: no such folder; give the folder of the Parquet files of the log")
    log = OperationLog(folder)
    files = sorted(path for path in folder.rglob("*.parquet") if path.is_file())
    if not files:
        raise Missing(f"{folder}: holds no .parquet files; write the log as Parquet, one file per day, say")
    for path in files:
        try:
            file = pq.ParquetFile(path, page_checksum_verification=True)
            if not file.metadata.num_rows:
                raise Unreadable(f"{path}: is damaged or empty (it has no rows)")
            header = checked_header(path, list(file.schema_arrow.names))
            index, unit = match_headers(path, header, _entry(folder, path), [])["t"]
            first = next(file.iter_batches(1000, columns=[header[index]])).column(0)
            times = _numbers(path, header[index], first)
            scale = 1.0 if pa.types.is_timestamp(first.type) else to_si("t", unit, f"{path}: column '{header[index]}'")
            begin = float(np.nanmin(times, initial=math.inf)) * scale
            log.parts.append(Part(path, begin))
        except UserError as error:
            log.left_out.append(str(error))
        except (OSError, ValueError, StopIteration, pa.ArrowException) as error:
            log.left_out.append(f"{path}: is damaged ({_short(error)})")
    if not log.parts:
        raise Unreadable(f"{folder}: no part can be read; {log.left_out[0]}")
    log.parts.sort(key=lambda part: (part.begin, part.path))
    return log


def _entry(folder: Path, path: Path) -> SidecarEntry:
    """What the sidecar beside the part ``path``, or else in the ``folder`` of the log, says."""
    if not (path.parent / NAME).exists() and (folder / NAME).exists():
        return read_sidecar(folder / NAME).entry(path)
    return sidecar_entry(path)


def _numbers(path: Path, cell: str, values: object) -> np.ndarray:
    """An Arrow array as floats (N,), NaN where it is null; time stamps become seconds since 1970."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = values.type  # type: ignore[attr-defined]
    if pa.types.is_timestamp(kind):
        stamps = pc.cast(pc.cast(values, pa.timestamp("us")), pa.int64())
        return np.asarray(pc.cast(stamps, pa.float64(), safe=False).to_numpy(zero_copy_only=False)) / 1e6
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise BadValue(f"{path}: column '{cell}' holds {kind}, which is no number")
    return np.array(pc.cast(values, pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=float)


def _short(error: object) -> str:
    return " ".join(str(error).split())[:120]
