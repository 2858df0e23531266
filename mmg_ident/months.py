"""Months of operational data: read in pieces, cut, a subset chosen and fitted, all windows scored, changes dated."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cases.io.unit_sanity import implausible
from cases.operation.cutting import Cut, cut_log, window_rows
from cases.operation.parts import OperationLog, read_log
from cases.trial import Trial
from diagnosis.hypotheses.over_time.changes import find_changes
from diagnosis.hypotheses.over_time.month_study import MonthStudy, pooled, window_scores
from diagnosis.hypotheses.over_time.weights import UNEXPLAINED
from fitting.calibrate import FitOptions, calibrate
from fitting.design.informative_windows import ChosenWindows, choose_windows
from fitting.prediction.innovations import Stretches, candidates_of, scatter
from fitting.result import FitResult
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.progress import LOGGER, OnProgress
from mmg.ship import Ship

WHOLE = 13.0
"""Ship lengths of the prediction by which windows are chosen: nearly a whole window."""


@dataclass(frozen=True)
class MonthOptions:
    """What to do with a log.

    fit: whether the ship is calibrated on the chosen windows; most: of them; seed: of the bootstrap; settings: of the
    calibration; command: that is stored; name: of the calibration.
    """

    fit: bool = True
    most: int = 24
    seed: int = 0
    settings: Settings = field(default_factory=lambda: Settings(loss="huber"))
    command: str = ""
    name: str = ""


def study_months(
    folder: str | Path, ship: Ship, options: MonthOptions | None = None, progress: OnProgress | None = None
) -> tuple[MonthStudy, FitResult | None]:
    """Study the log in the Parquet files of ``folder`` with a ``ship``; returns what was found, and the calibration.

    The log is read several times, never as a whole: in memory are a piece of it, the chosen windows, and 24 numbers for
    each stretch and candidate. options: what to do; progress: of the calibration. Raises UserError for a folder without
    a readable part, units that the numbers refute, and a log in which the ship is never under way.
    """
    options, clock = options or MonthOptions(), _Laps()
    log = read_log(folder)
    cut = cut_log(checked(log), ship.particulars["L"])
    clock.lap("check and cut")
    for sentence in log.left_out:
        LOGGER.warning("left out: %s", sentence)
    if not cut.windows:
        raise UserError(f"{folder}: no window of {cut.length:.0f} s in which the ship is under way, without a gap")
    LOGGER.info(f"{cut.rows} rows, {len(cut.windows)} windows of {cut.length:.0f} s under way")
    start, choice, result, scores, warnings = ship, None, None, {}, []
    if options.fit:
        choice, trials = _subset(log, cut, ship, options.most)
        clock.lap("choose")
        LOGGER.info(f"{len(trials)} of {choice.of} manoeuvring windows are fitted")
        chosen = FitOptions(next_trial=False, per_campaign=("none",), command=options.command, name=options.name)
        result = calibrate(ship, trials, [], options.settings, chosen, progress)
        ship = result.ship
        clock.lap("fit")
        scores["before"] = _scores(log, cut, start)
    found = Stretches(ship, candidates_of(ship)).of(_numbered(log, cut))
    changes = find_changes(found, cut.begin, cut.end, options.seed)
    by_window = window_scores(found, len(cut.windows), changes.spells.distance, UNEXPLAINED)
    scores["after" if options.fit else "before"] = pooled(by_window)
    clock.lap("score and date")
    if not changes.tested:
        warnings.append("the log is too short to say what changed: it needs more spells under way")
    fitted = np.zeros(len(cut.windows), bool)
    fitted[list(choice.windows) if choice else []] = True
    columns = {
        "begin_s": np.array([w.begin for w in cut.windows]),
        "end_s": np.array([w.end for w in cut.windows]),
        "manoeuvring": np.array([w.manoeuvring for w in cut.windows]),
        "fitted": fitted,
        **by_window,
    }
    study = MonthStudy(log, cut, ship, choice, scores, columns, changes, clock.laps, options.seed, tuple(warnings))
    return study, result


class _Laps:
    """Seconds that each part of the work lasted."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now


def checked(log: OperationLog) -> Iterator[dict[str, np.ndarray]]:
    """The pieces of the ``log``, columns (N,) by name. Raises UserError where the numbers of one refute its units."""
    for piece in log.pieces():
        if sentence := implausible(piece):
            raise UserError(f"{log.folder}: at t = {piece['t'][0]:.0f} s: {sentence}")
        yield piece


def _numbered(log: OperationLog, cut: Cut) -> Iterator[tuple[int, Mapping[str, np.ndarray]]]:
    """Number and columns of every window."""
    return ((k, rows) for k, (_, rows) in enumerate(window_rows(log.pieces(), cut.windows)))


def _scores(log: OperationLog, cut: Cut, ship: Ship) -> dict[str, float]:
    """Errors of ``ship`` over all windows, by channel."""
    found = Stretches(ship, ()).of(_numbered(log, cut))
    distance = scatter(found.errors)[1]
    return pooled(window_scores(found, len(cut.windows), distance / np.median(distance), UNEXPLAINED))


def _subset(log: OperationLog, cut: Cut, ship: Ship, most: int) -> tuple[ChosenWindows, list[Trial]]:
    """The windows that tell most about the free coefficients of ``ship``, by their numbers in the cut, as trials."""
    numbers = [k for k, w in enumerate(cut.windows) if w.manoeuvring]
    if not numbers:
        raise UserError(f"{log.folder}: no manoeuvring window: the log cannot calibrate a ship; use --no-fit")
    windows = [cut.windows[k] for k in numbers]
    rows = ((k, columns) for k, (_, columns) in enumerate(window_rows(log.pieces(), windows)))
    found = choose_windows(Stretches(ship, (), WHOLE, ship.free).of(rows), most)
    chosen = sorted(found.windows)
    trials = [
        Trial(f"window_{numbers[k]:05d}", columns)
        for k, (_, columns) in zip(chosen, window_rows(log.pieces(), [windows[k] for k in chosen]), strict=True)
    ]
    return replace(found, windows=tuple(numbers[k] for k in found.windows)), trials
