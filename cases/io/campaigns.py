"""Campaigns: runs with the same instruments and loading, told apart by the sidecar, the day or the folder.

What a run belongs to is said by the key ``campaign`` of its sidecar; else it is the day (of the sidecar, of the file
name, or of a clock that counts seconds since 1970); else, where trials lie in several folders, its folder.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cases.io.groups import dates_in, day_of, folders_of, no_dates_in
from cases.io.sidecar import line_for
from cases.trial import Trial
from mmg.errors import Conflict, UnknownName
from mmg.messages import Message
from mmg.ship import Ship

UNKNOWN = "no campaign"
"""Name of what trials belong to of which nothing is known."""
TAKEN, MEAN = "campaign", "campaign_mean"
"""Codes of messages: instruments as in a campaign, as in the mean of all."""
MOST_LISTED = 3
"""Trials named in one message."""


@dataclass(frozen=True)
class Campaigns:
    """Trials by campaign. names: of the campaigns, sorted; number: (trials,) of each trial's; messages: on names with a
    date that is none, and on copies."""

    names: tuple[str, ...]
    number: tuple[int, ...]
    messages: tuple[Message, ...] = ()

    def runs(self, name: str) -> int:
        """How many trials the campaign ``name`` has."""
        return sum(self.names[k] == name for k in self.number)

    @property
    def comparable(self) -> tuple[str, ...]:
        """Names of those with two runs at least."""
        return tuple(name for name in self.names if self.runs(name) > 1)


def campaigns_of(trials: Sequence[Trial]) -> Campaigns:
    """The campaigns of ``trials``.

    Raises UserError where the sidecar names for a campaign another day than the file name, or another folder of
    these trials than that in which the file lies.
    """
    folders, labels = folders_of(trials), campaign_labels(trials)
    for trial, folder in zip(trials, folders, strict=True):
        _refuse_contradiction(trial, trial.meta.get("campaign", ""), day_of(trial), folder, folders)
    names = tuple(sorted(set(labels)))
    messages = [*_no_dates(trials, labels), *_copies(trials, labels)]
    return Campaigns(names, tuple(names.index(label) for label in labels), tuple(messages))


def campaign_labels(trials: Sequence[Trial]) -> list[str]:
    """The campaign of each of ``trials``, UNKNOWN where nothing tells it; contradictions are passed over."""
    labels = zip(trials, folders_of(trials), strict=True)
    return [trial.meta.get("campaign", "") or day_of(trial) or folder or UNKNOWN for trial, folder in labels]


def campaign_among(trial: Trial, known: Iterable[str]) -> str | None:
    """Which of the ``known`` campaigns a ``trial`` belongs to: by its sidecar, its day or its folder; None for none.

    A trial whose sidecar names a campaign is of no other one.
    """
    names = list(known)
    if said := trial.meta.get("campaign", ""):
        return said if said in names else None
    if (day := day_of(trial)) in names:
        return day
    if trial.path is None:
        return None
    parts = trial.path.resolve().parent.parts
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
    """The one ship that serves all ``trials``: as their campaign has it where that is one and known, else the mean.

    And a message that says which.
    """
    if not ship.campaigns:
        return ship, []
    found = {campaign_among(trial, ship.campaigns) for trial in trials}
    name = found.pop() if len(found) == 1 else None
    if name is not None:
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
    messages = [
        Message(f"{_listed(of[name])}: {names} as in campaign {name}", TAKEN) for name in sorted(filter(None, of))
    ]
    if unknown:
        words = (
            f"{_listed(unknown)}: of no campaign that the calibration knows ({', '.join(ship.campaigns)}): {names} at "
            "the mean of all, with wider bands; --campaign NAME says which one"
        )
        messages.append(Message(words, MEAN))
    return messages


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= MOST_LISTED else f"{names[0]} and {len(names) - 1} others"


def _refuse_contradiction(trial: Trial, said: str, day: str, folder: str, folders: Sequence[str]) -> None:
    """Raises UserError where the sidecar, the day and the folder of a ``trial`` name different campaigns."""
    if not said:
        return
    where = line_for(trial.path, trial.name, f'campaign = "{said}"')
    as_day = dates_in(said)
    if as_day and day and as_day[0] != day:
        raise Conflict(
            f"{trial.name}: the sidecar says campaign {said}, but the trial is of {day} (file name, day or clock); "
            f"correct {where}"
        )
    if folder and said != folder and said in folders:
        raise Conflict(
            f"{trial.name}: the sidecar says campaign {said}, but the file lies in folder {folder}, and {said} is "
            f"another folder of these trials; move the file, or correct {where}"
        )


def _no_dates(trials: Sequence[Trial], labels: Sequence[str]) -> list[Message]:
    """A message on each of ``trials`` in whose name stands a date that is none, and nothing else tells the day."""
    found = []
    for trial, label in zip(trials, labels, strict=True):
        wrong = no_dates_in(trial.path.stem if trial.path is not None else trial.name)
        if wrong and not (trial.meta.get("campaign") or day_of(trial)):
            line = line_for(trial.path, trial.name, 'campaign = "..."')
            words = f"{wrong[0]} in its name is no day of the calendar; it counts to {label}; else add to {line}"
            found.append(Message(f"{trial.name}: {words}", "no_date"))
    return found


def _copies(trials: Sequence[Trial], labels: Sequence[str]) -> list[Message]:
    """Messages on files that are in two campaigns."""
    first: dict[str, int] = {}
    found = []
    for i, trial in enumerate(trials):
        k = first.setdefault(trial.sha256, i) if trial.sha256 else i
        if labels[k] != labels[i]:
            words = (
                f"{trials[k].name} of campaign {labels[k]} and {trial.name} of campaign {labels[i]} are the same file; "
                f"it counts once, for {labels[k]}: remove the one that is wrong"
            )
            found.append(Message(words, "same_file_in_two_campaigns"))
    return found
