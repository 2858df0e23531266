"""Records left out of a calibration: the folds, and how much of what is left out the bands hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cases.io import published_splits as splits
from cases.io.groups import group_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from cases.trial_set import TrialSet
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import predict_all
from fitting.prediction.score import pooled_sigma
from fitting.result import FitResult
from mmg.ship import Ship

SHIP = "esso_osaka_3m"
PAST = 30.0
"""s before a window that a prediction may use."""
NORMAL = 1.6448536269514722
"""Half width of a 90 % interval of a normal distribution [standard deviations]."""


@dataclass(frozen=True)
class Fold:
    """One fit and what it is judged by: ground, its own name, ship, trials to fit, trials left out, sigma (6,); truth:
    true coefficients by symbol, where they are known."""

    ground: str
    name: str
    ship: Ship
    train: Sequence[Trial]
    out: Sequence[Trial]
    sigma: np.ndarray
    truth: dict[str, float]


def trials_of(names: Sequence[str]) -> list[Trial]:
    """Records by their ``names`` without their broken stretches, as the commands take them."""
    return list(TrialSet.of(splits.find(names)).sound)


def folds_of(trials: Sequence[Trial]) -> list[list[int]]:
    """Numbers of ``trials`` in five folds that spread each day and kind; those that share rows stay together."""
    days, groups = group_trials(trials, "day"), list(range(len(trials)))
    position = {t.name: i for i, t in enumerate(trials)}
    for i, copies in enumerate(TrialSet.of(trials).copies):
        for copy in copies:
            pair = (groups[i], groups[position[copy["other"]]])
            groups = [min(pair) if g in pair else g for g in groups]
    labels = [f"{days.names[k]} {t.kind}" for t, k in zip(trials, days.number, strict=True)]
    heads = sorted(set(groups), key=lambda i: (labels[i], i))
    fold = {group: k % 5 for k, group in enumerate(heads)}
    return [[i for i, g in enumerate(groups) if fold[g] == k] for k in range(5)]


def records() -> Iterator[Fold]:
    """The records of Train-TZRB+ in five folds; those that share rows stay together."""
    trials = trials_of(splits.TRAIN_TZRB_PLUS)
    sigma, ship = pooled_sigma(trials), load_ship(SHIP)
    for k, out in enumerate(folds_of(trials)):
        rest = [t for i, t in enumerate(trials) if i not in out]
        yield Fold("records", str(k), ship, rest, [trials[i] for i in out], sigma, {})


def inside_bands(found: FitResult, fold: Fold, part: dict[str, Any]) -> dict[str, list[int]]:
    """How many numbers of the runs left out of ``fold`` the 90 % bands hold, of how many, by length of the windows
    and kind of manoeuvre. part: what becomes of a part of the bands."""
    assert found.objects is not None
    bands, counted = bands_of(found.to_dict(), found.ship), dict[str, list[int]]()
    if bands is None:
        return counted
    if "factor" in part:
        one = np.ones_like(bands.process.factor)
        bands = replace(bands, process=replace(bands.process, factor=one, adapted=one))
    if "held" in part:
        bands = replace(bands, held=None)
    if "root" in part:
        bands = replace(bands, root=bands.root[:, :0])
    for trial in fold.out:
        for length, stride in ((30.0, 15.0), (100.0, 100.0)):
            made = predict_all(found.objects.after, [trial], length, stride, length > 50, bands=bands)
            rows = counted.setdefault(f"{length:g} s {trial.kind}", [0, 0])
            for window in made[0][0]:
                error = window.error(trial.states)[1:]
                known = np.isfinite(error)
                rows[0] += int((np.abs(error) < NORMAL * window.std[1:])[known].sum())
                rows[1] += int(known.sum())
    return counted
