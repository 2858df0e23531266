"""Runs left out of a calibration, refitted in full: mean of files by kind of manoeuvre, with jackknife errors.

All 35 records of Train-TZRB+ in folds that spread each day and kind (``--folds 5``), or whole days and kinds left out
(``--folds day-kind``); records that share rows stay together. Each fold is what ``mmg fit`` does by default, or with
the options named, on the other records; its ship predicts the records left out, 30 s windows and 100 s restarts, in
units of the sigma of all records, without and with 30 s of past. Variants are compared with the first one, file by
file. Broken stretches (``mmg check``: frozen or jumping columns, a ship moved by hand while her propeller rests) are
left out of what is fitted and what is scored, as by ``mmg fit`` and ``mmg score``; ``--unchecked`` leaves none out.
This is a measure and trains nothing that is judged on the five hold-outs; ``--without-hold-outs`` leaves them out
altogether, which choices of method must do; ``--hold-outs`` scores them once by ships fitted on Train-TZRB and on the
rest of Train-TZRB+, with the sigma of Train-TZRB.

Run from the repository root: python -m benchmarks.cross_validation [VARIANT ...], VARIANT being "default" or options as
"loss=student,window=50,estimator=windows,measurement=velocity_filter+gyro,campaigns=none". rows=all fits broken
stretches too, but scores as the others do; runs=train-tzrb fits those of Train-TZRB alone. Finished folds are kept in
--rows and not made again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import record, table
from benchmarks.sound_records import trials_of
from cases import published_splits as splits
from cases.checks.trusted import as_they_are
from cases.io.groups import group_trials
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from fitting.pipeline import FitOptions
from fitting.prediction.score import pooled_sigma, score
from fitting.selection.left_out_runs import METRICS, Jackknifed, RunScores, folds_by, sharing_rows
from fitting.settings import Settings
from mmg_ident.api import calibrate

ROWS = Path(tempfile.gettempdir()) / "mmg_cross_validation.jsonl"
LABELS = {"window": "30 s windows", "paper": "100 s restarts"}
SETTINGS = {"loss": str, "weight": float, "window": float, "step": float, "horizon": float, "passes": int}
"""Options of a variant that are settings of the calibration; OTHERS are the others."""
OTHERS = ("estimator", "rows", "runs", "measurement", "campaigns")
PAST = 30.0
"""s before a window that a prediction may use."""
WITH_PAST = ", past"
"""Ending of the names of scores with that past."""


def options_of(variant: str) -> dict[str, Any]:
    """Options named by a ``variant``. Raises SystemExit for one that is not known."""
    found: dict[str, Any] = {}
    for word in [] if variant == "default" else variant.split(","):
        key, _, value = word.partition("=")
        if key in ("estimator", "rows", "runs"):
            found[key] = value
        elif key == "measurement":
            found[key] = tuple(v for v in value.split("+") if v != "none")
        elif key == "campaigns":
            found[key] = tuple(value.split("+"))
        elif key in SETTINGS and hasattr(Settings(), key):
            found[key] = SETTINGS[key](value)
        else:
            raise SystemExit(f"{variant}: {key!r} is none of {', '.join([*SETTINGS, *OTHERS])}")
    return found


def grouped(trials: Sequence[Trial]) -> tuple[list[str], list[int]]:
    """Day and kind of each of ``trials``, and a number that those share which hold the same rows."""
    days = group_trials(trials, "day")
    labels = [f"{days.names[k]} {t.kind}" for t, k in zip(trials, days.number, strict=True)]
    return labels, sharing_rows(trials)


def fold_score(variant: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict[str, Any]:
    """Scores of the trials ``out`` by a ship fitted on ``train`` with the options of a ``variant``; sigma (6,)."""
    began, chosen = time.perf_counter(), options_of(variant)
    if chosen.pop("runs", "every") == "train-tzrb":
        train = [t for t in train if t.name in splits.TRAIN_TZRB]
    if chosen.pop("rows", "sound") == "all":
        train = as_they_are(read_trials([Path(t.path) for t in train]))
    options = FitOptions(next_trial=False, estimator=chosen.pop("estimator", "both"))
    if "measurement" in chosen:
        options = replace(options, instruments=chosen.pop("measurement"))
    if "campaigns" in chosen:
        options = replace(options, per_campaign=chosen.pop("campaigns"))
    found = calibrate(load_ship("esso_osaka_3m"), train, (), Settings(**chosen), options)
    assert found.objects is not None
    seconds = time.perf_counter() - began
    files = {}
    for past in (None, PAST):
        rows = score(found.objects.after, out, sigma, adapt=past).trials
        files["files" + (WITH_PAST if past else "")] = {r.name: [r.window, r.paper, r.windows] for r in rows}
    return {"converged": found.converged, "seconds": seconds, **files}


class Rows:
    """Results kept in a file of lines, by a key of what made them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.known = {row["key"]: row for row in map(json.loads, lines)}

    def made(self, key: str, variant: str, train: Sequence[Trial], out: Sequence[Trial], sigma: np.ndarray) -> dict:
        """The row of ``fold_score``, made now unless it is known."""
        names = json.dumps([key, variant, [t.sha256 for t in train], [t.sha256 for t in out]])
        mark = hashlib.sha256(names.encode()).hexdigest()[:16]
        if mark not in self.known:
            row = {"key": mark, "variant": variant, **fold_score(variant, train, out, sigma)}
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            self.known[mark] = row
            mean = np.nanmean([w for w, _, n in row["files"].values() if n])
            print(
                f"{variant}: {len(out)} of {len(out) + len(train)} files, {mean:.4f}, {row['seconds']:.0f} s",
                flush=True,
            )
        return self.known[mark]


def cross_validated(
    rows: Rows, mark: str, variant: str, trials: Sequence[Trial], folds: Sequence[Sequence[int]], ending: str = ""
) -> tuple[RunScores, float, bool]:
    """Scores of all ``trials`` by ships that did not see them, mean seconds of a fit, whether all fits converged; with
    the past of a window where the ``ending`` says so."""
    sigma, found, seconds, converged = pooled_sigma(trials), {}, [], True
    for out in folds:
        rest = [t for i, t in enumerate(trials) if i not in out]
        row = rows.made(mark, variant, rest, [trials[i] for i in out], sigma)
        found |= row["files" + ending]
        seconds.append(row["seconds"])
        converged &= row["converged"]
    window, paper, count = np.array([found[t.name] for t in trials]).T
    bare = [np.where(count > 0, v, np.nan) for v in (window, paper)]
    scores = RunScores(tuple(t.name for t in trials), tuple(t.kind for t in trials), *bare, count, sigma)
    return scores, float(np.mean(seconds)), converged


def lines_of(scores: dict[str, RunScores]) -> list[str]:
    """Tables of both metrics by kind and variant, changes against the first variant."""
    first, lines = next(iter(scores.values())), []
    kinds = list(dict.fromkeys(first.kinds))
    for metric in METRICS:
        body = []
        for kind in (*kinds, None):
            count = int(np.isfinite(first.of(metric, kind)).sum())
            cells = [_cell(s.mean(metric, kind), first.change(s, metric, kind), s is first) for s in scores.values()]
            body.append([f"{kind or 'all'} ({count})", *cells])
        lines += [f"{LABELS[metric]}:", "", *table(["kind (files)", *scores], body), ""]
    return lines


def _cell(mean: Jackknifed, change: Jackknifed, first: bool) -> str:
    words = f"{mean.value:.4f} ± {mean.error:.4f}"
    return words if first else f"{words} ({100 * change.value:+.1f} ± {100 * change.error:.1f} %)"


def scores_of_folds(
    variants: Sequence[str], made: Callable[[str, Sequence[Trial], Sequence[Trial], np.ndarray], dict], ending: str
) -> tuple[dict[str, RunScores], list[dict]]:
    """Scores by variant of all records of Train-TZRB+, left out in five folds, and the rows that hold them.

    made: from the name of a fold, trials to fit, trials left out and sigma (6,) a row whose "files" has the scores of
    each of the ``variants`` with an ``ending`` to its name.
    """
    trials = trials_of(splits.TRAIN_TZRB_PLUS)
    labels, groups = grouped(trials)
    sigma, rows = pooled_sigma(trials), []
    for k, out in enumerate(folds_by(labels, groups, 5)):
        rest = [t for i, t in enumerate(trials) if i not in out]
        rows.append(made(f"fold {k}", rest, [trials[i] for i in out], sigma))
    names, kinds = tuple(t.name for t in trials), tuple(t.kind for t in trials)
    scores = {}
    for variant in variants:
        files = {name: found for row in rows for name, found in row["files"][variant + ending].items()}
        window, paper, count = np.array([files[name] for name in names]).T
        window, paper = (np.where(count > 0, v, np.nan) for v in (window, paper))
        scores[variant] = RunScores(names, kinds, window, paper, count, sigma)
    return scores, rows


def hold_out_lines(rows: Rows, mark: str, variants: Sequence[str], unchecked: bool) -> list[str]:
    """Tables of the five hold-outs by ships fitted on Train-TZRB and on the rest of Train-TZRB+."""
    held, small = (trials_of(names, unchecked) for names in (splits.DEVELOPMENT_HOLDOUT, splits.TRAIN_TZRB))
    large = trials_of([n for n in splits.TRAIN_TZRB_PLUS if n not in splits.DEVELOPMENT_HOLDOUT], unchecked)
    columns: dict[str, dict] = {}
    for variant in variants:
        for words, train in (("Train-TZRB", small), ("Train-TZRB+ without them", large)):
            row = rows.made(mark, variant, train, held, pooled_sigma(small))
            for ending in ("", WITH_PAST):
                columns[f"{words}, {variant}{ending}"] = row["files" + ending]
    body = [[t.name, *(f"{c[t.name][0]:.4f} / {c[t.name][1]:.4f}" for c in columns.values())] for t in held]
    means = [np.mean([v[:2] for v in c.values()], axis=0) for c in columns.values()]
    body.append(["mean of files", *(f"{a:.4f} / {b:.4f}" for a, b in means)])
    return [
        "30 s windows / 100 s restarts, in units of the sigma of Train-TZRB:",
        "",
        *table(["hold-out", *columns], body),
    ]


def fold_lines(rows: Rows, mark: str, variants: Sequence[str], trials: Sequence[Trial], how: str) -> list[str]:
    """Tables of all ``trials`` left out in folds; how: number of folds, or day-kind."""
    labels, groups = grouped(trials)
    if how == "day-kind":
        folds = [tuple(i for i, k in enumerate(labels) if k == label) for label in dict.fromkeys(labels)]
    else:
        folds = folds_by(labels, groups, int(how))
    lines, remarks = [], []
    for ending in ("", WITH_PAST):
        found, remarks = {}, []
        for variant in variants:
            found[variant], seconds, converged = cross_validated(rows, mark, variant, trials, folds, ending)
            remarks.append(f"{variant}: {seconds:.0f} s a fit, {'all' if converged else 'NOT all'} converged")
        lines += [f"With {PAST:g} s of past:" if ending else "Without a past:", "", *lines_of(found)]
    head = f"{len(trials)} records in {len(folds)} folds, refitted in full; mean of files ± jackknife error over "
    head += f"files; in brackets the change against the first variant and its error. {'; '.join(remarks)}."
    return [head, "", *lines]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cross_validation", description=__doc__)
    parser.add_argument("variants", nargs="*", default=["default"])
    parser.add_argument("--folds", default="5", help="number of folds, or day-kind: each of them left out as a whole")
    parser.add_argument("--without-hold-outs", action="store_true")
    parser.add_argument("--hold-outs", action="store_true", help="score the five hold-outs instead")
    parser.add_argument("--unchecked", action="store_true", help="fit and score broken stretches too")
    parser.add_argument("--rows", type=Path, default=ROWS, help="file of finished folds")
    parser.add_argument("--mark", default="", help="word kept with the rows: others are made for another one")
    parser.add_argument("--title", help="record the tables in RESULTS.md under this title")
    given = parser.parse_args()
    for variant in given.variants:
        options_of(variant)
    rows, mark = Rows(given.rows), given.mark + ("unchecked" if given.unchecked else "checked")
    options = ["--unchecked"] * given.unchecked
    if given.hold_outs:
        options += ["--hold-outs"]
        lines = hold_out_lines(rows, mark, given.variants, given.unchecked)
    else:
        options += [f"--folds {given.folds}", *["--without-hold-outs"] * given.without_hold_outs]
        names = [n for n in splits.TRAIN_TZRB_PLUS if not (given.without_hold_outs and n in splits.DEVELOPMENT_HOLDOUT)]
        lines = fold_lines(rows, mark, given.variants, trials_of(names, given.unchecked), given.folds)
    command = " ".join(["python -m benchmarks.cross_validation", *given.variants, *options])
    if given.title:
        record(given.title, command, lines)
    else:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
