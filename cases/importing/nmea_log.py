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
from cases.importing.nmea_sentences import DECODERS, Said, checksum, field_names, said_by
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
    ("rot",), ("u", "v"), ("rudder",), ("rudder_starboard",), ("rudder_port",), ("rpm",), ("rpm_starboard",),
    ("rpm_port",), ("RPM-E",), ("RPM-E_starboard",), ("RPM-E_port",),
    ("apparent_wind_speed", "apparent_wind_direction"), ("true_wind_speed", "twa", "twd"),
)  # fmt: skip
"""Columns that are taken from one source: that which says one of them most often."""
SHAFTS, RUDDERS = ("rpm", "rpm_starboard", "rpm_port"), ("rudder_starboard", "rudder_port")
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
    try:
        when = moments(heard, logger_of(texts), str(path), chosen.zone_hours or 0.0)
    except Missing as error:
        why = (f"{name} {count}: {why}" for (name, why), count in left.most_common(12))
        raise Missing(f"{error}; left out: {', '.join(why) or 'none'}") from None
    log = _Log(heard, when.t, left, list(when.notices))
    log.take_positions()
    log.take_heading(chosen.variation)
    log.take_others()
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
            try:
                said = said_by(kind, match[2]) if right else Said({}, CHECKSUM)
            except (ValueError, OverflowError):
                said = Said({}, "damaged")
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
    """A log of which the sources are chosen: heard, t: its series and their times; left: counts of (sentence, why) that
    are left out; taken: column -> times and values; used: columns by series; why: what more is said of a series."""

    def __init__(
        self,
        heard: dict[str, Series],
        t: dict[str, np.ndarray],
        left: Counter[tuple[str, str]],
        notices: list[Message],
    ) -> None:
        self.heard, self.t, self.left, self.notices = heard, t, left, notices
        self.taken: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.used: dict[str, list[str]] = {name: [] for name in heard}
        self.why: dict[str, str] = {}

    def rows(self, name: str, column: str) -> np.ndarray:
        """Rows (M,) of a series that say a column, in the order of their times."""
        good = np.flatnonzero(np.isfinite(self.heard[name].column(column)) & np.isfinite(self.t[name]))
        return good[np.argsort(self.t[name][good], kind="stable")]

    def said(self, name: str, column: str) -> tuple[np.ndarray, np.ndarray]:
        """Times and values (M,) of a column that a series says."""
        rows = self.rows(name, column)
        return self.t[name][rows], self.heard[name].column(column)[rows]

    def speaking(self, *columns: str) -> list[str]:
        """The series that say one of the ``columns``, that which says one most often first."""
        counts = {name: max(len(self.rows(name, column)) for column in columns) for name in self.heard}
        return sorted((name for name in counts if counts[name]), key=lambda name: -counts[name])

    def take(self, column: str, said: dict[str, tuple[np.ndarray, np.ndarray]]) -> None:
        """Use what the first series ``said`` as a column, and others where it is silent."""
        self.taken[column] = merged(list(said.values()))
        for name in said:
            self.used[name].append(column)

    def leave(self, names: Sequence[str], why: str) -> None:
        """Say ``why`` series are not used, of which nothing was said yet."""
        for name in names:
            self.why.setdefault(name, why)

    def take_positions(self) -> None:
        """Latitude and longitude of one receiver, and the speed and course over ground that it says."""
        fixes = []
        for name in self.heard:
            if len(rows := self.rows(name, "latitude")):
                series = self.heard[name]
                parts = [series.column(c)[rows] for c in ("latitude", "longitude", "decimals", "quality")]
                fixes.append(Fixes(name, series.talker, rows, self.t[name][rows], *parts))
        receivers = receivers_of(fixes)
        for used in receivers[:1]:
            self.take("latitude", {f.name: (f.t, f.latitude) for f in used.same})
            self.take("longitude", {f.name: (f.t, f.longitude) for f in used.same})
            self.leave(
                [f.name for f in used.fixes if f not in used.same],
                f"of the same receiver as {used.same[0].name}, whose fix is used",
            )
        for other in receivers[1:]:
            off = "" if other.distance is None else f" {other.distance:.{0 if other.distance >= 10 else 1}f} m off"
            for f in other.fixes:
                why = f"second receiver{off or ', not heard at the same time'}"
                self.left[f.name, why] += len(f) if self.used[f.name] else 0  # two receivers behind one talker
                self.leave([] if self.used[f.name] else [f.name], why)
        self._take_speeds(receivers)

    def _take_speeds(self, receivers: Sequence[Receiver]) -> None:
        """Speed and course of the first of the ``receivers``: RMC with its position, or VTG of its talkers."""
        own = {f.name: f.index for used in receivers[:1] for f in used.fixes}
        talkers = {self.heard[name].talker for name in own}
        foreign = {f.talker for other in receivers[1:] for f in other.fixes}
        speeds = {}
        for name in self.speaking("sog"):
            series = self.heard[name]
            if name in own or not receivers:
                speeds[name] = own.get(name, np.arange(len(series.at)))
            elif series.talker in foreign:
                self.leave([name], f"of {'one of two receivers' if series.talker in talkers else 'a second receiver'}")
            elif series.kind == "VTG":
                speeds[name] = np.arange(len(series.at))
        most = max(map(len, speeds.values()), default=0)
        names = sorted(speeds, key=lambda n: (len(speeds[n]) < ALIKE * most, self.heard[n].kind != "RMC"))
        for column in ("sog", "cog"):
            rows = {n: np.intersect1d(self.rows(n, column), speeds[n]) for n in names}
            said = {n: (self.t[n][r], self.heard[n].column(column)[r]) for n, r in rows.items() if len(r)}
            if said:
                self.take(column, said)

    def take_heading(self, variation: float | None) -> None:
        """The true heading that is said most often, that of a water log (VHW) last, or a magnetic one with a variation:
        that of the map, its own at other times, or that of a receiver. Zeros alone are no variation: receivers without
        a model of the earth's field write them."""
        names = sorted(self.speaking("heading"), key=lambda name: self.heard[name].kind == "VHW")
        compasses = self.speaking("magnetic")
        if names:
            self.take("heading", {names[0]: self.said(names[0], "heading")})
            self.leave(names[1:], f"heading is taken from {names[0]}")
            self.leave(compasses, f"magnetic; the true heading of {names[0]} is used")
        for name in compasses if not names else ():
            known = {n: self.said(n, "variation") for n in (name, *self.speaking("variation"))}
            known = {n: said for n, said in known.items() if said[1].any()}
            if variation is not None:
                known = {"the map": (np.zeros(1), np.full(1, variation))}
            if "heading" in self.taken or not known:
                self.leave(
                    [name], "heading is taken from another compass" if known else magnetic(self.heard[name].kind)
                )
                continue
            of, (at, east) = next(iter(known.items()))
            t, values = self.said(name, "magnetic")
            self.take("heading", {name: (t, (values + np.interp(t, at, east)) % 360.0)})
            self.why[name] = f"with the variation {np.median(east):.3g} deg of {of}"

    def take_others(self) -> None:
        """Of what several sources say, the one that says it most often."""
        self._leave_zeros()
        for group in TOGETHER:
            names = self.speaking(*group)
            if group[0].startswith("RPM-E") and any(shaft in self.taken for shaft in SHAFTS):
                self.leave(names, "of an engine; the shaft is used")
                continue
            for column in group if names else ():
                if len(self.rows(names[0], column)):
                    self.take(column, {names[0]: self.said(names[0], column)})
            self.leave([n for n in names[1:] if not self.used[n]], f"{group[0]} is taken from {''.join(names[:1])}")
        for name in self.heard:
            for shaft in SHAFTS:
                self._see_blades(name, self.said(name, f"blades {shaft}")[1])
        for alone, sides in (("rudder", RUDDERS), ("rpm", SHAFTS[1:])):
            only = [side for side in sides if side in self.taken]
            if alone not in self.taken and len(only) == 1:
                self.taken[alone] = self.taken.pop(only[0])
                self.used = {n: [alone if c == only[0] else c for c in columns] for n, columns in self.used.items()}

    def _leave_zeros(self) -> None:
        """Leave out a rudder that stays at zero beside another one of its source: no sensor is there."""
        for name in self.speaking(*RUDDERS):
            said = {side: self.said(name, side)[1] for side in RUDDERS}
            still = [side for side in RUDDERS if len(said[side]) and not said[side].any()]
            if len(still) == 1 and all(map(len, said.values())):
                self.left[f"{name} {still[0]}", "always zero, where the other one moves"] += len(said[still[0]])
                self.heard[name].column(still[0])[:] = np.nan

    def _see_blades(self, name: str, pitch: np.ndarray) -> None:
        """Say where the blades of a propeller move: revolutions alone do not tell its thrust then."""
        if len(pitch) and np.ptp(pitch) > MOVES:
            words = f"pitch from {pitch.min():g} to {pitch.max():g} % of its largest, whose angle is not said"
            self.left[f"{name} pitch", words] += len(pitch)
            said = f"{name}: the blades of the propeller move, {words}; revolutions alone do not tell its thrust"
            self.notices.append(Message(said, "pitch_moves"))

    def accounts(self) -> tuple[Account, ...]:
        """What became of every talker and sentence."""
        rows = []
        for name, series in self.heard.items():
            valid, why = sum(map(bool, series.values)), self.why.get(name, "")
            valid -= sum(count for (one, other), count in self.left.items() if one == name and "receiver" in other)
            used = tuple(self.used[name]) or (("time",) if series.kind == "ZDA" else ())
            if valid:
                rows.append(Account(name, valid, used, why or ("" if used else NOT_READ)))
        return (*rows, *(Account(name, count, (), why) for (name, why), count in self.left.items() if count))

    def table(self, path: Path, absolute: bool, words: str) -> RawTable:
        """The columns on the times of all of them, with the accounts."""
        import pandas as pd

        accounts = self.accounts()
        names = [name for name in UNITS if name in self.taken]
        if not names:
            raise Missing(f"{path}: no sentence is used: {'; '.join(map(str, accounts[:20]))}")
        t = np.unique(np.concatenate([np.round(self.taken[name][0], 3) for name in names]))
        columns = {"time": t} | {name: np.full(len(t), np.nan) for name in names}
        for name in names:
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
