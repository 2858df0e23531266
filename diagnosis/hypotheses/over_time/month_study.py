"""What a long log says of a ship: windows, the subset that was fitted, scores of all windows, and what changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import numpy as np

from cases.operation.cutting import Cut
from cases.operation.parts import OperationLog
from cases.shipfiles.effects import parameters
from diagnosis.hypotheses.over_time.change_test import DatedChange
from diagnosis.hypotheses.over_time.changes import CandidateChange, Changes
from fitting.design.informative_windows import ChosenWindows
from fitting.prediction.innovations import CHANNELS, Innovations
from fitting.report.run_folder import versions
from mmg.effects import Parameter
from mmg.ship import Ship

SINCE_1970 = 3e8
"""A clock that shows more seconds than this counts from 1970."""


@dataclass(frozen=True)
class MonthStudy:
    """All that was found in a long log.

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

    @property
    def days(self) -> float:
        """Length of the log [days]."""
        return (self.cut.end - self.cut.begin) / 86400.0

    def date(self, day: float) -> str:
        """A ``day`` since the log began in words: a date where its clock counts from 1970."""
        if self.cut.begin < SINCE_1970:
            return f"day {day:.1f}"
        return datetime.fromtimestamp(self.cut.begin + 86400 * day, timezone.utc).strftime("%Y-%m-%d %H:%M")

    def words(self, row: CandidateChange) -> str:
        """A sentence on the change ``row``."""
        c, unit = row.change, self.unit(row.name)
        size = f"{c.size:+.3g} {unit}".rstrip() + f" (standard error {c.std:.2g})"
        name = f"{row.name} ({self.parameter(row.name).description})"
        if c.step:
            low, high = (self.date(d) for d in c.begin_90)
            return f"{name} changed at once on {self.date(c.begin)} (90 %: {low} to {high}) by {size}"
        begin = f"{self.date(c.begin)} (90 %: {self.date(c.begin_90[0])} to {self.date(c.begin_90[1])})"
        return f"{name} changed slowly from {begin} to {self.date(c.end)} by {size}"

    def parameter(self, name: str) -> Parameter:
        """The parameter of an effect by its ``name``."""
        effect, _, symbol = name.partition(".")
        return next(p for p in parameters(self.ship, effect) if p.symbol == symbol)

    def unit(self, name: str) -> str:
        """Unit of the parameter ``name``."""
        return self.parameter(name).unit

    def to_dict(self) -> dict[str, Any]:
        """The content of months.json."""
        manoeuvring = sum(w.manoeuvring for w in self.cut.windows)
        return {
            "ship": self.ship.title,
            "log": {
                "folder": str(self.log.folder),
                "parts": len(self.log.parts),
                "left_out": self.log.left_out,
                "notices": self.log.notices,
                "rows": self.cut.rows,
                "begin_s": self.cut.begin,
                "end_s": self.cut.end,
                "days": self.days,
                "step_s": self.cut.step,
            },
            "cut": {
                "window_s": self.cut.length,
                "windows": len(self.cut.windows),
                "manoeuvring": manoeuvring,
                "seconds": self.cut.seconds,
            },
            "subset": self._subset(),
            "scores": self.scores,
            "changes": [self._row(t) | {"company": list(with_)} for t, with_ in self._named()],
            "candidates": [self._row(t) for t in self.changes.tested],
            "unexplained_share": self.changes.spells.unexplained,
            "warnings": list(self.warnings),
            "timings_s": dict(self.timings),
            "seed": self.seed,
            "versions": versions(),
        }

    def _named(self) -> list[tuple[CandidateChange, tuple[str, ...]]]:
        return list(zip(self.changes.named, self.changes.company, strict=True))

    def _subset(self) -> dict[str, Any] | None:
        if self.choice is None:
            return None
        rows = zip(self.choice.windows, self.choice.gains, strict=True)
        windows = self.cut.windows
        return {
            "windows": [{"begin_s": windows[k].begin, "end_s": windows[k].end, "gain": gain} for k, gain in rows],
            "of": self.choice.of,
            "log_det": sum(self.choice.gains),
            "log_det_all": self.choice.all,
        }

    def _row(self, row: CandidateChange) -> dict[str, Any]:
        c: DatedChange = row.change
        return {
            "name": row.name,
            "unit": self.unit(row.name),
            "kind": "step" if c.step else "ramp",
            "begin_day": c.begin,
            "end_day": c.end,
            "half_day": c.half,
            "begin_90": list(c.begin_90),
            "end_90": list(c.end_90),
            "begin": self.date(c.begin),
            "size": c.size,
            "std": c.std,
            "gain": c.gain,
            "p_value": c.p_value,
        }


def window_scores(found: Innovations, count: int, distance: np.ndarray, limit: float) -> dict[str, np.ndarray]:
    """Root mean square errors of each of ``count`` windows at the end of its stretches, from innovations ``found``, NaN
    for one without: name of the channel -> (count,); "unexplained": whether the ``distance`` (S,) of a stretch is
    beyond the ``limit``."""
    out = {}
    number = np.bincount(found.window, minlength=count)
    for k, name in enumerate(CHANNELS):
        own = np.flatnonzero(found.channels == k)
        if len(own):
            total = np.bincount(found.window, found.errors[:, own[-1]] ** 2, minlength=count)
            out[name] = np.sqrt(np.where(number > 0, total / np.maximum(number, 1), np.nan))
    out["unexplained"] = np.bincount(found.window, distance > limit, minlength=count) > 0
    return out


def pooled(by_window: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Root mean square of all windows that are not unexplained, by channel, of ``by_window``: name -> (W,)."""
    sound = ~by_window["unexplained"]
    return {name: float(np.sqrt(np.nanmean(by_window[name][sound] ** 2))) for name in CHANNELS if name in by_window}
