"""NMEA 0183 logs as a table: each talker and sentence is a time series, one of each quantity is used, all are named."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.importing.import_map import ImportMap, magnetic
from cases.importing.nmea_clock import Series, logger_of, moments
from cases.importing.nmea_receivers import ALIKE, Fixes, Receiver, merged, receivers_of
from cases.importing.nmea_sentences import DECODERS, POSITIONS, checksum, field_names, said_by
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable, raw_table
from cases.io.files import read_bytes
from mmg.errors import Missing
from mmg.messages import Message

CHECKSUM = "checksum wrong"
"""Why a sentence is left out."""
SENTENCE = re.compile(r"[$!](P[A-Z0-9]{2,9}|[A-Z][A-Z0-9][A-Z]{3}),([^*$!]*)(?:\*([0-9A-Fa-f]{2}))?")
TAG = re.compile(r"\\(?:[^\\]*,)?s:([^,*\\]+)[^\\]*\\")
"""The source of a tag block of NMEA 4."""
UNITS = {
    "time": "s", "latitude": "deg", "longitude": "deg", "sog": "kn", "cog": "deg", "heading": "deg", "rot": "deg/min",
    "u": "kn", "v": "kn", "rudder": "deg", "rudder_starboard": "deg", "rudder_port": "deg", "rpm": "rpm",
    "rpm_starboard": "rpm", "rpm_port": "rpm", "apparent_wind_speed": "m/s", "apparent_wind_direction": "deg",
    "true_wind_speed": "m/s", "twa": "deg", "twd": "deg", "RPM-E": "rpm", "RPM-E_starboard": "rpm",
    "RPM-E_port": "rpm",
}  # fmt: skip
"""Columns of the table and their units."""
TOGETHER = (
    ("rot",), ("u", "v"), ("rudder", "rudder_starboard"), ("rudder", "rudder_port"), ("rpm",), ("rpm_starboard",),
    ("rpm_port",), ("RPM-E",), ("RPM-E_starboard",), ("RPM-E_port",),
    ("apparent_wind_speed", "apparent_wind_direction"), ("true_wind_speed", "twa", "twd"),
)  # fmt: skip
"""Columns that are taken from one source: that which says one of them most often."""
SHAFTS, RUDDERS = ("rpm", "rpm_starboard", "rpm_port"), ("rudder_starboard", "rudder_port")
TRUE = ("HDT", "THS"), ("VHW",)
"""Sentences with a true heading, the better first."""
MOVES = 1.0
"""Per cent of the largest pitch by which blades move at least: the least step that RPM says."""


def is_nmea(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` hold a sentence."""
    lines = [line for line in content[:8192].decode("latin-1").splitlines() if line.strip()]
    return len(lines) > 2 and sum(bool(SENTENCE.search(line)) for line in lines) > 0.5 * len(lines)


def read_nmea(path: Path, chosen: ImportMap | None = None) -> RawTable:
    """The table of the log ``path``: a row for each moment at which something that is used was said.

    chosen: the map, of which ``variation`` and ``zone_hours`` are used. What became of each talker and sentence is in
    the ``accounts`` of the table. Raises UserError where pynmeagps is missing, where neither a sentence nor a logger
    tells a time, and where the times run backwards.
    """
    chosen = chosen or ImportMap()
    heard, texts, left = _heard(path, chosen.ignored_in(path))
    when = moments(heard, logger_of(texts), str(path), chosen.zone_hours or 0.0)
    log = _Log(heard, when.t, left, list(when.notices))
    log.take_positions()
    log.take_headings(chosen.variation)
    log.take_others()
    for name in SHAFTS:
        log.see_blades(name)
    return log.table(path, when.absolute, when.words)


def _heard(path: Path, ignored: set[str]) -> tuple[dict[str, Series], list[str], Counter[tuple[str, str]]]:
    """The series of the log ``path`` by talker, sentence and instrument, what stands beside each of its sentences, and
    how many were left out: by sentence and why. ignored: sentences that the map does not want."""
    field_names()
    heard: dict[str, Series] = {}
    left: Counter[tuple[str, str]] = Counter()
    texts: list[str] = []
    for line in read_bytes(path).decode("latin-1").splitlines():
        end, count = 0, len(texts)
        for match in SENTENCE.finditer(line):
            before, head = line[end : match.start()], match[1]
            end = match.end()
            kind = head[2:]
            right = match[3] is None or checksum(match[0][1:-3]) == int(match[3], 16)
            if match[0][0] == "!" or head[0] == "P" or kind not in DECODERS:
                left[head, NOT_READ if right else CHECKSUM] += 1
                continue
            if head in ignored:
                left[head, "ignored by the map"] += 1
                continue
            tag = TAG.search(before)
            source = f"{head} of {tag[1]}" if tag else head
            why = CHECKSUM
            said = None
            if right:
                try:
                    said = said_by(kind, match[2])
                except (ValueError, OverflowError):
                    why = "damaged"
            if said is None:
                left[source, why] += 1
                if source in heard:  # it keeps its place in the order
                    heard[source].at.append(len(texts))
                    heard[source].time.append(np.nan)
                    heard[source].values.append({})
                    texts.append(before)
                continue
            name = f"{source} {said.instrument}" if said.instrument else source
            series = heard.setdefault(name, Series(head[:2], kind))
            series.at.append(len(texts))
            series.time.append(said.time)
            series.values.append({} if said.why else said.values)
            texts.append(before if before.strip() or count != len(texts) else line[end:])
            if said.why:
                left[name, said.why] += 1
            for part, why in said.aside:
                left[f"{name} {part}", why] += 1
        if not end and line.strip():
            left["lines", "damaged or no sentence"] += 1
    return heard, texts, left


class _Log:
    """A log of which the sources are chosen one after the other; heard, t: the series and their times."""

    def __init__(
        self,
        heard: dict[str, Series],
        t: dict[str, np.ndarray],
        left: Counter[tuple[str, str]],
        notices: list[Message],
    ) -> None:
        self.heard, self.t, self.notices = heard, t, notices
        self.taken: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # column -> times and values
        self.used: dict[str, list[str]] = {name: [] for name in heard}
        self.why: dict[str, str] = {}
        self.left = left

    def said(self, name: str, column: str, rows: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Times and values (N,) of a column that the series says, in order; rows: of it alone."""
        t, values = self.t[name], self.heard[name].column(column)
        good = np.flatnonzero(np.isfinite(values) & np.isfinite(t))
        good = good if rows is None else np.intersect1d(good, rows)
        good = good[np.argsort(t[good], kind="stable")]
        return t[good], values[good]

    def take(self, column: str, name: str, said: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """Use what a series ``said`` as a ``column``."""
        self.taken[column] = merged([said or self.said(name, column)])
        self.used[name].append(column)

    def leave(self, name: str, why: str) -> None:
        if not self.used[name]:
            self.why[name] = why

    def take_positions(self) -> None:
        """Latitude and longitude of one receiver, and the speed and course over ground that it says."""
        fixes = []
        for name, series in self.heard.items():
            if series.kind in POSITIONS and len(self.said(name, "latitude")[0]):
                rows = np.flatnonzero(np.isfinite(series.column("latitude")) & np.isfinite(self.t[name]))
                rows = rows[np.argsort(self.t[name][rows], kind="stable")]
                parts = [series.column(c)[rows] for c in ("latitude", "longitude", "decimals", "quality")]
                fixes.append(Fixes(name, series.talker, rows, self.t[name][rows], *parts))
        receivers = receivers_of(fixes)
        used = receivers[0] if receivers else None
        if used is not None:
            for i, column in enumerate(("latitude", "longitude")):
                self.taken[column] = merged([(f.t, (f.latitude, f.longitude)[i]) for f in used.same])
            for f in used.same:
                self.used[f.name] += [c for c in ("latitude", "longitude") if c not in self.used[f.name]]
            for f in used.fixes:
                self.leave(f.name, f"the same receiver as {used.same[0].name}, whose fix is used")
        for other in receivers[1:]:
            self._leave_receiver(other)
        self._take_speeds(used, receivers[1:])

    def _leave_receiver(self, other: Receiver) -> None:
        off = "" if other.distance is None else f" {other.distance:.{0 if other.distance >= 10 else 1}f} m off"
        for f in other.fixes:
            why = f"second receiver{off}" if off else "another receiver, not heard at the same time"
            if self.used[f.name]:  # two receivers behind one talker
                self.left[f.name, why] += len(f)
            else:
                self.why[f.name] = why

    def _take_speeds(self, used: Receiver | None, others: Sequence[Receiver]) -> None:
        """Speed and course of the receiver that is ``used``: RMC with its position, or VTG of its talkers."""
        own = {f.name: f.index for f in used.fixes} if used else {}
        talkers = {f.talker for f in used.fixes} if used else set()
        foreign = {f.talker for other in others for f in other.fixes}
        speeds = {}
        for name, series in self.heard.items():
            if series.kind not in ("RMC", "VTG") or not len(self.said(name, "sog")[0]):
                continue
            if name in own:
                speeds[name] = own[name]
            elif series.talker in foreign:
                what = "of one of two receivers" if series.talker in talkers else "of the second receiver"
                self.why.setdefault(name, what)
            elif series.kind == "VTG" or used is None:
                speeds[name] = np.arange(len(series.at))
        most = max(map(len, speeds.values()), default=0)
        names = sorted(speeds, key=lambda n: (len(speeds[n]) < ALIKE * most, self.heard[n].kind != "RMC"))
        for column in ("sog", "cog"):
            said = {n: self.said(n, column, speeds[n]) for n in names}
            said = {n: values for n, values in said.items() if len(values[0])}
            if said:
                self.taken[column] = merged(list(said.values()))
                for name in said:
                    self.used[name].append(column)

    def take_headings(self, variation: float | None) -> None:
        """The true heading that is said most often, or a magnetic one with a variation: that of the map, its own at
        other times, or that of a receiver."""
        names = [
            n for n in self.heard if self.heard[n].kind in (*TRUE[0], *TRUE[1]) and len(self.said(n, "heading")[0])
        ]
        rank = {n: (self.heard[n].kind in TRUE[1], -len(self.said(n, "heading")[0])) for n in names}
        if names:
            first, *rest = sorted(names, key=lambda n: rank[n])
            self.take("heading", first)
            self._not_taken(rest, "heading", first)
        compasses = [n for n in self.heard if self.heard[n].kind in ("HDG", "HDM")]
        compasses = sorted((n for n in compasses if len(self.said(n, "magnetic")[0])), key=lambda n: -len(self.t[n]))
        for name in compasses:
            if "heading" in self.taken:
                self.leave(name, f"magnetic; the true heading of {self._of('heading')} is used")
                continue
            t, values = self.said(name, "magnetic")
            known, of = self._variation(name, variation)
            if known is None:
                self.leave(name, magnetic(self.heard[name].kind))
                continue
            self.take("heading", name, (t, (values + np.interp(t, *known)) % 360.0))
            self.why[name] = f"with the variation {of}, {float(np.median(known[1])):.3g} deg"

    def _variation(self, name: str, said: float | None) -> tuple[tuple[np.ndarray, np.ndarray] | None, str]:
        """Times and variations [deg] for a magnetic heading, and whose they are. Zeros alone stand for none: receivers
        without a model of the earth's field write them."""
        if said is not None:
            return (np.zeros(1), np.full(1, said)), "of the map"
        for other in (name, *(n for n in self.heard if self.heard[n].kind in ("HDG", "RMC"))):
            t, values = self.said(other, "variation")
            if values.any():
                return (t, values), f"of {other}"
        return None, ""

    def take_others(self) -> None:
        """Of what several sources say, the one that says it most often."""
        for group in TOGETHER:
            counts = {n: max(len(self.said(n, column)[0]) for column in group) for n in self.heard}
            best = max(counts, key=lambda n: counts[n], default="")
            if not best or not counts[best]:
                continue
            for column in group:
                if len(self.said(best, column)[0]) and column not in self.taken:
                    self.take(column, best)
            self._not_taken([n for n in counts if counts[n] and n != best], group[0], best)
        self._one_rudder()
        if any(name in self.taken for name in SHAFTS):
            self._drop([c for c in self.taken if c.startswith("RPM-E")], "of an engine; the shaft is used")

    def _one_rudder(self) -> None:
        """One of two sensors is the rudder where the other does not speak, or stays at zero."""
        both = [c for c in RUDDERS if c in self.taken]
        moving = [c for c in both if self.taken[c][1].any()]
        if len(both) == 2 and len(moving) == 1:
            self._drop([c for c in both if c not in moving], "always zero, where the other one moves")
            both = moving
        if len(both) == 1 and "rudder" not in self.taken:
            self._rename(both[0], "rudder")
        shafts = [c for c in SHAFTS if c in self.taken]
        if len(shafts) == 1:
            self._rename(shafts[0], "rpm")

    def see_blades(self, column: str) -> None:
        """Say where the blades of a propeller move: revolutions alone do not tell its thrust then."""
        for name in self.heard:
            pitch = self.said(name, f"blades {column}")[1]
            if len(pitch) and np.ptp(pitch) > MOVES:
                words = f"pitch from {pitch.min():g} to {pitch.max():g} % of its largest, whose angle is not said"
                self.left[f"{name} pitch", words] += len(pitch)
                said = f"{name}: the blades of the propeller move, {words}; revolutions alone do not tell its thrust"
                self.notices.append(Message(said, "pitch_moves"))

    def _of(self, column: str) -> str:
        return next(name for name, columns in self.used.items() if column in columns)

    def _not_taken(self, names: Sequence[str], column: str, best: str) -> None:
        for name in names:
            self.leave(name, f"{column} is taken from {best}, which says it more often or is heard first")

    def _rename(self, old: str, new: str) -> None:
        if old != new:
            self.taken[new] = self.taken.pop(old)
            self.used = {name: [new if c == old else c for c in columns] for name, columns in self.used.items()}

    def _drop(self, columns: Sequence[str], why: str) -> None:
        for column in columns:
            del self.taken[column]
            for name, used in self.used.items():
                if column in used:
                    used.remove(column)
                    if used:
                        self.left[f"{name} {column}", why] += len(self.said(name, column)[0])
                    else:
                        self.why[name] = why

    def accounts(self) -> tuple[Account, ...]:
        """What became of every talker and sentence."""
        rows = []
        for name, series in self.heard.items():
            valid, why = sum(map(bool, series.values)), self.why.get(name, "")
            valid -= sum(count for (one, other), count in self.left.items() if one == name and "receiver" in other)
            used = tuple(self.used[name]) or (() if why or series.kind != "ZDA" else ("time",))
            if valid:
                rows.append(Account(name, valid, used, why if why or used else NOT_READ))
        return (*rows, *(Account(name, count, (), why) for (name, why), count in self.left.items()))

    def table(self, path: Path, absolute: bool, words: str) -> RawTable:
        """The columns on the times of all of them, with the accounts."""
        import pandas as pd

        accounts = self.accounts()
        names = [name for name in UNITS if name in self.taken]
        if not names:
            raise Missing(f"{path}: no sentence is used: {'; '.join(map(str, accounts[:20]))}")
        t = np.unique(np.concatenate([np.round(self.taken[name][0], 3) for name in names]))
        columns = {"time": t}
        for name in names:
            columns[name] = np.full(len(t), np.nan)
            columns[name][np.searchsorted(t, np.round(self.taken[name][0], 3))] = self.taken[name][1]
        units = [UNITS[name] for name in columns]
        frame = pd.DataFrame(columns).astype(object)
        table = raw_table(path, str(path), list(columns), units, frame, [*_messages(accounts), *self.notices])
        return replace(table, clock=Clock(t, absolute, "time", words), accounts=accounts)


def _messages(accounts: Sequence[Account]) -> list[Message]:
    """The accounts as notices: of what is used, what is not valid, damaged, doubled, and not read."""
    groups: dict[str, list[str]] = {}
    for account in accounts:
        if account.used_as:
            code = "nmea"
        elif account.why in (CHECKSUM, "damaged", "damaged or no sentence"):
            code = "nmea_damaged"
        elif account.why == NOT_READ:
            code = "nmea_not_read"
        elif account.why.startswith(("status", "mode", "quality", "empty", "no hemisphere")):
            code = "nmea_void"
        else:
            code = "doubled"
        groups.setdefault(code, []).append(str(account))
    return [Message("; ".join(lines), code) for code, lines in groups.items()]
