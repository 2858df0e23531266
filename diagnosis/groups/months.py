"""Months of operational data: read in pieces, cut, a subset chosen and fitted, all windows scored, changes dated."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from cases.io.conventions import heading_and_rate, mislabelled
from cases.operation.log import Cut, OperationLog, cut_log, read_log, window_rows
from cases.shipfiles.effects import parameters
from cases.trial import Trial
from diagnosis.groups.over_time import DAY, Changes, DatedChange, find_changes
from fitting.calibrate import FitOptions, calibrate
from fitting.prediction.innovations import (
    CHANNELS,
    UNEXPLAINED,
    ChosenWindows,
    Innovations,
    Stretches,
    candidates_of,
    choose_windows,
    scatter,
)
from fitting.report.run_folder import SCHEMA_VERSION, versions
from fitting.result import FitResult
from fitting.settings import Settings
from mmg.effects import Parameter
from mmg.errors import BadValue, TooFewData
from mmg.messages import LOGGER, OnProgress
from mmg.ship import Ship

WHOLE = 13.0  # Ship lengths of the prediction by which windows are chosen: nearly a whole window. Set by hand.

SINCE_1970 = 3e8  # A clock that shows more seconds than this counts from 1970


@dataclass(frozen=True)
class MonthStudy:
    """All that a long log says.

    log, cut: what was read and how it was cut; ship: that was compared with it; choice: windows that were fitted, by
    their numbers in ``cut.windows``, None where nothing was; scores: root mean square errors at the end of stretches,
    by "before" and "after" the fit, and channel; by_window: name of a column -> values (W,); changes: what changed;
    timings: [s]; seed: of the bootstrap; warnings: sentences.
    """

    log: OperationLog
    cut: Cut
    ship: Ship
    choice: ChosenWindows | None
    scores: Mapping[str, Mapping[str, float]]
    by_window: Mapping[str, np.ndarray]
    changes: Changes
    timings: Mapping[str, float]
    seed: int
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        count = f"{self.days:.1f} days, {len(self.cut.windows)} windows, {len(self.changes.named)} changes"
        return f"<MonthStudy of {self.ship.title}: {count}, {len(self.warnings)} warnings>"

    @property
    def days(self) -> float:
        """Length of the log [days]."""
        return (self.cut.end - self.cut.begin) / DAY

    def date(self, day: float) -> str:
        """A ``day`` since the log began in words: a date where its clock counts from 1970."""
        if self.cut.begin < SINCE_1970:
            return f"day {day:.1f}"
        return datetime.fromtimestamp(self.cut.begin + DAY * day, timezone.utc).strftime("%Y-%m-%d %H:%M")

    def words(self, row: DatedChange) -> str:
        """A sentence on the change ``row``."""
        p = parameter_of(self.ship, row.name)
        size = f"{row.size:+.3g} {p.unit}".rstrip() + f" (standard error {row.std:.2g})"
        begin = f"{self.date(row.begin)} (90 %: {self.date(row.begin_90[0])} to {self.date(row.begin_90[1])})"
        how = f"at once on {begin}" if row.step else f"slowly from {begin} to {self.date(row.end)}"
        return f"{row.name} ({p.description}) changed {how} by {size}"

    def to_dict(self) -> dict[str, Any]:
        """The content of months.json."""
        cut, log = self.cut, self.log
        return {
            "kind": "months",
            "schema_version": SCHEMA_VERSION,
            "ship": self.ship.title,
            "log": {
                "folder": str(log.folder),
                "parts": len(log.parts),
                "left_out": log.left_out,
                "notices": log.notices,
                "rows": cut.rows,
                "begin_s": cut.begin,
                "end_s": cut.end,
                "days": self.days,
                "step_s": cut.step,
            },
            "cut": {
                "window_s": cut.length,
                "windows": len(cut.windows),
                "manoeuvring": sum(w.manoeuvring for w in cut.windows),
                "seconds": cut.seconds,
            },
            "subset": self._subset(),
            "scores": self.scores,
            "changes": [self._row(row) | {"company": list(row.company)} for row in self.changes.named],
            "candidates": [self._row(row) for row in self.changes.tested],
            "unexplained_share": self.changes.spells.unexplained,
            "warnings": list(self.warnings),
            "timings_s": dict(self.timings),
            "seed": self.seed,
            "versions": versions(),
        }

    def _subset(self) -> dict[str, Any] | None:
        if self.choice is None:
            return None
        rows = [(self.cut.windows[k], gain) for k, gain in zip(self.choice.windows, self.choice.gains, strict=True)]
        return {
            "windows": [{"begin_s": w.begin, "end_s": w.end, "gain": gain} for w, gain in rows],
            "of": self.choice.of,
            "log_det": sum(self.choice.gains),
            "log_det_all": self.choice.all,
        }

    def _row(self, row: DatedChange) -> dict[str, Any]:
        return {
            "name": row.name,
            "unit": parameter_of(self.ship, row.name).unit,
            "kind": "step" if row.step else "ramp",
            "begin_day": row.begin,
            "end_day": row.end,
            "half_day": 0.5 * (row.begin + row.end),
            "begin": self.date(row.begin),
            **{key: getattr(row, key) for key in ("begin_90", "end_90", "size", "std", "gain", "p_value")},
        }


def parameter_of(ship: Ship, name: str) -> Parameter:
    """The parameter ``name``, "effect.symbol", as the ``ship`` has it."""
    effect, _, symbol = name.partition(".")
    return next(p for p in parameters(ship, effect) if p.symbol == symbol)


def study_months(
    folder: str | Path,
    ship: Ship,
    settings: Settings | None = None,
    options: FitOptions | None = None,
    most: int = 24,
    progress: OnProgress | None = None,
) -> tuple[MonthStudy, FitResult | None]:
    """Study the log in the Parquet files of ``folder`` with a ``ship``; returns what it says, and the calibration.

    The log is read several times, never as a whole: in memory are a piece of it, the chosen windows, and 24 numbers for
    each stretch and candidate. settings, options: of the calibration (default: with the loss of Huber), whose seed is
    that of the bootstrap as well; most: windows that are fitted, 0 where the ship is taken as she is; progress: of the
    calibration. Raises UserError for a folder without a readable part, units that the numbers refute, and a log in
    which the ship is never under way.
    """
    settings, options = settings or Settings(loss="huber"), options or FitOptions()
    timings, clock = dict[str, float](), [time.perf_counter()]

    def lap(name: str) -> None:
        clock.append(time.perf_counter())
        timings[name] = clock[-1] - clock[-2]

    log = read_log(folder)
    cut = cut_log(checked(log), ship.particulars["L"])
    lap("check and cut")
    for line in log.left_out:
        LOGGER.warning("left out: %s", line)
    if not cut.windows:
        raise TooFewData(f"{folder}: no window of {cut.length:.0f} s in which the ship is under way, without a gap")
    LOGGER.info(f"{cut.rows} rows, {len(cut.windows)} windows of {cut.length:.0f} s under way")
    choice, result, scores = None, None, {}
    if most:
        start = ship
        choice, trials = _subset(log, cut, ship, most)
        lap("choose")
        LOGGER.info(f"{len(trials)} of {choice.of} manoeuvring windows are fitted")
        options = replace(options, next_trial=False, per_campaign=("none",))
        result = calibrate(ship, trials, [], settings, options, progress)
        ship = result.ship
        lap("fit")
        scores["before"] = _scores(log, cut, start)
    found = Stretches(ship, candidates_of(ship)).of(_numbered(log, cut))
    changes = find_changes(found, cut.begin, cut.end, settings.seed)
    by_window = window_scores(found, len(cut.windows), changes.spells.distance)
    scores["after" if most else "before"] = pooled(by_window)
    lap("score and date")
    short = "the log is too short to say what changed: it needs more spells under way"
    lost = "the predictions diverge: this ship does not follow the log; see that it is hers and in her size"
    explodes = not all(math.isfinite(error) for errors in scores.values() for error in errors.values())
    warnings = tuple(words for words, holds in ((lost, explodes), (short, not changes.tested)) if holds)
    columns = {
        "begin_s": np.array([w.begin for w in cut.windows]),
        "end_s": np.array([w.end for w in cut.windows]),
        "manoeuvring": np.array([w.manoeuvring for w in cut.windows]),
        "fitted": np.isin(np.arange(len(cut.windows)), choice.windows if choice else []),
        **by_window,
    }
    return MonthStudy(log, cut, ship, choice, scores, columns, changes, timings, settings.seed, warnings), result


def checked(log: OperationLog) -> Iterator[dict[str, np.ndarray]]:
    """The pieces of the ``log``, columns (N,) by name. Raises UserError where the numbers of one refute its units."""
    for piece in log.pieces():
        wrong = [sentence for *_, sentence in mislabelled(piece)]
        if sentence := next(iter(wrong), heading_and_rate(piece)):
            raise BadValue(f"{log.folder}: at t = {piece['t'][0]:.0f} s: {sentence}")
        yield piece


def _numbered(log: OperationLog, cut: Cut) -> Iterator[tuple[int, Mapping[str, np.ndarray]]]:
    """Number and columns of every window."""
    return ((k, rows) for k, (_, rows) in enumerate(window_rows(log.pieces(), cut.windows)))


def _scores(log: OperationLog, cut: Cut, ship: Ship) -> dict[str, float]:
    """Errors of ``ship`` over all windows, by channel."""
    found = Stretches(ship, ()).of(_numbered(log, cut))
    distance = scatter(found.errors)[1]
    return pooled(window_scores(found, len(cut.windows), distance / np.median(distance)))


def _subset(log: OperationLog, cut: Cut, ship: Ship, most: int) -> tuple[ChosenWindows, list[Trial]]:
    """The windows that tell most about the free coefficients of ``ship``, by their numbers in the cut, as trials."""
    numbers = [k for k, w in enumerate(cut.windows) if w.manoeuvring]
    if not numbers:
        raise TooFewData(f"{log.folder}: no manoeuvring window: the log cannot calibrate a ship; use --no-fit")
    windows = [cut.windows[k] for k in numbers]
    rows = ((k, columns) for k, (_, columns) in zip(numbers, window_rows(log.pieces(), windows), strict=False))
    found = choose_windows(Stretches(ship, (), WHOLE, ship.free).of(rows), most)
    chosen = sorted(found.windows)
    cuts = window_rows(log.pieces(), [cut.windows[k] for k in chosen])
    return found, [Trial(f"window_{k:05d}", columns) for k, (_, columns) in zip(chosen, cuts, strict=True)]


def window_scores(innovations: Innovations, count: int, distance: np.ndarray) -> dict[str, np.ndarray]:
    """Root mean square errors of each of ``count`` windows at the end of its stretches, from ``innovations``, NaN
    for one without: name of the channel -> (count,); "unexplained": whether one of its stretches was moved by something
    else, by the ``distance`` (S,) of each over the usual one."""
    out = {}
    number = np.bincount(innovations.window, minlength=count)
    for k, name in enumerate(CHANNELS):
        own = np.flatnonzero(innovations.channels == k)
        if len(own):
            total = np.bincount(innovations.window, innovations.errors[:, own[-1]] ** 2, minlength=count)
            out[name] = np.sqrt(np.where(number > 0, total / np.maximum(number, 1), np.nan))
    out["unexplained"] = np.bincount(innovations.window, distance > UNEXPLAINED, minlength=count) > 0
    return out


def pooled(by_window: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Root mean square of all windows that are not unexplained, by channel, of ``by_window``: name -> (W,)."""
    sound = ~by_window["unexplained"]
    return {name: float(np.sqrt(np.nanmean(by_window[name][sound] ** 2))) for name in CHANNELS if name in by_window}
