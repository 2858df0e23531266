"""Trials that belong together: groups that can be compared (those of a day, of a folder, or with the same key in the
sidecar), and campaigns: runs with the same instruments and loading.

The campaign of a run is what the key ``campaign`` of its sidecar says; else its day (of the sidecar, of the file name,
or of a clock that counts seconds since 1970); else, where trials lie in several folders, its folder.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timezone
from pathlib import Path

from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.errors import Conflict, Missing, TooFewData, UnknownName
from mmg.messages import Message, listed
from mmg.ship import Ship

# Seconds since 1970 of the years 1990 and 2100: a clock between them tells the day.
CLOCK = (631_152_000.0, 4_102_444_800.0)
CALENDAR = {"day": 10, "month": 7, "year": 4}  # Length of each part of a date as ISO 8601 writes it
KEYS = (*CALENDAR, "folder", "group", "kind", "role")  # What trials can be grouped by
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DATES = (  # 22-Nov-2026, then 2026-11-22 or 20261122. Months by names come first: what follows the year may be a time.
    re.compile(rf"(?<!\d)(?P<d>\d{{1,2}})[-_. ]?(?P<m>{'|'.join(MONTHS)})[a-z]*[-_. ]?(?P<y>[12]\d{{3}})(?!\d)", re.I),
    re.compile(r"(?<!\d)(?P<y>[12]\d{3})([-_.]?)(?P<m>\d{2})\2(?P<d>\d{2})(?!\d)"),
)


@dataclass(frozen=True)
class Groups:
    """Trials in groups. by: what they have in common; names: of the groups, sorted; number: of each trial's group."""

    by: str
    names: tuple[str, ...]
    number: tuple[int, ...]

    def runs(self, name: str) -> int:
        """How many trials the group ``name`` has."""
        return sum(self.names[k] == name for k in self.number)

    @property
    def comparable(self) -> tuple[str, ...]:
        """Names of those with two runs at least."""
        return tuple(name for name in self.names if self.runs(name) > 1)

    def members(self, trials: Sequence[Trial]) -> dict[str, list[Trial]]:
        """The ``trials`` that were grouped, by the name of their group."""
        members: dict[str, list[Trial]] = {name: [] for name in self.names}
        for trial, k in zip(trials, self.number, strict=True):
            members[self.names[k]].append(trial)
        return members


def group_trials(trials: Sequence[Trial], by: str) -> Groups:
    """Group ``trials`` ``by`` "day" ("month", "year") as of ``day_of``, "folder", or a key of the sidecar: "group",
    "kind", "role". Raises UserError for another word, a trial that belongs to none, and fewer than two groups."""
    key = by.strip().lower()
    if key not in KEYS:
        raise UnknownName(f"--between {by}: not one of {', '.join(KEYS)}")
    labels = [_label(trial, key) for trial in trials] if key != "folder" else folders_of(trials)
    for trial in trials:
        if key == "folder" and trial.path is None:
            raise Missing(f"--between folder: {trial.name} was not read from a file")
    names = tuple(sorted(set(labels)))
    if len(names) < 2:
        words = f"all trials are of one group ({names[0]})" if names else "no trials are given"
        raise TooFewData(f"--between {by}: {words}; give trials of two at least")
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
    below = [Path(os.path.relpath(p, base)).as_posix() for p in parents]  # the same words on every system
    return [Path(base).name if name == "." else name for name in below]


def day_of(trial: Trial) -> str:
    """The day of a ``trial`` in ISO 8601: of its sidecar, its name or its clock; "" where nothing tells it."""
    texts = (trial.path.stem if trial.path is not None else "", trial.name)
    start = float(trial.t[0])
    clock = datetime.fromtimestamp(start, timezone.utc).date().isoformat() if CLOCK[0] < start < CLOCK[1] else ""
    return trial.meta.get("day", "") or next((day for text in texts for day in dates_in(text)), clock)


def dates_in(text: str) -> list[str]:
    """The days that ``text`` names, as ISO 8601 writes them; what is no day of the calendar is passed over."""
    days = []
    for match in (match for pattern in DATES for match in pattern.finditer(text)):
        month = match["m"].lower()[:3]
        number = MONTHS.index(month) + 1 if month in MONTHS else int(month)
        with contextlib.suppress(ValueError):
            days.append(date(int(match["y"]), number, int(match["d"])).isoformat())
    return days


UNKNOWN = "no campaign"  # Name of what trials belong to of which nothing is known
TAKEN, MEAN = "campaign", "campaign_mean"  # Codes of messages: instruments as in a campaign, as in the mean of all


def campaigns_of(trials: Sequence[Trial]) -> Groups:
    """The campaigns of ``trials``. Raises UserError where the sidecar names for a campaign another day than the file
    name, or another folder of these trials than that in which the file lies."""
    folders, labels = folders_of(trials), campaign_labels(trials)
    for trial, folder in zip(trials, folders, strict=True):
        _refuse_contradiction(trial, folder, folders)
    names = tuple(sorted(set(labels)))
    return Groups("campaign", names, tuple(names.index(label) for label in labels))


def campaign_labels(trials: Sequence[Trial]) -> list[str]:
    """The campaign of each of ``trials``, UNKNOWN where nothing tells it; contradictions are passed over."""
    labels = zip(trials, folders_of(trials), strict=True)
    return [trial.meta.get("campaign", "") or day_of(trial) or folder or UNKNOWN for trial, folder in labels]


def campaign_among(trial: Trial, known: Iterable[str]) -> str | None:
    """Which of the ``known`` campaigns a ``trial`` belongs to: by its sidecar, its day or its folder; None for none. A
    trial whose sidecar names a campaign is of no other one."""
    names = list(known)
    if said := trial.meta.get("campaign", ""):
        return said if said in names else None
    if (day := day_of(trial)) in names:
        return day
    parts = trial.path.resolve().parent.parts if trial.path is not None else ()
    # Folders were told by what differed among the trials of the fit: here any end of the path may be that.
    tails = [Path(*parts[-k:]).as_posix() for k in range(1, len(parts))]
    return next((tail for tail in tails if tail in names), None)


def ship_of_campaign(ship: Ship, name: str | None) -> Ship:
    """The ``ship`` as the campaign ``name`` has it, as it is for None. Raises UserError for one it does not know."""
    if name is None:
        return ship
    if not ship.campaigns:
        raise UnknownName(f"--campaign {name}: {ship.name} knows no campaigns: its instruments have one value for all")
    if name not in ship.campaigns:
        raise UnknownName(f"--campaign {name}: unknown; {ship.name} knows {', '.join(ship.campaigns)}")
    return ship.of_campaign(name)


def ship_in(ship: Ship, trials: Sequence[Trial]) -> tuple[Ship, list[Message]]:
    """The ship that serves all ``trials``, as their one campaign has it or else the mean, and which, as a message."""
    if not ship.campaigns:
        return ship, []
    campaigns = {campaign_among(trial, ship.campaigns) for trial in trials}
    if len(campaigns) == 1 and (name := campaigns.pop()) is not None:
        return ship.of_campaign(name), [Message(f"instruments as in campaign {name}", TAKEN)]
    words = "the trials are of several campaigns, or of none that is known: instruments as in the mean of all"
    return replace(ship, campaigns={}), [Message(words, MEAN)]


def campaigns_taken(ship: Ship, trials: Sequence[Trial]) -> list[Message]:
    """Which campaigns' instruments predictions of ``trials`` by ``ship`` take, and which trials are of none that is
    known; nothing for a ship without campaigns."""
    if not ship.campaigns:
        return []
    names = ", ".join(next(iter(ship.campaigns.values())))
    of: dict[str | None, list[str]] = {}
    for trial in trials:
        of.setdefault(campaign_among(trial, ship.campaigns), []).append(trial.name)
    unknown = of.pop(None, [])
    known = sorted(filter(None, of))
    messages = [Message(f"{listed(of[name])}: {names} as in campaign {name}", TAKEN) for name in known]
    if unknown:
        words = f"of no campaign that the calibration knows ({', '.join(ship.campaigns)}): {names} at the mean of all"
        messages.append(Message(f"{listed(unknown)}: {words}, with wider bands; --campaign NAME says which one", MEAN))
    return messages


def _refuse_contradiction(trial: Trial, folder: str, folders: Sequence[str]) -> None:
    """Raises UserError where the sidecar, the day and the folder of a ``trial`` name different campaigns."""
    said, day = trial.meta.get("campaign", ""), day_of(trial)
    if not said:
        return
    where = line_for(trial.path, trial.name, f'campaign = "{said}"')
    begin = f"{trial.name}: the sidecar says campaign {said}, but the"
    as_day = dates_in(said)
    if as_day and day and as_day[0] != day:
        raise Conflict(f"{begin} trial is of {day} (file name, day or clock); correct {where}")
    if folder and said != folder and said in folders:
        words = f"file lies in folder {folder}, and {said} is another folder of these trials"
        raise Conflict(f"{begin} {words}; move the file, or correct {where}")
