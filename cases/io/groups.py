"""Groups of trials that can be compared: those of a day, of a folder, or with the same key in the sidecar."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime, timezone
from pathlib import Path

from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.errors import Missing, TooFewData, UnknownName

CLOCK = (631_152_000.0, 4_102_444_800.0)
"""Seconds since 1970 of the years 1990 and 2100: a clock between them tells the day."""
CALENDAR = {"day": 10, "month": 7, "year": 4}
"""Length of each part of a date as ISO 8601 writes it."""
KEYS = (*CALENDAR, "folder", "group", "kind", "role")
"""What trials can be grouped by."""
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DATES = (
    re.compile(rf"(?<!\d)(?P<d>\d{{1,2}})[-_. ]?(?P<m>{'|'.join(MONTHS)})[a-z]*[-_. ]?(?P<y>[12]\d{{3}})(?!\d)", re.I),
    re.compile(r"(?<!\d)(?P<y>[12]\d{3})([-_.]?)(?P<m>\d{2})\2(?P<d>\d{2})(?!\d)"),
)
"""A month by its name comes first: what follows the year may be the time."""


@dataclass(frozen=True)
class Groups:
    """Trials in groups. by: what they have in common; names: of the groups, sorted; number: of each trial's group."""

    by: str
    names: tuple[str, ...]
    number: tuple[int, ...]

    def members(self, trials: Sequence[Trial]) -> dict[str, list[Trial]]:
        """The ``trials`` that were grouped, by the name of their group."""
        return {
            name: [t for t, k in zip(trials, self.number, strict=True) if k == i] for i, name in enumerate(self.names)
        }


def group_trials(trials: Sequence[Trial], by: str) -> Groups:
    """Group ``trials`` ``by`` "day" ("month", "year"), "folder", or a key of the sidecar: "group", "kind", "role".

    The day is that of ``day_of``. Returns the groups. Raises UserError for
    another word, for a trial that belongs to none, and for fewer than two groups.
    """
    key = by.strip().lower()
    if key not in KEYS:
        raise UnknownName(f"--between {by}: not one of {', '.join(KEYS)}")
    labels = [_label(trial, key) for trial in trials] if key != "folder" else folders_of(trials)
    for trial in trials:
        if key == "folder" and trial.path is None:
            raise Missing(f"--between folder: {trial.name} was not read from a file")
    names = tuple(sorted(set(labels)))
    if len(names) < 2:
        found = f"all trials are of one group ({names[0]})" if names else "no trials are given"
        raise TooFewData(f"--between {by}: {found}; give trials of two at least")
    return Groups(key, names, tuple(names.index(label) for label in labels))


def _label(trial: Trial, key: str) -> str:
    """The group of a trial."""
    if key in CALENDAR:
        if day := day_of(trial):
            return day[: CALENDAR[key]]
        line = line_for(trial.path, trial.name, 'day = "2026-11-22"')
        words = f"no date in the name of {trial.name} (as 2026-11-22, 20261122 or 22-Nov-2026)"
        raise Missing(f"--between day: {words}; add to {line}")
    label = trial.meta.get("group", "") if key == "group" else str(getattr(trial, key))
    if not label:
        line = line_for(trial.path, trial.name, f'{key} = "..."')
        raise Missing(f"--between {key}: nothing is known of {trial.name}; add to {line}")
    return label


def folders_of(trials: Sequence[Trial]) -> list[str]:
    """The folder of each of ``trials`` below the one that holds all; "" where all lie in one, or one has none."""
    parents = [trial.path.resolve().parent for trial in trials if trial.path is not None]
    if len(parents) < len(trials) or len(set(parents)) < 2:
        return [""] * len(trials)
    base = os.path.commonpath([str(p) for p in parents])
    below = [Path(os.path.relpath(p, base)).as_posix() for p in parents]
    return [Path(base).name if name == "." else name for name in below]


def day_of(trial: Trial) -> str:
    """The day of a ``trial`` as ISO 8601 writes it: of its sidecar, of its name, or of a clock that counts since 1970;
    "" where nothing tells it."""
    texts = (trial.path.stem if trial.path is not None else "", trial.name)
    start = float(trial.t[0])
    clock = datetime.fromtimestamp(start, timezone.utc).date().isoformat() if CLOCK[0] < start < CLOCK[1] else ""
    return trial.meta.get("day", "") or next((day for text in texts for day in dates_in(text)), clock)


def dates_in(text: str) -> list[str]:
    """The days that ``text`` names, as ISO 8601 writes them; what is no day of the calendar is passed over."""
    return [day for day, _ in _written(text) if day]


def no_dates_in(text: str) -> list[str]:
    """What in ``text`` is written as a date with its parts apart, and is no day of the calendar (2026-02-30)."""
    return [words for day, words in _written(text) if not day and not words.isdigit()]


def _written(text: str) -> list[tuple[str, str]]:
    """Dates in a ``text``: the day, "" for what is none, and how it is written."""
    found = []
    for match in (match for pattern in DATES for match in pattern.finditer(text)):
        month, day = match["m"].lower()[:3], ""
        number = MONTHS.index(month) + 1 if month in MONTHS else int(month)
        with contextlib.suppress(ValueError):
            day = date(int(match["y"]), number, int(match["d"])).isoformat()
        found.append((day, match[0]))
    return found
