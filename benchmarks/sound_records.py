"""Records of the published splits as the commands take them: without their broken stretches."""

from __future__ import annotations

from collections.abc import Iterable

from cases import published_splits as splits
from cases.checks.trusted import as_they_are, without_broken
from cases.io.read import read_trials
from cases.trial import Trial


def trials_of(names: Iterable[str], unchecked: bool = False) -> list[Trial]:
    """Records by their ``names`` without their broken stretches, or with them if ``unchecked``."""
    found = read_trials(splits.find(names))
    return as_they_are(found) if unchecked else without_broken(found)
