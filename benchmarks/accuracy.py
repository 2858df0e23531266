"""Errors on runs that a calibration has not seen: all records left out in five folds, and the five hold-outs.

folds: the 35 records of Train-TZRB+ in five folds each predicted by what ``mmg fit``
makes of the others: 30 s windows and 100 s restarts in units of the sigma of all records, mean of files with its
jackknife error, without and with 30 s of past; and how many of their rows the 90 % bands hold.
hold-outs: five records by the captive ship and by ships fitted on Train-TZRB and on the rest of Train-TZRB+, in units
of their own sigma. Nothing is chosen by them. Broken stretches are left out, as by ``mmg fit`` and ``mmg score``.
black-box: the windowed network of ``mmg train --model rnn-window`` on Train-TZRB, by default: its errors on the random
record of the hold-outs over those of the captive ship, of each seed and of the mean of their trajectories.

Run from the repository root: python -m benchmarks.accuracy [folds] [hold-outs] [black-box] [--record]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.record import Figure, parser_of, report, table
from cases.io import published_splits as splits
from cases.io.campaigns import group_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from cases.trial_set import TrialSet
from fitting.calibrate import FitOptions
from fitting.prediction.bands import bands_of
from fitting.prediction.predict import predict_all
from fitting.prediction.score import pooled_sigma
from fitting.result import FitResult
from mmg.ship import Ship
from mmg_ident.api import calibrate, score, train
from residual.papers.comparison import is_random
from residual.settings import BlackBoxSettings

METRICS = {"30": "30 s windows", "100": "100 s restarts"}

SHIP = "esso_osaka_3m"
PAST = 30.0
"""s before a window that a prediction may use."""
NORMAL = 1.6448536269514722
"""Half width of a 90 % interval of a normal distribution [standard deviations]."""


@dataclass(frozen=True)
class Fold:
    """One fit and what it is judged by: ground, its own name, ship, trials to fit, trials left out, sigma (6,)."""

    ground: str
    name: str
    ship: Ship
    train: Sequence[Trial]
    out: Sequence[Trial]
    sigma: np.ndarray


def trials_of(names: Sequence[str]) -> list[Trial]:
    """Records by their ``names`` without their broken stretches, as the commands take them."""
    return list(TrialSet.of(splits.find(names)).sound)


def folds_of(trials: Sequence[Trial]) -> list[list[int]]:
    """Numbers of ``trials`` in five folds that spread each day and kind; those that share rows stay together."""
    days, apart = group_trials(trials, "day"), TrialSet.of(trials).apart
    groups = [next(numbers[0] for numbers in apart if i in numbers) for i in range(len(trials))]
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
        yield Fold("records", str(k), ship, rest, [trials[i] for i in out], sigma)


def inside_bands(found: FitResult, trials: Sequence[Trial]) -> dict[str, np.ndarray]:
    """How many numbers of the ``trials`` the 90 % bands of ``found`` hold, and of how many, by length of the windows
    [s]."""
    assert found.objects is not None
    bands, rows = bands_of(found.to_dict(), found.ship), {"30": np.zeros(2), "100": np.zeros(2)}
    if bands is None:
        return rows
    for trial in trials:
        for name, stride in (("30", 15.0), ("100", 100.0)):
            made = predict_all(found.objects.after, [trial], float(name), stride, name == "100", bands=bands)
            for window in made[0][0]:
                error = window.error(trial.states)[1:]
                known = np.isfinite(error)
                rows[name] += (np.abs(error) < NORMAL * window.std[1:])[known].sum(), known.sum()
    return rows


def mean_bands(words: str, name: str, rows: Mapping[str, np.ndarray]) -> dict[str, Figure]:
    """Figures of the shares of ``inside_bands``."""
    what = f"rows inside the 90 % band, mean of the states: {words}"
    return {f"bands_{name}_{s}": Figure(f"{what}, {s} s", inside / of, "%") for s, (inside, of) in rows.items()}


def folds() -> dict[str, Figure]:
    """All records, each predicted by a calibration on the other folds."""
    errors: dict[str, list[list[float]]] = {"": [], "past_": []}
    rows: dict[str, np.ndarray] = {"30": np.zeros(2), "100": np.zeros(2)}
    for fold in records():
        found = calibrate(fold.ship, list(fold.train), (), None, FitOptions(next_trial=False))
        print(f"fold {fold.name}: {len(fold.out)} records, converged {found.converged}", flush=True)
        for mark, past in zip(errors, (None, PAST), strict=True):
            made = score(found, list(fold.out), fold.sigma, adapt=past).trials
            errors[mark] += [[r.window, r.paper] for r in made if r.windows]
        for length, counted in inside_bands(found, fold.out).items():
            rows[length] += counted
    figures = mean_bands("records left out", "records", rows)
    for mark, words in zip(errors, ("without a past", f"{PAST:g} s of past"), strict=True):
        for (metric, name), column in zip(METRICS.items(), np.array(errors[mark]).T, strict=True):
            error = float(column.std(ddof=1) / np.sqrt(len(column)))
            what = f"cross-validation over {len(column)} records, {name}, mean of files: {words}"
            figures[f"cv_{mark}{metric}"] = Figure(what, float(column.mean()), "", error)
    return figures


def hold_outs() -> dict[str, Figure]:
    """The five hold-outs, file by file, and pooled as figures."""
    held = trials_of(splits.DEVELOPMENT_HOLDOUT)
    sigma, rest = pooled_sigma(held), [n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT]
    scores = {"captive": ("captive model tests", score(SHIP, held, sigma))}
    for name, words, names in (("tzrb", "Train-TZRB", splits.TRAIN_TZRB), ("plus", "Train-TZRB+ without them", rest)):
        found = calibrate(SHIP, trials_of(names), (), None, FitOptions(next_trial=False))
        scores[name] = words, score(found, held, sigma)
        scores[f"{name}_past"] = f"{words}, {PAST:g} s of past", score(found, held, sigma, adapt=PAST)
    body = [
        [trial.name, *(f"{s.trials[i].window:.4f} / {s.trials[i].paper:.4f}" for _, s in scores.values())]
        for i, trial in enumerate(held)
    ]
    print("\n".join(table([" / ".join(METRICS.values()), *(words for words, _ in scores.values())], body)))
    return {
        f"holdout_{name}_{metric}": Figure(f"hold-outs, {METRICS[metric]}, pooled: {words}", value)
        for name, (words, found) in scores.items()
        for metric, value in zip(METRICS, (found.window, found.paper), strict=True)
    }


def black_box() -> dict[str, Figure]:
    """The windowed network on the random record of the hold-outs, over the captive ship."""
    held = trials_of(splits.DEVELOPMENT_HOLDOUT)
    sigma, place = pooled_sigma(held), next(i for i, t in enumerate(held) if is_random(t))
    box = train(SHIP, trials_of(splits.TRAIN_TZRB), settings=BlackBoxSettings(kind="rnn-window", seeds=3)).black_box
    assert box is not None
    models: list[Any] = [SHIP, box, *(replace(box, systems=(one,)) for one in box.systems)]
    rows = [score(model, held, sigma).trials[place] for model in models]
    figures = {}
    for key, name in METRICS.items():
        captive, mean, *each = (row.window if key == "30" else row.paper for row in rows)
        what = f"windowed network on Train-TZRB over the captive ship, random hold-out, {name}"
        seeds = np.array(each) / captive
        error = float(seeds.std(ddof=1) / np.sqrt(len(seeds)))
        figures[f"box_seeds_{key}"] = Figure(f"{what}: a seed alone", float(seeds.mean()), "", error)
        figures[f"box_mean_{key}"] = Figure(f"{what}: mean of {len(each)} seeds", mean / captive)
    return figures


def main() -> None:
    """Measure, print and, if asked, record."""
    parts = {"folds": folds, "hold-outs": hold_outs, "black-box": black_box}
    parser = parser_of("accuracy", __doc__)
    parser.add_argument("parts", nargs="*", default=list(parts), help="folds, hold-outs, black-box; default all")
    given = parser.parse_args()
    for part in given.parts:
        report(parts[part](), f"accuracy {part}", given.record)


if __name__ == "__main__":
    main()
