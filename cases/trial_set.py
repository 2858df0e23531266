"""A set of trials and what is known of it: worked out where it is asked for, once, and never changed.

Every command makes one of its files, and every function that takes trials takes one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias, overload

import numpy as np

from cases.checks import CheckReport, check, inputs_are_constant
from cases.checks.folders import Duplicates, duplicates
from cases.checks.report import CONTRADICTORY, DOUBTFUL
from cases.checks.stretches import BrokenStretch, broken_stretches
from cases.inputs import SAMPLED
from cases.io.campaigns import Groups, campaign_labels, campaigns_of, group_trials, ship_of_campaign
from cases.io.read import read_trials
from cases.io.sidecar import line_for
from cases.trial import LEFT_OUT, Trial, left_out, looked_at
from mmg.errors import BadValue, Conflict, Missing, TooFewData, is_several, refusing
from mmg.messages import Message, listed
from mmg.ship import Ship

# What a set is made of: one or several files, folders or trials.
Given: TypeAlias = "str | Path | Trial | Sequence[str | Path | Trial]"
DOUBT = "doubtful"  # Code of the notice on what mmg check doubts of a trial
JUDGED = {"judged": "yes"}  # Mark of trials that went through ``ready``
KEPT = 4  # Sets that are known in a session, which fits and judges a few again and again. Set by hand.
MOST_LISTED = 5  # Of names and pairs in one message. Set by hand: display.


@refusing
@dataclass(frozen=True, eq=False)
class TrialSet(Sequence[Trial]):
    """Trials, in their order, and what is known of them together."""

    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, given: Given) -> TrialSet:
        """The set of what is ``given``: itself, trials as they are, files and folders read. Raises UserError for what
        cannot be read."""
        if isinstance(given, TrialSet):
            return given
        # what has columns or keys is a trial, or a frame or mapping, which iterates over names
        single = hasattr(given, "columns") or hasattr(given, "keys") or not is_several(given)
        several: list[Any] = [given] if single else list(given)  # type: ignore[arg-type, list-item]
        for item in several:
            if not isinstance(item, (str, Path, Trial)):
                raise BadValue(
                    f"trials: {type(item).__name__} is none: give files, folders or Trial objects, "
                    "of a frame Trial.from_pandas"
                )
        paths = [item for item in several if not isinstance(item, Trial)]
        if paths and len(paths) == len(several):  # in one call: each file once, all that cannot be read said together
            return cls(tuple(read_trials(paths)))
        if not paths:
            return _set_of(tuple(several))
        each = ([item] if isinstance(item, Trial) else read_trials(item) for item in several)
        return cls(tuple(trial for some in each for trial in some))

    def __len__(self) -> int:
        return len(self.trials)

    @overload
    def __getitem__(self, index: int) -> Trial: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Trial, ...]: ...
    def __getitem__(self, index: int | slice) -> Trial | tuple[Trial, ...]:
        return self.trials[index]

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.trials)

    def __add__(self, others: Given) -> TrialSet:
        return TrialSet((*self.trials, *TrialSet.of(others)))

    def __repr__(self) -> str:
        seconds = sum(trial.duration for trial in self)
        names = listed([trial.name for trial in self], MOST_LISTED)
        return f"<TrialSet of {len(self)} trials, {seconds:.4g} s: {names}>"

    @cached_property
    def reports(self) -> tuple[CheckReport, ...]:
        """What mmg check says of each: units, signs, frames, lags, broken stretches, copies, excitation."""
        return tuple(check(self.trials, self._duplicates))

    @cached_property
    def _duplicates(self) -> list[Duplicates]:
        return duplicates(self.trials)

    @property
    def sharing(self) -> list[tuple[int, int]]:
        """Numbers of the pairs that share rows, in order."""
        return [(i, j) for i, (others, _) in enumerate(self._duplicates) for j in sorted(others) if i < j]

    @property
    def apart(self) -> list[tuple[int, ...]]:
        """Folds that leave out each alone, those that share rows together: numbers of trials."""
        groups = list(range(len(self)))
        for pair in self.sharing:
            both = [groups[i] for i in pair]
            groups = [min(both) if g in both else g for g in groups]  # union of the two sets, by its least number
        return [tuple(i for i, g in enumerate(groups) if g == k) for k in dict.fromkeys(groups)]

    @cached_property
    def campaigns(self) -> Groups:
        """Who belongs to which campaign. Raises UserError where sidecar, day and folder contradict each other."""
        return campaigns_of(self.trials)

    def groups(self, by: str) -> Groups:
        """The groups ``by`` day, folder, kind ... Raises UserError as ``group_trials``."""
        return group_trials(self.trials, by)

    def said_campaign(self, name: str | None, ship: Ship) -> TrialSet:
        """The trials as of the campaign ``name`` of a ``ship``, as they are for None. Raises UserError for a campaign
        that the ship does not know."""
        if name is None:
            return self
        ship_of_campaign(ship, name)
        return TrialSet(tuple(replace(trial, meta={**trial.meta, "campaign": name}) for trial in self))

    @property
    def sampled(self) -> TrialSet:
        """The trials with actuators that move along straight lines from sample to sample, whatever trials.toml says."""
        return TrialSet(tuple(replace(trial, meta={**trial.meta, "inputs": SAMPLED}) for trial in self))

    @property
    def remarks(self) -> list[Message]:
        """Messages on what was left out of the trials and what is doubtful about them, the same of several once."""
        trials_of: dict[Message, list[str]] = {}
        for trial in self:
            for note in trial.notices:
                if isinstance(note, Message) and note.code in (LEFT_OUT, DOUBT):
                    text = Message(note.removeprefix(f"{trial.name}: "), note.code)
                    trials_of.setdefault(text, []).append(trial.name)
        # names side by side where one file was read twice, too
        names = {text: listed(list(dict.fromkeys(each)), MOST_LISTED) for text, each in trials_of.items()}
        return [Message(f"{names[text]}: {text}", text.code) for text in trials_of]

    @cached_property
    def broken(self) -> tuple[Sequence[BrokenStretch], ...]:
        """The broken stretches of each; none where it was decided before what is left out."""
        return tuple([] if looked_at(trial) else broken_stretches(trial) for trial in self.trials)

    @cached_property
    def sound(self) -> TrialSet:
        """The trials without their broken stretches, each with a notice on what was left out and why."""
        return TrialSet(tuple(_without(t, found) for t, found in zip(self.trials, self.broken, strict=True)))

    @property
    def as_they_are(self) -> TrialSet:
        """The trials marked as looked at, so that nothing of them is left out later."""
        kept = (trial if looked_at(trial) else left_out(trial, [], "") for trial in self.trials)
        return TrialSet(tuple(_marked(trial) for trial in kept))

    def by_role(self, use: str) -> tuple[TrialSet, TrialSet, list[Message]]:
        """Those that may be of this ``use``, such as "trained on", those that trials.toml keeps out by their
        role test or validate, and a message on these. Raises UserError where they are all."""
        kept, out = (tuple(t for t in self if (t.role in ("test", "validate")) is held) for held in (False, True))
        messages = []
        if out:
            names = ", ".join(t.name for t in out)
            if not kept:
                line = line_for(out[0].path, out[0].name, 'role = "train"')
                words = f"none is left that may be {use}: write for those that may, {line}"
                raise Missing(f"{names}: trials.toml gives them the role test or validate; {words}")
            messages = [Message(f"not {use}, by their role in trials.toml: {names}", "role_held_out")]
        return TrialSet(kept), TrialSet(out), messages

    def moving(self, purpose: str) -> TrialSet:
        """The trials, for a ``purpose`` such as "fit". Raises UserError without any, and where no input ever changes:
        then no force of the ship is told from another."""
        if not self:
            raise Missing(f"no trials to {purpose}: name at least one trial file")
        if all(inputs_are_constant(trial) for trial in self):
            words = "the inputs n and delta never change, so that no force is told from another"
            raise TooFewData(f"{', '.join(t.name for t in self)}: {words}; give trials with manoeuvres")
        return self

    @cached_property
    def once(self) -> tuple[TrialSet, list[Message]]:
        """Each trial once, and messages on copies, which would count as if the run had been made again."""
        messages: list[Message] = []
        first_of: dict[bytes, int] = {}
        copies: dict[int, list[int]] = {}
        for i, trial in enumerate(self.trials):
            first = first_of.setdefault(_content(trial), i)
            if first != i:
                copies.setdefault(first, []).append(i)
        campaign = campaign_labels(self.trials) if copies else []
        for first, others in copies.items():
            name, its = self[first].name, campaign[first]
            names = listed([self[i].name for i in others], MOST_LISTED)
            words = f"{names}: copies of {name}, which say nothing more; left out, so that no run counts twice"
            messages.append(Message(words, "copies_left_out"))
            for i in [i for i in others if campaign[i] != its]:
                words = f"{name} of campaign {its} and {self[i].name} of campaign {campaign[i]} are the same file"
                words += f"; it counts for {its}: remove the one that is wrong"
                messages.append(Message(words, "same_file_in_two_campaigns"))
        return TrialSet(tuple(self[i] for i in first_of.values())), messages

    def training(self, judges: Sequence[Trial] = ()) -> tuple[TrialSet, list[Message]]:
        """The trials to train on, and messages on those that trials.toml keeps out by their role, on copies, and on
        what was left out of trials and ``judges``. Raises UserError when none is left."""
        kept, _, messages = self.by_role("trained on")
        once, copies = kept.once
        return once, [*TrialSet((*once, *judges)).remarks, *messages, *copies]


@lru_cache(maxsize=KEPT)
def _set_of(trials: tuple[Trial, ...]) -> TrialSet:
    return TrialSet(trials)


def ready(*sets: Given, unchecked: bool = False) -> tuple[TrialSet, ...]:
    """The ``sets`` as they may be fitted and judged: without broken stretches, doubts among their notices.

    unchecked: leave them as they are; sets that went through here before stay as well. Raises UserError where the data
    of one of them refute what its file says.
    """
    given = [TrialSet.of(some) for some in sets]
    if all(trial.meta.items() >= JUDGED.items() for some in given for trial in some):
        return tuple(given)
    if unchecked:
        return tuple(some.as_they_are for some in given)
    return _judged(tuple(given))


@lru_cache(maxsize=KEPT)
def _judged(sets: tuple[TrialSet, ...]) -> tuple[TrialSet, ...]:
    """The ``sets`` as ``ready`` gives them; the same for the same, so that what is known of them stays known."""
    every = sets[0] if len(sets) == 1 else TrialSet(tuple(trial for some in sets for trial in some))
    wrong = [report for report in every.reports if report.verdict == CONTRADICTORY]
    if wrong:
        text = next(f.text for f in wrong[0].findings if f.level == CONTRADICTORY).rstrip(".")
        names = ", ".join(report.path or report.name for report in wrong)
        advice = "correct it in trials.toml, or add --unchecked (unchecked=True)"
        raise Conflict(f"{names}: contradictory, as mmg check says ({text}); {advice}")
    rows = iter(zip(every, every.reports, strict=True))
    return tuple(TrialSet(tuple(_judged_trial(*row) for row in islice(rows, len(some)))) for some in sets)


def shared_rows(train: Sequence[Trial], held_out: Sequence[Trial]) -> list[Message]:
    """Messages on rows that two trials of ``train`` share, or one of them and one of ``held_out``."""
    trials = TrialSet((*train, *held_out))
    messages = []
    for i, other in trials.sharing:
        first, second = trials[i].name, trials[other].name
        if i < len(train) <= other:
            words = f"{second} shares rows with {first}: its score is not held out"
            messages.append(Message(words, "not_held_out"))
        elif other < len(train):
            words = f"{first} and {second} share rows, which count twice in the fit: leave one of them out"
            messages.append(Message(words, "shared_rows"))
    out: list[Message] = []
    for code in ("not_held_out", "shared_rows"):
        same = [message for message in dict.fromkeys(messages) if message.code == code]
        more = f"{len(same) - MOST_LISTED} more pairs of trials share rows (mmg check lists them)"
        out += same[:MOST_LISTED] + [Message(more, code)] * (len(same) > MOST_LISTED)
    return out


def _judged_trial(trial: Trial, report: CheckReport) -> Trial:
    """``trial`` without the broken stretches of its ``report``, with a notice on each doubt."""
    if not looked_at(trial):
        trial = _without(trial, [BrokenStretch(**row) for row in report.numbers["stretches"]["broken"]])
    doubts = [f.text for f in report.findings if f.level == DOUBTFUL and f.topic not in ("stretches", "duplicates")]
    notices = [Message(f"{trial.name}: doubtful: {text}", DOUBT) for text in doubts]
    return _marked(replace(trial, notices=(*trial.notices, *notices)))


def in_own_water(trials: Iterable[Trial], per_run: Mapping[str, Mapping[str, Any]] | None) -> list[Trial]:
    """Each of the ``trials`` through the water, where a calibration found a current of its own in it; per_run: as in
    its result.json."""
    found = []
    for trial in trials:
        own = (per_run or {}).get(trial.name, {})
        north, east = (own[s]["value"] if s in own else 0.0 for s in ("current.x", "current.y"))
        found.append(trial.through_water(north, east) if north or east else trial)
    return found


def _marked(trial: Trial) -> Trial:
    return replace(trial, meta={**trial.meta, **JUDGED})


def _without(trial: Trial, found: Sequence[BrokenStretch]) -> Trial:
    """``trial`` without the broken stretches that were ``found``, marked as looked at."""
    if looked_at(trial):
        return trial
    spans = [(s.begin_s, s.end_s) for s in found]
    why = "; ".join(dict.fromkeys(part for s in found for part in s.what.split("; ")))
    words = f"{why}; to keep all, add to {line_for(trial.path, trial.name, 'exclude = []')}"
    return left_out(trial, spans, words, [span for span, s in zip(spans, found, strict=True) if s.moved])


def _content(trial: Trial) -> bytes:
    """What is the same for two trials of the same numbers; a clock may begin anywhere."""
    digest = hashlib.sha256()
    for name, column in sorted(trial.columns.items()):
        values = column - column[0] if name == "t" else column
        digest.update(name.encode())
        # to nine digits, which a file keeps; + 0.0 makes -0.0 the same as 0.0
        digest.update(np.ascontiguousarray(np.round(values, 9) + 0.0, dtype=float).tobytes())
    return digest.digest()
