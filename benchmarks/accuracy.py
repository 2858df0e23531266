"""Errors on runs that a calibration has not seen: all records left out in five folds, and the five hold-outs.

folds: the 35 records of Train-TZRB+ in five folds (``benchmarks/left_out.py``), each predicted by what ``mmg fit``
makes of the others: 30 s windows and 100 s restarts in units of the sigma of all records, mean of files with its
jackknife error, without and with 30 s of past; and how many of their rows the 90 % bands hold.
hold-outs: five records by the captive ship and by ships fitted on Train-TZRB and on the rest of Train-TZRB+, in units
of their own sigma. Nothing is chosen by them. Broken stretches are left out, as by ``mmg fit`` and ``mmg score``.

Run from the repository root: python -m benchmarks.accuracy [folds] [hold-outs] [--record]
"""

from __future__ import annotations

import numpy as np

from benchmarks.left_out import PAST, SHIP, inside_bands, records, trials_of
from benchmarks.record import Figure, keep, parser_of, table
from cases.io import published_splits as splits
from fitting.calibrate import FitOptions
from fitting.prediction.score import pooled_sigma
from mmg_ident.api import calibrate, score

METRICS = {"30": "30 s windows", "100": "100 s restarts"}


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
        for words, counted in inside_bands(found, fold, {}).items():
            rows[words.split()[0]] += counted
    figures = {}
    for mark, words in zip(errors, ("without a past", f"{PAST:g} s of past"), strict=True):
        for (metric, name), column in zip(METRICS.items(), np.array(errors[mark]).T, strict=True):
            error = float(column.std(ddof=1) / np.sqrt(len(column)))
            what = f"cross-validation over {len(column)} records, {name}, mean of files: {words}"
            figures[f"cv_{mark}{metric}"] = Figure(what, float(column.mean()), "", error)
    for length, (inside, count) in rows.items():
        what = f"rows inside the 90 % band, mean of the states: records left out, {length} s"
        figures[f"bands_records_{length}"] = Figure(what, inside / count, "%")
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


def main() -> None:
    """Measure, print and, if asked, record."""
    parts = {"folds": folds, "hold-outs": hold_outs}
    parser = parser_of("accuracy", __doc__)
    parser.add_argument("parts", nargs="*", default=list(parts), help="folds, hold-outs; default both")
    given = parser.parse_args()
    for part in given.parts:
        made = parts[part]()
        print("\n".join(f"{f.what}: {f.value:.4f}" + (f" ± {f.error:.4f}" if f.error else "") for f in made.values()))
        if given.record:
            keep(made, f"python -m benchmarks.accuracy {part}")


if __name__ == "__main__":
    main()
