"""NMEA 0183 logs as a table: each talker and sentence is a time series, one of each quantity is used, all are named."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.nmea_clock import Series, logger_of, moments_of
from cases.importing.nmea_receivers import ALIKE, Fixes, Receiver, merged, receivers_of
from cases.importing.nmea_sentences import DECODERS, Decoded, checksum, decoded, field_names
from cases.importing.raw_table import NOT_READ, Account, Clock, RawTable, raw_table
from cases.importing.series import mostly
from cases.io.files import read_bytes
from mmg.errors import Missing
from mmg.messages import Message

CHECKSUM = "checksum wrong"
"""Why a sentence is rejected out."""
SENTENCE = re.compile(r"[$!](P[A-Z0-9]{2,9}|[A-Z][A-Z0-9][A-Z]{3}),([^*$!]*)(?:\*([0-9A-Fa-f]{2}))?")
TAG = re.compile(r"\\(?:[^\\]*,)?s:([^,*\\]+)[^\\]*\\")
"""The source of a tag block of NMEA 4."""
_COLUMNS = {
    "deg": "latitude longitude cog heading heading_magnetic variation rudder rudder_starboard rudder_port "
    "apparent_wind_direction twa twd",
    "kn": "sog u v", "deg/min": "rot", "m/s": "apparent_wind_speed true_wind_speed",
    "rpm": "rpm rpm_starboard rpm_port RPM-E RPM-E_starboard RPM-E_port",
}  # fmt: skip
UNITS = {column: unit for unit, columns in _COLUMNS.items() for column in columns.split()}
"""Columns of the table and their units."""
TOGETHER = (
    "heading", "heading_magnetic", "u v", "apparent_wind_speed apparent_wind_direction", "true_wind_speed twa twd",
    "rot", "rudder", "rudder_starboard", "rudder_port", *_COLUMNS["rpm"].split(),
)  # fmt: skip
"""Columns that are taken from one source: that which says one of them most often."""
SHAFTS, RUDDERS = ("rpm", "rpm_starboard", "rpm_port"), ("rudder_starboard", "rudder_port")
BETTER = {"heading_magnetic": ("heading",)} | {f"RPM-E{side}": SHAFTS for side in ("", "_starboard", "_port")}
"""Column -> those beside which it is not used: a true heading, the shafts of engines."""
CODES = (
    ("nmea_damaged", "checksum|damaged"), ("nmea_not_read", NOT_READ),
    ("nmea_void", "status|mode|quality|empty|no hemisphere"),
)  # fmt: skip
"""Codes of messages, and the first words of why sentences are not used."""
MOVES = 1.0
"""Per cent of the largest pitch by which blades move at least: the least step that RPM says."""
Samples = tuple[np.ndarray, np.ndarray]
"""Times [s] and values (M,)."""


def is_nmea(content: bytes) -> bool:
    """Whether most lines of the begin of ``content`` hold a sentence."""
    return mostly(content, SENTENCE)


def read_nmea(path: Path, chosen: ImportMap | None = None) -> RawTable:
    """The table of the log ``path``: a row for each moment at which something that is used was said.

    chosen: the map, of which ``zone_hours`` and ``ignore`` are used. What became of each talker and
    sentence is in the ``accounts`` of the table. Raises UserError where pynmeagps is missing, where neither a sentence
    nor a logger tells a time, where the times run backwards, and where no sentence is used.
    """
    chosen = chosen or ImportMap()
    series, prefixes, rejected = _parsed(path, chosen.ignored_in(path))
    try:
        t, clock, notices = moments_of(series, logger_of(prefixes), str(path), chosen.zone_hours or 0.0)
    except Missing as error:
        why = (f"{name} {count}: {why}" for (name, why), count in rejected.most_common(12))
        raise Missing(f"{error}; left out: {', '.join(why) or 'none'}") from None
    log = _Selection(series, t, rejected)
    log.select_positions()
    log.select_others()
    return log.table(path, clock, notices)


def _parsed(path: Path, ignored: set[str]) -> tuple[dict[str, Series], list[str], Counter[tuple[str, str]]]:
    """The series of the log ``path`` by talker, sentence and instrument, what stands before (or behind) each of their
    sentences, and counts of what is rejected, by sentence and why. ignored: sentences that the map does not want."""
    field_names()
    by_name: dict[str, Series] = {}
    rejected: Counter[tuple[str, str]] = Counter()
    prefixes: list[str] = []
    for line in read_bytes(path).decode("latin-1").splitlines():
        end = 0
        for match in SENTENCE.finditer(line):
            prefix, head, kind = line[end : match.start()], match[1], match[1][2:]
            prefix = prefix if prefix.strip() or end else line[match.end() :]
            end = match.end()
            right = match[3] is None or checksum(match[0][1:-3]) == int(match[3], 16)
            known = match[0][0] == "$" and head[0] != "P" and kind in DECODERS
            if not known or head in ignored:
                rejected[head, "ignored by the map" if known else NOT_READ if right else CHECKSUM] += 1
                continue
            tag = TAG.search(prefix)
            source = f"{head} of {tag[1]}" if tag else head
            try:
                sentence = decoded(kind, match[2]) if right else Decoded({}, CHECKSUM)
            except (ValueError, OverflowError):
                sentence = Decoded({}, "damaged")
            name = f"{source} {sentence.instrument}" if sentence.instrument else source
            series = by_name.setdefault(name, Series(head[:2], kind))  # what is not valid keeps its place in the order
            series.at.append(len(prefixes))
            series.time.append(sentence.time)
            series.values.append({} if sentence.why else sentence.values)
            prefixes.append(prefix)
            aside = [(f"{name} {part}", why) for part, why in sentence.aside]
            rejected.update([(name, sentence.why), *aside] if sentence.why else aside)
        if not end and line.strip():
            rejected["lines", "damaged or no sentence"] += 1
    return by_name, prefixes, rejected


class _Selection:
    """The choice of a source for each column of a log.

    series, t: by name, and their times; rejected: counts by (sentence, why); columns: samples of those that are chosen;
    used: columns by series; why: what else is to be said of a series.
    """

    def __init__(self, series: dict[str, Series], t: dict[str, np.ndarray], rejected: Counter[tuple[str, str]]) -> None:
        self.series, self.t, self.rejected = series, t, rejected
        self.columns: dict[str, Samples] = {}
        self.used: dict[str, list[str]] = {name: [] for name in series}
        self.why: dict[str, str] = {}
        self.warnings: list[Message] = []

    def rows(self, name: str, column: str) -> np.ndarray:
        """Rows (M,) of a series that hold a column, in the order of their times."""
        good = np.flatnonzero(np.isfinite(self.series[name].column(column)) & np.isfinite(self.t[name]))
        return good[np.argsort(self.t[name][good], kind="stable")]

    def samples(self, name: str, column: str, rows: np.ndarray | None = None) -> Samples:
        """Of a column of a series; rows: of it alone."""
        own = self.rows(name, column)
        own = own if rows is None else own[np.isin(own, rows)]
        return self.t[name][own], self.series[name].column(column)[own]

    def sources(self, *columns: str) -> list[str]:
        """The series that hold one of the ``columns``, that with most samples first, a water log (VHW) last."""
        counts = {name: max(len(self.rows(name, column)) for column in columns) for name in self.series}
        names = (name for name in counts if counts[name])
        return sorted(names, key=lambda name: (self.series[name].kind == "VHW", -counts[name]))

    def select(self, column: str, samples: dict[str, Samples]) -> None:
        """Use ``samples`` of the first series as a column, and of others where it is silent."""
        self.columns[column] = merged(list(samples.values()))
        for name in samples:
            self.used[name].append(column)

    def reject(self, names: Sequence[str], why: str) -> None:
        """Say ``why`` series are not used, of which nothing is said yet."""
        for name in names:
            self.why.setdefault(name, why)

    def select_positions(self) -> None:
        """Latitude and longitude of one receiver, and its speed and course over ground."""
        fixes = []
        for name in self.sources("latitude"):
            rows, series = self.rows(name, "latitude"), self.series[name]
            parts = [series.column(c)[rows] for c in ("latitude", "longitude", "decimals", "quality")]
            fixes.append(Fixes(name, rows, self.t[name][rows], *parts))
        receivers = receivers_of(sorted(fixes, key=lambda f: self.series[f.name].at[0]))
        for used in receivers[:1]:
            self.select("latitude", {f.name: (f.t, f.latitude) for f in used.fixes})
            self.select("longitude", {f.name: (f.t, f.longitude) for f in used.fixes})
        for other in receivers[1:]:
            off = ", not heard at the same time" if other.distance is None else f" {other.distance:.3g} m off"
            for f in other.fixes:
                why = f"second receiver{off}"
                if self.used[f.name]:  # two receivers behind one talker
                    self.rejected[f.name, why] += len(f)
                else:
                    self.why[f.name] = why
        self._select_speeds(receivers)

    def _select_speeds(self, receivers: Sequence[Receiver]) -> None:
        """Speed and course of the first of the ``receivers``: RMC with its position, or VTG of its talkers."""
        own = {f.name: f.index for used in receivers[:1] for f in used.fixes}
        foreign = {self.series[f.name].talker for other in receivers[1:] for f in other.fixes}
        rows: dict[str, np.ndarray] = {}
        for name in self.sources("sog"):
            if name not in own and self.series[name].talker in foreign:
                self.reject([name], "of a second receiver, or of one of two")
            elif name in own or not own or self.series[name].kind == "VTG":
                rows[name] = own.get(name, np.arange(len(self.series[name].at)))
        most = max(map(len, rows.values()), default=0)
        names = sorted(rows, key=lambda name: (len(rows[name]) < ALIKE * most, self.series[name].kind != "RMC"))
        for column in ("sog", "cog"):
            samples = {name: self.samples(name, column, rows[name]) for name in names}
            if samples := {name: both for name, both in samples.items() if len(both[0])}:
                self.select(column, samples)

    def select_others(self) -> None:
        """Of what several sources hold, that with most samples."""
        self._reject_zeros()
        for group in map(str.split, TOGETHER):
            names = self.sources(*group)
            if better := [column for column in BETTER.get(group[0], ()) if column in self.columns]:
                self.reject(names, f"{better[0]} is used")
                continue
            for name in names[:1]:
                for column in group:
                    if len(self.rows(name, column)):
                        self.select(column, {name: self.samples(name, column)})
                self.reject([n for n in names[1:] if not self.used[n]], f"{group[0]} is taken from {name}")
        self._select_variation()
        for alone, sides in (("rudder", RUDDERS), ("rpm", SHAFTS[1:])):
            only = [side for side in sides if side in self.columns]
            if alone not in self.columns and len(only) == 1:
                self.columns[alone] = self.columns.pop(only[0])
                self.used = {n: [alone if c == only[0] else c for c in used] for n, used in self.used.items()}
        for name, shaft in itertools.product(self.series, SHAFTS):
            pitch = self.samples(name, f"blades {shaft}")[1]
            if len(pitch) and np.ptp(pitch) > MOVES:
                moved = f"from {pitch.min():g} to {pitch.max():g} % of its largest, whose angle is not said"
                words = f"{name}: the blades of the propeller move {moved}; revolutions alone do not tell its thrust"
                self.rejected[f"{name} pitch", moved] += len(pitch)
                self.warnings.append(Message(words, "pitch_moves"))

    def _select_variation(self) -> None:
        """The variation that the compass says, or else a receiver. Zeros alone are none: receivers without a model of
        the earth's field write them."""
        compass = [name for name in self.series if "heading_magnetic" in self.used[name]]
        for name in (*compass, *self.sources("variation")) if compass else ():
            t, east = self.samples(name, "variation")
            if east.any() and "variation" not in self.columns:
                at = self.columns["heading_magnetic"][0]
                self.select("variation", {name: (at, np.interp(at, t, east))})

    def _reject_zeros(self) -> None:
        """Leave out a rudder that stays at zero beside another one of its source: no sensor is there."""
        for name in self.sources(*RUDDERS):
            values = {side: self.samples(name, side)[1] for side in RUDDERS}
            still = [side for side in RUDDERS if len(values[side]) and not values[side].any()]
            if len(still) == 1 and all(map(len, values.values())):
                self.rejected[f"{name} {still[0]}", "always zero, where the other one moves"] += len(values[still[0]])
                self.series[name].column(still[0])[:] = np.nan

    def accounts(self) -> tuple[Account, ...]:
        """What became of every talker and sentence."""
        rows = []
        for name, series in self.series.items():
            valid, why = sum(map(bool, series.values)), self.why.get(name, "")
            valid -= sum(count for (one, other), count in self.rejected.items() if one == name and "receiver" in other)
            used = tuple(self.used[name]) or (("time",) if series.kind == "ZDA" else ())
            if valid:
                rows.append(Account(name, valid, used, why or ("" if used else NOT_READ)))
        return (*rows, *(Account(name, count, (), why) for (name, why), count in self.rejected.items()))

    def table(self, path: Path, clock: Clock, notices: Sequence[Message]) -> RawTable:
        """The columns at the times of all of them, with the accounts."""
        import pandas as pd

        accounts = self.accounts()
        names = [name for name in UNITS if name in self.columns]
        if not names:
            raise Missing(f"{path}: no sentence is used: {'; '.join(map(str, accounts[:20]))}")
        t = np.unique(np.concatenate([np.round(self.columns[name][0], 3) for name in names]))
        columns = {name: np.full(len(t), np.nan) for name in names}
        for name, values in columns.items():
            values[np.searchsorted(t, np.round(self.columns[name][0], 3))] = self.columns[name][1]
        said = [*_messages(accounts), *notices, *self.warnings]
        units, frame = [UNITS[name] for name in names], pd.DataFrame({"time": t} | columns).astype(object)
        table = raw_table(path, str(path), ["time", *names], ["s", *units], frame, said)
        return replace(table, clock=replace(clock, t=t), accounts=accounts)


def _messages(accounts: Sequence[Account]) -> list[Message]:
    """The accounts as notices: of what is used, what is not valid, damaged, doubled, and not read."""
    groups: dict[str, list[str]] = {}
    for account in accounts:
        code = "nmea" if account.used_as else next((c for c, words in CODES if re.match(words, account.why)), "doubled")
        groups.setdefault(code, []).append(str(account))
    return [Message("; ".join(lines), code) for code, lines in groups.items()]
